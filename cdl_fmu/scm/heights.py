"""The soil's surface, and what pressed it before, as patches for wheels of other tiers."""

from __future__ import annotations

import math

from ..slave.interface import TESTED
from ..slave.kernel import kernel
from ..strength import strength_of, yield_pressure
from ..unloading import tested_depth, unloading_of
from .erosion import repose_of
from .stress import pressure_modulus
from .tiles import FILL, SINKAGE, TILE, base_height, find, in_tile, nearest, surface_height, tile_of


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
def fill_patch(p, rows, marks, head, ground, frame, r_0, patch):
    """Heights around a wheel at r_0: nodes at multiples of the spacing, each the mean of nine points a third of the spacing apart."""
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
    whole = nearest(apart, 1.0)
    on_nodes = whole > 0 and abs(apart - whole) < 1e-9
    for a in range(n_x):
        for b in range(n_y):
            patch.z[a, b] = 0.0
    for i in range(3 * i0 - 1, 3 * (i0 + n_x) - 1):
        a = (i + 1) // 3 - i0
        row, tile = -1, 0
        for j in range(3 * j0 - 1, 3 * (j0 + n_y) - 1):
            b = (j + 1) // 3 - j0
            if on_nodes:
                u, v = i * whole, j * whole
                if tile_of(v) != tile or j == 3 * j0 - 1:
                    tile = tile_of(v)
                    row = find(marks, head, tile_of(u), tile)
                patch.z[a, b] += base_height(p, ground, frame, u, v) if row < 0 else surface_height(rows, row, in_tile(u), in_tile(v))
            else:
                patch.z[a, b] += height_at(p, rows, marks, head, ground, frame, i * spacing / 3.0, j * spacing / 3.0)
    for a in range(n_x):
        for b in range(n_y):
            patch.z[a, b] /= 9.0


@kernel
def fill_compaction(p, rows, marks, head, patch):
    """What pressed the soil before at the nodes of a patch whose heights are filled: means of the cells around each node."""
    n_x, n_y = patch.z.shape
    law, modulus, least = unloading_of(p), pressure_modulus(p, p.b_w), TESTED * p.b_w
    untouched = modulus * least**p.n
    # A tool as large as the wheel is wide, that stands: how a wheel weakens the soil below it is that wheel's to know.
    strength = strength_of(p, p.strength == 1.0, repose_of(p), p.b_w, p.b_w, 0.0, 0.0)
    reach = max(nearest(0.5 * patch.spacing, p.cell) - 1, 0)
    for a in range(n_x):
        for b in range(n_y):
            patch.sinkage[a, b], patch.yield_pressure[a, b] = 0.0, untouched
            if patch.spacing == 0.0:
                continue
            i, j = nearest(patch.origin[0] + a * patch.spacing, p.cell), nearest(patch.origin[1] + b * patch.spacing, p.cell)
            pressed, fill = _pressed_around(i, j, reach, rows, marks, head)
            if pressed > 0.0 or fill > 0.0:
                depth = tested_depth(law, modulus, p.n, pressed, least)
                patch.sinkage[a, b] = pressed
                patch.yield_pressure[a, b] = yield_pressure(strength, modulus * depth**p.n, depth, fill, 0.0, 1.0)


@kernel
def _pressed_around(i, j, reach, rows, marks, head):
    """Mean plastic sinkage and fill [m] of the cells around cell (i, j), up to ``reach`` cells away."""
    sinkage = fill = 0.0
    for ti in range(tile_of(i - reach), tile_of(i + reach) + 1):
        for tj in range(tile_of(j - reach), tile_of(j + reach) + 1):
            row = find(marks, head, ti, tj)
            if row < 0:
                continue
            for u in range(max(i - reach, ti * TILE), min(i + reach, ti * TILE + TILE - 1) + 1):
                for v in range(max(j - reach, tj * TILE), min(j + reach, tj * TILE + TILE - 1) + 1):
                    sinkage += rows[row, SINKAGE, in_tile(u), in_tile(v)]
                    fill += rows[row, FILL, in_tile(u), in_tile(v)]
    n = (2.0 * reach + 1.0) ** 2
    return sinkage / n, fill / n
