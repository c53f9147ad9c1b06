"""Torques of rotation geometries in the contacts between particles."""

from __future__ import annotations

import math

import numpy as np

from ..slave.kernel import kernel
from .law import PULL
from .particles import LENGTH, SIDE, R, X, Y, Z
from .shape import shape_torque

_L = np.uint64(LENGTH)


@kernel
def add_shape_torques(grains, law, i, pair, begin, stop, force, torque_a, torque_b):
    """Add them to the torques of a block's contacts, once its forces are known.

    Args:
        grains: The bed.
        law: Contact law, [LAW].
        i: First particle of the block's first contact.
        pair: Number of that contact.
        begin, stop: The block's contacts, places in its rows.
        force, torque_a, torque_b: Blocks of three rows each: force on the first particle [N], torque on the first and on the second [N.m].
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
        f_x, f_y, f_z = force[o], force[o + _L], force[o + _L + _L]
        if f_x == f_y == f_z == 0.0:
            continue
        d_x, d_y, d_z = body[a, X] - body[b, X], body[a, Y] - body[b, Y], body[a, Z] - body[b, Z]
        if half_x > 0.0:
            d_x -= math.copysign(2.0 * half_x, d_x) if abs(d_x) > half_x else 0.0
        if half_y > 0.0:
            d_y -= math.copysign(2.0 * half_y, d_y) if abs(d_y) > half_y else 0.0
        inverse = 1.0 / math.sqrt(d_x * d_x + d_y * d_y + d_z * d_z)
        n_x, n_y, n_z = d_x * inverse, d_y * inverse, d_z * inverse
        r_eff = body[a, R] * body[b, R] / (body[a, R] + body[b, R])
        moment = r_eff * (f_x * n_x + f_y * n_y + f_z * n_z + law[PULL] * r_eff * r_eff)  # a pull has no lever
        if moment <= 0.0:
            continue
        a_x, a_y, a_z = shape_torque(grains.figure, orientation[a], n_x, n_y, n_z)
        b_x, b_y, b_z = shape_torque(grains.figure, orientation[b], -n_x, -n_y, -n_z)
        t_x, t_y, t_z = moment * (a_x - b_x), moment * (a_y - b_y), moment * (a_z - b_z)
        torque_a[o] += t_x
        torque_a[o + _L] += t_y
        torque_a[o + _L + _L] += t_z
        torque_b[o] -= t_x
        torque_b[o + _L] -= t_y
        torque_b[o + _L + _L] -= t_z
