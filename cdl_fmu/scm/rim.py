"""Pressure and shear below a wheel's rim, for a block of cells at once: branch-free loops over columns.

Compilers turn such loops into vector instructions, which halves the cost of a step. A block is a record whose columns have a fixed length,
so that their places in memory are known when the loops are compiled.
"""

from __future__ import annotations

import math

import numpy as np

from ..bcm.loads import shear_radius
from ..slave.kernel import kernel
from ..terramechanics import flow_value, janosi_displacement
from .stress import bearing_depth, counted, power, pressure, remembered, secant_share, whole
from .tiles import POINTS

#: Cells in a block: a multiple of a vector's length, and no power of two, whose columns would compete for the same lines of the cache.
BLOCK = 120

#: Forces [N] and torques [N.m] of a cell on the wheel, stiffness [N/m] and damping [N s/m], in the order of the sums of a tool.
FORCES = ("f_x", "f_y", "f_z", "t_x", "t_y", "t_z", "k_xy", "k_z", "d_z")
_COLUMNS = (
    # What is known of a cell: its tile's row and place there; its place along and across the heading [m], share that the rim covers [1],
    # height of the axle above the wheel's centre there [m]; the soil's surface relative to that centre [m], its fill [m], and its shear
    # displacement in world axes [m], updated.
    *("row", "a", "b", "along", "across", "cover", "lift", "surface", "fill", "j_x", "j_y", "slip"),
    *("soft", "lean", "side"),
    # What its points sum to: pressure [Pa], its moment [Pa.m], floors [m], stiffness [Pa/m], push along [Pa], torque [Pa.m].
    *("total", "moment", "floors", "stiffness", "push", "torque"),
    *FORCES,
    # Velocity of the rim against the soil in world axes [m/s], mobilised share of the strength [1].
    *("u_x", "u_y", "share"),
    # Of the points that are worked on: depth [m], the depth that counts [m], its power.
    *("depth", "bearing", "power"),
    # Of the shear: where the pressure acts along [m] and height of the rim there [m], cosine of its slope, displacement that counts [m].
    *("x", "z", "cos", "m_x", "m_y", "length"),
)
DTYPE = np.dtype(
    [(name, np.float64, (BLOCK,)) for name in _COLUMNS]
    # Plastic sinkage [m] of each point before and after.
    + [(name, np.float64, (POINTS, BLOCK)) for name in ("before", "after")]
)

#: Share of the radius up to which the rim counts as a lower surface.
STEEPEST = 0.995
_SHALLOWEST = 1e-12  # [m] instead of depths below 0, whose pressure does not count
_LEAST = 1e-300  # [Pa] instead of no pressure, where one is divided by it


@kernel(inline=True)
def attitude(wheel):
    """Cosine of the camber, heading (horizontal unit vector, x and y), and rise of the axle to the left."""
    T = wheel.T
    level = math.sqrt(T[1, 0] * T[1, 0] + T[1, 1] * T[1, 1])
    return level, T[1, 1] / level, -T[1, 0] / level, T[1, 2]


@kernel(inline=True)
def damping_of(p, wheel):
    """Factor of the pressure by the speed at which the wheel sinks (Hunt & Crossley 1975, as in BCM)."""
    return max(0.0, 1.0 - p.c_d * wheel.v_0[2])


@kernel
def press_and_shear(p, wheel, n, modulus, table, per_spacing, h, long, block):
    """What the first n cells of a block do to the wheel, and the wheel to them.

    Args:
        modulus: k of the pressure law [N/m^(n+2)].
        table, per_spacing: Powers of the depth, see ``tabulate``, and their nodes per metre.
        h: Length of the step [s].
    """
    level, h_x, h_y, _ = attitude(wheel)
    per_level = 1.0 / level
    for m in range(n):
        block.total[m] = block.moment[m] = block.floors[m] = block.stiffness[m] = block.push[m] = block.torque[m] = 0.0
    tan_phi = math.tan(p.phi)
    forward = 1.0 if (wheel.v_0[0] * h_x + wheel.v_0[1] * h_y) >= 0.0 else -1.0
    for m in range(n):
        j = math.sqrt(block.j_x[m] ** 2 + block.j_y[m] ** 2)
        share = 1.0 - math.exp(-j / p.K)
        block.soft[m] = 1.0 - math.exp(-block.slip[m] / p.e[0]) if p.e[0] > 0.0 else 0.0
        block.side[m] = share * tan_phi * abs(block.j_y[m] * h_x - block.j_x[m] * h_y) / max(j, 1e-12)
        block.lean[m] = forward * share * tan_phi * (block.j_x[m] * h_x + block.j_y[m] * h_y) / max(j, 1e-12)
    sin_phi = math.sin(p.phi)
    N_q = flow_value(p.phi) * math.exp(math.pi * tan_phi)
    N_g = p.e[4]
    b_, l_ = min(p.b_w, long), max(p.b_w, long)
    ratio = b_ / max(l_, 1e-9)
    surcharge = p.rho * p.gravity * N_q * (1.0 + ratio * tan_phi)
    d_q = 2.0 * tan_phi * (1.0 - sin_phi) ** 2
    weight = 0.5 * p.rho * p.gravity * b_ * N_g * (1.0 - 0.4 * ratio)
    m_l = 0.5 * (2.0 + long / p.b_w) / (1.0 + long / p.b_w)
    m_b = 0.5 * (2.0 + p.b_w / max(long, 1e-9)) / (1.0 + p.b_w / max(long, 1e-9))
    for k in range(POINTS):
        offset = (k + 0.5) * p.cell / POINTS - 0.5 * p.cell
        _depths(n, offset, p.r_w, per_level, p.mound_strength, block)
        for m in range(n):
            block.power[m] = power(table, per_spacing, p.n, block.bearing[m])
        _pressures(n, k, offset, p.r_w, per_level, modulus, p.k_e, p.n, (forward, tan_phi, sin_phi, surcharge, d_q, weight, max(b_, 1e-9), (p.e[3], p.e[5], p.e[6], p.e[7], p.e[8], m_l, m_b, p.e[12])), block)
    v_0, w_0, reach = wheel.v_0, wheel.w_0, shear_radius(p, flow_value(p.phi)) / p.r_w
    _velocities(
        n,
        (v_0[0] * h_x + v_0[1] * h_y, v_0[1] * h_x - v_0[0] * h_y, v_0[2]),
        (w_0[0] * h_x + w_0[1] * h_y, w_0[1] * h_x - w_0[0] * h_y, w_0[2]),
        (h_x, h_y, per_level, p.r_w, reach, p.K, p.tau_r, h),
        block,
    )
    for m in range(n):
        block.share[m] = janosi_displacement(block.length[m], p.K)
    damping, area = damping_of(p, wheel), p.cell * p.cell
    cohesion = p.c * min(damping, 1.0) * area
    _forces(n, (forward, p.e[11] * (0.25 * math.pi - 0.5 * p.phi)), (h_x, h_y, 1.0 / p.r_w, reach, p.K, math.tan(p.phi), cohesion, area / POINTS, damping, p.c_d), block)


@kernel
def _depths(n, offset, r, per_level, mound_strength, block):
    """Depths of a point of each cell, ``offset`` [m] from its node along the heading."""
    least = (1.0 - STEEPEST**2) * r * r
    for m in range(n):
        x = block.along[m] + offset
        depth = block.surface[m] - (block.lift[m] - math.sqrt(max(r * r - x * x, least))) * per_level
        block.depth[m] = depth
        block.bearing[m] = max(bearing_depth(mound_strength, depth, block.fill[m]), _SHALLOWEST)


@kernel
def _pressures(n, k, offset, r, per_level, modulus, k_e, exponent, cs, block):
    """Add the pressure of point k of each cell."""
    least, per_k_e = (1.0 - STEEPEST**2) * r * r, 1.0 / k_e
    for m in range(n):
        x = block.along[m] + offset
        square = r * r - x * x
        root = math.sqrt(max(square, least))
        z = (block.lift[m] - root) * per_level
        depth, before = block.depth[m], block.before[k, m]
        p_B = modulus * block.power[m]
        forward, tan_phi, sin_phi, surcharge, d_q, weight, b_, es = cs
        a, tilt_share, half, rear, lateral, m_l, m_b, e11 = es
        f = 1.0
        theta = math.asin(max(-1.0, min(forward * x / r, 1.0)))
        if a > 0.0:
            lean = block.lean[m]
            if False:
                lean *= upward(theta, e11)
            f = min(1.0, (inclined(tan_phi, sin_phi, -lean) * math.exp(-tilt_share * tan_phi * theta)) ** (a * m_l))
            if rear > 0.0:
                f = min(f, (inclined(tan_phi, sin_phi, block.lean[m]) * math.exp(e11 * tan_phi * theta)) ** (rear * a * m_l))
            if lateral > 0.0:
                f = min(f, inclined(tan_phi, sin_phi, -block.side[m]) ** (lateral * a * m_b))
        soft = block.soft[m]
        g = block.bearing[m]
        p_cs = min(p_B, surcharge * g * (1.0 + d_q * (g / b_ if g < b_ else math.atan(g / b_))) + weight)
        plastic = (1.0 - soft) * p_B * f ** half + soft * p_cs * f
        sigma, rise = pressure(k_e, exponent, depth - before, block.bearing[m], plastic)
        pressed = square > least and depth > before
        sigma = sigma if pressed else 0.0
        after = max(before, depth - sigma * per_k_e) if pressed else before
        # Pressure of the side below a tilted rim cancels its push across, as in BCM: no force across.
        push = -sigma * x / root * per_level
        block.after[k, m] = after
        block.floors[m] += after
        block.total[m] += sigma
        block.moment[m] += sigma * x
        block.stiffness[m] += rise if pressed else 0.0
        block.push[m] += push
        block.torque[m] += z * push - x * sigma


@kernel(inline=True)
def upward(theta, theta_w):
    return math.cos(max(0.0, min(0.5 * math.pi * theta / theta_w, math.pi)))


@kernel(inline=True)
def inclined(tan_phi, sin_phi, push):
    phi, delta = math.atan(tan_phi), math.atan(push)
    two_m = math.acos(max(-1.0, min(1.0, math.sin(delta) / sin_phi))) - phi - delta
    return (1.0 + sin_phi * math.sin(two_m + phi)) / (1.0 + sin_phi) * math.exp((0.5 * math.pi - phi - two_m) * tan_phi)


@kernel
def _velocities(n, v, w, constants, block):
    """Velocity of the rim against each cell, along its tangent and along the axle, and the shear displacement that follows.

    Args:
        v, w: Velocity [m/s] and angular velocity [rad/s] of the wheel along, across and up.
    """
    v_x, v_y, v_z = v
    w_x, w_y, w_z = w
    h_x, h_y, per_level, r, reach, K, tau_r, h = constants
    l_x, l_y, per_r = -h_y, h_x, 1.0 / r
    for m in range(n):
        across = block.across[m]
        x = block.moment[m] / max(block.total[m], _LEAST)
        sin = x * per_r
        cos = math.sqrt(1.0 - sin * sin)
        z = (block.lift[m] - r * cos) * per_level
        u_x, u_z = v_x + reach * (w_y * z - w_z * across), v_z + reach * (w_x * across - w_y * x)
        u_t, u_l = u_x * cos + u_z * sin, v_y + w_z * x - w_x * z
        u_1, u_2 = u_t * h_x + u_l * l_x, u_t * h_y + u_l * l_y
        j_x, j_y = remembered(K, block.j_x[m] + h * u_1, block.j_y[m] + h * u_2)
        block.x[m], block.z[m], block.cos[m] = x, z, cos
        block.u_x[m], block.u_y[m], block.j_x[m], block.j_y[m] = u_1, u_2, j_x, j_y
        block.slip[m] += h * math.sqrt(u_1 * u_1 + u_2 * u_2)
        block.m_x[m], block.m_y[m], block.length[m] = counted(tau_r, j_x, j_y, u_1, u_2)


@kernel
def _forces(n, up, constants, block):
    """Pressure and shear of each cell as forces on the wheel."""
    h_x, h_y, per_r, reach, K, tan_phi, cohesion, area, damping, c_d = constants
    l_x, l_y = -h_y, h_x
    for m in range(n):
        x, z, cos, across, cover = block.x[m], block.z[m], block.cos[m], block.across[m], block.cover[m]
        point = cover * area
        pressed, sin = point * damping, x * per_r
        f_z = pressed * block.total[m]
        strength = (cohesion * cover + f_z * tan_phi) / cos  # Eq. (8.7)
        drag = strength * secant_share(K, block.length[m], block.share[m])
        m_x, m_y = block.m_x[m], block.m_y[m]
        if up[1] > 0.0 and up[0] * (m_x * h_x + m_y * h_y) > 0.0 and up[0] * sin > 0.0:
            along = (m_x * h_x + m_y * h_y) * (upward(math.asin(min(1.0, up[0] * sin)), up[1]) - 1.0)
            m_x, m_y = m_x + along * h_x, m_y + along * h_y
        f_t, f_l = -drag * (m_x * h_x + m_y * h_y), -drag * (m_x * l_x + m_y * l_y)
        s_x, s_z = f_t * cos, f_t * sin
        f_x = pressed * block.push[m]
        block.f_x[m] = whole(f_x + s_x)
        block.f_y[m] = whole(f_l)
        block.f_z[m] = whole(f_z + s_z)
        block.t_x[m] = whole(across * (f_z + s_z) - reach * z * f_l)
        block.t_y[m] = whole(pressed * block.torque[m] + reach * (z * s_x - x * s_z))
        block.t_z[m] = whole(reach * x * f_l - across * (f_x + s_x))
        block.k_xy[m] = whole(drag)
        block.k_z[m] = whole(pressed * block.stiffness[m])
        block.d_z[m] = whole(c_d * point * block.total[m])
