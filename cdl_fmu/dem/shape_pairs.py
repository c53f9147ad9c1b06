"""Torques of rotation geometries in the contacts between particles, in blocks as in ``pairs``."""

from __future__ import annotations

import math

import numpy as np

from ..slave.kernel import kernel
from .law import PULL, RETURNED
from .particles import A_X, B_X, D_X, LENGTH, Q_A, Q_B, R_A, R_B, SIDE, TURNING, U_X, W_X, W_Y, W_Z, X, Y, Z
from .shape import acting, shape_torque

_F_X, _F_Y, _F_Z = (np.uint64((D_X + k) * LENGTH) for k in range(3))
_D_X, _D_Y, _D_Z = (np.uint64((U_X + k) * LENGTH) for k in range(3))
_A_X, _A_Y, _A_Z = (np.uint64((A_X + k) * LENGTH) for k in range(3))
_B_X, _B_Y, _B_Z = (np.uint64((B_X + k) * LENGTH) for k in range(3))
_R_A, _R_B = np.uint64(R_A * LENGTH), np.uint64(R_B * LENGTH)
_A_0, _A_1, _A_2, _A_3 = (np.uint64((Q_A + k) * LENGTH) for k in range(4))
_B_0, _B_1, _B_2, _B_3 = (np.uint64((Q_B + k) * LENGTH) for k in range(4))
_W_X, _W_Y, _W_Z = (np.uint64((TURNING + k) * LENGTH) for k in range(3))


@kernel
def add_shape_torques(grains, law, i, pair, begin, stop, buf):
    """Add them to the torques of a block's contacts, once its forces are known.

    Args:
        grains: The bed.
        law: Contact law, [LAW].
        i: First particle of the block's first contact.
        pair: Number of that contact.
        begin, stop: The block's contacts, places in its rows.
        buf: The block's memory.
    """
    side = grains.count[SIDE]
    body, orientation = grains.body[side], grains.orientation[side]
    first, partner = grains.first[side], grains.partner[side]
    half_x, half_y = 0.5 * grains.periods[0], 0.5 * grains.periods[1]
    for o in range(np.uint64(begin), np.uint64(stop)):
        while first[i + 1] <= pair:
            i += 1
        a, b = np.uint64(i), np.uint64(partner[np.uint64(pair)])
        pair += 1
        d_x, d_y = body[a, X] - body[b, X], body[a, Y] - body[b, Y]
        if half_x > 0.0:
            d_x -= math.copysign(2.0 * half_x, d_x) if abs(d_x) > half_x else 0.0
        if half_y > 0.0:
            d_y -= math.copysign(2.0 * half_y, d_y) if abs(d_y) > half_y else 0.0
        buf[_D_X + o], buf[_D_Y + o], buf[_D_Z + o] = d_x, d_y, body[a, Z] - body[b, Z]
        buf[_W_X + o], buf[_W_Y + o] = body[a, W_X] - body[b, W_X], body[a, W_Y] - body[b, W_Y]
        buf[_W_Z + o] = body[a, W_Z] - body[b, W_Z]
        q = orientation[a]
        buf[_A_0 + o], buf[_A_1 + o], buf[_A_2 + o], buf[_A_3 + o] = q[0], q[1], q[2], q[3]
        q = orientation[b]
        buf[_B_0 + o], buf[_B_1 + o], buf[_B_2 + o], buf[_B_3 + o] = q[0], q[1], q[2], q[3]
    _add_torques(begin, stop, grains.figure, law, buf)


@kernel
def _add_torques(begin, stop, figure, law, buf):
    """Add the torques of contacts begin .. stop - 1."""
    pull, returned = law[PULL], law[RETURNED]
    zero = pull - pull
    for o in range(np.uint64(begin), np.uint64(stop)):
        d_x, d_y, d_z = buf[_D_X + o], buf[_D_Y + o], buf[_D_Z + o]
        inverse = 1.0 / math.sqrt(d_x * d_x + d_y * d_y + d_z * d_z)
        n_x, n_y, n_z = d_x * inverse, d_y * inverse, d_z * inverse
        f_n = buf[_F_X + o] * n_x + buf[_F_Y + o] * n_y + buf[_F_Z + o] * n_z
        r_eff = buf[_R_A + o] * buf[_R_B + o] / (buf[_R_A + o] + buf[_R_B + o])
        moment = r_eff * (f_n + pull * r_eff * r_eff)  # a pull has no lever
        moment = moment if moment > 0.0 and f_n != 0.0 else zero
        w_x, w_y, w_z = buf[_W_X + o], buf[_W_Y + o], buf[_W_Z + o]
        q = buf[_A_0 + o], buf[_A_1 + o], buf[_A_2 + o], buf[_A_3 + o]
        a_x, a_y, a_z = acting(shape_torque(figure, q, (n_x, n_y, n_z)), (w_x, w_y, w_z), returned)
        q = buf[_B_0 + o], buf[_B_1 + o], buf[_B_2 + o], buf[_B_3 + o]
        b_x, b_y, b_z = acting(shape_torque(figure, q, (-n_x, -n_y, -n_z)), (-w_x, -w_y, -w_z), returned)
        t_x, t_y, t_z = moment * (a_x - b_x), moment * (a_y - b_y), moment * (a_z - b_z)
        buf[_A_X + o] += t_x
        buf[_A_Y + o] += t_y
        buf[_A_Z + o] += t_z
        buf[_B_X + o] -= t_x
        buf[_B_Y + o] -= t_y
        buf[_B_Z + o] -= t_z
