"""Terramechanics: one equation, one kernel on floats. SI units, angles in rad, sinkage z positive downward.

Equations (8.5) to (8.8) are those of the chapter on heterogeneous wheel-ground contact (Buse et al.); theta counts from the
wheel's nadir, positive towards its heading.
"""

from __future__ import annotations

import math

from .slave.kernel import kernel

#: Least share of k_phi that k_c/b + k_phi may fall to where a negative k_c meets a width known only at run time.
LEAST_MODULUS_SHARE = 1e-3


@kernel
def bekker_modulus(k_c, k_phi, b):
    """k_eq [N/m^(n+2)] of a contact of width b [m]; bounded from below, because measured k_c are often negative."""
    return max(k_c / b + k_phi, LEAST_MODULUS_SHARE * k_phi)  # Eq. (8.5)


@kernel
def bekker(k_eq, z, n):
    """Normal stress [Pa] at sinkage z [m]."""
    return k_eq * z**n if z > 0.0 else 0.0  # Eq. (8.5)


@kernel
def mohr_coulomb(c, sigma, tan_phi):
    """Shear strength [Pa] under the normal stress sigma [Pa]."""
    return c + sigma * tan_phi  # Eq. (8.7)


@kernel
def janosi_velocity(v, V_j):
    """Mobilisation per shear velocity (1 - exp(-v/V_j))/v [s/m]: tau = -tau_max * this * velocity vector, for v >= 0 [m/s]."""
    x = v / V_j
    if x < 1e-3:
        return (1.0 - x * (0.5 - x * (1.0 / 6.0 - x / 24.0))) / V_j  # series of Eq. (8.6) at rest, to 1e-14
    return (1.0 - math.exp(-x)) / v  # Eq. (8.6); faster than expm1 and good to 2e-13 here


@kernel
def janosi_displacement(j, K):
    """Share of the shear strength mobilised at the shear displacement j [m] >= 0 with the modulus K [m]."""
    return -math.expm1(-j / K)  # Janosi & Hanamoto 1961


@kernel
def mapped_shear_velocity(K, omega, arc):
    """V_j [m/s] at which the velocity form mobilises what the displacement form with the modulus K [m] does.

    ``arc`` [rad] is the angle since entry, which takes arc/|omega| seconds; the shear velocity must be its mean over that time.
    """
    return K * abs(omega) / arc  # from j = v arc/|omega| and v/V_j = j/K


@kernel
def exit_share(eta, v, V_theta):
    """|theta_0/theta_1| of the end that the wheel leaves at the speed v [m/s]: 1 at rest, eta when driving."""
    return eta + (1.0 - eta) * math.exp(-max(0.0, v) / V_theta)  # exponential reduction, section 8.3.10


@kernel
def travel_speed(v_x, rim_speed):
    """Signed speed [m/s] that shapes the contact: the faster of hub and rim, or their sum where they oppose (continuous reversal)."""
    return max(v_x, rim_speed, 0.0) + min(v_x, rim_speed, 0.0)  # own choice


@kernel
def slip_ratio(v_x, rim_speed, floor):
    """Slip 1 - v_x/(r omega) driving, r omega/v_x - 1 in skid, for both directions; speeds below floor [m/s] count as floor."""
    slip = (rim_speed - v_x) / max(abs(rim_speed), abs(v_x), floor)
    return max(-1.0, min(1.0, slip if v_x + rim_speed >= 0.0 else -slip))


@kernel
def wong_reece_mirror(theta, theta_lead, theta_trail, theta_m):
    """Angle ahead of the maximum stress at theta_m whose stress acts at theta behind it [rad]."""
    return theta_lead - (theta - theta_trail) / (theta_m - theta_trail) * (theta_lead - theta_m)  # Wong & Reece 1967


@kernel
def flow_value(phi):
    """Rankine's passive flow value N_phi [1]."""
    return math.tan(math.pi / 4.0 + phi / 2.0) ** 2  # Eq. (8.8)


@kernel
def unit_weight(rho, gravity, slope):
    """Weight of soil per volume [N/m3] along the ground's normal, by which pressure grows with depth in a layer on a slope [rad]."""
    return rho * gravity * math.cos(slope)  # infinite slope, Terzaghi 1943


@kernel
def rankine_wall(gamma_s, height, depth, q, c, N_phi):
    """Passive earth force per width [N/m] on a wall of that height [m] whose top lies at depth [m], surcharge q [Pa]."""
    sigma_top = gamma_s * depth * N_phi + q * N_phi + 2.0 * c * math.sqrt(N_phi)  # Eq. (8.8)
    return height * (sigma_top + 0.5 * gamma_s * height * N_phi)  # its integral over the wall
