"""Forces of one visco-elastic contact point: normal force over penetration, and friction over sliding speed."""

from __future__ import annotations

import math

from ..slave.kernel import kernel


@kernel
def linear(k, depth):
    """Elastic force [N] and stiffness [N/m] of a linear spring."""
    return k * depth, k


@kernel
def bekker(k_eq, n, b, r, depth):
    """Elastic force [N] and tangent stiffness [N/m] of a rim of radius r and width b [m] whose contact is symmetric about its nadir.

    The integral of Bekker's pressure k_eq z^n along the contact, the rim's arc taken as a parabola.
    """
    if depth <= 0.0:
        return 0.0, 0.0
    # b k_eq sqrt(2 r) B(n + 1, 1/2) z^(n + 1/2), B being the beta function
    beta = math.exp(math.lgamma(n + 1.0) + math.lgamma(0.5) - math.lgamma(n + 1.5))
    force = b * k_eq * math.sqrt(2.0 * r) * beta * depth ** (n + 0.5)
    return force, (n + 0.5) * force / depth


@kernel
def damping(ratio, stiffness, mass):
    """Damping [N.s/m] of Lehr's ratio, 1 being critical, of a mass [kg] on a spring; none where the stiffness vanishes."""
    return 2.0 * ratio * math.sqrt(stiffness * mass)


@kernel
def friction_secant(mu, mu_static, v_static, v_creep, v):
    """Coefficient of friction per sliding speed, mu(v) / v [s/m]: the force on the tool is - F_n times this times the sliding velocity.

    own choice, as the chapter leaves the function open: mu(v) = (mu + (mu_static - mu) exp(-(v/v_static)^2)) tanh(v/v_creep). Static
    friction holds up to creep at speeds below v_creep; above v_static it has fallen to sliding friction (Stribeck's form).
    """
    x = v / v_creep
    share = math.tanh(x) / v if x > 1e-4 else (1.0 - x * x / 3.0) / v_creep
    return (mu + (mu_static - mu) * math.exp(-((v / v_static) ** 2))) * share
