"""The soil's surface, and what pressed it before, as patches for wheels of other tiers."""

from __future__ import annotations

import math

from ..slave.interface import TESTED
from ..slave.kernel import kernel
from ..strength import CRITICAL_STATE, strength_of
from ..strength import yield_pressure as yields_at
from ..unloading import tested_depth, unloading_of
from .erosion import repose_of
from .stress import pressure_modulus
from .tiles import FILL, SINKAGE, base_height, find, in_tile, nearest, surface_height, tile_of


@kernel
def height_at(p, rows, marks, head, ground, frame, x, y):
    """Height [m] of the soil's surface at (x, y) [m], bilinear between nodes."""
    s, q = x / p.cell, y / p.cell
    i, j = math.floor(s), math.floor(q)
    s, q = s - i, q - j
    total = 0.0
    for a in range(2):
        for b in range(2):
            share = (s if a else 1.0 - s) * (q if b else 1.0 - q)
            if share > 0.0:
                row = find(marks, head, tile_of(i + a), tile_of(j + b))
                if row < 0:
                    total += share * base_height(p, ground, frame, i + a, j + b)
                else:
                    total += share * surface_height(rows, row, in_tile(i + a), in_tile(j + b))
    return total


@kernel
def is_set(r_0):
    """False for a position that was never sent: exactly 0. Some masters send zeros before the first step."""
    return r_0[0] != 0.0 or r_0[1] != 0.0 or r_0[2] != 0.0


@kernel
def fill_patch(p, rows, marks, head, ground, frame, r_0, patch, sinkage=None, yield_pressure=None):
    """Heights around a wheel at r_0: nodes at multiples of the spacing, each the mean of nine points a third of the spacing apart.

    Args:
        sinkage, yield_pressure: Those of a patch that carries what pressed the soil before, None of another.
    """
    if not is_set(r_0):
        patch.spacing = 0.0
        return
    spacing = p.patch_spacing
    n_x, n_y = patch.z.shape
    i0 = nearest(r_0[0], spacing) - n_x // 2
    j0 = nearest(r_0[1], spacing) - n_y // 2
    patch.spacing = spacing
    patch.origin[0], patch.origin[1] = i0 * spacing, j0 * spacing
    apart = spacing / (3.0 * p.cell)  # cells from one of the nine points to the next
    on_nodes = apart > 0.5 and abs(apart - nearest(apart, 1.0)) < 1e-9
    for a in range(n_x):
        for b in range(n_y):
            patch.z[a, b] = 0.0
            if sinkage is not None:
                sinkage[a, b] = yield_pressure[a, b] = 0.0
    for i in range(3 * i0 - 1, 3 * (i0 + n_x) - 1):
        a, u = (i + 1) // 3 - i0, nearest(i * apart, 1.0)
        row, tile, first = -1, 0, True
        for j in range(3 * j0 - 1, 3 * (j0 + n_y) - 1):
            b, v = (j + 1) // 3 - j0, nearest(j * apart, 1.0)
            if first or tile_of(v) != tile:
                tile, first = tile_of(v), False
                row = find(marks, head, tile_of(u), tile)
            if not on_nodes:
                patch.z[a, b] += height_at(p, rows, marks, head, ground, frame, i * spacing / 3.0, j * spacing / 3.0)
            elif row < 0:
                patch.z[a, b] += base_height(p, ground, frame, u, v)
            else:
                patch.z[a, b] += surface_height(rows, row, in_tile(u), in_tile(v))
            if sinkage is not None and row >= 0:
                sinkage[a, b] += rows[row, SINKAGE, in_tile(u), in_tile(v)]
                yield_pressure[a, b] += rows[row, FILL, in_tile(u), in_tile(v)]  # for the time being
    for a in range(n_x):
        for b in range(n_y):
            patch.z[a, b] /= 9.0
    if sinkage is not None:
        _fill_yield_pressure(p, sinkage, yield_pressure)


@kernel
def _fill_yield_pressure(p, sinkage, yield_pressure):
    """Sums of nine cells' plastic sinkage and fill [m] at each node, as mean plastic sinkage and the pressure at which soil yields."""
    law, modulus, least = unloading_of(p), pressure_modulus(p, p.b_w), TESTED * p.b_w
    untouched = modulus * least**p.n
    # A tool as large as the wheel is wide, that stands: how a wheel weakens the soil below it is that wheel's to know.
    strength = strength_of(p, p.strength == CRITICAL_STATE, repose_of(p), p.b_w, p.b_w, 0.0, 0.0)
    for a in range(sinkage.shape[0]):
        for b in range(sinkage.shape[1]):
            pressed, fill = sinkage[a, b] / 9.0, yield_pressure[a, b] / 9.0
            sinkage[a, b], yield_pressure[a, b] = pressed, untouched
            if pressed > 0.0 or fill > 0.0:
                depth = tested_depth(law, modulus, p.n, pressed, least)
                yield_pressure[a, b] = yields_at(strength, modulus * depth**p.n, depth, fill, 0.0, 1.0)
