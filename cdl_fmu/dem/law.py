"""The law of a contact between particles, or of a particle with a tool.

Normal force: Hertz, F = 4/3 E* sqrt(R*) d^1.5, or linear (Cundall & Strack 1979), F = 2 E* R* d, damped so that a head-on impact
gives the coefficient of restitution. Tangential force: Mindlin's stiffness times the tangential displacement since the contact began, at
most mu times the normal force (Coulomb). Rolling: a spring against the rolling angle, at most mu_r R* times the normal force (type C of Ai
et al. 2011, without viscous part). Cohesion: a constant pull while the contact lasts.
"""

from __future__ import annotations

import math

import numpy as np

from ..slave.kernel import kernel

#: Places of a law's numbers: 1 for Hertz or for linear contacts; 2 E* [Pa]; elastic force over stiffness times overlap; damping over
#: sqrt(stiffness times mass); tangential over normal stiffness, and its root; mu; rolling over tangential stiffness times R*^2; mu_r;
#: pull over R*^2 [Pa]; mass over radius^3 [kg/m3]; time step [s]; 0.5 and 1 in the precision of the loops, which know no other constants;
#: share of its energy that an impact returns, e^2, and so does a rotation geometry.
HERTZ, LINEAR, STIFFNESS, ELASTIC, DAMPING, TANGENTIAL, SHEAR_DAMPING, FRICTION = range(8)
ROLLING, ROLLING_FRICTION, PULL, MASS, STEP, HALF, ONE, RETURNED = range(8, 16)
LAW = 16


@kernel(inline=True)
def respond(law, overlap, touching, r_eff, m_eff, n, u_n, u_t, w, shear, roll):
    """Force and rolling torque of a contact, on its first particle.

    Args:
        law: Its numbers, [LAW].
        overlap: Overlap of the surfaces, 0 if they do not touch [m].
        touching: Whether they touch.
        r_eff, m_eff: Effective radius [m] and mass [kg].
        n: Unit normal towards the first particle (3).
        u_n: Velocity of the first particle's centre along n against the second's [m/s].
        u_t: Velocity of its surface across n against the other's [m/s] (3).
        w: Angular velocity of the first against the second [rad/s] (3).
        shear, roll: History: tangential displacement [m] (3) and rolling angle [rad] (3).

    Returns:
        Normal force [N], tangential force [N] (3), rolling torque [N.m] (3), new shear (3) and roll (3), stiffness [N/m] and damping
        [N.s/m] along the normal.
    """
    one, dt = law[ONE], law[STEP]
    zero = one - one
    n_x, n_y, n_z = n
    t_x, t_y, t_z = u_t
    s_n = law[STIFFNESS] * (law[HERTZ] * math.sqrt(r_eff * overlap) + law[LINEAR] * r_eff)  # dF/d overlap
    s_t = law[TANGENTIAL] * s_n  # Mindlin 1949
    damping = law[DAMPING] * math.sqrt(s_n * m_eff)
    f_n = law[ELASTIC] * s_n * overlap - damping * u_n
    f_n = f_n if touching else zero
    limit = f_n if f_n > zero else zero
    # The displacement is turned into the present plane.
    x, y, z = shear
    along = x * n_x + y * n_y + z * n_z
    x, y, z = x - along * n_x + t_x * dt, y - along * n_y + t_y * dt, z - along * n_z + t_z * dt
    pull, most = s_t * math.sqrt(x * x + y * y + z * z), law[FRICTION] * limit
    scale = most / pull if pull > most else one
    scale = scale if touching else zero
    x, y, z = x * scale, y * scale, z * scale
    shear = x, y, z
    # Coulomb's limit holds for spring and damper together: at first touch nearly all of the normal force is damping.
    damper = law[SHEAR_DAMPING] * damping
    f_x, f_y, f_z = -s_t * x - damper * t_x, -s_t * y - damper * t_y, -s_t * z - damper * t_z
    pull = math.sqrt(f_x * f_x + f_y * f_y + f_z * f_z)
    scale = most / pull if pull > most else one
    f_t = f_x * scale, f_y * scale, f_z * scale
    k_r = law[ROLLING] * s_t * r_eff * r_eff
    x, y, z = roll
    w_x, w_y, w_z = w
    along = x * n_x + y * n_y + z * n_z + (w_x * n_x + w_y * n_y + w_z * n_z) * dt
    x, y, z = x - along * n_x + w_x * dt, y - along * n_y + w_y * dt, z - along * n_z + w_z * dt
    pull, most = k_r * math.sqrt(x * x + y * y + z * z), law[ROLLING_FRICTION] * r_eff * limit
    scale = most / pull if pull > most else one
    scale = scale if touching else zero
    x, y, z = x * scale, y * scale, z * scale
    f_n = f_n - law[PULL] * r_eff * r_eff if touching else zero
    return f_n, f_t, (-k_r * x, -k_r * y, -k_r * z), shear, (x, y, z), s_n, damping


def law_of(E, nu, e, mu, mu_r, cohesion, density, dt, linear, precision=np.float64) -> np.ndarray:
    """A law's numbers.

    Args:
        E: Young's modulus of both bodies [Pa].
        nu: Their Poisson's ratio.
        e: Coefficient of restitution.
        mu, mu_r: Coefficients of friction and of rolling friction.
        cohesion: Pull over the square of the diameter of equal particles [Pa].
        density: Of the particles' grains [kg/m3].
        dt: Time step [s].
        linear: True for linear contacts, False for Hertz'.
        precision: Type of the numbers.
    """
    beta = -math.log(e) / math.hypot(math.log(e), math.pi)
    law = np.zeros(LAW)
    law[LINEAR if linear else HERTZ] = 1.0
    law[STIFFNESS] = E / (1.0 - nu**2)  # 2 E*, with E* = E / (2 (1 - nu^2)) for equal bodies
    law[ELASTIC] = 1.0 if linear else 2.0 / 3.0
    law[DAMPING] = 2.0 * beta if linear else 2.0 * math.sqrt(5.0 / 6.0) * beta  # Tsuji et al. 1992, Antypov & Elliott 2011
    law[TANGENTIAL] = 2.0 * (1.0 - nu) / (2.0 - nu)  # 8 G* / (2 E*), G* = G / (2 (2 - nu)) for equal bodies
    law[SHEAR_DAMPING] = math.sqrt(law[TANGENTIAL])
    law[FRICTION], law[ROLLING], law[ROLLING_FRICTION] = mu, 1.0, mu_r
    law[PULL] = 16.0 * cohesion  # diameter = 4 R* of equal particles
    law[MASS] = 4.0 / 3.0 * math.pi * density
    law[STEP], law[HALF], law[ONE], law[RETURNED] = dt, 0.5, 1.0, e * e
    return law.astype(precision)
