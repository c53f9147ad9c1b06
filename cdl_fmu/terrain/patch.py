"""Patch: soil heights on a regular grid in world axes, and what pressed the soil before; bilinear between its nodes."""

from __future__ import annotations

import math

from ..slave.kernel import kernel


@kernel(inline=True)
def _place(patch, x, y):
    """Whether the patch reaches the world position (x, y) [m]; node before it, and the shares of the way to the next."""
    i_last, j_last = patch.z.shape[0] - 1, patch.z.shape[1] - 1
    s = (x - patch.origin[0]) / patch.spacing
    q = (y - patch.origin[1]) / patch.spacing
    if not (0.0 <= s <= i_last and 0.0 <= q <= j_last):
        return False, 0, 0, 0.0, 0.0
    i, j = min(math.floor(s), i_last - 1), min(math.floor(q), j_last - 1)
    return True, i, j, s - i, q - j


@kernel
def surface(patch, x, y):
    """Soil surface at the world position (x, y) [m].

    Returns:
        inside: False where the patch does not reach; the rest is 0 there.
        z: Height [m].
        slope_x, slope_y: Its gradient [1].
    """
    inside, i, j, s, q = _place(patch, x, y)
    if not inside:
        return False, 0.0, 0.0, 0.0
    z, slope_x, slope_y = _bilinear(patch.z, i, j, s, q, patch.spacing)
    return True, z, slope_x, slope_y


@kernel
def add_sinkage(patch, sinkage, x, y, z, slope_x, slope_y):
    """The level from which sinkage counts and its gradient, from the surface at (x, y) within a patch and the sinkage [m] of its nodes."""
    _, i, j, s, q = _place(patch, x, y)
    more, rise_x, rise_y = _bilinear(sinkage, i, j, s, q, patch.spacing)
    return z + more, slope_x + rise_x, slope_y + rise_y


@kernel
def pressed_before(patch, x, y):
    """What pressed the soil before at the world position (x, y) [m] of a patch with compaction.

    Returns:
        inside: False where the patch does not reach; the rest is 0 there.
        sinkage: Plastic sinkage [m].
        yield_pressure: [Pa].
    """
    inside, i, j, s, q = _place(patch, x, y)
    if not inside:
        return False, 0.0, 0.0
    return True, _bilinear(patch.sinkage, i, j, s, q, 1.0)[0], _bilinear(patch.yield_pressure, i, j, s, q, 1.0)[0]


@kernel
def sinkage_at(patch, x, y):
    """Plastic sinkage [m] at the world position (x, y) [m] of a patch with compaction; 0 where it does not reach."""
    inside, i, j, s, q = _place(patch, x, y)
    return _bilinear(patch.sinkage, i, j, s, q, 1.0)[0] if inside else 0.0


@kernel(inline=True)
def _bilinear(field, i, j, s, q, spacing):
    """A field between its nodes, and its gradient."""
    z00, z10, z01, z11 = field[i, j], field[i + 1, j], field[i, j + 1], field[i + 1, j + 1]
    slope_x = ((z10 - z00) * (1.0 - q) + (z11 - z01) * q) / spacing
    slope_y = ((z01 - z00) * (1.0 - s) + (z11 - z10) * s) / spacing
    return (z00 * (1.0 - s) + z10 * s) * (1.0 - q) + (z01 * (1.0 - s) + z11 * s) * q, slope_x, slope_y
