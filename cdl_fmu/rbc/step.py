"""The RBC step: contacts of all tools, their problem, and its impulses as mean forces over the step."""

from __future__ import annotations

import math

from ..frames import dot
from ..mesh.contacts import GAP, ID, POINT, A, B, Scratch
from ..mesh.pool import FOUND, MEMORY, N_MESHES
from ..mesh.surface import Meshes
from ..mesh.tools import NO_DATA, clear_wrench, count_silent, refused_tool, show_tool
from ..slave.kernel import kernel
from ..slave.model import STATUS_SPAN
from .contacts import find, take_levers
from .problem import make_problem, take_mobility
from .solve import BY_PIVOTS, UNSOLVED, solve

#: Status numbers beside those of the tools: a warning that the scalar mass is too large.
GROWS = 6

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
        memory[i].came[0] = memory[i].came[1] = memory[i].came[2] = 0.0
        clear_wrench(wrenches[i])
    for j in range(len(answers)):
        clear_wrench(answers[j])
    for c in range(len(kept)):
        kept[c].on = 0.0


@kernel
def step(t, h, P, laws, U, wheels, bodies, X, memory, kept, Y, wrenches, answers, diagnostics, arrays):
    p, u, x, y = P[0], U[0], X[0], Y[0]
    n_wheels, n_bodies = len(wheels), len(bodies)
    meshes, scratch, candidates = Meshes(*arrays[:N_MESHES]), Scratch(*arrays[N_MESHES:FOUND]), arrays[FOUND]
    rows, lever, mobility, mobile, G, b, target, mu, impulse, v, twist, directions, best, tableau, basis = arrays[MEMORY:]
    status, index = refused_tool(wheels, memory, n_bodies, meshes.roots)
    if status:
        return status + STATUS_SPAN * index

    n, status = find(p, laws, wheels, bodies, meshes, scratch, candidates, rows)
    if status:
        return status
    warning = 0
    for i in range(n_wheels):
        count_silent(wheels[i], memory[i])
        if memory[i].silent > 0.0:
            warning = NO_DATA + STATUS_SPAN * i
    for c in range(n):
        take_levers(wheels, bodies, rows[c], lever[c])
    exact = take_mobility(u, mobility)
    if not exact:
        for i in range(n_wheels):
            if _gains(p, wheels[i], memory[i]):
                warning = GROWS + STATUS_SPAN * i
    make_problem(h, p, laws, u, wheels, bodies, n, rows, lever, mobility, mobile, G, b, target, mu, twist, exact)
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
        show_tool(p, wheels[i], _deepest(i, n, rows), wrenches[i], diagnostics[i])
    y.n_contacts, y.sweeps, y.residual = n, sweeps, residual
    y.pivoted, y.unsolved = x.pivoted / max(x.steps, 1.0), x.unsolved / max(x.steps, 1.0)
    return warning


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
        clear_wrench(wrenches[i])
    for j in range(len(bodies)):
        clear_wrench(answers[j])
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
def _deepest(i, n, rows):
    """Deepest overlap of a wheel [m]."""
    deepest = 0.0
    for c in range(n):
        if int(rows[c, A]) == i:
            deepest = max(deepest, -rows[c, GAP])
    return deepest
