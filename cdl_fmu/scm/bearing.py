"""What a cell bears below a meshed tool: the forces of its pressures, and shear on its mean surface."""

from __future__ import annotations

import math

from ..slave.kernel import kernel
from .columns import D_Z, F_X, F_Y, F_Z, K_X, K_Y, K_Z, T_X, T_Y, T_Z
from .faces import velocity
from .stress import mobilised, remembered, sheared, whole
from .support import resist_cell

#: What presses on a cell: plan area [m2], force down [N], stiffness [N/m], moments of that force [N.m], horizontal force, torque.
NOTHING = (0.0,) * 11
TOTAL = 1


@kernel(inline=True)
def pressed_with(pressed, x, y, z, n_x, n_y, n_z, plan, sigma, rise):
    """What presses on a cell, and another element with its pressure [Pa] and the slope of that [Pa/m]."""
    f, g_x, g_y = plan * sigma, n_x / n_z, n_y / n_z
    area, total, stiffness, q_x, q_y, q_z, f_x, f_y, t_x, t_y, t_z = pressed
    t_x, t_y, t_z = t_x + f * (y - z * g_y), t_y + f * (z * g_x - x), t_z + f * (x * g_y - y * g_x)
    q_x, q_y, q_z = q_x + f * x, q_y + f * y, q_z + f * z
    return area + plan, total + f, stiffness + plan * rise, q_x, q_y, q_z, f_x + f * g_x, f_y + f * g_y, t_x, t_y, t_z


@kernel(inline=True)
def _turned(u_x, u_y, u_z, n_x, n_y, n_z):
    """Velocity along a surface of this normal [m/s], turned with it into the horizontal plane, as displacements are kept."""
    normal = n_x * u_x + n_y * u_y + n_z * u_z
    u_x, u_y, u_z = u_x - normal * n_x, u_y - normal * n_y, u_z - normal * n_z
    return u_x - n_x * u_z / (1.0 + n_z), u_y - n_y * u_z / (1.0 + n_z)


@kernel
def bear(p, tool, is_body, h_x, h_y, damping, tan_phi, pressed, j_x, j_y, path, held, h, sums):
    """Add the forces of a cell: its pressures, and shear on its mean surface.

    Args:
        pressed: What presses on it.
        j_x, j_y: Shear displacement before the step [m].
        path: Of slip on the cell before the step [m].
        held: Friction that the cell could give before [N]; 0 if none is to be compared with.

    Returns:
        Shear displacement and path of slip [m], mobilised share of the strength, mean velocity against the soil over the time h [m/s],
        turned into the horizontal plane, and the friction that the cell can give [N].
    """
    area, total, stiffness, q_x, q_y, q_z, p_x, p_y, t_x, t_y, t_z = pressed
    l_x, l_y = -h_y, h_x
    # The mean surface: where its pressure acts, and the inward normal along which it does.
    x, y, z = q_x / total, q_y / total, q_z / total
    length = math.sqrt(p_x * p_x + p_y * p_y + total * total)
    n_x, n_y, n_z = p_x / length, p_y / length, total / length
    u_x, u_y, u_z = velocity(tool.v_0, tool.w_0, x, y, z)
    normal = n_x * u_x + n_y * u_y + n_z * u_z
    u_x, u_y = _turned(u_x, u_y, u_z, n_x, n_y, n_z)
    s_x, s_y, s_z = velocity(tool.mean_v, tool.mean_w, x, y, z)
    s_x, s_y = _turned(s_x, s_y, s_z, n_x, n_y, n_z)
    grip = (p.c * area + total * tan_phi) / n_z
    path += h * math.hypot(s_x, s_y)
    if is_body:
        damping = max(0.0, 1.0 - p.c_d * normal)
        j_x, j_y, m_x, m_y, share, secant = sheared(p, held, grip, j_x, j_y, h * s_x, h * s_y, path, u_x, u_y)
    else:
        j_x, j_y = remembered(p.K, j_x + h * s_x, j_y + h * s_y)
        m_x, m_y, share, secant = mobilised(p, j_x, j_y, u_x, u_y)
    drag = (p.c * min(damping, 1.0) * area + total * damping * tan_phi) / n_z * secant  # Eq. (8.7)
    f_x, f_y = -drag * m_x, -drag * m_y
    f_z = -(n_x * f_x + n_y * f_y)
    add(sums, h_x, h_y, x, y, z, f_x + n_x * f_z / (1.0 + n_z), f_y + n_y * f_z / (1.0 + n_z), f_z)
    sums[F_X] += whole(damping * (p_x * h_x + p_y * h_y))
    sums[F_Y] += whole(damping * (p_x * l_x + p_y * l_y))
    sums[F_Z] += whole(damping * total)
    sums[T_X] += whole(damping * (t_x * h_x + t_y * h_y))
    sums[T_Y] += whole(damping * (t_x * l_x + t_y * l_y))
    sums[T_Z] += whole(damping * t_z)
    sums[K_X] += whole(drag)
    sums[K_Y] += whole(drag)
    sums[K_Z] += whole(stiffness * damping)
    sums[D_Z] += whole(p.c_d * total)
    if is_body:
        resist_cell(sums, stiffness * damping, drag, p.c_d * total * n_z, p_x / total, p_y / total, n_x, n_y, n_z, x, y, z)
    return j_x, j_y, path, share, s_x, s_y, grip


@kernel(inline=True)
def add(sums, h_x, h_y, x, y, z, f_x, f_y, f_z):
    """Add a force [N] at a point [m] relative to the tool's origin, both in world axes."""
    t_x, t_y = y * f_z - z * f_y, z * f_x - x * f_z
    sums[F_X] += whole(f_x * h_x + f_y * h_y)
    sums[F_Y] += whole(f_y * h_x - f_x * h_y)
    sums[F_Z] += whole(f_z)
    sums[T_X] += whole(t_x * h_x + t_y * h_y)
    sums[T_Y] += whole(t_y * h_x - t_x * h_y)
    sums[T_Z] += whole(x * f_y - y * f_x)
