"""The soil's surface, and what pressed it before, as patches for wheels of other tiers."""

from __future__ import annotations

import math

from ..contact import is_set
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
    i0, j0 = nearest(r_0[0], spacing) - n_x // 2, nearest(r_0[1], spacing) - n_y // 2
    changed = patch.spacing != spacing or patch.origin[0] != i0 * spacing or patch.origin[1] != j0 * spacing
    patch.spacing, patch.origin[0], patch.origin[1] = spacing, i0 * spacing, j0 * spacing
    apart = spacing / (3.0 * p.cell)  # cells from one of the nine points to the next
    on_nodes = apart > 0.5 and abs(apart - nearest(apart, 1.0)) < 1e-9
    if sinkage is not None:
        # Of a tool as large as the wheel is wide, that stands: how a wheel weakens the soil below it is that wheel's to know.
        strength = strength_of(p, p.strength == CRITICAL_STATE, repose_of(p), p.b_w, p.b_w, 0.0, 0.0)
        untouched = _yields(p, strength, 0.0, 0.0)
    tile_i = tile_j = row = -1
    for a in range(n_x):
        for b in range(n_y):
            z = pressed = fill = 0.0
            for k in range(9):
                i, j = 3 * (i0 + a) + k // 3 - 1, 3 * (j0 + b) + k % 3 - 1
                u, v = nearest(i * apart, 1.0), nearest(j * apart, 1.0)
                if tile_of(u) != tile_i or tile_of(v) != tile_j or a + b + k == 0:
                    tile_i, tile_j = tile_of(u), tile_of(v)
                    row = find(marks, head, tile_i, tile_j)
                if not on_nodes:
                    z += height_at(p, rows, marks, head, ground, frame, i * spacing / 3.0, j * spacing / 3.0)
                elif row < 0:
                    z += base_height(p, ground, frame, u, v)
                else:
                    z += surface_height(rows, row, in_tile(u), in_tile(v))
                if sinkage is not None and row >= 0:
                    pressed, fill = pressed + rows[row, SINKAGE, in_tile(u), in_tile(v)], fill + rows[row, FILL, in_tile(u), in_tile(v)]
            changed |= patch.z[a, b] != z / 9.0
            patch.z[a, b] = z / 9.0
            if sinkage is not None:
                pressed, fill = pressed / 9.0, fill / 9.0
                yields = _yields(p, strength, pressed, fill) if pressed > 0.0 or fill > 0.0 else untouched
                changed |= sinkage[a, b] != pressed or yield_pressure[a, b] != yields
                sinkage[a, b], yield_pressure[a, b] = pressed, yields
    if changed:
        patch.revision += 1.0


@kernel
def _yields(p, strength, pressed, fill):
    """Pressure [Pa] at which soil yields that has a plastic sinkage and a fill [m]."""
    modulus = pressure_modulus(p, p.b_w)
    depth = tested_depth(unloading_of(p), modulus, p.n, pressed, TESTED * p.b_w)
    return yields_at(strength, modulus * depth**p.n, depth, fill, 0.0, 1.0)
