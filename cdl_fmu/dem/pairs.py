"""Forces between particles: Hertz-Mindlin or linear contacts with friction, rolling resistance and cohesion.

The pairs are worked on in blocks: a block's particles are gathered, its contacts computed in a loop that the compiler vectorises, and the
forces added to the particles. Rows of one array at constant distances tell the compiler that no row overlaps another.
"""

from __future__ import annotations

import math

import numpy as np

from ..slave.kernel import kernel
from .law import HALF, MASS, ONE, respond
from .particles import BUFFER, HISTORY, LENGTH, ROLL, SHEAR, SIDE, V_X, V_Y, V_Z, W_X, W_Y, W_Z, R, X, Y, Z
from .prefetch import prefetch
from .shape_pairs import add_shape_torques

#: How many pairs ahead particles are asked for, which come from memory in no order if a bed is large. Own choice, by speed.
AHEAD = 64

_L = np.uint64(LENGTH)
_ROWS = [np.uint64(row * LENGTH) for row in range(BUFFER)]
_D_X, _D_Y, _D_Z, _U_X, _U_Y, _U_Z, _A_X, _A_Y, _A_Z, _B_X, _B_Y, _B_Z, _R_A, _R_B = _ROWS
_SHEAR_X, _SHEAR_Y, _SHEAR_Z = (np.uint64((SHEAR + k) * LENGTH) for k in range(3))
_ROLL_X, _ROLL_Y, _ROLL_Z = (np.uint64((ROLL + k) * LENGTH) for k in range(3))


@kernel
def _contacts(first, last, start, law, buf, history):
    """Forces of the contacts first .. last - 1 of a block whose history begins at ``start``."""
    mass, half, one = law[MASS], law[HALF], law[ONE]
    zero = one - one
    for o in range(np.uint64(first), np.uint64(last)):
        d_x, d_y, d_z = buf[_D_X + o], buf[_D_Y + o], buf[_D_Z + o]
        r_a, r_b = buf[_R_A + o], buf[_R_B + o]
        distance = math.sqrt(d_x * d_x + d_y * d_y + d_z * d_z)
        overlap = r_a + r_b - distance
        touching = overlap > zero
        overlap = overlap if touching else zero
        inverse = one / distance
        n_x, n_y, n_z = d_x * inverse, d_y * inverse, d_z * inverse
        a3, b3 = r_a * r_a * r_a, r_b * r_b * r_b
        share = one / ((r_a + r_b) * (a3 + b3))
        r_eff, m_eff = r_a * r_b * (a3 + b3) * share, mass * a3 * b3 * (r_a + r_b) * share
        arm_a, arm_b = r_a - half * overlap, r_b - half * overlap
        u_x, u_y, u_z = buf[_U_X + o], buf[_U_Y + o], buf[_U_Z + o]
        wa_x, wa_y, wa_z = buf[_A_X + o], buf[_A_Y + o], buf[_A_Z + o]
        wb_x, wb_y, wb_z = buf[_B_X + o], buf[_B_Y + o], buf[_B_Z + o]
        u_n = u_x * n_x + u_y * n_y + u_z * n_z
        w_x, w_y, w_z = arm_a * wa_x + arm_b * wb_x, arm_a * wa_y + arm_b * wb_y, arm_a * wa_z + arm_b * wb_z
        u_t = (
            u_x - u_n * n_x - (w_y * n_z - w_z * n_y),
            u_y - u_n * n_y - (w_z * n_x - w_x * n_z),
            u_z - u_n * n_z - (w_x * n_y - w_y * n_x),
        )
        shear = history[start + _SHEAR_X + o], history[start + _SHEAR_Y + o], history[start + _SHEAR_Z + o]
        roll = history[start + _ROLL_X + o], history[start + _ROLL_Y + o], history[start + _ROLL_Z + o]
        w = wa_x - wb_x, wa_y - wb_y, wa_z - wb_z
        f_n, (t_x, t_y, t_z), (q_x, q_y, q_z), (x, y, z), (r_x, r_y, r_z), _, _ = respond(
            law, overlap, touching, r_eff, m_eff, (n_x, n_y, n_z), u_n, u_t, w, shear, roll
        )
        history[start + _SHEAR_X + o], history[start + _SHEAR_Y + o], history[start + _SHEAR_Z + o] = x, y, z
        history[start + _ROLL_X + o], history[start + _ROLL_Y + o], history[start + _ROLL_Z + o] = r_x, r_y, r_z
        # The tangential force's arm is against the normal on the first particle, along it on the second.
        c_x, c_y, c_z = t_y * n_z - t_z * n_y, t_z * n_x - t_x * n_z, t_x * n_y - t_y * n_x
        buf[_A_X + o], buf[_A_Y + o], buf[_A_Z + o] = arm_a * c_x + q_x, arm_a * c_y + q_y, arm_a * c_z + q_z
        buf[_B_X + o], buf[_B_Y + o], buf[_B_Z + o] = arm_b * c_x - q_x, arm_b * c_y - q_y, arm_b * c_z - q_z
        buf[_D_X + o], buf[_D_Y + o], buf[_D_Z + o] = f_n * n_x + t_x, f_n * n_y + t_y, f_n * n_z + t_z


@kernel
def slab_forces(grains, law, slab):
    """Add the forces of the pairs whose first particle is in this slab; the second is in it or in the next."""
    side = grains.count[SIDE]
    body, first, partner, history = grains.body[side], grains.first[side], grains.partner[side], grains.history[side]
    force, buf = grains.force, grains.blocks[slab]
    half_x, half_y = 0.5 * grains.periods[0], 0.5 * grains.periods[1]
    i, last = grains.slabs[slab], grains.slabs[slab + 1]
    k, end, room = first[i], first[last], len(partner) - 1
    while k < end:
        block = k // LENGTH
        begin = k - block * LENGTH
        stop = min(end - block * LENGTH, LENGTH)
        next_block = np.uint64((block + 1) * HISTORY * LENGTH)
        # Gather: i is the particle that pair k belongs to.
        here, pair = i, k
        o, to = np.uint64(begin), np.uint64(stop)
        while o < to:
            while first[here + 1] <= pair:
                here += 1
            a = body[np.uint64(here)]
            x, y, z, r = a[X], a[Y], a[Z], a[R]
            u_x, u_y, u_z, w_x, w_y, w_z = a[V_X], a[V_Y], a[V_Z], a[W_X], a[W_Y], a[W_Z]
            until = min(np.uint64(first[here + 1] - block * LENGTH), to)
            for q in range(o, until):
                b = np.uint64(partner[np.uint64(pair)])
                soon = np.uint64(partner[np.uint64(min(pair + AHEAD, room))])
                prefetch(body, soon, 0)
                prefetch(body, soon, 64)
                prefetch(force, soon, 0)
                prefetch(history, next_block + np.uint64(HISTORY) * q, 0)
                pair += 1
                d_x, d_y = x - body[b, X], y - body[b, Y]
                if half_x > 0.0:
                    d_x -= math.copysign(2.0 * half_x, d_x) if abs(d_x) > half_x else 0.0
                if half_y > 0.0:
                    d_y -= math.copysign(2.0 * half_y, d_y) if abs(d_y) > half_y else 0.0
                buf[_D_X + q], buf[_D_Y + q], buf[_D_Z + q] = d_x, d_y, z - body[b, Z]
                buf[_U_X + q], buf[_U_Y + q], buf[_U_Z + q] = u_x - body[b, V_X], u_y - body[b, V_Y], u_z - body[b, V_Z]
                buf[_A_X + q], buf[_A_Y + q], buf[_A_Z + q] = w_x, w_y, w_z
                buf[_B_X + q], buf[_B_Y + q], buf[_B_Z + q] = body[b, W_X], body[b, W_Y], body[b, W_Z]
                buf[_R_A + q], buf[_R_B + q] = r, body[b, R]
            o = until
        _contacts(begin, stop, np.uint64(block * HISTORY * LENGTH), law, buf, history)
        if grains.orientation.shape[1] > 0:
            add_shape_torques(grains, law, i, k, begin, stop, buf)
        # Add to the particles.
        pair, o = k, np.uint64(begin)
        while o < to:
            while first[i + 1] <= pair:
                i += 1
            f_x = f_y = f_z = t_x = t_y = t_z = 0.0
            until = min(np.uint64(first[i + 1] - block * LENGTH), to)
            for q in range(o, until):
                b = np.uint64(partner[np.uint64(pair)])
                pair += 1
                x, y, z = buf[_D_X + q], buf[_D_Y + q], buf[_D_Z + q]
                f_x += x
                f_y += y
                f_z += z
                t_x += buf[_A_X + q]
                t_y += buf[_A_Y + q]
                t_z += buf[_A_Z + q]
                force[b, 0] -= x
                force[b, 1] -= y
                force[b, 2] -= z
                force[b, 3] += buf[_B_X + q]
                force[b, 4] += buf[_B_Y + q]
                force[b, 5] += buf[_B_Z + q]
            a = np.uint64(i)
            force[a, 0] += f_x
            force[a, 1] += f_y
            force[a, 2] += f_z
            force[a, 3] += t_x
            force[a, 4] += t_y
            force[a, 5] += t_z
            o = until
        k = pair
