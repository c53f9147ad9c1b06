"""Contact forces in one implicit step of a multibody system: (M + H (kv + J' (D + H K) J)) dv = H (forces at the step's begin).

Bodies that are touched are its *frames*. A force along an axis that follows the motion is a *row*: how the axis follows each coordinate of
the system, and what else the step needs to know of it.
"""

from __future__ import annotations

import math

from cdl_fmu.frames import cross, dot
from cdl_fmu.slave.kernel import kernel

from .interface import is_sent

#: Columns of an anchor, the pose and twist of a frame for which forces hold.
R_0, T_0, V_0, W_0 = 0, 3, 12, 15
ANCHOR = 18

#: Columns of a row, counted from its end: displacement since the anchor, velocity, velocity of the anchor; force at the anchor, stiffness,
#: damping, the mass that it moves; force at the step's begin; the axis; frame it acts on, frame its opposite acts on (-1: none); number of
#: the contact that it belongs to, and 1 for the axis along which that cannot pull.
X, V, V_ANCHOR, F, K, D, MASS, FORCE, AXIS, ON, AGAINST, CONTACT, NORMAL = -15, -14, -13, -12, -11, -10, -9, -8, -7, -4, -3, -2, -1
ROW = 15


@kernel
def keep(R, T, twists, anchors):
    """Make the present poses [n, 3], [n, 3, 3] and twists [n, 6] of all frames their anchors [n, ANCHOR]."""
    for i in range(len(R)):
        for k in range(3):
            anchors[i, R_0 + k] = R[i, k]
            anchors[i, V_0 + k], anchors[i, W_0 + k] = twists[i, k], twists[i, 3 + k]
            for j in range(3):
                anchors[i, T_0 + 3 * k + j] = T[i, k, j]


@kernel
def take(sent, anchor):
    """Replace an anchor by the one that came with a contact, if one did."""
    if is_sent(sent.T):
        for k in range(3):
            anchor[R_0 + k], anchor[V_0 + k], anchor[W_0 + k] = sent.r_0[k], sent.v_0[k], sent.w_0[k]
            for j in range(3):
                anchor[T_0 + 3 * k + j] = sent.T[k, j]


@kernel
def start_row(row, on, against, contact, normal, force, stiffness, damping, mass):
    """A row along which nothing moves yet; frames are added by ``follow`` or ``turn_with``."""
    for d in range(row.size):
        row[d] = 0.0
    row[ON], row[AGAINST], row[CONTACT], row[NORMAL] = on, against, contact, normal
    row[F], row[K], row[D], row[MASS] = force, stiffness, damping, mass


@kernel
def follow(sign, axis, point, i, where, anchors, row):
    """Let a row follow frame i's material at a point [m] along an axis, both in world, as they were at the anchor."""
    anchor = anchors[i]
    a_x, a_y, a_z = sign * axis[0], sign * axis[1], sign * axis[2]
    m_x, m_y, m_z = cross(point[0] - anchor[R_0], point[1] - anchor[R_0 + 1], point[2] - anchor[R_0 + 2], a_x, a_y, a_z)
    R, _, twists, J = where
    for d in range(row.size - ROW):
        row[d] += dot(a_x, a_y, a_z, J[i, 0, d], J[i, 1, d], J[i, 2, d])
    row[X] += a_x * (R[i, 0] - anchor[R_0]) + a_y * (R[i, 1] - anchor[R_0 + 1]) + a_z * (R[i, 2] - anchor[R_0 + 2])
    row[V] += dot(a_x, a_y, a_z, twists[i, 0], twists[i, 1], twists[i, 2])
    row[V_ANCHOR] += dot(a_x, a_y, a_z, anchor[V_0], anchor[V_0 + 1], anchor[V_0 + 2])
    turn_with(m_x, m_y, m_z, i, where, anchors, row)


@kernel
def turn_with(m_x, m_y, m_z, i, where, anchors, row):
    """Let a row follow frame i's rotation about the vector m, in world.

    Displacement is of first order in the rotation since the anchor: spin alone moves nothing along the normal.
    """
    _, T, twists, J = where
    anchor = anchors[i]
    for d in range(row.size - ROW):
        row[d] += dot(m_x, m_y, m_z, J[i, 3, d], J[i, 4, d], J[i, 5, d])
    row[X] += m_x * _turn(T[i], anchor, 2, 1) + m_y * _turn(T[i], anchor, 0, 2) + m_z * _turn(T[i], anchor, 1, 0)
    row[V] += dot(m_x, m_y, m_z, twists[i, 3], twists[i, 4], twists[i, 5])
    row[V_ANCHOR] += dot(m_x, m_y, m_z, anchor[W_0], anchor[W_0 + 1], anchor[W_0 + 2])


@kernel
def _turn(T, anchor, i, j):
    """Half of element (i, j) less (j, i) of T' T_anchor: with (2, 1), (0, 2), (1, 0) the rotation vector from the anchor, in world."""
    turn = 0.0
    for k in range(3):
        turn += T[k, i] * anchor[T_0 + 3 * k + j] - T[k, j] * anchor[T_0 + 3 * k + i]
    return 0.5 * turn


@kernel
def begin(h, row):
    """Force along a row at the begin of a step of h [s].

    own choice: F = F0 - K (x0 - x_a) - D (v1 - v_a) - H K (v1 - v0 / (1 + W^2)) with the velocities v0 and v1 at the step's ends
    and W = (omega H)^2 = H^2 K / m of the mass that a wheel carries. For soft contacts this is anchored in velocity: no numerical
    damping, and no bias where v0 is not 0 though nothing is compressed, as on a rolling wheel. For stiff ones it is backward Euler,
    where the other form returns an impact with up to 1.1 of its speed and undoes the contact's own damping. Rebound speed over
    impact speed at 1 ms, mean over the phase of the impact, for omega H = 0.19, 0.47, 2.2 (2 kg) and 7 (2 kg) without damping:
    1.00, 0.97, 0.85, 0.42; backward Euler throughout 0.75, 0.54, 0.32, 0.47; anchored in velocity throughout 1.00, 1.00, 1.01, 1.00
    (0.89 instead of 0.45 for a damping ratio of 0.3 at omega H = 7).
    """
    W = h * h * row[K] / row[MASS]
    row[FORCE] = row[F] - row[K] * row[X] - row[D] * (row[V] - row[V_ANCHOR]) - h * row[K] * row[V] * (W * W / (1.0 + W * W))


@kernel
def add_row(h, row, A, forces):
    """Add what a row's force differs from its value at the anchor to the step's matrix and forces."""
    gain = h * (row[D] + h * row[K])
    more = row[FORCE] - row[F]
    for d in range(forces.size):
        if row[d] != 0.0:
            forces[d] += more * row[d]
            share = gain * row[d]
            for e in range(d + 1):
                A[d, e] += share * row[e]


@kernel
def drop_row(row, forces):
    """Take a row's force out of the wrenches of which it is a part."""
    for d in range(forces.size):
        forces[d] -= row[F] * row[d]


@kernel
def end(h, row, change):
    """Force along a row that acted in the step, by the change of velocity in it."""
    v = 0.0
    for d in range(change.size):
        v += row[d] * change[d]
    return row[FORCE] - (row[D] + h * row[K]) * v


@kernel
def add_wrench(J, f, t, forces):
    """Add a wrench about a frame's origin to the forces on the coordinates; J [6, n] is its Jacobian."""
    for d in range(forces.size):
        forces[d] += dot(J[0, d], J[1, d], J[2, d], f[0], f[1], f[2]) + dot(J[3, d], J[4, d], J[5, d], t[0], t[1], t[2])


@kernel
def factor(A):
    """Cholesky factor of a symmetric positive matrix [n, n], in place in and below its diagonal; False if it is not positive."""
    for j in range(len(A)):
        for k in range(j):
            share = A[j, k]
            if share != 0.0:
                for i in range(j, len(A)):
                    A[i, j] -= share * A[i, k]
        if not A[j, j] > 0.0:
            return False
        root = math.sqrt(A[j, j])
        for i in range(j, len(A)):
            A[i, j] /= root
    return True


@kernel
def forward(L, b):
    """Solve L y = b in place, L being a factor; returns the number of leading zeros of b and y."""
    first = 0
    while first < len(L) - 1 and b[first] == 0.0:
        first += 1
    for i in range(first, len(L)):
        total = b[i]
        for k in range(first, i):
            total -= L[i, k] * b[k]
        b[i] = total / L[i, i]
    return first


@kernel
def backward(L, b):
    """Solve L' x = b in place."""
    for i in range(len(L) - 1, -1, -1):
        total = b[i]
        for k in range(i + 1, len(L)):
            total -= L[k, i] * b[k]
        b[i] = total / L[i, i]
