"""The parametric wheel as an analytic surface."""

from __future__ import annotations

import math

from .slave.kernel import kernel


@kernel
def wheel_distance(x, y, z, r_w, b_w, n_g, h_g, t_g):
    """Signed distance [m] of a point of the wheel's frame from the wheel of ``cdl_fmu.wheel.WHEEL``: rim and plates, < 0 within.

    Exact outside; within it is that of the part in which the point is deepest. Grousers stand as in ``wheel_mesh``.

    Args:
        x, y, z: Point [m]; y is the axle.
        r_w, b_w, n_g, h_g, t_g: As in ``wheel_mesh``.
    """
    rho, axial = math.hypot(x, z), abs(y) - 0.5 * b_w
    distance = _distance(rho - r_w, axial, -math.inf)
    if n_g >= 1.0 and h_g > 0.0:
        pitch = 2.0 * math.pi / n_g
        angle = math.atan2(x, -z)
        angle -= pitch * math.floor(angle / pitch + 0.5)
        along, out = abs(rho * math.sin(angle)), rho * math.cos(angle)
        half = 0.5 * (r_w + h_g)  # a plate begins at the axle
        distance = min(distance, _distance(along - 0.5 * t_g, axial, abs(out - half) - half))
    return distance


@kernel(inline=True)
def _distance(a, b, c):
    """Distance from an edge or corner where two or three of these are above 0, else the largest."""
    outside = math.sqrt(max(a, 0.0) ** 2 + max(b, 0.0) ** 2 + max(c, 0.0) ** 2)
    return outside if outside > 0.0 else max(a, b, c)
