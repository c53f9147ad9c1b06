"""The RBC step: contacts of all tools, their problem, and its impulses as mean forces over the step."""

from __future__ import annotations

import math

import numpy as np

from ..contact import SLIP_FLOOR, has_pose, show
from ..frames import cross, dot
from ..mesh.contacts import CONTACT, GAP, ID, NORMAL, POINT, A, B, Scratch
from ..mesh.pool import FOUND, MEMORY, N_MESHES
from ..mesh.reduce import thin_out
from ..mesh.surface import Meshes
from ..mesh.tools import NO_DATA, TOO_DEEP, TOO_MANY, body_candidates, count_silent, is_fixed, refused_tool, wheel_candidates
from ..slave.kernel import kernel
from ..slave.model import STATUS_SPAN
from ..terramechanics import slip_ratio
from ..wheel import tip_radius
from .solve import BY_PIVOTS, UNSOLVED, solve

#: Status numbers beside those of the tools: a warning that the scalar mass is too large.
GROWS = 6

#: Most contacts of one pair of tools: four hold a body on another.
_MOST = 4
#: Time [s] in which an overlap is taken back, in no fewer than so many steps. own choice: what is pushed out faster hops, by its speed,
#: higher than it was deep. A scalar mass is pushed out faster, as the overlap is what bears the weight that it does not know.
_PUSHED_OUT, _PUSHED_OUT_SCALAR, _STEPS_OUT = 0.02, 0.005, 5.0
_FASTER = 1.05  # rebound speed over impact speed from which the contact is said to gain energy

#: What the kernels get: arrays of any length, so that one step serves models of all sizes.
ARGUMENTS = (
    *("p", "p.body", "u", "u.wheel", "u.body", "x", "x.wheel", "x.kept"),
    *("y", "y.wheel", "y.body", "y.diagnostics"),
)


@kernel
def initialise(t, P, laws, X, memory, kept, Y, wrenches, answers, diagnostics, arrays):
    x, y = X[0], Y[0]
    x.steps = x.pivoted = x.unsolved = 0.0
    y.n_contacts = y.sweeps = y.residual = y.pivoted = y.unsolved = 0.0
    for i in range(len(memory)):
        memory[i].silent = 0.0
        for k in range(3):
            memory[i].came[k] = wrenches[i].f_0[k] = wrenches[i].t_0[k] = 0.0
    for j in range(len(answers)):
        for k in range(3):
            answers[j].f_0[k] = answers[j].t_0[k] = 0.0
    for c in range(len(kept)):
        kept[c].on = 0.0


@kernel
def step(t, h, P, laws, U, wheels, bodies, X, memory, kept, Y, wrenches, answers, diagnostics, arrays):
    p, u, x, y = P[0], U[0], X[0], Y[0]
    n_wheels, n_bodies = len(wheels), len(bodies)
    meshes, scratch, candidates = Meshes(*arrays[:N_MESHES]), Scratch(*arrays[N_MESHES:FOUND]), arrays[FOUND]
    rows, lever, mobile, G, b, target, mu, impulse, v, twist, directions, best, tableau, basis = arrays[MEMORY:]
    status, index = refused_tool(wheels, memory, n_bodies, meshes.roots)
    if status:
        return status + STATUS_SPAN * index

    n = np.int64(0)
    for i in range(n_wheels):
        if wheels[i].active > 0.0 and has_pose(wheels[i]):
            for j in range(n_bodies):
                found = wheel_candidates(p, i, wheels[i], n_bodies, bodies[j], j, meshes, scratch, candidates)
                if found < 0:
                    return TOO_MANY + STATUS_SPAN * j
                n, overlap = _keep_few(p, found, n_wheels, candidates, rows, n)
                if overlap > p.reach:
                    return TOO_DEEP + STATUS_SPAN * j
    for j in range(n_bodies):
        for k in range(j + 1, n_bodies):
            if is_fixed(laws[j]) and is_fixed(laws[k]):
                continue
            found = body_candidates(p, n_wheels, bodies[j], j, bodies[k], k, meshes, scratch, candidates)
            if found < 0:
                return TOO_MANY + STATUS_SPAN * j
            n, overlap = _keep_few(p, found, n_wheels, candidates, rows, n)
            if overlap > p.reach:
                return TOO_DEEP + STATUS_SPAN * j

    warning = 0
    for i in range(n_wheels):
        count_silent(wheels[i], memory[i])
        if memory[i].silent > 0.0:
            warning = NO_DATA + STATUS_SPAN * i
    for c in range(n):
        _take_levers(wheels, bodies, rows[c], lever[c])
    exact = _has_mobility(u)
    if not exact:
        for i in range(n_wheels):
            if _gains(p, wheels[i], memory[i]):
                warning = GROWS + STATUS_SPAN * i
    _make_problem(h, p, laws, u, wheels, bodies, n, rows, lever, mobile, G, b, target, mu, v, twist, exact)
    _start_from(p, n, rows, lever, kept, impulse)
    outcome, sweeps, residual = 0, 0, 0.0
    if n > 0 and h > 0.0:
        outcome, sweeps, residual = solve(n, G, b, target, mu, impulse, v, p.tolerance, int(p.max_sweeps), directions, best, tableau, basis)
        x.steps += 1.0
        x.pivoted += 1.0 if outcome == BY_PIVOTS else 0.0
        x.unsolved += 1.0 if outcome == UNSOLVED else 0.0
    _answer(h, p, wheels, bodies, n, rows, lever, impulse, wrenches, answers)
    _remember(n, rows, lever, impulse, kept)
    for i in range(n_wheels):
        _note(i, n, rows, lever, impulse, twist, memory[i])
        _show(p, i, wheels[i], n, rows, wrenches[i], diagnostics[i])
    y.n_contacts, y.sweeps, y.residual = n, sweeps, residual
    y.pivoted, y.unsolved = x.pivoted / max(x.steps, 1.0), x.unsolved / max(x.steps, 1.0)
    return warning


@kernel
def _keep_few(p, found, n_wheels, candidates, rows, n):
    """Add the contacts of one pair to the rows; of too many the most distant go. Next row, and deepest overlap [m]."""
    few, overlap = thin_out(candidates, 0, found, p.spacing, _MOST), 0.0
    for c in range(few):
        overlap = max(overlap, -candidates[c, GAP])
        to = n
        if n == len(rows):
            to = 0
            for k in range(len(rows)):
                if rows[k, GAP] > rows[to, GAP]:
                    to = k
            if rows[to, GAP] <= candidates[c, GAP]:
                continue
        else:
            n += 1
        for k in range(CONTACT):
            rows[to, k] = candidates[c, k]
        rows[to, B] += n_wheels  # all tools are counted alike: wheels, then bodies
    return n, overlap


@kernel
def _origin(wheels, bodies, tool):
    r = wheels[tool].r_0 if tool < len(wheels) else bodies[tool - len(wheels)].r_0
    return r[0], r[1], r[2]


@kernel
def _take_levers(wheels, bodies, row, lever):
    """How a contact's normal and tangents, [3, 12], move with the twists of both tools; friction's first direction is a wheel's heading."""
    n_x, n_y, n_z = row[NORMAL], row[NORMAL + 1], row[NORMAL + 2]
    on, against = int(row[A]), int(row[B])
    t_x, t_y, t_z = 1.0, 0.0, 0.0
    if on < len(wheels):
        T = wheels[on].T
        t_x, t_y, t_z = cross(T[1, 0], T[1, 1], T[1, 2], n_x, n_y, n_z)
    if dot(t_x, t_y, t_z, t_x, t_y, t_z) < 0.03 or on >= len(wheels):
        t_x, t_y, t_z = (1.0, 0.0, 0.0) if abs(n_x) < 0.9 else (0.0, 0.0, 1.0)
    along = dot(t_x, t_y, t_z, n_x, n_y, n_z)
    t_x, t_y, t_z = t_x - along * n_x, t_y - along * n_y, t_z - along * n_z
    length = math.sqrt(dot(t_x, t_y, t_z, t_x, t_y, t_z))
    t_x, t_y, t_z = t_x / length, t_y / length, t_z / length
    s_x, s_y, s_z = cross(n_x, n_y, n_z, t_x, t_y, t_z)
    for side in range(2):
        r_x, r_y, r_z = _origin(wheels, bodies, on if side == 0 else against)
        a_x, a_y, a_z = row[POINT] - r_x, row[POINT + 1] - r_y, row[POINT + 2] - r_z
        sign = 1.0 - 2.0 * side
        _lever(sign, n_x, n_y, n_z, a_x, a_y, a_z, lever[0], 6 * side)
        _lever(sign, t_x, t_y, t_z, a_x, a_y, a_z, lever[1], 6 * side)
        _lever(sign, s_x, s_y, s_z, a_x, a_y, a_z, lever[2], 6 * side)


@kernel
def _lever(sign, x, y, z, a_x, a_y, a_z, out, at):
    m_x, m_y, m_z = cross(a_x, a_y, a_z, x, y, z)
    out[at], out[at + 1], out[at + 2] = sign * x, sign * y, sign * z
    out[at + 3], out[at + 4], out[at + 5] = sign * m_x, sign * m_y, sign * m_z


@kernel
def _has_mobility(u):
    """Whether the multibody system tells its inverse inertia."""
    mobility = 0.0
    for k in range(u.inverse_inertia.shape[0]):
        mobility = max(mobility, u.inverse_inertia[k, k])
    return mobility > 0.0


@kernel
def _make_problem(h, p, laws, u, wheels, bodies, n, rows, lever, mobile, G, b, target, mu, v, twist, exact):
    """Velocities per impulse G, free velocities b, what the normal ones have to reach, and friction."""
    n_wheels = len(wheels)
    for i in range(n_wheels + len(bodies)):
        for k in range(3):
            twist[i, k] = wheels[i].v_0[k] if i < n_wheels else bodies[i - n_wheels].v_0[k]
            twist[i, 3 + k] = wheels[i].w_0[k] if i < n_wheels else bodies[i - n_wheels].w_0[k]
    for c in range(n):
        on, against = 6 * int(rows[c, A]), 6 * int(rows[c, B])
        for r in range(3):
            now = free = 0.0
            for k in range(6):
                now += lever[c, r, k] * twist[on // 6, k] + lever[c, r, 6 + k] * twist[against // 6, k]
                free += lever[c, r, k] * u.free_twist[on + k] + lever[c, r, 6 + k] * u.free_twist[against + k]
            b[3 * c + r] = free if exact else now
            if r == 0:
                v[c] = now
        slow = max(_PUSHED_OUT if exact else _PUSHED_OUT_SCALAR, _STEPS_OUT * h)
        _bound(h, slow, p, laws, n_wheels, c, rows, b[3 * c], v[c], target, mu)
    if not exact:
        _scalar_masses(p, laws, n_wheels, n, rows, G)
        return
    A_ = u.inverse_inertia
    for d in range(n):
        on, against = 6 * int(rows[d, A]), 6 * int(rows[d, B])
        for s in range(3):
            for r in range(A_.shape[0]):
                total = 0.0
                for k in range(6):
                    total += A_[r, on + k] * lever[d, s, k] + A_[r, against + k] * lever[d, s, 6 + k]
                mobile[s, r] = total
        for c in range(d, n):
            on_c, against_c = 6 * int(rows[c, A]), 6 * int(rows[c, B])
            for r in range(3):
                for s in range(3):
                    total = 0.0
                    for k in range(6):
                        total += lever[c, r, k] * mobile[s, on_c + k] + lever[c, r, 6 + k] * mobile[s, against_c + k]
                    G[3 * c + r, 3 * d + s] = G[3 * d + s, 3 * c + r] = total


@kernel
def _bound(h, slow, p, laws, n_wheels, c, rows, free, now, target, mu):
    """Least normal velocity at the step's end: what closes the gap, or takes back the overlap in time, or the rebound (Newton).

    An overlap is taken back within ``slow`` [s].
    """
    on, against = int(rows[c, A]), int(rows[c, B])
    law = laws[against - n_wheels]
    mu[c], restitution = law.mu, law.restitution
    if on >= n_wheels:
        mu[c] = min(mu[c], laws[on - n_wheels].mu)
        restitution = min(restitution, laws[on - n_wheels].restitution)
    gap = rows[c, GAP]
    least = 0.0
    if h > 0.0:
        least = -gap / h if gap > 0.0 else -gap / slow
    if now < -p.rest_speed and gap + h * min(free, now) <= 0.0:
        least = max(least, -restitution * now)
    target[c] = least


@kernel
def _scalar_masses(p, laws, n_wheels, n, rows, G):
    """Contacts that do not know of each other, each with its share of the tools' masses (mass splitting, Tonge 2012)."""
    for c in range(n):
        mobility = 0.0
        for side in range(2):
            tool, on_tool = int(rows[c, A + side]), 0
            for d in range(n):
                on_tool += int(rows[d, A] == tool) + int(rows[d, B] == tool)
            if tool < n_wheels:
                mobility += on_tool / p.effective_mass
            elif not is_fixed(laws[tool - n_wheels]):
                mobility += on_tool / laws[tool - n_wheels].mass
        for r in range(3):
            for d in range(n):
                for s in range(3):
                    G[3 * c + r, 3 * d + s] = mobility if c == d and r == s else 0.0


@kernel
def _start_from(p, n, rows, lever, kept, impulse):
    """Impulses of the last step at the same contacts, or near ones of the same tools where a contact is new."""
    for c in range(n):
        match, nearest = -1, p.spacing * p.spacing
        for m in range(len(kept)):
            old = kept[m]
            if old.on != rows[c, A] + 1.0 or old.against != rows[c, B] + 1.0:
                continue
            if old.id == rows[c, ID]:
                match = m
                break
            x, y, z = old.point_0[0] - rows[c, POINT], old.point_0[1] - rows[c, POINT + 1], old.point_0[2] - rows[c, POINT + 2]
            if dot(x, y, z, x, y, z) < nearest:
                match, nearest = m, dot(x, y, z, x, y, z)
        for r in range(3):
            impulse[3 * c + r] = 0.0
            if match >= 0:
                old = kept[match].impulse_0
                impulse[3 * c + r] = dot(old[0], old[1], old[2], lever[c, r, 0], lever[c, r, 1], lever[c, r, 2])
        impulse[3 * c] = max(impulse[3 * c], 0.0)


@kernel
def _remember(n, rows, lever, impulse, kept):
    for c in range(len(kept)):
        if c >= n:
            kept[c].on = 0.0
            continue
        kept[c].on, kept[c].against, kept[c].id = rows[c, A] + 1.0, rows[c, B] + 1.0, rows[c, ID]
        for k in range(3):
            kept[c].point_0[k] = rows[c, POINT + k]
            kept[c].impulse_0[k] = 0.0
            for r in range(3):
                kept[c].impulse_0[k] += impulse[3 * c + r] * lever[c, r, k]


@kernel
def _answer(h, p, wheels, bodies, n, rows, lever, impulse, wrenches, answers):
    """Mean forces over the step."""
    n_wheels = len(wheels)
    for i in range(n_wheels):
        _clear(wrenches[i])
    for j in range(len(bodies)):
        _clear(answers[j])
    if h == 0.0:
        return
    for c in range(n):
        on, against = int(rows[c, A]), int(rows[c, B])
        weight = wheels[on].active if on < n_wheels else 1.0
        for r in range(3):
            f = weight * impulse[3 * c + r] / h
            if on < n_wheels:
                _add(f, lever[c, r], 0, wrenches[on])
            else:
                _add(f, lever[c, r], 0, answers[on - n_wheels])
            _add(f, lever[c, r], 6, answers[against - n_wheels])


@kernel
def _clear(wrench):
    for k in range(3):
        wrench.f_0[k] = wrench.t_0[k] = 0.0


@kernel
def _add(f, lever, at, wrench):
    for k in range(3):
        wrench.f_0[k] += f * lever[at + k]
        wrench.t_0[k] += f * lever[at + 3 + k]


@kernel
def _note(i, n, rows, lever, impulse, twist, memory):
    """Remember how fast a wheel came on to its contacts, along their normal, for ``_gains``."""
    for k in range(3):
        memory.came[k] = 0.0
    fastest = 0.0
    for c in range(n):
        if int(rows[c, A]) != i or impulse[3 * c] <= 0.0:
            continue
        speed = 0.0
        for k in range(6):
            speed -= lever[c, 0, k] * twist[i, k]
        if speed > fastest:
            fastest = speed
            for k in range(3):
                memory.came[k] = speed * lever[c, 0, k]


@kernel
def _gains(p, wheel, memory):
    """Whether a wheel leaves a contact faster than it came: its scalar mass is more than 2 / (1 + restitution) of what it carries."""
    came = memory.came
    speed = math.sqrt(dot(came[0], came[1], came[2], came[0], came[1], came[2]))
    if speed <= p.rest_speed:
        return False
    left = dot(wheel.v_0[0], wheel.v_0[1], wheel.v_0[2], came[0], came[1], came[2]) / speed
    return left > _FASTER * speed


@kernel
def _show(p, i, wheel, n, rows, wrench, shown):
    """Diagnostics of a wheel; its sinkage is the deepest overlap, as there is no ground here from which it could count."""
    deepest = 0.0
    for c in range(n):
        if int(rows[c, A]) == i:
            deepest = max(deepest, -rows[c, GAP])
    T, v, w = wheel.T, wheel.v_0, wheel.w_0
    level = max(math.hypot(T[1, 0], T[1, 1]), 1e-3)
    speed, rim = (v[0] * T[1, 1] - v[1] * T[1, 0]) / level, tip_radius(p) * dot(w[0], w[1], w[2], T[1, 0], T[1, 1], T[1, 2])
    torque = -dot(wrench.t_0[0], wrench.t_0[1], wrench.t_0[2], T[1, 0], T[1, 1], T[1, 2])
    show(wheel, deepest, slip_ratio(speed, rim, SLIP_FLOOR), 0.0, 0.0, wrench.f_0, torque, shown)
