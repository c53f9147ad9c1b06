"""The DEM step: tools go to their new poses in substeps, and tell what they felt."""

from __future__ import annotations

import math

from ..contact import NO_DATA, PATIENCE, SLIP_FLOOR, anchor_here, has_pose, is_set, lowest_point, refusal, sees, show
from ..frames import dot
from ..mesh.surface import Meshes
from ..slave.kernel import kernel
from ..slave.model import STATUS_SPAN
from ..terramechanics import slip_ratio
from .advance import advance, advance_in_parallel
from .law import STEP
from .particles import SIDE, STALE, Particles, X, Y, Z
from .pool import TIME
from .tools import DAMPER, DEEPEST, FORCE, MIDDLE, NORMAL, POSITION, ROTATION, TENSOR, TORQUE, VELOCITY, Tools

#: Status numbers beside those of wheels.
FULL, TOO_DEEP, BODY_NO_DATA, BODY_STILL_NO_DATA, BODY_TOO_DEEP, NO_MESH = 5, 6, 7, 8, 9, 10
#: Overlap of a particle with a tool, in its radius, with which no contact begins of a tool that came there by itself. Own choice.
DEEP = 0.3

#: Arrays of the pool: where those of tools and of meshes begin, and what follows: law, longest substep and gravity, patches.
_TOOLS = len(Particles._fields)
_MESHES = _TOOLS + len(Tools._fields)
_LAW = _MESHES + len(Meshes._fields)
_SETTINGS, _PATCHES = _LAW + 1, _LAW + 2

#: What the kernels get: arrays of any length, so that one step serves models of all sizes.
ARGUMENTS = (
    *("p", "u.wheel", "u.trailing", "u.body", "x.wheel", "x.body"),
    *("y.wheel", "y.contact", "y.diagnostics", "y.patch", "y.body", "y.support"),
)


@kernel
def initialise(t, P, wheels, bodies, wrenches, contacts, diagnostics, patches, answers, supports, arrays):
    for i in range(len(wheels)):
        wheels[i].silent = 0.0
    for i in range(len(bodies)):
        bodies[i].silent = 0.0


@kernel
def _send(count, tools, t, tool, is_there):
    """Tell tool t where to go; one that has just come is there at once."""
    goal, pose = tools.goals[t], tools.poses[t]
    if is_there:
        for k in range(3):
            goal[POSITION + k] = tool.r_0[k]
            for j in range(3):
                goal[ROTATION + 3 * k + j] = tool.T[k, j]
        if tools.present[t] == 0:
            for k in range(VELOCITY):
                pose[k] = goal[k]
            count[STALE] = 1  # what it touches is to be listed
    tools.present[t] = 1 if is_there else 0


@kernel
def _along(tensor, first, a_x, a_y, a_z):
    """A symmetric tensor along an axis."""
    return (
        tensor[first] * a_x * a_x
        + tensor[first + 3] * a_y * a_y
        + tensor[first + 5] * a_z * a_z
        + 2.0 * (tensor[first + 1] * a_x * a_y + tensor[first + 2] * a_x * a_z + tensor[first + 4] * a_y * a_z)
    )


@kernel
def _middle(felt, k, otherwise):
    """Where along axis k the tool's contacts are stiffest, or another place if there is none."""
    trace = felt[TENSOR] + felt[TENSOR + 3] + felt[TENSOR + 5]
    return felt[MIDDLE + k] / trace if trace > 0.0 else otherwise


@kernel
def _answer(p, wheel, felt, wrench, contact):
    """Wrench and interface Jacobian of a wheel."""
    level = math.hypot(wheel.T[1, 0], wheel.T[1, 1])
    l_x, l_y = wheel.T[1, 0] / level, wheel.T[1, 1] / level
    weight = wheel.active
    for k in range(3):
        wrench.f_0[k], wrench.t_0[k] = weight * felt[FORCE + k], weight * felt[TORQUE + k]
        contact.point_0[k] = _middle(felt, k, wheel.r_0[k] - (p.r_w if k == 2 else 0.0))
    for k in range(3):
        a_x, a_y, a_z = (l_y, -l_x, 0.0) if k == 0 else ((l_x, l_y, 0.0) if k == 1 else (0.0, 0.0, 1.0))
        contact.axes[k, 0], contact.axes[k, 1], contact.axes[k, 2] = a_x, a_y, a_z
        contact.F[k] = a_x * wrench.f_0[0] + a_y * wrench.f_0[1] + a_z * wrench.f_0[2]
        contact.K[k], contact.D[k] = weight * _along(felt, TENSOR, a_x, a_y, a_z), weight * _along(felt, DAMPER, a_x, a_y, a_z)
    contact.in_contact = 1.0 if contact.K[2] > 0.0 else 0.0
    anchor_here(wheel, contact)


@kernel
def _answer_body(body, felt, known, wrench, support):
    """Wrench and interface Jacobian of a body; False if it has no pose, whose steps are counted."""
    there = has_pose(body)
    for k in range(3):
        wrench.f_0[k] = felt[FORCE + k] if there else 0.0
        wrench.t_0[k] = felt[TORQUE + k] if there else 0.0
        support.point_0[k] = _middle(felt, k, body.r_0[k])
        a_x, a_y, a_z = 1.0 if k == 0 else 0.0, 1.0 if k == 1 else 0.0, 1.0 if k == 2 else 0.0
        support.K[k], support.D[k] = _along(felt, TENSOR, a_x, a_y, a_z), _along(felt, DAMPER, a_x, a_y, a_z)
        support.K_r[k] = support.D_r[k] = 0.0
    support.in_contact = 1.0 if there and support.K[2] > 0.0 else 0.0
    anchor_here(body, support)
    known.silent = 0.0 if there else known.silent + 1.0
    return there


@kernel
def _diagnose(p, wheel, grains, tools, t, wrench, shown):
    T, v, w = wheel.T, wheel.v_0, wheel.w_0
    level = math.hypot(T[1, 0], T[1, 1])
    h_x, h_y = T[1, 1] / level, -T[1, 0] / level
    speed = v[0] * h_x + v[1] * h_y
    rim = p.r_w * dot(w[0], w[1], w[2], T[1, 0], T[1, 1], T[1, 2])
    # Angles from nadir of the foremost and of the last particle that touches.
    side = grains.count[SIDE]
    front, back = -math.pi, math.pi
    for k in range(tools.first[side, t], tools.first[side, t + 1]):
        kept, i = tools.kept[side, k], tools.particle[side, k]
        if kept[0, NORMAL] != 0.0 or kept[0, NORMAL + 1] != 0.0 or kept[0, NORMAL + 2] != 0.0:
            body = grains.body[side, i]
            along = (body[X] - wheel.r_0[0]) * h_x + (body[Y] - wheel.r_0[1]) * h_y
            angle = math.atan2(along, wheel.r_0[2] - body[Z])
            front, back = max(front, angle), min(back, angle)
    if front < back:
        front = back = 0.0
    entry, leave = (front, back) if speed + rim >= 0.0 else (back, front)
    torque = -dot(wrench.t_0[0], wrench.t_0[1], wrench.t_0[2], T[1, 0], T[1, 1], T[1, 2])
    show(wheel, p.ground_z - lowest_point(p, wheel), slip_ratio(speed, rim, SLIP_FLOOR), entry, leave, wrench.f_0, torque, shown)


@kernel
def _fill_patches(patches, trailing, spacing, known):
    """What the pool found of the heights around each trailing wheel."""
    for i in range(len(patches)):
        patch, row = patches[i], known[i]
        if not is_set(trailing[i].r_0) or row[2] == 0.0:
            patch.spacing = 0.0
            continue
        patch.spacing, patch.origin[0], patch.origin[1] = spacing, row[0], row[1]
        if patch.revision != row[2]:
            patch.revision = row[2]
            n_x, n_y = patch.z.shape
            for a in range(n_x):
                for b in range(n_y):
                    patch.z[a, b] = row[3 + a * n_y + b]


def step_with(advance):
    """The step with one way to advance the particles."""

    @kernel
    def step(
        t, h, P, wheels, trailing, bodies, wheel_memory, body_memory, wrenches, contacts, diagnostics, patches, answers, supports, arrays
    ):
        p = P[0]
        grains, tools, meshes, law = arrays[:_TOOLS], arrays[_TOOLS:_MESHES], Meshes(*arrays[_MESHES:_LAW]), arrays[_LAW]
        dt, gravity = arrays[_SETTINGS][0], arrays[_SETTINGS][1:TIME]
        _fill_patches(patches, trailing, p.patch_spacing, arrays[_PATCHES])
        if h == 0.0:
            return 0  # forces come with motion: what the last step told holds
        for i in range(len(wheels)):
            status = refusal(p, wheels[i], wheel_memory[i].silent, p.ground_z)
            if status:
                return status + STATUS_SPAN * i
        n = max(math.ceil(h / dt - 1e-9), 1)
        moving, count = Tools(*tools), Particles(*grains).count
        law[STEP] = h / n
        for k in range(len(moving.kinds)):
            moving.laws[k, STEP] = h / n
        for i in range(len(bodies)):
            if moving.roots[1 + len(wheels) + i] < 0:
                return NO_MESH + STATUS_SPAN * i
            if not has_pose(bodies[i]) and body_memory[i].silent >= PATIENCE:
                return BODY_STILL_NO_DATA + STATUS_SPAN * i
        for i in range(len(wheels)):
            _send(count, moving, 1 + i, wheels[i], wheels[i].active > 0.0 and has_pose(wheels[i]))
        for i in range(len(bodies)):
            _send(count, moving, 1 + len(wheels) + i, bodies[i], has_pose(bodies[i]))
        if not advance(grains, tools, meshes, law, gravity, h / n, n):
            return FULL
        arrays[_SETTINGS][TIME] += h
        status = 0
        for i in range(len(wheels)):
            felt = moving.sums[1 + i]
            if felt[DEEPEST] > DEEP:
                return TOO_DEEP + STATUS_SPAN * i
            if sees(wheels[i], wheel_memory[i], wrenches[i], contacts[i], diagnostics[i]):
                _answer(p, wheels[i], felt, wrenches[i], contacts[i])
                _diagnose(p, wheels[i], Particles(*grains), moving, 1 + i, wrenches[i], diagnostics[i])
            elif wheel_memory[i].silent > 0.0:
                status = NO_DATA + STATUS_SPAN * i
        for i in range(len(bodies)):
            felt = moving.sums[1 + len(wheels) + i]
            if felt[DEEPEST] > DEEP:
                return BODY_TOO_DEEP + STATUS_SPAN * i
            if not _answer_body(bodies[i], felt, body_memory[i], answers[i], supports[i]):
                status = BODY_NO_DATA + STATUS_SPAN * i
        return status

    return step


step = step_with(advance)
parallel_step = step_with(advance_in_parallel)
