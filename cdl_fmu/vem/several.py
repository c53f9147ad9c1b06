"""Several visco-elastic contact points between wheels and bodies that are meshes.

Each place where two surfaces overlap is one spring, however many of their features overlap there: see ``mesh.reduce.shares``.
"""

from __future__ import annotations

import math

import numpy as np

from ..contact import has_pose
from ..frames import cross, dot
from ..mesh.contacts import GAP, NORMAL, POINT, WEIGHT, Scratch
from ..mesh.pool import FOUND, MEMORY, N_MESHES
from ..mesh.reduce import at_one_place, shares
from ..mesh.surface import Meshes
from ..mesh.tools import (
    NO_DATA,
    TOO_DEEP,
    TOO_MANY,
    body_candidates,
    clear_wrench,
    count_silent,
    is_fixed,
    refused_tool,
    show_tool,
    wheel_candidates,
)
from ..slave.kernel import kernel
from ..slave.model import STATUS_SPAN
from ..terramechanics import bekker_modulus
from ..wheel import tip_radius
from .law import bekker, damping, friction_secant, linear
from .single import LINEAR

#: What the kernels get: arrays of any length, so that one step serves models of all sizes.
ARGUMENTS = ("p", "p.body", "u.wheel", "u.body", "x.wheel", "y.wheel", "y.body", "y.pair", "y.anchor", "y.diagnostics")


@kernel
def initialise_bodies(t, P, laws, memory, wrenches, answers, pairs, anchors, diagnostics, arrays):
    for i in range(len(memory)):
        memory[i].silent = 0.0
    _clear(wrenches, answers, pairs)


@kernel
def _clear(wrenches, answers, pairs):
    for i in range(len(wrenches)):
        clear_wrench(wrenches[i])
    for j in range(len(answers)):
        clear_wrench(answers[j])
    for c in range(len(pairs)):
        pairs[c].on = pairs[c].against = 0.0


@kernel
def step_on_bodies(t, h, P, laws, wheels, bodies, memory, wrenches, answers, pairs, anchors, diagnostics, arrays):
    p, n_bodies = P[0], len(bodies)
    meshes, scratch, candidates, out = Meshes(*arrays[:N_MESHES]), Scratch(*arrays[N_MESHES:FOUND]), arrays[FOUND], arrays[MEMORY]
    status, index = refused_tool(wheels, memory, n_bodies, meshes.roots)
    if status:
        return status + STATUS_SPAN * index
    _clear(wrenches, answers, pairs)
    slot = np.int64(0)
    for i in range(len(wheels)):
        wheel, deepest = wheels[i], 0.0
        if wheel.active > 0.0 and has_pose(wheel):
            for j in range(n_bodies):
                n = wheel_candidates(p, i, wheel, n_bodies, bodies[j], j, meshes, scratch, candidates)
                if n < 0:
                    return TOO_MANY + STATUS_SPAN * j
                own = laws[j]
                mass = p.effective_mass if is_fixed(own) else 1.0 / (1.0 / p.effective_mass + 1.0 / own.mass)
                law = own.k, own.damping_ratio, own.mu, max(own.mu, own.mu_static), mass, wheel.active, p.normal_model
                against = len(wheels) + j
                slot, depth = _touch(p, law, i, wheel, against, bodies[j], n, candidates, out, wrenches[i], answers[j], pairs, slot)
                if depth > p.reach:
                    return TOO_DEEP + STATUS_SPAN * j
                deepest = max(deepest, depth)
        show_tool(p, wheel, deepest, wrenches[i], diagnostics[i])
        _anchor(wheel, anchors[i])
    for j in range(n_bodies):
        _anchor(bodies[j], anchors[len(wheels) + j])
        for k in range(j + 1, n_bodies):
            one, other = laws[j], laws[k]
            if is_fixed(one) and is_fixed(other):
                continue
            n = body_candidates(p, len(wheels), bodies[j], j, bodies[k], k, meshes, scratch, candidates)
            if n < 0:
                return TOO_MANY + STATUS_SPAN * j
            mobility = (0.0 if is_fixed(one) else 1.0 / one.mass) + (0.0 if is_fixed(other) else 1.0 / other.mass)
            law = (
                min(one.k, other.k),
                min(one.damping_ratio, other.damping_ratio),
                min(one.mu, other.mu),
                min(max(one.mu, one.mu_static), max(other.mu, other.mu_static)),
                1.0 / mobility,
                1.0,
                LINEAR,
            )
            on, against = len(wheels) + j, len(wheels) + k
            slot, depth = _touch(p, law, on, bodies[j], against, bodies[k], n, candidates, out, answers[j], answers[k], pairs, slot)
            if depth > p.reach:
                return TOO_DEEP + STATUS_SPAN * j
    warning = 0  # only what is not refused changes the state
    for i in range(len(wheels)):
        count_silent(wheels[i], memory[i])
        if memory[i].silent > 0.0:
            warning = NO_DATA + STATUS_SPAN * i
    return warning


@kernel
def _anchor(tool, anchor):
    for k in range(3):
        anchor.r_0[k], anchor.v_0[k], anchor.w_0[k] = tool.r_0[k], tool.v_0[k], tool.w_0[k]
        for j in range(3):
            anchor.T[k, j] = tool.T[k, j]


@kernel
def _touch(p, law, on, tool, against, other, n, candidates, out, wrench, opposite, pairs, slot):
    """Forces between two tools with n candidates, by places; next free slot of ``pairs``, and deepest overlap [m].

    Places are told apart from the deepest candidate on: what is within ``spacing`` of it and faces alike is one place.
    """
    shares(candidates, 0, n, p.spacing, out)
    deepest = 0.0
    while True:
        first = -1
        for c in range(n):
            if out[c] > 0.0 and (first < 0 or candidates[c, GAP] < candidates[first, GAP]):
                first = c
        if first < 0:
            return slot, deepest
        if candidates[first, WEIGHT] > 0.5:  # it touches more than it is about to
            deepest = max(deepest, -candidates[first, GAP])
        load = x = y = z = n_x = n_y = n_z = stiffness = damper = total = 0.0
        for c in range(n):
            if out[c] <= 0.0 or not at_one_place(candidates, first, c, p.spacing):
                continue
            k, d, f = _push(p, law, tool, other, candidates[c], out[c])
            out[c] = 0.0
            if f > 0.0:  # else it stays without force, however it moves
                load, stiffness, damper = load + f, stiffness + k, damper + d
            # By stiffness times depth, not by force, so that the place does not jump where damping takes the force away.
            weight = -k * candidates[c, GAP]
            x, y, z = x + weight * candidates[c, POINT], y + weight * candidates[c, POINT + 1], z + weight * candidates[c, POINT + 2]
            n_x, n_y = n_x + weight * candidates[c, NORMAL], n_y + weight * candidates[c, NORMAL + 1]
            n_z += weight * candidates[c, NORMAL + 2]
            total += weight
        length = math.sqrt(dot(n_x, n_y, n_z, n_x, n_y, n_z))
        place = x / total, y / total, z / total
        normal = n_x / length, n_y / length, n_z / length
        _act(p, law, on, tool, against, other, place, normal, load, stiffness, damper, wrench, opposite, pairs, slot)
        slot += 1


@kernel
def _push(p, law, tool, other, candidate, share):
    """Stiffness, damping and normal force of a candidate with its share of the spring."""
    stiffness, ratio, _, _, mass, weight, model = law
    depth = -candidate[GAP]
    if model == LINEAR:
        force, stiffness = linear(stiffness, depth)
    else:
        force, stiffness = bekker(bekker_modulus(p.k_c, p.k_phi, p.b_w), p.n, p.b_w, tip_radius(p), depth)
    damper = damping(ratio, stiffness, mass)
    v_x, v_y, v_z = _sliding(tool, other, candidate[POINT], candidate[POINT + 1], candidate[POINT + 2])
    v_n = dot(v_x, v_y, v_z, candidate[NORMAL], candidate[NORMAL + 1], candidate[NORMAL + 2])
    share *= weight
    return share * stiffness, share * damper, share * max(0.0, force - damper * v_n)


@kernel
def _sliding(tool, other, x, y, z):
    """Velocity [m/s] of a tool's material at a point (x, y, z) [m] against the other tool's."""
    a_x, a_y, a_z = cross(tool.w_0[0], tool.w_0[1], tool.w_0[2], x - tool.r_0[0], y - tool.r_0[1], z - tool.r_0[2])
    b_x, b_y, b_z = cross(other.w_0[0], other.w_0[1], other.w_0[2], x - other.r_0[0], y - other.r_0[1], z - other.r_0[2])
    v, w = tool.v_0, other.v_0
    return v[0] - w[0] + a_x - b_x, v[1] - w[1] + a_y - b_y, v[2] - w[2] + a_z - b_z


@kernel
def _act(p, law, on, tool, against, other, place, normal, load, stiffness, damper, wrench, opposite, pairs, slot):
    """Let a place's normal force, and friction with it, act on both tools, and tell its Jacobian if there is a slot left."""
    _, _, mu, mu_static, _, _, _ = law
    x, y, z = place
    n_x, n_y, n_z = normal
    v_x, v_y, v_z = _sliding(tool, other, x, y, z)
    v_n = dot(v_x, v_y, v_z, n_x, n_y, n_z)
    v_x, v_y, v_z = v_x - v_n * n_x, v_y - v_n * n_y, v_z - v_n * n_z
    friction = load * friction_secant(mu, mu_static, p.v_static, p.v_creep, math.sqrt(dot(v_x, v_y, v_z, v_x, v_y, v_z)))
    f_x, f_y, f_z = load * n_x - friction * v_x, load * n_y - friction * v_y, load * n_z - friction * v_z
    _add(wrench, tool, x, y, z, f_x, f_y, f_z)
    _add(opposite, other, x, y, z, -f_x, -f_y, -f_z)
    if slot >= len(pairs):
        return
    pair = pairs[slot]
    t_x, t_y, t_z = tangent(n_x, n_y, n_z)
    s_x, s_y, s_z = cross(n_x, n_y, n_z, t_x, t_y, t_z)
    axes = pair.axes
    axes[0, 0], axes[0, 1], axes[0, 2] = t_x, t_y, t_z
    axes[1, 0], axes[1, 1], axes[1, 2] = s_x, s_y, s_z
    axes[2, 0], axes[2, 1], axes[2, 2] = n_x, n_y, n_z
    pair.on, pair.against = on + 1.0, against + 1.0
    pair.point_0[0], pair.point_0[1], pair.point_0[2] = x, y, z
    pair.F[0], pair.F[1], pair.F[2] = dot(f_x, f_y, f_z, t_x, t_y, t_z), dot(f_x, f_y, f_z, s_x, s_y, s_z), load
    pair.K[0], pair.K[1], pair.K[2] = 0.0, 0.0, stiffness
    pair.D[0], pair.D[1], pair.D[2] = friction, friction, damper


@kernel
def tangent(n_x, n_y, n_z):
    """A unit vector across a normal: along the world's x axis as far as it can be, or z where the normal is x."""
    if abs(n_x) < 0.9:
        x, y, z = 1.0 - n_x * n_x, -n_x * n_y, -n_x * n_z
    else:
        x, y, z = -n_z * n_x, -n_z * n_y, 1.0 - n_z * n_z
    length = math.sqrt(dot(x, y, z, x, y, z))
    return x / length, y / length, z / length


@kernel
def _add(wrench, tool, x, y, z, f_x, f_y, f_z):
    t_x, t_y, t_z = cross(x - tool.r_0[0], y - tool.r_0[1], z - tool.r_0[2], f_x, f_y, f_z)
    wrench.f_0[0] += f_x
    wrench.f_0[1] += f_y
    wrench.f_0[2] += f_z
    wrench.t_0[0] += t_x
    wrench.t_0[1] += t_y
    wrench.t_0[2] += t_z
