"""Height patch: soil heights on a regular grid in world axes, bilinear between its nodes."""

from __future__ import annotations

import math

from ..slave.kernel import kernel


@kernel
def surface(patch, x, y):
    """Soil surface at the world position (x, y) [m].

    Returns:
        inside: False where the patch does not reach; the rest is 0 there.
        z: Height [m].
        slope_x, slope_y: Its gradient [1].
    """
    heights = patch.z
    i_last, j_last = heights.shape[0] - 1, heights.shape[1] - 1
    s = (x - patch.origin[0]) / patch.spacing
    q = (y - patch.origin[1]) / patch.spacing
    if not (0.0 <= s <= i_last and 0.0 <= q <= j_last):
        return False, 0.0, 0.0, 0.0
    i, j = min(math.floor(s), i_last - 1), min(math.floor(q), j_last - 1)
    s, q = s - i, q - j
    z00, z10, z01, z11 = heights[i, j], heights[i + 1, j], heights[i, j + 1], heights[i + 1, j + 1]
    slope_x = ((z10 - z00) * (1.0 - q) + (z11 - z01) * q) / patch.spacing
    slope_y = ((z01 - z00) * (1.0 - s) + (z11 - z10) * s) / patch.spacing
    return True, (z00 * (1.0 - s) + z10 * s) * (1.0 - q) + (z01 * (1.0 - s) + z11 * s) * q, slope_x, slope_y
