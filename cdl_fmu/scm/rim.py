"""Pressure and shear below a wheel's rim, for a block of cells at once: branch-free loops over columns.

Compilers turn such loops into vector instructions, which halves the cost of a step. A block is a record whose columns have a fixed length,
so that their places in memory are known when the loops are compiled.
"""

from __future__ import annotations

import math

import numpy as np

from ..bcm.loads import shear_radius
from ..slave.kernel import kernel
from ..strength import angle, escape, exponential, left_by_push, log_of_push, softened, yield_pressure
from ..terramechanics import flow_value
from ..unloading import pressure, unloading_of, unloading_stiffness
from .density import bearing_gain, friction
from .stress import counted, power, remembered, secant_share, whole
from .tiles import POINTS

#: Cells in a block: a multiple of a vector's length, and no power of two, whose columns would compete for the same lines of the cache.
BLOCK = 120

#: Forces [N] and torques [N.m] of a cell on the wheel, stiffness [N/m] and damping [N s/m], in the order of the sums of a tool.
FORCES = ("f_x", "f_y", "f_z", "t_x", "t_y", "t_z", "k_xy", "k_z", "d_z")
_COLUMNS = (
    # What is known of a cell: its tile's row and place there; its place along and across the heading [m], share that the rim covers [1],
    # height of the axle above the wheel's centre there [m]; the soil's surface relative to that centre [m], its fill [m], and its shear
    # displacement in world axes and its path of slip [m], updated.
    *("row", "a", "b", "along", "across", "cover", "lift", "surface", "fill", "j_x", "j_y", "path"),
    # Height by which the soil was compacted, its plastic sinkage [m]; its tan(phi), pressure that it bears over what plates measured.
    *("compacted", "sinkage", "friction", "firm"),
    # Share of its way to the critical state; mobilised shares of friction that push soil ahead and across (left); shares of strength
    # that the push leaves ahead, behind and beside.
    *("soft", "push_ahead", "push_across", "ahead", "behind", "beside"),
    # What its points sum to: pressure [Pa], its moment [Pa.m], floors [m], stiffness [Pa/m], push along [Pa], torque [Pa.m].
    *("total", "moment", "floors", "stiffness", "push", "torque"),
    *FORCES,
    # Velocity of the rim against the soil in world axes [m/s], mobilised share of the strength [1].
    *("u_x", "u_y", "share"),
    # Of the points that are worked on: depth [m], at least what counts as one, and its power.
    *("depth", "positive", "power"),
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
_SHALLOWEST = 1e-4  # [m] instead of less, and of depths below 0, whose pressure does not count: powers are tabulated there
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


@kernel(inline=True)
def pushes(K, d_x, d_y, j_x, j_y):
    """Mobilised shares of friction that push soil along the direction d and across it, to the left, after a shear displacement j [m]."""
    j = math.sqrt(j_x * j_x + j_y * j_y)
    secant = secant_share(K, j, 1.0 - exponential(-j * (1.0 / K)))
    return secant * (j_x * d_x + j_y * d_y), secant * (j_y * d_x - j_x * d_y)


@kernel
def press_and_shear(p, wheel, n, strength, density, modulus, tables, per_root, h, block):
    """What the first n cells of a block do to the wheel, and the wheel to them.

    Args:
        modulus: k of the pressure law [N/m^(n+2)].
        strength, density: See ``strength_of`` and ``density_of``.
        tables, per_root: Powers of the depth and what pushes leave, see ``wheel_contact``; nodes of the powers per root of depth.
        h: Length of the step [s].
    """
    level, h_x, h_y, _ = attitude(wheel)
    per_level = 1.0 / level
    forward = 1.0 if wheel.v_0[0] * h_x + wheel.v_0[1] * h_y >= 0.0 else -1.0
    K, f_x, f_y = p.K, forward * h_x, forward * h_y
    for m in range(n):
        ahead, across = pushes(K, f_x, f_y, block.j_x[m], block.j_y[m])
        block.push_ahead[m], block.push_across[m] = ahead, forward * across
        block.soft[m] = softened(strength, block.path[m])
    if density.per_void > 0.0:  # else the same, at no cost
        for m in range(n):
            block.friction[m] = friction(density, block.compacted[m], block.sinkage[m])
            block.firm[m] = bearing_gain(density, block.friction[m])
    else:
        for m in range(n):
            block.friction[m], block.firm[m] = density.tan_phi, 1.0
    for m in range(n):
        ahead, across = block.push_ahead[m], block.push_across[m]
        logs = log_of_push(tables[1], ahead), log_of_push(tables[1], -ahead), log_of_push(tables[1], abs(across))
        block.ahead[m], block.behind[m], block.beside[m] = left_by_push(strength, logs[0], logs[1], logs[2])
    for m in range(n):
        block.total[m] = block.moment[m] = block.floors[m] = block.stiffness[m] = block.push[m] = block.torque[m] = 0.0
    unloading = unloading_of(p)
    for k in range(POINTS):
        offset = (k + 0.5) * p.cell / POINTS - 0.5 * p.cell
        _depths(n, offset, p.r_w, per_level, block)
        for m in range(n):
            block.power[m] = power(tables[0], per_root, p.n, block.positive[m])
        _pressures(n, k, offset, (p.r_w, p.n, per_level, forward, modulus), strength, unloading, block)
    v_0, w_0, reach = wheel.v_0, wheel.w_0, shear_radius(p, flow_value(p.phi)) / p.r_w
    _velocities(
        n,
        (v_0[0] * h_x + v_0[1] * h_y, v_0[1] * h_x - v_0[0] * h_y, v_0[2]),
        (w_0[0] * h_x + w_0[1] * h_y, w_0[1] * h_x - w_0[0] * h_y, w_0[2]),
        (h_x, h_y, per_level, p.r_w, reach, K, p.tau_r, h),
        block,
    )
    for m in range(n):
        block.share[m] = 1.0 - exponential(-block.length[m] * (1.0 / K))
    damping, area = damping_of(p, wheel), p.cell * p.cell
    cohesion = p.c * min(damping, 1.0) * area
    _forces(n, (h_x, h_y, 1.0 / p.r_w, reach, K, cohesion, area / POINTS, damping, p.c_d), block)


@kernel
def _depths(n, offset, r, per_level, block):
    """Depths of a point of each cell, ``offset`` [m] from its node along the heading."""
    least = (1.0 - STEEPEST**2) * r * r
    for m in range(n):
        x = block.along[m] + offset
        depth = block.surface[m] - (block.lift[m] - math.sqrt(max(r * r - x * x, least))) * per_level
        block.depth[m] = depth
        block.positive[m] = max(depth, _SHALLOWEST)


@kernel
def _pressures(n, k, offset, constants, strength, unloading, block):
    """Add the pressure of point k of each cell."""
    r, law_n, per_level, forward, modulus = constants
    per_r = 1.0 / r
    least = (1.0 - STEEPEST**2) * r * r
    for m in range(n):
        x = block.along[m] + offset
        square = r * r - x * x
        root = math.sqrt(max(square, least))
        z = (block.lift[m] - root) * per_level
        depth, before = block.depth[m], block.before[k, m]
        positive, dense = block.positive[m], modulus * block.power[m] * block.firm[m]
        sin = forward * x * per_r
        share = escape(strength, angle(sin, root * per_r), sin, block.ahead[m], block.behind[m], block.beside[m])
        plastic = yield_pressure(strength, dense, positive, block.fill[m], block.soft[m], share)
        k_u = unloading_stiffness(unloading, positive, dense, before)
        sigma, rise = pressure(k_u, law_n, depth - before, positive, plastic)
        pressed = square > least and depth > before
        sigma = sigma if pressed else 0.0
        after = max(before, depth - sigma / k_u) if pressed else before
        # Pressure of the side below a tilted rim cancels its push across, as in BCM: no force across.
        push = -sigma * x / root * per_level
        block.after[k, m] = after
        block.floors[m] += after
        block.total[m] += sigma
        block.moment[m] += sigma * x
        block.stiffness[m] += rise if pressed else 0.0
        block.push[m] += push
        block.torque[m] += z * push - x * sigma


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
        block.path[m] += h * math.sqrt(u_1 * u_1 + u_2 * u_2)
        block.m_x[m], block.m_y[m], block.length[m] = counted(tau_r, j_x, j_y, u_1, u_2)


@kernel
def _forces(n, constants, block):
    """Pressure and shear of each cell as forces on the wheel."""
    h_x, h_y, per_r, reach, K, cohesion, area, damping, c_d = constants
    l_x, l_y = -h_y, h_x
    for m in range(n):
        x, z, cos, across, cover = block.x[m], block.z[m], block.cos[m], block.across[m], block.cover[m]
        point = cover * area
        pressed, sin = point * damping, x * per_r
        f_z = pressed * block.total[m]
        strength = (cohesion * cover + f_z * block.friction[m]) / cos  # Eq. (8.7)
        drag = strength * secant_share(K, block.length[m], block.share[m])
        m_x, m_y = block.m_x[m], block.m_y[m]
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
