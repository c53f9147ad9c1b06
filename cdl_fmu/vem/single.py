"""One visco-elastic contact point a wheel: a spring, a damper and friction where its rim is deepest below a plane."""

from __future__ import annotations

import math

from ..contact import LEAST_CAMBER_COSINE, SLIP_FLOOR, anchor_here, lowest_point, show
from ..frames import cross, dot
from ..slave.kernel import kernel
from ..terramechanics import bekker_modulus, slip_ratio
from ..wheel import tip_radius
from .law import bekker, damping, friction_secant, linear

LINEAR = 1.0


@kernel
def contact_with_plane(p, wheel, patch, n_x, n_y, n_z, d, wrench, contact, shown):
    """Wrench, Jacobian and diagnostics of a wheel whose centre is d [m] above a plane with the normal n.

    The point is the rim's deepest, halfway across its width. ``patch`` is not looked at: rock remembers nothing.
    """
    T, r, v, w = wheel.T, wheel.r_0, wheel.v_0, wheel.w_0
    a_x, a_y, a_z = T[1, 0], T[1, 1], T[1, 2]
    sin_g = dot(a_x, a_y, a_z, n_x, n_y, n_z)
    cos_g = math.sqrt(max(1.0 - sin_g * sin_g, LEAST_CAMBER_COSINE**2))
    x_x, x_y, x_z = cross(a_x, a_y, a_z, n_x, n_y, n_z)
    x_x, x_y, x_z = x_x / cos_g, x_y / cos_g, x_z / cos_g
    y_x, y_y, y_z = cross(n_x, n_y, n_z, x_x, x_y, x_z)
    u_x, u_y, u_z = cross(x_x, x_y, x_z, a_x, a_y, a_z)  # from the point to the centre
    radius = tip_radius(p)
    depth = radius * cos_g - d
    s_x, s_y, s_z = -radius * u_x, -radius * u_y, -radius * u_z
    t_x, t_y, t_z = cross(w[0], w[1], w[2], s_x, s_y, s_z)
    t_x, t_y, t_z = v[0] + t_x, v[1] + t_y, v[2] + t_z
    v_x, v_y, v_n = dot(t_x, t_y, t_z, x_x, x_y, x_z), dot(t_x, t_y, t_z, y_x, y_y, y_z), dot(t_x, t_y, t_z, n_x, n_y, n_z)

    load = stiffness = damper = 0.0
    if depth > 0.0:
        if p.normal_model == LINEAR:
            load, stiffness = linear(p.k, depth)
        else:
            load, stiffness = bekker(bekker_modulus(p.k_c, p.k_phi, p.b_w), p.n, p.b_w, radius, depth)
        damper = damping(p.damping_ratio, stiffness, p.effective_mass)
        load = wheel.active * (load - damper * v_n)
        if load < 0.0:
            load = stiffness = damper = 0.0  # it does not pull back what leaves
    friction = load * friction_secant(p.mu, max(p.mu, p.mu_static), p.v_static, p.v_creep, math.sqrt(v_x * v_x + v_y * v_y))

    f_x, f_y = -friction * v_x, -friction * v_y
    f, m = wrench.f_0, wrench.t_0
    f[0] = f_x * x_x + f_y * y_x + load * n_x
    f[1] = f_x * x_y + f_y * y_y + load * n_y
    f[2] = f_x * x_z + f_y * y_z + load * n_z
    m[0], m[1], m[2] = cross(s_x, s_y, s_z, f[0], f[1], f[2])
    axes, point = contact.axes, contact.point_0
    axes[0, 0], axes[0, 1], axes[0, 2] = x_x, x_y, x_z
    axes[1, 0], axes[1, 1], axes[1, 2] = y_x, y_y, y_z
    axes[2, 0], axes[2, 1], axes[2, 2] = n_x, n_y, n_z
    point[0], point[1], point[2] = r[0] + s_x, r[1] + s_y, r[2] + s_z
    contact.F[0], contact.F[1], contact.F[2] = f_x, f_y, load
    contact.K[2] = wheel.active * stiffness
    contact.D[0], contact.D[1], contact.D[2] = friction, friction, wheel.active * damper
    contact.in_contact = 1.0 if depth > 0.0 else 0.0
    anchor_here(wheel, contact)
    speed, rim = dot(v[0], v[1], v[2], x_x, x_y, x_z), radius * dot(w[0], w[1], w[2], a_x, a_y, a_z)
    torque = -dot(m[0], m[1], m[2], a_x, a_y, a_z)
    show(wheel, p.ground_z - lowest_point(p, wheel), slip_ratio(speed, rim, SLIP_FLOOR), 0.0, 0.0, f, torque, shown)
