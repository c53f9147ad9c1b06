"""Contacts between particles and tools: the lists of particles near each tool, and the forces on both."""

from __future__ import annotations

from ..slave.kernel import kernel
from .law import HALF, PULL, RETURNED, respond
from .particles import FREE, SIDE, SLABS, V_X, V_Y, V_Z, W_X, W_Y, W_Z, M, N, R, X, Y, Z
from .shape import acting, shape_torque
from .tools import (
    AROUND,
    B_W,
    CONTACTS,
    DAMPER,
    DEEPEST,
    FELT,
    FORCE,
    H_G,
    KEPT,
    MESH,
    MIDDLE,
    N_G,
    NORMAL,
    PLANE,
    POSITION,
    R_W,
    ROLLED,
    ROTATION,
    SLID,
    SPIN,
    T_G,
    TENSOR,
    TORQUE,
    VELOCITY,
    surface_speed,
)
from .touch import DISTANCE, MOST
from .touch import NORMAL as ACROSS
from .touch_mesh import mesh_touches
from .touch_wheel import wheel_touches

_SAME = 0.7  # own choice: cosine between the normals of one contact in two substeps, at least
# Own choice: share of its overlap that counts of a contact that goes on, where a tool is looked for that cannot have come where it is.
# Chains of force press single fine particles in by half their radius.
_PRESSED = 0.3


@kernel
def rows_of(tools, meshes, t, x, y, z, reach, stack, rows):
    """Where a sphere of radius ``reach`` [m] about a point of the world touches tool t: the number of rows, in the tool's own frame."""
    if tools.present[t] == 0:
        return 0
    pose, shape = tools.poses[t], tools.shapes[t]
    x, y, z = x - pose[POSITION], y - pose[POSITION + 1], z - pose[POSITION + 2]
    if tools.kinds[t] == PLANE:
        rows[0, DISTANCE] = pose[ROTATION + 6] * x + pose[ROTATION + 7] * y + pose[ROTATION + 8] * z
        rows[0, ACROSS], rows[0, ACROSS + 1], rows[0, ACROSS + 2] = 0.0, 0.0, 1.0
        return 1 if rows[0, DISTANCE] < reach else 0
    if x * x + y * y + z * z > (shape[AROUND] + reach) ** 2:
        return 0
    l_x = pose[ROTATION] * x + pose[ROTATION + 1] * y + pose[ROTATION + 2] * z
    l_y = pose[ROTATION + 3] * x + pose[ROTATION + 4] * y + pose[ROTATION + 5] * z
    l_z = pose[ROTATION + 6] * x + pose[ROTATION + 7] * y + pose[ROTATION + 8] * z
    if tools.kinds[t] == MESH:
        return mesh_touches(meshes, tools.roots[t], l_x, l_y, l_z, reach, stack, rows)
    return wheel_touches(l_x, l_y, l_z, reach, shape[R_W], shape[B_W], shape[N_G], shape[H_G], shape[T_G], rows)


@kernel
def list_touches(grains, tools, meshes, horizon):
    """List the particles near each tool, in their new order, with the history of those known before; False if there is no room."""
    count = grains.count
    old = count[SIDE]
    n, new = count[N], 1 - old
    body, slots, first = grains.body[new], tools.slots, tools.first[new]
    k = first[0] = 0
    for i in range(n):
        slots[i] = -1
    for t in range(len(tools.kinds)):
        before, after = tools.first[old, t], tools.first[old, t + 1]
        for known in range(before, after):
            slots[tools.particle[old, known]] = known
        tools.margins[t, 0] = 1.2 * surface_speed(tools, t) * horizon + 1e-5  # own choice; 10 um: a tool that begins to move
        tools.margins[t, 1] = 0.0
        slab = 0
        for i in range(n):
            while i == grains.slabs[slab]:
                tools.slabs[t, slab] = k
                slab += 1
            if body[i, FREE] == 0.0:
                continue
            reach = grains.built[i, 3] + tools.margins[t, 0]
            if rows_of(tools, meshes, t, body[i, X], body[i, Y], body[i, Z], reach, tools.stack[0], tools.rows[0]) == 0:
                continue
            if k == tools.particle.shape[1]:
                return False
            tools.particle[new, k] = i
            known = slots[grains.order[i]]
            for m in range(MOST):
                for c in range(KEPT):
                    tools.kept[new, k, m, c] = tools.kept[old, known, m, c] if known >= 0 else 0.0
            k += 1
        first[t + 1] = k
        for later in range(slab, count[SLABS] + 1):
            tools.slabs[t, later] = k
        for known in range(before, after):
            slots[tools.particle[old, known]] = -1
    return True


@kernel
def touch_forces(grains, tools, meshes, slab):
    """Add the forces of tools to the particles of a slab, and to what the tools feel."""
    for t in range(len(tools.kinds)):
        if tools.slabs[t, slab + 1] > tools.slabs[t, slab]:
            _touch_forces(grains, tools, meshes, t, slab)


@kernel
def _is_row(kept, m):
    """Whether row m of a touch is in use: it has a normal."""
    return kept[m, NORMAL] != 0.0 or kept[m, NORMAL + 1] != 0.0 or kept[m, NORMAL + 2] != 0.0


@kernel
def _touch_forces(grains, tools, meshes, t, slab):
    side = grains.count[SIDE]
    body, force, particle, kept = grains.body[side], grains.force, tools.particle[side], tools.kept[side]
    pose, law, felt = tools.poses[t], tools.laws[t], tools.felt[t, slab]
    rows, before = tools.rows[slab], tools.rows[slab, MOST:]
    orientation = grains.orientation[side]
    shaped = len(orientation) > 0
    for k in range(tools.slabs[t, slab], tools.slabs[t, slab + 1]):
        i = particle[k]
        x, y, z, r = body[i, X], body[i, Y], body[i, Z], body[i, R]
        found = rows_of(tools, meshes, t, x, y, z, r, tools.stack[slab], rows)
        if found == 0 and not _is_row(kept[k], 0):
            continue
        known = used = 0  # rows of the last substep, and of this one
        while known < MOST and _is_row(kept[k], known):
            for c in range(KEPT):
                before[known, c] = kept[k, known, c]
            known += 1
        for m in range(found):
            distance, l_x, l_y, l_z = rows[m, DISTANCE], rows[m, ACROSS], rows[m, ACROSS + 1], rows[m, ACROSS + 2]
            if distance >= r:
                continue
            n_x = pose[ROTATION] * l_x + pose[ROTATION + 3] * l_y + pose[ROTATION + 6] * l_z
            n_y = pose[ROTATION + 1] * l_x + pose[ROTATION + 4] * l_y + pose[ROTATION + 7] * l_z
            n_z = pose[ROTATION + 2] * l_x + pose[ROTATION + 5] * l_y + pose[ROTATION + 8] * l_z
            # The contact of the last substep with the nearest normal is this one.
            same, cosine = -1, _SAME
            for q in range(known):
                c = before[q, NORMAL] * n_x + before[q, NORMAL + 1] * n_y + before[q, NORMAL + 2] * n_z
                if c > cosine:
                    same, cosine = q, c
            shear = roll = (0.0, 0.0, 0.0)
            if same >= 0:
                shear = (before[same, SLID], before[same, SLID + 1], before[same, SLID + 2])
                roll = (before[same, ROLLED], before[same, ROLLED + 1], before[same, ROLLED + 2])
                for c in range(3):
                    before[same, NORMAL + c] = 0.0  # of one contact only
            p_x, p_y, p_z = x - n_x * distance, y - n_y * distance, z - n_z * distance
            a_x, a_y, a_z = p_x - pose[POSITION], p_y - pose[POSITION + 1], p_z - pose[POSITION + 2]
            w_x, w_y, w_z = pose[SPIN], pose[SPIN + 1], pose[SPIN + 2]
            u_x = body[i, V_X] - pose[VELOCITY] - (w_y * a_z - w_z * a_y)
            u_y = body[i, V_Y] - pose[VELOCITY + 1] - (w_z * a_x - w_x * a_z)
            u_z = body[i, V_Z] - pose[VELOCITY + 2] - (w_x * a_y - w_y * a_x)
            u_n = u_x * n_x + u_y * n_y + u_z * n_z
            b_x, b_y, b_z = body[i, W_X], body[i, W_Y], body[i, W_Z]
            u_t = (
                u_x - u_n * n_x - distance * (b_y * n_z - b_z * n_y),
                u_y - u_n * n_y - distance * (b_z * n_x - b_x * n_z),
                u_z - u_n * n_z - distance * (b_x * n_y - b_y * n_x),
            )
            w = b_x - w_x, b_y - w_y, b_z - w_z
            f_n, f_t, (q_x, q_y, q_z), shear, roll, s_n, damping = respond(
                law, r - distance, True, r, body[i, M], (n_x, n_y, n_z), u_n, u_t, w, shear, roll
            )
            moment = r * (f_n + law[PULL] * r * r)  # a pull has no lever
            if shaped and moment > 0.0:
                turned = orientation[i, 0], orientation[i, 1], orientation[i, 2], orientation[i, 3]
                s_x, s_y, s_z = acting(shape_torque(grains.figure, turned, (n_x, n_y, n_z)), w, law[RETURNED])
                q_x, q_y, q_z = q_x + moment * s_x, q_y + moment * s_y, q_z + moment * s_z
            kept[k, used, NORMAL], kept[k, used, NORMAL + 1], kept[k, used, NORMAL + 2] = n_x, n_y, n_z
            kept[k, used, SLID], kept[k, used, SLID + 1], kept[k, used, SLID + 2] = shear
            kept[k, used, ROLLED], kept[k, used, ROLLED + 1], kept[k, used, ROLLED + 2] = roll
            used += 1
            t_x, t_y, t_z = f_t
            f_x, f_y, f_z = f_n * n_x + t_x, f_n * n_y + t_y, f_n * n_z + t_z
            force[i, 0] += f_x
            force[i, 1] += f_y
            force[i, 2] += f_z
            force[i, 3] += distance * (t_y * n_z - t_z * n_y) + q_x
            force[i, 4] += distance * (t_z * n_x - t_x * n_z) + q_y
            force[i, 5] += distance * (t_x * n_y - t_y * n_x) + q_z
            felt[FORCE] -= f_x
            felt[FORCE + 1] -= f_y
            felt[FORCE + 2] -= f_z
            felt[TORQUE] -= a_y * f_z - a_z * f_y + q_x
            felt[TORQUE + 1] -= a_z * f_x - a_x * f_z + q_y
            felt[TORQUE + 2] -= a_x * f_y - a_y * f_x + q_z
            s_n, damping = law[HALF] * s_n, law[HALF] * damping  # own choice: it rests on others that give way as much
            add_stiffness(felt, TENSOR, s_n, n_x, n_y, n_z)
            add_stiffness(felt, DAMPER, damping, n_x, n_y, n_z)
            felt[MIDDLE] += s_n * p_x
            felt[MIDDLE + 1] += s_n * p_y
            felt[MIDDLE + 2] += s_n * p_z
            felt[CONTACTS] += 1.0
            felt[DEEPEST] = max(felt[DEEPEST], (1.0 - distance / r) * (1.0 if known == 0 else _PRESSED))
        for m in range(used, known):
            for c in range(KEPT):
                kept[k, m, c] = 0.0


@kernel
def add_stiffness(felt, at, s, n_x, n_y, n_z):
    """Add s n n' to the symmetric tensor at this place."""
    felt[at] += s * n_x * n_x
    felt[at + 1] += s * n_x * n_y
    felt[at + 2] += s * n_x * n_z
    felt[at + 3] += s * n_y * n_y
    felt[at + 4] += s * n_y * n_z
    felt[at + 5] += s * n_z * n_z


@kernel
def gather_felt(tools, t, n_slabs, share):
    """Add this share of what tool t felt in a substep in each of the slabs to its sums, and clear them."""
    for slab in range(n_slabs):
        if tools.slabs[t, slab + 1] > tools.slabs[t, slab]:
            felt = tools.felt[t, slab]
            tools.sums[t, DEEPEST] = max(tools.sums[t, DEEPEST], felt[DEEPEST])
            for c in range(DEEPEST):
                tools.sums[t, c] += share * felt[c]
            for c in range(FELT):
                felt[c] = 0.0
