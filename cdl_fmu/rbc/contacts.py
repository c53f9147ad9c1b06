"""Contacts of a step: few of each pair of tools, and how each moves with them."""

from __future__ import annotations

import math

import numpy as np

from ..contact import has_pose
from ..frames import cross, dot
from ..mesh.contacts import CONTACT, GAP, NORMAL, POINT, WEIGHT, A, B
from ..mesh.reduce import thin_out
from ..mesh.tools import TOO_DEEP, TOO_MANY, body_candidates, is_fixed, wheel_candidates
from ..slave.kernel import kernel
from ..slave.model import STATUS_SPAN

#: Most contacts of one pair of tools: four hold a body on another.
_MOST = 4


@kernel
def find(p, laws, wheels, bodies, meshes, scratch, candidates, rows):
    """Contacts of all wheels with bodies, and of these with each other.

    Args:
        rows: For contacts as ``mesh.contacts`` has them; A and B count wheels, then bodies. Where there are too many, the most distant go.

    Returns:
        Number of contacts, and the status that the step ends with before anything changes, or 0.
    """
    n, n_wheels = np.int64(0), len(wheels)
    for j in range(len(bodies)):
        for i in range(n_wheels):
            if wheels[i].active > 0.0 and has_pose(wheels[i]):
                found = wheel_candidates(p, i, wheels[i], len(bodies), bodies[j], j, meshes, scratch, candidates)
                n, status = _keep_few(p, found, n_wheels, candidates, rows, n)
                if status:
                    return n, status + STATUS_SPAN * j
        for k in range(j + 1, len(bodies)):
            if not (is_fixed(laws[j]) and is_fixed(laws[k])):
                found = body_candidates(p, n_wheels, bodies[j], j, bodies[k], k, meshes, scratch, candidates)
                n, status = _keep_few(p, found, n_wheels, candidates, rows, n)
                if status:
                    return n, status + STATUS_SPAN * j
    return n, 0


@kernel
def _keep_few(p, found, n_wheels, candidates, rows, n):
    """Add the contacts of one pair to the rows. Next row, and a refusal or 0."""
    if found < 0:
        return n, TOO_MANY
    touching = 0
    for c in range(found):  # rigid bodies touch or do not: see cone_weight
        if candidates[c, WEIGHT] > 0.5:
            for k in range(CONTACT):
                candidates[touching, k] = candidates[c, k]
            touching += 1
    for c in range(thin_out(candidates, 0, touching, p.spacing, _MOST)):
        if -candidates[c, GAP] > p.reach:
            return n, TOO_DEEP
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
    return n, 0


@kernel
def _origin(wheels, bodies, tool):
    r = wheels[tool].r_0 if tool < len(wheels) else bodies[tool - len(wheels)].r_0
    return r[0], r[1], r[2]


@kernel
def take_levers(wheels, bodies, row, lever):
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
