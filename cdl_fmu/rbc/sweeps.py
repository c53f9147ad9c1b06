"""Rigid contact by projected Gauss-Seidel: contact after contact is solved for the impulses of all others, until all agree.

The conditions, for each contact, with v = b + G p (Stewart & Trinkle 1996; Anitescu & Potra 1997; Eqs. (8.1) to (8.4)):

    0 <= lambda_n _|_ v_n - target >= 0,  0 <= lambda_f _|_ D'v_t + E sigma >= 0,  0 <= sigma _|_ mu lambda_n - E'lambda_f >= 0

The impulses p [N.s] and the velocities v [m/s] have three rows a contact: normal, first and second tangent. lambda_n is the normal row of
p, D lambda_f its tangential ones.
"""

from __future__ import annotations

import math

from ..slave.kernel import kernel
from .friction import least, nearest


@kernel
def velocities(n, G, b, p, v):
    """v = b + G p of n contacts [m/s]."""
    for j in range(3 * n):
        v[j] = b[j]
    for c in range(n):
        _add(n, G, c, p[3 * c], p[3 * c + 1], p[3 * c + 2], v)


@kernel(inline=True)
def _add(n, G, c, q_n, q_x, q_y, v):
    """Add to v what an impulse [N.s] on contact c makes of it. G is symmetric: its rows, which lie together, are its columns."""
    if q_n != 0.0 or q_x != 0.0 or q_y != 0.0:
        for j in range(3 * n):
            v[j] += q_n * G[3 * c, j] + q_x * G[3 * c + 1, j] + q_y * G[3 * c + 2, j]


@kernel
def residual(n, G, target, mu, p, v, directions):
    """How far impulses and velocities of n contacts are from the conditions [m/s].

    The largest residual of the natural map of a contact (Facchinei & Pang 2003, section 1.5): normal |min(v_n - target, g_n lambda_n)| and
    tangential g_t |p_t - the point of the polygon nearest to p_t - v_t / g_t|. There g_n = G_nn and g_t, the mean of the tangential
    diagonal (own choice), make velocities of impulses, so that masses of any unit give the same.

    It bounds the violation: change v_n, g_n lambda_n, v_t and g_t p_t of a contact by no more than that, and they keep the conditions
    exactly, with friction bounded by the lambda_n given. So nothing approaches by more beyond its target, and what separates by more bears
    less than the impulse that makes so much velocity.
    """
    worst = 0.0
    for c in range(n):
        i = 3 * c
        g_n, g_t = G[i, i], 0.5 * (G[i + 1, i + 1] + G[i + 2, i + 2])
        off = abs(min(v[i] - target[c], g_n * p[i])) if g_n > 0.0 else max(0.0, target[c] - v[i])
        worst = _worse(off, worst)
        if g_t > 0.0:
            x, y = p[i + 1], p[i + 2]
            q_x, q_y = nearest(directions, mu[c] * max(p[i], 0.0), x - v[i + 1] / g_t, y - v[i + 2] / g_t)
            worst = _worse(g_t * math.sqrt((q_x - x) * (q_x - x) + (q_y - y) * (q_y - y)), worst)
    return worst


@kernel(inline=True)
def _worse(off, worst):
    """The larger one, or what is not a number."""
    return worst if off <= worst or worst != worst else off


@kernel
def gauss_seidel(n, G, b, target, mu, p, v, tolerance, max_sweeps, directions):
    """Sweep over n contacts, to and fro, from the impulses p, which it changes, with the velocities v.

    Args: as :func:`cdl_fmu.rbc.solve.solve`.

    Returns:
        Sweeps made and the residual reached [m/s], not a number if there is one among the data.
    """
    velocities(n, G, b, p, v)
    off, sweeps = residual(n, G, target, mu, p, v, directions), 0
    while off > tolerance and sweeps < max_sweeps:
        for k in range(n):
            c = n - 1 - k if sweeps % 2 else k
            _relax(n, G, target[c], mu[c], p, v, directions, c)
        sweeps += 1
        off = residual(n, G, target, mu, p, v, directions)
    return sweeps, off


@kernel(inline=True)
def _relax(n, G, target, mu, p, v, directions, c):
    """Solve one contact for the impulses of the others: the normal impulse, then friction."""
    i = 3 * c
    if G[i, i] <= 0.0:
        return  # nothing moves, whatever the impulse
    q_n = max(0.0, p[i] - (v[i] - target) / G[i, i])
    change = q_n - p[i]
    q_x = q_y = 0.0
    a_xx, a_xy, a_yy = G[i + 1, i + 1], G[i + 1, i + 2], G[i + 2, i + 2]
    if mu * q_n > 0.0 and a_xx + a_yy > 0.0:
        v_x, v_y = v[i + 1] + change * G[i, i + 1], v[i + 2] + change * G[i, i + 2]
        q_x, q_y = least(directions, mu * q_n, a_xx, a_xy, a_yy, p[i + 1], p[i + 2], v_x, v_y)
    _add(n, G, c, change, q_x - p[i + 1], q_y - p[i + 2], v)
    p[i], p[i + 1], p[i + 2] = q_n, q_x, q_y
