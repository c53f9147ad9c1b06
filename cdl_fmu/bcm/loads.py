"""Loads of the soil on a rigid wheel above a plane: rim, grousers and side faces.

All are resolved at the wheel's centre in the wheel's axes: x along the heading in the plane, a along the axle (to the left),
r = x cross a, away from the soil. The plane's normal has the components (0, sin_g, cos_g) there, g being the camber.
``d`` is the height of the centre above the plane [m]. Velocities are the wheel's relative to the soil.

Own choice: on a cambered wheel the low side face bears the pressure of the rim beside it, sigma tan(g) cos(theta) per rim area
along the axle. A pressure that depends on depth alone then has no resultant along the plane, as it must (divergence theorem),
and a wheel beside the middle of a rut is pushed back.
"""

from __future__ import annotations

import math

import numpy as np

from ..contact import SLIP_FLOOR
from ..slave.kernel import kernel
from ..strength import CRITICAL_STATE, escape, left_by_push, log_of_friction, softened, strength_of, yield_pressure
from ..terramechanics import (
    exit_share,
    flow_value,
    janosi_velocity,
    mapped_shear_velocity,
    mohr_coulomb,
    rankine_wall,
    unit_weight,
    wong_reece_mirror,
)
from .soil import bearing_arc, pressed_at, pressure_at

#: Gauss-Legendre over theta and across the width: 1e-6 of the load with smooth shear, 1e-5 where the rim's slip changes its sign.
_NODES, _WEIGHTS = (np.ascontiguousarray(a) for a in np.polynomial.legendre.leggauss(10))
_STRIPS, _STRIP_WEIGHTS = (np.ascontiguousarray(a) for a in np.polynomial.legendre.leggauss(3))
_N = len(_NODES)

#: Below this sum of camber [rad] and of yaw and roll rate times width [m/s] one strip stands for the whole width.
_ONE_STRIP = 1e-9
#: Cosine of the largest entry angle: a deeper wheel is loaded like one in the soil up to here.
_DEEPEST = -0.98
#: Least mapped V_j [m/s]: keeps the friction of a wheel at rest finite.
_LEAST_V_J = 1e-3


@kernel
def entry_angle(p, d, cos_g):
    """Angle [rad] from nadir at which the rim cuts the plane; 0 without contact."""
    c = d / (p.r_w * cos_g)
    return math.acos(max(c, _DEEPEST)) if c < 1.0 else 0.0


@kernel
def shear_velocity_scale(p, omega, travel, theta_1, theta):
    """V_j [m/s] at theta of a wheel that rolls with omega [rad/s] and enters the soil at theta_1, or at -theta_1 in reverse."""
    if p.V_j_mode == 1.0:
        return p.V_j
    # At rest, where no end is the entry, half of the arc counts.
    arc = theta_1 + driving(p, travel) * (abs(math.copysign(theta_1, travel) - theta) - theta_1)
    return max(mapped_shear_velocity(p.K, omega, max(arc, 1e-9)), _LEAST_V_J)


@kernel
def driving(p, travel):
    """0 at rest, 1 when the contact has the shape that travel [m/s] gives it."""
    return 1.0 - math.exp(-abs(travel) / p.V_theta)


@kernel
def shear_radius(p, N_phi):
    """Radius [m] on which the soil shears: the rim, or the grousers' tips where the failure wedges of neighbouring grousers meet."""
    r_tip = p.r_w + p.h_g
    if p.n_g > 0.0 and p.h_g * math.sqrt(N_phi) >= 2.0 * math.pi / p.n_g * r_tip:
        return r_tip
    return p.r_w


@kernel
def rim(p, soil, patch, tan_phi, r_s, d, sin_g, cos_g, v_x, v_a, v_r, w_x, w_a, w_r, travel, slip):
    """Normal and shear stress on the rim, integrated over theta and, with camber or yaw, across the width.

    Args:
        soil, patch: The soil below the wheel, and what pressed it before, see ``pressure_at``.
        r_s: Radius on which the soil shears [m], see shear_radius.
        v_x, v_a, v_r, w_x, w_a, w_r: Velocity [m/s] and angular velocity [rad/s] of the wheel in its axes.
        travel: Signed speed that shapes the contact [m/s].
        slip: Slip, which moves the largest stress of Wong and Reece.

    Returns:
        fx, fa, fr [N], mx, ma, mr [N.m], stiffness along the plane's normal [N/m], damping along x, a and the normal [N.s/m],
        shear force along the rim [N] and the largest one that the soil could bear [N], largest and least angle of the contact [rad].
    """
    fx = fa = fr = mx = ma = mr = k_z = d_x = d_y = d_z = thrust = strength = entry = exit_ = 0.0
    front = exit_share(p.eta, -travel, p.V_theta)
    rear = exit_share(p.eta, travel, p.V_theta)
    two_part = p.normal_model == 2.0
    mapped = p.V_j_mode == 2.0
    shaped = driving(p, travel)
    weak, forward = p.strength == CRITICAL_STATE, 1.0 if v_x >= 0.0 else -1.0
    tan_g = sin_g / cos_g
    v_n = v_a * sin_g + v_r * cos_g  # separating velocity of the centre from the plane

    # The part of the width that touches the plane; the edge of a cambered wheel may be in the air.
    left, right = 0.5 * p.b_w, -0.5 * p.b_w
    if sin_g > 0.0:
        left = min(left, (p.r_w * cos_g - d) / sin_g)
    elif sin_g < 0.0:
        right = max(right, (p.r_w * cos_g - d) / sin_g)
    one_strip = patch is None and abs(sin_g) + (abs(w_x) + abs(w_r)) * p.b_w < _ONE_STRIP
    for j in range(1 if one_strip else len(_STRIPS)):
        xi = 0.5 * (left + right) + (0.0 if one_strip else 0.5 * (left - right) * _STRIPS[j])
        width = (left - right) * (1.0 if one_strip else 0.5 * _STRIP_WEIGHTS[j])
        theta_1 = entry_angle(p, d + xi * sin_g, cos_g)
        if width <= 0.0 or theta_1 <= 0.0:
            continue
        theta_front, theta_rear = front * theta_1, -rear * theta_1
        cos_1 = math.cos(theta_1)
        damping = max(0.0, 1.0 - p.c_d * (v_n + w_x * xi * cos_g))  # Hunt & Crossley 1975, own choice for soil
        cohesion = p.c * min(1.0, damping)  # no adhesion on separation

        s = strength_of(p, weak, p.phi, p.b_w, p.r_w * math.sin(theta_1), p.r_w * (1.0 - cos_1), v_x)

        # Wong & Reece: largest stress at theta_m, ahead of nadir in the direction of travel, at nadir while at rest.
        # Part 0 is behind it, part 1 ahead; Bekker's stress has the second part only.
        lead, trail = (theta_front, theta_rear) if travel >= 0.0 else (theta_rear, theta_front)
        grows, late, cos_lead = True, 0.0, cos_1
        if patch is not None:
            found, trail, lead, grows = bearing_arc(soil, patch, cos_g, cos_1, trail, lead, xi)
            if not found:
                continue
            late, cos_lead = math.copysign(theta_1, travel) - lead, math.cos(lead)  # soil is sheared from where it is met
        entry, exit_ = max(entry, lead, trail), min(exit_, lead, trail)
        theta_m = max(0.0, min(0.95, p.c_1 + p.c_2 * slip)) * lead * shaped if two_part else trail
        for part in range(0 if two_part else 1, 2):
            start, end = (trail, theta_m) if part == 0 else (theta_m, lead)
            half = 0.5 * abs(end - start)
            # One node more at the trailing end: how the arc grows with sinkage is part of the stiffness.
            for k in range(_N + (not two_part and grows)):
                if k < _N:
                    theta = 0.5 * (start + end) + half * _NODES[k]
                    dA = p.r_w * width * half * _WEIGHTS[k]
                    growth = 0.0
                else:
                    theta = trail
                    dA = 0.0
                    growth = width * abs(trail) / (theta_1 * cos_g * math.sin(theta_1))
                sin, cos = math.sin(theta), math.cos(theta)
                deepening = 1.0
                cos_z = cos
                if part == 0:
                    mirror = wong_reece_mirror(theta, lead, trail, theta_m)
                    cos_z = math.cos(mirror)
                    slope = -(lead - theta_m) / (theta_m - trail)
                    deepening -= math.sin(mirror) * (mirror - slope * theta) / (theta_1 * math.sin(theta_1))
                z = p.r_w * cos_g * (cos_z - cos_1)
                V_j = shear_velocity_scale(p, w_a, travel, theta_1, theta + late)
                sin_v, cos_v = sin, cos
                if mapped and abs(lead - theta) > 1e-6:
                    # Mean shear velocity since entry: in steady rolling this is Janosi & Hanamoto's displacement form exactly.
                    sin_v += shaped * ((cos - cos_lead) / (lead - theta) - sin)
                    cos_v += shaped * ((math.sin(lead) - sin) / (lead - theta) - cos)
                v_t = (v_x - w_r * xi) * cos_v + (v_r + w_x * xi) * sin_v - w_a * r_s
                v_l = v_a + r_s * (w_r * sin_v + w_x * cos_v)
                phi_m = janosi_velocity(math.sqrt(v_t * v_t + v_l * v_l), V_j)
                static, rise, dense = pressure_at(soil, patch, z, sin, cos, xi)
                if static <= 0.0 < z:
                    continue  # clear of a floor that was pressed before
                if weak and z > 0.0:
                    # Sinking is no slip: soil would lose strength the faster a wheel sinks, which then sinks the faster.
                    rolling = (v_x - w_r * xi) * cos_v - w_a * r_s
                    yields = _weakened(p, s, tan_phi, dense, z, theta, lead, forward, shaped, v_x, rolling, v_l, V_j)
                    if yields < static:
                        static, rise = yields, p.n * yields / z
                sigma = static * damping
                tau_max = mohr_coulomb(cohesion, sigma, tan_phi)
                g = tau_max * phi_m
                tau_t, tau_l = -g * v_t, -g * v_l  # Eq. (8.6)
                p_x = tau_t * cos - sigma * sin
                p_r = sigma * cos + tau_t * sin
                p_side = sigma * cos * tan_g
                fx += p_x * dA
                fa += (p_side + tau_l) * dA
                fr += p_r * dA
                mx += (xi * p_r + cos * (p.r_w * p_side + r_s * tau_l)) * dA
                ma -= r_s * tau_t * dA
                mr += (sin * (p.r_w * p_side + r_s * tau_l) - xi * p_x) * dA
                thrust += tau_t * dA
                strength += tau_max * dA
                d_x += g * cos * cos * dA
                d_y += g * dA
                d_z += g * sin * sin * dA
                # Force along the plane's normal per normal stress, with the shear strength that it brings.
                share = cos / cos_g - tan_phi * phi_m * (v_t * sin * cos_g + v_l * sin_g)
                if damping > 0.0:
                    d_z += p.c_d * static * share * dA
                    if z > 0.0:
                        k_z += rise * damping * deepening * share * dA
                k_z += (p_r * cos_g + (p_side + tau_l) * sin_g) * growth
    return fx, fa, fr, mx, ma, mr, k_z, d_x, d_y, d_z, thrust, strength, entry, exit_


@kernel
def _weakened(p, s, tan_phi, dense, z, theta, lead, forward, shaped, v_x, v_t, v_l, V_j):
    """What is left of the pressure that dense soil bears at theta, where it has been sheared since it entered the contact at lead.

    Args:
        s: Strength, see ``strength_of``.
        dense, z: Pressure [Pa] at the depth z [m].
        v_t, v_l: Velocity of slip along the rim and the axle [m/s]; V_j: what mobilises 63 % of the strength [m/s].
    """
    speed = math.sqrt(v_t * v_t + v_l * v_l)
    phi_m, per_travel = janosi_velocity(speed, V_j), shaped / max(abs(v_x), SLIP_FLOOR)
    path = speed * p.r_w * abs(math.sin(lead) - math.sin(theta)) * per_travel
    # Soil ahead of a wheel in skid is sheared in the passive wedge that it pushes.
    path += p.preshear * s.depth * math.sqrt(flow_value(p.phi)) * max(forward * v_t, 0.0) * per_travel
    ahead, beside = forward * phi_m * v_t * tan_phi, phi_m * abs(v_l) * tan_phi
    logs = log_of_friction(tan_phi, ahead), log_of_friction(tan_phi, -ahead), log_of_friction(tan_phi, beside)
    left = left_by_push(s, logs[0], logs[1], logs[2])
    share = escape(s, forward * theta, forward * math.sin(theta), left[0], left[1], left[2])
    return yield_pressure(s, dense, z, 0.0, softened(s, path), share)


@kernel
def grousers(p, soil, patch, tan_phi, N_phi, r_s, d, sin_g, cos_g, v_x, v_a, v_r, w_x, w_a, w_r, travel, angle, thrust_left):
    """Passive earth force on the grousers' faces, bearing and shear on their tips, all at the middle of the width.

    Args:
        angle: theta of one grouser [rad].
        thrust_left: Largest sum of face forces along the rim that the soil can still bear [N].

    Returns:
        fx, fa, fr [N], mx, ma, mr [N.m], stiffness along the normal [N/m], damping along x, a and the normal [N.s/m].
    """
    fx = fa = fr = mx = ma = mr = k_z = d_x = d_y = d_z = 0.0
    r_tip = p.r_w + p.h_g
    pitch = 2.0 * math.pi / p.n_g
    theta_1 = entry_angle(p, d, cos_g)
    # Behind the wheel the soil's surface is where the rim left it: below the plane by ``drop``, reached linearly from nadir on.
    theta_front = exit_share(p.eta, -travel, p.V_theta) * theta_1
    theta_rear = exit_share(p.eta, travel, p.V_theta) * theta_1
    drop_front = p.r_w * cos_g * (math.cos(theta_front) - math.cos(theta_1))
    drop_rear = p.r_w * cos_g * (math.cos(theta_rear) - math.cos(theta_1))
    gamma_s = unit_weight(p.rho, p.gravity, p.slope)
    damping = max(0.0, 1.0 - p.c_d * (v_a * sin_g + v_r * cos_g))
    reach = math.acos(max(-1.0, min(1.0, d / (r_tip * cos_g))))
    first = math.ceil((-reach - angle) / pitch)
    last = math.floor((reach - angle) / pitch)
    capacity = 0.0
    for i in range(first, last + 1):
        capacity += abs(_face(p, angle + i * pitch, d, cos_g, soil, patch, gamma_s, N_phi, theta_front, theta_rear, drop_front, drop_rear))
    cap = 1.0 if capacity <= thrust_left else thrust_left / capacity
    for i in range(first, last + 1):
        theta = angle + i * pitch
        sin, cos = math.sin(theta), math.cos(theta)
        V_j = shear_velocity_scale(p, w_a, travel, theta_1, theta)
        v_t = v_x * cos + v_r * sin
        if r_s < r_tip:  # else the soil between the grousers turns with them
            r_face = p.r_w + 0.5 * p.h_g
            v_face = v_t - w_a * r_face
            passive = cap * _face(p, theta, d, cos_g, soil, patch, gamma_s, N_phi, theta_front, theta_rear, drop_front, drop_rear)
            g = passive * janosi_velocity(abs(v_face), V_j)
            f = -g * v_face
            fx += f * cos
            fr += f * sin
            ma -= f * r_face
            d_x += g * cos * cos
            d_z += g * sin * sin
        z = r_tip * cos * cos_g - d - _drop(theta, theta_front, theta_rear, drop_front, drop_rear)
        static, rise, _ = pressure_at(soil, patch, z, sin, cos, 0.0)
        if static <= 0.0:
            continue
        area = p.b_w * p.t_g
        sigma = static * damping
        v_tip = v_t - w_a * r_tip
        v_l = v_a + r_tip * (w_r * sin + w_x * cos)
        phi_m = janosi_velocity(math.sqrt(v_tip * v_tip + v_l * v_l), V_j)
        g = area * mohr_coulomb(p.c * min(1.0, damping, z / p.t_g), sigma, tan_phi) * phi_m
        f, f_l = -g * v_tip, -g * v_l
        f_l += sigma * area * cos * sin_g / cos_g
        fx += f * cos - sigma * area * sin
        fa += f_l
        fr += f * sin + sigma * area * cos
        mx += r_tip * cos * f_l
        ma -= r_tip * f
        mr += r_tip * sin * f_l
        d_x += g * cos * cos
        d_y += g
        d_z += g * sin * sin
        if damping > 0.0:
            share = area * (cos / cos_g - tan_phi * phi_m * (v_tip * sin * cos_g + v_l * sin_g))
            d_z += p.c_d * static * share
            k_z += rise * damping * share
    return fx, fa, fr, mx, ma, mr, k_z, d_x, d_y, d_z


@kernel
def _drop(theta, theta_front, theta_rear, drop_front, drop_rear):
    if theta >= 0.0:
        return drop_front * (min(1.0, theta / theta_front) if theta_front > 0.0 else 1.0)
    return drop_rear * (min(1.0, -theta / theta_rear) if theta_rear > 0.0 else 1.0)


@kernel
def _face(p, theta, d, cos_g, soil, patch, gamma_s, N_phi, theta_front, theta_rear, drop_front, drop_rear):
    """Passive earth force [N] on the wetted part of a grouser's face."""
    slant = math.cos(theta) * cos_g
    surface = d + _drop(theta, theta_front, theta_rear, drop_front, drop_rear)
    top = p.r_w * slant - surface
    bottom = top + p.h_g * slant
    if bottom <= 0.0 or slant <= 0.0:
        return 0.0
    q = (
        p.kappa_q * pressure_at(soil, patch, top, math.sin(theta), math.cos(theta), 0.0)[0]
    )  # surcharge: the share kappa_q of the rim's pressure
    top = max(top, 0.0)
    return p.b_w / slant * rankine_wall(gamma_s, bottom - top, top, q, p.c, N_phi)


@kernel
def sides(p, soil, patch, N_phi, d, sin_g, cos_g, v_x, v_a, w_x, w_a, w_r, travel):
    """Passive earth force on the side faces, wherever they move against the soil.

    Returns:
        fa [N], mx, mr [N.m], damping along a [N.s/m].
    """
    fa = mx = mr = d_y = 0.0
    theta_1 = entry_angle(p, d - 0.5 * p.b_w * abs(sin_g), cos_g)
    if theta_1 <= 0.0:
        return fa, mx, mr, d_y
    theta_front = exit_share(p.eta, -travel, p.V_theta) * theta_1
    theta_rear = exit_share(p.eta, travel, p.V_theta) * theta_1
    gamma_s = unit_weight(p.rho, p.gravity, p.slope)
    half = 0.5 * (theta_front + theta_rear)
    length, depth = p.r_w * math.sin(theta_1), p.r_w * (1.0 - math.cos(theta_1))
    s = strength_of(p, p.strength == CRITICAL_STATE, p.phi, p.b_w, length, depth, v_x)
    lead = theta_front if travel >= 0.0 else -theta_rear
    for k in range(_N):
        theta = 0.5 * (theta_front - theta_rear) + half * _NODES[k]
        sin, cos = math.sin(theta), math.cos(theta)
        v_l = v_a + p.r_w * (w_r * sin + w_x * cos)
        xi = 0.5 * p.b_w if v_l > 0.0 else -0.5 * p.b_w
        height = p.r_w * cos - (d + xi * sin_g) / cos_g
        if patch is not None:  # the wall is as high as the surface beside the wheel is, not as the level from which sinkage counts
            height -= pressed_at(soil, patch, sin, cos, math.copysign(abs(xi) + patch.spacing, xi))[1]
        if height <= 0.0:
            continue
        q = p.kappa_q * pressure_at(soil, patch, height, sin, cos, xi)[0]
        V_j = p.V_j
        if p.V_j_mode == 2.0:
            # Soil beside the wheel is passed at the speed of travel, however fast the rim spins.
            passed = p.r_w * abs(math.sin(lead) - sin)
            V_j = max(s.wall_modulus * abs(v_x) / max(passed, 1e-6), _LEAST_V_J)
        g = s.wall * rankine_wall(gamma_s, height, 0.0, q, p.c, N_phi) * janosi_velocity(abs(v_l), V_j) * p.r_w * cos * half * _WEIGHTS[k]
        f = -g * v_l
        fa += f
        mx += (p.r_w * cos - height / 3.0) * f  # a pressure that grows with depth acts at a third of the height
        mr += p.r_w * sin * f
        d_y += g
    return fa, mx, mr, d_y
