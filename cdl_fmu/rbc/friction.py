"""The polyhedral friction cone: at a normal impulse it leaves a regular polygon for the friction impulse.

Its corners are ``radius d_k`` with unit vectors d_k, k = 0 .. n_directions - 1, at the angles 2 pi k / n_directions from the first tangent,
and ``radius`` = mu lambda_n [N.s]. A point of the polygon is a sum of lambda_k d_k with lambda_k >= 0 and sum lambda_k <= radius, so the
point is enough as unknown.
"""

from __future__ import annotations

import math

import numpy as np

from ..slave.kernel import kernel
from ..slave.model import ModelError

D_X, D_Y, N_X, N_Y = range(4)  # columns of the directions: corner d_k, outward normal of the edge from corner k to corner k + 1

# own choice: share of a contact's mobility that is added to it, so that a direction in which nothing moves has one answer, too
_SHIFT = 1e-12


def friction_directions(n_directions: int) -> np.ndarray:
    """Corners and edges of the polygon of radius 1, shape [n_directions, 4], columns as ``D_X, D_Y, N_X, N_Y``.

    Raises:
        ModelError: ``n_directions`` is odd or below 4, so that friction could not oppose every direction.
    """
    if n_directions < 4 or n_directions % 2:
        raise ModelError(
            f"n_directions = {n_directions}: it must be an even number and at least 4 (directions of the polyhedral friction cone); "
            "8 leaves an error of 7.6 % in friction, 16 one of 1.9 %"
        )
    half = np.arange(n_directions // 2)
    table = np.empty((n_directions, 4))
    for first, shift in ((D_X, 0.0), (N_X, 0.5)):
        angle = 2.0 * math.pi * (half + shift) / n_directions
        corners = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        table[:, first : first + 2] = np.concatenate([corners, -corners])  # opposite corners are so to the last bit
    return table


@kernel(inline=True)
def _edge(directions, x, y):
    """Edge through whose sector, seen from the centre, the point (x, y) lies."""
    best, most = np.int64(0), -math.inf
    for k in range(directions.shape[0]):
        across = directions[k, N_X] * x + directions[k, N_Y] * y
        if across > most:
            best, most = k, across
    return best, most


@kernel(inline=True)
def nearest(directions, radius, x, y):
    """Point of the polygon nearest to the point (x, y) [N.s]."""
    k, across = _edge(directions, x, y)
    n_x, n_y = directions[k, N_X], directions[k, N_Y]
    inner = radius * (directions[k, D_X] * n_x + directions[k, D_Y] * n_y)
    if across <= inner:
        return x, y
    # A regular polygon is its own mirror image about a line through a corner, so the nearest point is in the same sector.
    half = radius * (directions[k, D_X] * n_y - directions[k, D_Y] * n_x)
    along = max(-half, min(n_x * y - n_y * x, half))
    return inner * n_x - along * n_y, inner * n_y + along * n_x


@kernel(inline=True)
def least(directions, radius, a_xx, a_xy, a_yy, x, y, v_x, v_y):
    """Friction impulse q in the polygon that dissipates most at one contact.

    It minimises (q - p) A (q - p) / 2 + v (q - p), which makes 0 = v + A (q - p) + what the polygon's edges push, the conditions
    0 <= lambda_f _|_ D'v + E sigma >= 0, 0 <= sigma _|_ mu lambda_n - E'lambda_f >= 0 of Stewart & Trinkle 1996 for one contact.

    Args:
        directions: As :func:`friction_directions` gives them.
        radius: mu lambda_n [N.s], above 0.
        a_xx, a_xy, a_yy: A, the contact's own tangential mobility [1/kg], positive semidefinite and not 0.
        x, y: p, its friction impulse as it was [N.s].
        v_x, v_y: v, the tangential velocity with that impulse [m/s].

    Returns:
        q_x, q_y [N.s].
    """
    shift = _SHIFT * (a_xx + a_yy)
    a_xx, a_yy = a_xx + shift, a_yy + shift
    per = 1.0 / (a_xx * a_yy - a_xy * a_xy)
    free_x = x - per * (a_yy * v_x - a_xy * v_y)
    free_y = y - per * (a_xx * v_y - a_xy * v_x)
    k, across = _edge(directions, free_x, free_y)
    n_x, n_y = directions[k, N_X], directions[k, N_Y]
    if across <= radius * (directions[k, D_X] * n_x + directions[k, D_Y] * n_y):
        return free_x, free_y  # sticks
    # The edges that face the free minimum hold the solution, and along them the function falls, then rises: walk down, from one of them.
    n, turn = directions.shape[0], 0
    q_x = q_y = 0.0
    for _ in range(n):
        n_x, n_y, d_x, d_y = directions[k, N_X], directions[k, N_Y], directions[k, D_X], directions[k, D_Y]
        q_x, q_y = radius * d_x, radius * d_y
        slope_x = v_x + a_xx * (q_x - x) + a_xy * (q_y - y)
        slope_y = v_y + a_xy * (q_x - x) + a_yy * (q_y - y)
        fall = n_y * slope_x - n_x * slope_y
        bend = n_y * (a_xx * n_y - a_xy * n_x) - n_x * (a_xy * n_y - a_yy * n_x)
        length = 2.0 * radius * (d_x * n_y - d_y * n_x)
        if fall <= 0.0:
            if turn > 0:
                break  # falls towards this corner from both sides
            turn = -1
        else:
            along = min(fall / bend, length)
            q_x, q_y = q_x - along * n_y, q_y + along * n_x
            if along < length or turn < 0:
                break
            turn = 1
        k += turn
        if k < 0:
            k = n - 1
        elif k == n:
            k = 0
    return q_x, q_y
