"""How stiffly soil carries a body: the interface Jacobian that a light body on stiff soil is integrated with.

Each pressed cell resists motion into it by its slope of pressure, and motion along it by the secant of its friction; steep faces resist by
the secant of their passive pressure. All of that is summed as a matrix of translation and rotation about the body's origin. What is sent is
its diagonal about the elastic centre, the point at which forces turn the body least.
"""

from __future__ import annotations

import math

from ..contact import anchor_here, has_pose
from ..slave.kernel import kernel
from .columns import ALONG_SOIL, CELLS, DAMPING, INTO, STILL

_LEAST = 1e-9  # [N/m] stiffness below which there is none


@kernel
def clear_support(sums):
    """Nothing supports the body."""
    for n in range(INTO, STILL):
        sums[n] = 0.0


@kernel(inline=True)
def _motion(d_x, d_y, d_z, x, y, z):
    """Motion along d at the point (x, y, z) [m] by unit translations and rotations of the body."""
    return d_x, d_y, d_z, y * d_z - z * d_y, z * d_x - x * d_z, x * d_y - y * d_x


@kernel
def resist_aside(sums, stiffness, d_x, d_y, d_z, x, y, z):
    """Add the stiffness [N/m] of soil that is pushed aside along d at the point (x, y, z) [m] from the body's origin, in world axes."""
    motion = _motion(d_x, d_y, d_z, x, y, z)
    n = 0
    for i in range(6):
        share = stiffness * motion[i]
        for j in range(i + 1):
            sums[ALONG_SOIL + n] += share * motion[j]
            n += 1


@kernel
def resist_cell(sums, stiffness, drag, damping, g_x, g_y, n_x, n_y, n_z, x, y, z):
    """Add what a pressed cell resists with.

    Args:
        stiffness: Slope of its force over depth [N/m].
        drag: Secant stiffness of its friction [N/m].
        damping: Fall of its force up by the speed of the surface up [N.s/m].
        g_x, g_y: Horizontal force per force up [1], which is also by how much deeper the surface gets where it moves along x and y.
        n_x, n_y, n_z: Unit normal of its mean surface, in world axes; x, y, z: its point [m].
    """
    # Two directions along the surface, turned out of the horizontal plane with it.
    turn = 1.0 / (1.0 + n_z)
    into = _motion(g_x, g_y, 1.0, x, y, z)
    one = _motion(1.0 - n_x * n_x * turn, -n_x * n_y * turn, -n_x, x, y, z)
    other = _motion(-n_x * n_y * turn, 1.0 - n_y * n_y * turn, -n_y, x, y, z)
    n = 0
    for i in range(6):
        for j in range(i + 1):
            both = into[i] * into[j]
            sums[INTO + n] += stiffness * both
            sums[DAMPING + n] += damping * both
            sums[ALONG_SOIL + n] += drag * (one[i] * one[j] + other[i] * other[j])
            n += 1


@kernel(inline=True)
def _at(first, i, j):
    """Where in the sums entry (i, j) of a matrix is."""
    return first + (i * (i + 1) // 2 + j if i >= j else j * (j + 1) // 2 + i)


@kernel(inline=True)
def _cross(c, i, j):
    """Entry (i, j) of the matrix of the vector product c x."""
    return 0.0 if i == j else c[3 - i - j] if (j - i) % 3 == 2 else -c[3 - i - j]


@kernel
def _move(sums, first, c):
    """Turn a matrix about the body's origin into that about the point c [m]."""
    # Translation t of the body's material at c and rotation r move it at the origin by t - r x c = t + c x r.
    for i in range(3):
        for j in range(i + 1):
            more = 0.0
            for k in range(3):
                more -= _cross(c, i, k) * sums[_at(first, 3 + j, k)] + _cross(c, j, k) * sums[_at(first, 3 + i, k)]
                for m in range(3):
                    more += _cross(c, i, k) * sums[_at(first, k, m)] * _cross(c, j, m)
            sums[_at(first, 3 + i, 3 + j)] += more
    for i in range(3):
        for j in range(3):
            for k in range(3):
                sums[_at(first, 3 + i, j)] -= _cross(c, i, k) * sums[_at(first, k, j)]


@kernel
def _bound(sums, first, i):
    """Entry i of the least diagonal matrix of this form that is nowhere softer than a symmetric one.

    Own choice: each entry of the diagonal is raised by its correlations with the others, so that steps which are implicit in it do not
    overshoot (Gershgorin 1931, on the matrix scaled to a diagonal of ones).
    """
    stiffness, raised = sums[_at(first, i, i)], 1.0
    if stiffness <= _LEAST:
        return 0.0
    for j in range(6):
        other = sums[_at(first, j, j)]
        if j != i and other > _LEAST:
            raised += abs(sums[_at(first, i, j)]) / math.sqrt(stiffness * other)
    return stiffness * raised


@kernel
def answer_support(p, body, sums, support):
    """Interface Jacobian of a body from its sums, which it uses up; none where the body is not near the ground."""
    support.in_contact = 0.0
    for i in range(3):
        support.point_0[i] = body.r_0[i]
        support.K[i] = support.D[i] = support.K_r[i] = support.D_r[i] = 0.0
    if not has_pose(body):
        return
    anchor_here(body, support)
    if sums[CELLS] < 0.0:
        return
    for n in range(21):
        sums[INTO + n] += sums[ALONG_SOIL + n]
    level, up = sums[_at(INTO, 0, 0)] + sums[_at(INTO, 1, 1)], sums[_at(INTO, 2, 2)]
    if level + up <= _LEAST:
        return
    # Elastic centre: there forces along z do not turn the body, and those along x and y turn it least.
    c_x = -sums[_at(INTO, 4, 2)] / up if up > _LEAST else 0.0
    c_y = sums[_at(INTO, 3, 2)] / up if up > _LEAST else 0.0
    c_z = (sums[_at(INTO, 4, 0)] - sums[_at(INTO, 3, 1)]) / level if level > _LEAST else 0.0
    c = c_x, c_y, c_z
    _move(sums, INTO, c)
    _move(sums, ALONG_SOIL, c)
    _move(sums, DAMPING, c)
    for i in range(3):
        support.point_0[i] += c[i]
        support.K[i], support.K_r[i] = _bound(sums, INTO, i), _bound(sums, INTO, 3 + i)
        support.D[i] = p.tau_r * _bound(sums, ALONG_SOIL, i) + _bound(sums, DAMPING, i)
        support.D_r[i] = p.tau_r * _bound(sums, ALONG_SOIL, 3 + i) + _bound(sums, DAMPING, 3 + i)
    support.in_contact = 1.0
