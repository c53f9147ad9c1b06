"""Grousers of a wheel: bearing and shear on their tips, passive earth pressure on their faces, and the soil that they carry along.

They are lines finer than a cell: they leave no mark of their own, as loose soil closes behind them.
"""

from __future__ import annotations

import math

from ..bcm.loads import shear_radius
from ..slave.kernel import kernel
from ..strength import angle, escape, left_by_push, log_of_push, softened, yield_pressure
from ..terramechanics import flow_value, mohr_coulomb, rankine_wall, unit_weight
from ..unloading import pressure, unloading_of, unloading_stiffness
from .columns import D_Z, K_X, K_Y, K_Z, PUSHED_X, PUSHED_Y, add_force
from .density import bearing_gain, densification, friction, passive_gain
from .rim import attitude, damping_of, pushes
from .stress import mobilised, nodes_per_root, power, whole
from .tiles import BASE, COMPACTED, FILL, SHEAR_X, SHEAR_Y, SINKAGE, SLIP, STAMP, floor_depth, in_tile, nearest, row_of


@kernel
def dragged_layer(p):
    """Depth [m] of the layer that goes with a wheel's rim at its speed."""
    # Grains below the rim, whose speed falls linearly from the rim's to 0.
    grains = 0.5 * p.transport_depth
    if p.n_g == 0.0 or p.h_g == 0.0:
        return grains
    # Rankine's wedge ahead of each grouser, h_g high and h_g tan(pi/4 + phi/2) long; at most what lies between two of them.
    wedge = 0.5 * p.h_g**2 * math.sqrt(flow_value(p.phi))
    return grains + min(wedge * p.n_g / (2.0 * math.pi * (p.r_w + 0.5 * p.h_g)), p.h_g)


@kernel
def _pressure(p, strength, modulus, table, per_root, depth, floor, fill, soft, share):
    """Pressure [Pa] and its slope [Pa/m] at a depth [m] below the floor, see ``pressure`` and ``yield_pressure``."""
    dense = modulus * power(table, per_root, p.n, depth)
    plastic = yield_pressure(strength, dense, depth, fill, soft, share)
    return pressure(unloading_stiffness(unloading_of(p), depth, dense, floor), p.n, depth - floor, depth, plastic)


@kernel
def grousers(p, wheel, strength, density, modulus, tables, stamp, rows, grid, corner, sums):
    """Bearing and shear on the grousers' tips, passive earth pressure on their faces, strip by strip across the width."""
    T, r_0, v_0, w_0 = wheel.T, wheel.r_0, wheel.v_0, wheel.w_0
    level, h_x, h_y, tilt = attitude(wheel)
    v_x, v_z, w_y = v_0[0] * h_x + v_0[1] * h_y, v_0[2], w_0[1] * h_x - w_0[0] * h_y
    N_phi, damping = flow_value(p.phi), damping_of(p, wheel)
    per_root = nodes_per_root(p, tables[0])
    r_tip = p.r_w + p.h_g
    # Angle from nadir of the grouser along -z of the wheel frame, about the axle.
    up_x, up_y, up_z = tilt * h_y, -tilt * h_x, level
    first = math.atan2(-(T[2, 0] * h_x + T[2, 1] * h_y), T[2, 0] * up_x + T[2, 1] * up_y + T[2, 2] * up_z)
    pitch = 2.0 * math.pi / p.n_g
    strips = math.ceil(p.b_w / p.cell)
    width = p.b_w / strips
    interlocked = shear_radius(p, N_phi) > p.r_w
    gamma_s = unit_weight(p.rho, p.gravity, p.slope)
    forward = 1.0 if v_x >= 0.0 else -1.0
    for g in range(int(p.n_g)):
        theta = first + g * pitch
        cos, sin = math.cos(theta), math.sin(theta)
        if cos < 0.1:
            continue
        for s in range(strips):
            xi = (s + 0.5) * width - 0.5 * p.b_w
            # Tip in level axes: radius along (sin, down), axle along (level, tilt).
            x = r_tip * sin
            y = xi * level + r_tip * cos * tilt
            z = xi * tilt - r_tip * cos * level
            i = nearest(r_0[0] + x * h_x - y * h_y, p.cell)
            j = nearest(r_0[1] + x * h_y + y * h_x, p.cell)
            row = row_of(grid, corner, i, j)
            a, b = in_tile(i), in_tile(j)
            kept = rows[row, STAMP, a, b] == stamp - 1.0
            floor = floor_depth(rows, row, a, b)
            fill = rows[row, FILL, a, b]
            surface = rows[row, BASE, a, b] + fill - r_0[2]
            depth = surface - z
            if depth <= floor:
                continue
            compacted = rows[row, COMPACTED, a, b]
            tan_phi = friction(density, compacted, rows[row, SINKAGE, a, b])
            borne = modulus * bearing_gain(density, tan_phi)
            j_x, j_y, path = sums[PUSHED_X], sums[PUSHED_Y], math.hypot(sums[PUSHED_X], sums[PUSHED_Y])
            if kept:
                j_x, j_y, path = rows[row, SHEAR_X, a, b], rows[row, SHEAR_Y, a, b], rows[row, SLIP, a, b]
            ahead, across = pushes(p.K, h_x * forward, h_y * forward, j_x, j_y)
            logs = log_of_push(tables[1], ahead), log_of_push(tables[1], -ahead), log_of_push(tables[1], abs(across))
            left = left_by_push(strength, logs[0], logs[1], logs[2])
            share = escape(strength, forward * angle(sin, cos), forward * sin, left[0], left[1], left[2])
            soft = softened(strength, path)
            sigma, rise = _pressure(p, strength, borne, tables[0], per_root, depth, floor, fill, soft, share)
            u = v_x * cos + v_z * sin - w_y * r_tip
            m_x, m_y, _, secant = mobilised(p, j_x, j_y, u * h_x, u * h_y)
            m_t, m_l = m_x * h_x + m_y * h_y, m_y * h_x - m_x * h_y
            area = width * p.t_g
            f_n = sigma * damping * area
            stiffness = mohr_coulomb(p.c * min(damping, 1.0), sigma * damping, tan_phi) * area * secant
            f_t, f_l = -stiffness * m_t, -stiffness * m_l
            add_force(sums, x, y, z, f_t * cos - f_n * sin, f_l, f_t * sin + f_n * cos * level)
            if not interlocked:  # else the soil between the grousers turns with them
                rim = depth - p.h_g * cos * level
                wetted = min(max(depth - floor, 0.0), p.h_g * cos * level)
                # The face's top lies below undisturbed soil ahead of the wheel, below the pressed floor behind.
                over = max((depth if x > 0.0 else depth - floor) - wetted, 0.0)
                q = 0.0
                if p.kappa_q > 0.0 and rim > floor:
                    q = p.kappa_q * _pressure(p, strength, borne, tables[0], per_root, rim, floor, fill, soft, share)[0]
                N_here, gamma_here = N_phi * passive_gain(density, tan_phi), gamma_s * densification(density, compacted)
                passive = rankine_wall(gamma_here, wetted, over, q, p.c, N_here) * width * secant
                face = p.r_w + 0.5 * p.h_g
                add_force(sums, face * sin, y, -face * cos, -passive * m_t * cos, 0.0, -passive * m_t * sin)
                stiffness += passive
            sums[K_X] += whole(stiffness)
            sums[K_Y] += whole(stiffness)
            sums[K_Z] += whole(rise * damping * area)
            sums[D_Z] += whole(p.c_d * sigma * area)
