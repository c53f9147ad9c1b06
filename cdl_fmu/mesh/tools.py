"""Wheels and bodies that touch each other: what hard contact models declare of them, and their contact candidates pair by pair."""

from __future__ import annotations

import math

import numpy as np

from ..contact import PATIENCE, SLIP_FLOOR, has_pose, show
from ..frames import dot, is_rotation
from ..slave.interface import body_pose, wheel_active, wheel_pose
from ..slave.kernel import kernel
from ..slave.model import Event
from ..slave.records import Choice, Real, Record
from ..terramechanics import slip_ratio
from ..wheel import WHEEL, tip_radius
from .contacts import CONTACT, GAP, A
from .pairs import mesh_contacts
from .wheel import wheel_contacts

#: What a hard contact model declares beside its laws.
TOOLS = WHEEL | Record(
    reach=Real(0.005, "m", "Distance up to which surfaces are looked for, and depth to which they may overlap", min=1e-5, max=1.0),
    spacing=Real(0.02, "m", "Distance within which contact points with one normal count as one", min=1e-5, max=1.0),
)
#: What it declares of each body.
BODY = Record(
    mass=Real(5.0, "kg", "Mass of the body; used where it can move", min=1e-3, max=1e6),
    fixed=Choice("Whether the body can move", off="it is moved by what acts on it", on="it stays where it is"),
    mu=Real(0.6, "1", "Coefficient of friction of wheels on this body; bodies on each other have the smaller one of both", (), 0.0, 10.0),
)
#: Distance up to which candidates are looked for, in units of ``reach``: what overlaps by more than reach is to be seen, and refused.
_SEEN = 2.0
_FIXED = BODY.fields["fixed"].value("on")

#: Status numbers of a step; a model's own start at 6.
NO_DATA, STILL_NO_DATA, NO_MESH, TOO_DEEP, TOO_MANY = 1, 2, 3, 4, 5
TOOL_EVENTS = {
    NO_DATA: Event("wheel {i} has no pose yet (T is no rotation or nothing was ever set): no force", is_error=False),
    STILL_NO_DATA: Event("wheel[{i}] still has no pose after 2 steps: connect wheel[{i}].r_0, T, v_0, w_0 to the rover"),
    NO_MESH: Event("body[{i}].mesh names no file: give the path of a closed mesh (.stl, .obj or .ply, in metres)"),
    TOO_DEEP: Event(
        "body {i}, at ({body.r_0[0]:.4g}, {body.r_0[1]:.4g}, {body.r_0[2]:.4g}) m, is overlapped by more than reach = {p.reach:g} m: start "
        "what touches it outside of it, make the contact stiffer, shorten the step, or raise reach"
    ),
    TOO_MANY: Event(
        "body {i} touches in more places at once than can be looked at: simplify its mesh or that of what touches it (some hundreds of "
        "faces serve), or lower reach"
    ),
}


def tool_inputs(n_wheels: int, n_bodies: int) -> Record:
    """Poses of wheels and bodies."""
    return wheel_pose(n_wheels) | wheel_active(n_wheels) | body_pose(n_bodies)


def tool_files(n_bodies: int) -> dict[str, str]:
    """Meshes of wheels and bodies."""
    closed = "(.stl, .obj or .ply, in metres"
    return {
        "wheel_mesh": f"Closed mesh of the wheels {closed}, y is the axle); none = cylinder with grousers",
        **{f"body[{j + 1}].mesh": f"Closed mesh of the body {closed})" for j in range(n_bodies)},
    }


@kernel
def refused_tool(wheels, silent, n_bodies, roots):
    """Status that a step ends with before anything changes, or 0, and the index of the tool concerned."""
    for j in range(n_bodies):
        if roots[j] < 0:
            return NO_MESH, j
    for i in range(len(wheels)):
        if wheels[i].active > 0.0 and not has_pose(wheels[i]) and silent[i].silent >= PATIENCE:
            return STILL_NO_DATA, i
    return 0, 0


@kernel
def count_silent(wheel, memory):
    """Count the steps in which an active wheel has no pose."""
    memory.silent = 0.0 if wheel.active == 0.0 or has_pose(wheel) else memory.silent + 1.0


@kernel
def is_fixed(body):
    """Whether the body with these parameters cannot move."""
    return body.fixed == _FIXED


@kernel
def wheel_candidates(p, i, wheel, n_bodies, body, j, meshes, scratch, candidates):
    """Contact candidates of wheel i with body j; their number, -1 if there are too many."""
    if not is_rotation(body.T):
        return 0
    # What the pool has after the bodies: plates of grousers, or the wheels' own mesh.
    plates, own, radius = n_bodies, n_bodies + 1, p.r_w
    if meshes.roots[own] >= 0:
        plates, radius = own, 0.0
    elif meshes.roots[plates] < 0:
        plates = -1
    n = wheel_contacts(i, radius, p.b_w, plates, p.t_g, wheel, meshes, j, body, _SEEN * p.reach, scratch, candidates, np.int64(0))
    return _within(p.reach, n, candidates)


@kernel
def body_candidates(p, n_wheels, first, j, second, k, meshes, scratch, candidates):
    """Contact candidates of bodies j and k, counted after the wheels; their number, -1 if there are too many."""
    if not (is_rotation(first.T) and is_rotation(second.T)) or not (has_pose(first) or has_pose(second)):
        return 0  # two at the very origin have not been set yet
    n = mesh_contacts(meshes, j, first, k, second, _SEEN * p.reach, scratch, candidates, np.int64(0))
    n = _within(p.reach, n, candidates)
    for c in range(n):
        candidates[c, A] += n_wheels
    return n


@kernel
def _within(reach, n, candidates):
    """Keep what is nearer than ``reach`` or overlaps; the number, -1 if there were more candidates than rows."""
    if n > len(candidates):
        return -1
    kept = 0
    for c in range(n):
        if candidates[c, GAP] < reach:
            for k in range(CONTACT):
                candidates[kept, k] = candidates[c, k]
            kept += 1
    return kept


@kernel
def clear_wrench(wrench):
    """Nothing acts."""
    for k in range(3):
        wrench.f_0[k] = wrench.t_0[k] = 0.0


@kernel
def show_tool(p, wheel, deepest, wrench, shown):
    """Diagnostics of a wheel; its sinkage is the deepest overlap, as there is no ground here from which it could count."""
    T, v, w = wheel.T, wheel.v_0, wheel.w_0
    level = max(math.hypot(T[1, 0], T[1, 1]), 1e-3)
    speed, rim = (v[0] * T[1, 1] - v[1] * T[1, 0]) / level, tip_radius(p) * dot(w[0], w[1], w[2], T[1, 0], T[1, 1], T[1, 2])
    torque = -dot(wrench.t_0[0], wrench.t_0[1], wrench.t_0[2], T[1, 0], T[1, 1], T[1, 2])
    show(wheel, deepest, slip_ratio(speed, rim, SLIP_FLOOR), 0.0, 0.0, wrench.f_0, torque, shown)
