"""Landslides: soil slides wherever its slope exceeds the angle of repose.

Across the face between two cells flows a share of the excess of the slope, whose size is that of the whole gradient at the face: the
difference across it, and along it the mean of the neighbours', diagonal ones included. The slope at rest therefore does not depend on its
direction. Where the ground is a slope, so that cells stand on it obliquely, a gradient g of their heights has the inclination
tan = T / w against the horizontal, with w = 1 - a.g, T^2 = (1 + a^2) (1 + g^2) - w^2 and a the tangent of the ground's slope, uphill: no
approximation. All cells flow at once, on the heights before the sweep, so that the order in which cells are visited does not matter. Cells
under a tool are held by it. Only cells near such that moved in the sweep before, or that a tool has worked on, are looked at.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba.extending import register_jitable

from ..frames import vertical
from ..slave.kernel import kernel
from .tiles import (
    BASE,
    BOX,
    FILL,
    QUEUE,
    SINKAGE,
    SLIDING,
    STAMP,
    TILE,
    TILE_I,
    TILE_J,
    add_soil,
    base_height,
    close_box,
    find,
    let_slide,
    quantised,
    surface_height,
)

#: Share of the excess across a face that flows in a sweep: near the angle of repose soil flows along the gradient alone, and 0.5 is the
#: limit of stability; on steep slopes it flows to all sides, and 0.25 is.
_SHARE_STEEP, _SHARE_GENTLE = 0.2, 0.48
_SHARE_CORNER = 0.2  # the same between two cells that share a corner
_FASTEST = 0.05  # of a cell that may flow across a face in a sweep, so that soil does not shoot into a gap below a tool
_AT_REST = 0.004  # excess of the slope that stays: below the 0.01 of a cell that is asked for
_LEAST_REPOSE = 0.01  # [rad]: no soil becomes level all the way, as a liquid would
_LEAST = 1e-6  # divisor where a drop at rest is about upright
_REACH = 2  # cells around one that moved whose faces feel it

#: Cell a of a tile has the index a + EDGE in its surroundings, so that no neighbour of a cell around the tile has an index below 0.
EDGE = 2
_AROUND = TILE + EDGE + 1
#: Memory for a tile that slides: heights [m] and whether they are held (0 or 1) of its cells and those around it, the change of each [m],
#: and whether soil may flow from a cell of the row that is looked at (0 or 1). Of fixed sizes, so that loops become vector instructions.
DTYPE = np.dtype([(name, np.float64, (_AROUND, _AROUND)) for name in ("z", "held", "moved")] + [("steep", np.float64, (_AROUND,))])


@register_jitable
def repose_of(p):
    """Angle of repose [rad]: ``repose``, or phi where that is 0."""
    return max(p.repose if p.repose > 0.0 else p.phi, _LEAST_REPOSE)


class _Tilt(NamedTuple):
    """Ground that is a slope; on level ground None stands for it, and kernels are compiled without all that hangs on it.

    Attributes:
        x, y: Tangent of the slope along the axes, positive where the ground rises.
        ahead, behind: Tangent of the steepest drop at rest from a cell to that at higher x and y, and back.
        left, right: The same to the cell at lower x and higher y, and back.
    """

    x: float
    y: float
    ahead: float
    behind: float
    left: float
    right: float


@kernel
def _tilt(p, tan_repose):
    up_x, up_y, up_z = vertical(p.slope, p.uphill)
    x, y = up_x / up_z, up_y / up_z
    ahead, behind = _steepest(p, tan_repose, math.sqrt(0.5) * (x + y))
    left, right = _steepest(p, tan_repose, math.sqrt(0.5) * (y - x))
    return _Tilt(x, y, ahead, behind, left, right)


@kernel
def _steepest(p, tan_repose, rise):
    """Tangent of the largest drop at rest along a line on which the ground rises by this tangent, and of that on the way back."""
    # In the plane through the line and the ground's normal, which leans against the vertical by what is left of the slope, the drop along
    # the line is the sum of the ground's rise there and of an angle that is somewhat larger than the angle of repose.
    lean = (math.tan(p.slope) ** 2 - rise * rise) * math.cos(p.slope) ** 2
    tan = tan_repose / math.sqrt(max(1.0 - lean * (1.0 + tan_repose * tan_repose), _LEAST))
    return (tan + rise) / max(1.0 - tan * rise, _LEAST), (tan - rise) / max(1.0 + tan * rise, _LEAST)


@kernel
def slide(p, rows, marks, head, ground, frame, stamp, k, tile):
    """What a sweep does to the tile at place k of the queue.

    Args:
        tile: Memory for it, a record of ``DTYPE``, whose ``moved`` is filled with the change of each cell in its box, and around it.
    """
    row = head[QUEUE + k]
    i0, i1, j0, j1 = marks[row, BOX] + EDGE, marks[row, BOX + 1] + EDGE, marks[row, BOX + 2] + EDGE, marks[row, BOX + 3] + EDGE
    _gather(p, rows, marks, head, ground, frame, stamp, row, i0, i1, j0, j1, tile)
    for i in range(i0 - 1, i1 + 2):
        for j in range(j0 - 1, j1 + 2):
            tile.moved[i, j] = 0.0
    tan_repose = math.tan(repose_of(p))
    if p.slope == 0.0:
        _move(p, tan_repose, None, i0, i1, j0, j1, tile)
    else:
        _move(p, tan_repose, _tilt(p, tan_repose), i0, i1, j0, j1, tile)


@kernel
def _move(p, tan_repose, tilt, i0, i1, j0, j1, tile):
    """What a sweep moves in a box of cells that are gathered."""
    for i in range(i0 - 1, i1 + 1):
        if not _may_flow(p, i, tan_repose, tilt, tile):
            continue
        for j in range(j0 - 1, j1 + 1):
            if tile.steep[j] == 0.0:
                continue
            here, beside, before, beyond = tile.z[i, j], tile.z[i + 1, j], tile.z[i, j + 1], tile.z[i + 1, j + 1]
            if j >= j0:
                n, t = _across_x(i, j, tile)
                if _is_steep(p, tan_repose, tilt, -n, t) and tile.held[i, j] + tile.held[i + 1, j] == 0.0:
                    flow = _limited(p, _flow(p, tan_repose, tilt, -n, t)[0])
                    tile.moved[i, j] -= flow
                    tile.moved[i + 1, j] += flow
            if i >= i0:
                n, t = _across_y(i, j, tile)
                if _is_steep(p, tan_repose, tilt, t, -n) and tile.held[i, j] + tile.held[i, j + 1] == 0.0:
                    flow = _limited(p, _flow(p, tan_repose, tilt, t, -n)[1])
                    tile.moved[i, j] -= flow
                    tile.moved[i, j + 1] += flow
            # Across corners: only where the faces leave an edge that is too steep.
            n = here - beyond
            steepest = tan_repose if tilt is None else tilt.ahead if n > 0.0 else tilt.behind
            if abs(n) > _corner(p, steepest) and tile.held[i, j] + tile.held[i + 1, j + 1] == 0.0:
                flow = _corner_flow(p, n, steepest)
                tile.moved[i, j] -= flow
                tile.moved[i + 1, j + 1] += flow
            n = beside - before
            steepest = tan_repose if tilt is None else tilt.left if n > 0.0 else tilt.right
            if abs(n) > _corner(p, steepest) and tile.held[i + 1, j] + tile.held[i, j + 1] == 0.0:
                flow = _corner_flow(p, n, steepest)
                tile.moved[i + 1, j] -= flow
                tile.moved[i, j + 1] += flow


@kernel(inline=True)
def _across_x(i, j, tile):
    """Difference of the heights [m per cell] across the face between (i, j) and (i + 1, j), and along it."""
    along = (tile.z[i, j + 1] - tile.z[i, j - 1]) + (tile.z[i + 1, j + 1] - tile.z[i + 1, j - 1])
    return tile.z[i, j] - tile.z[i + 1, j], 0.25 * along


@kernel(inline=True)
def _across_y(i, j, tile):
    """The same for the face between (i, j) and (i, j + 1)."""
    along = (tile.z[i + 1, j] - tile.z[i - 1, j]) + (tile.z[i + 1, j + 1] - tile.z[i - 1, j + 1])
    return tile.z[i, j] - tile.z[i, j + 1], 0.25 * along


@kernel
def _may_flow(p, i, tan_repose, tilt, tile):
    """Mark the cells of row i one of whose four faces and corners towards higher indices is too steep; True if there is one.

    All of a row at once, box or not: most faces are at rest, and vector instructions tell in a fraction of the time.
    """
    n_steep = 0
    for m in range(_AROUND - 2):
        j = m + 1
        n_x, t_x = _across_x(i, j, tile)
        n_y, t_y = _across_y(i, j, tile)
        one, other = tile.z[i, j] - tile.z[i + 1, j + 1], tile.z[i + 1, j] - tile.z[i, j + 1]
        if tilt is None:
            steep = max(n_x * n_x + t_x * t_x, n_y * n_y + t_y * t_y) > ((tan_repose + _AT_REST) * p.cell) ** 2
            steep = steep or max(abs(one), abs(other)) > _corner(p, tan_repose)
        else:
            steep = _is_steep(p, tan_repose, tilt, -n_x, t_x) or _is_steep(p, tan_repose, tilt, t_y, -n_y)
            steep = steep or max(one - _corner(p, tilt.ahead), -one - _corner(p, tilt.behind)) > 0.0
            steep = steep or max(other - _corner(p, tilt.left), -other - _corner(p, tilt.right)) > 0.0
        tile.steep[j] = 1.0 if steep else 0.0
        n_steep += 1 if steep else 0
    return n_steep > 0


@kernel(inline=True)
def _inclination(p, tilt, x, y):
    """T^2 [m2] and w [m] per cell, whose ratio T / w is the tangent to the horizontal of heights that rise by x and y [m per cell]."""
    square = x * x + y * y
    if tilt is None:
        return square, p.cell
    rise = tilt.x * x + tilt.y * y
    square += (tilt.x * tilt.x + tilt.y * tilt.y) * (square + p.cell * p.cell) + rise * (2.0 * p.cell - rise)
    return square, max(p.cell - rise, 0.0)  # 0: the soil overhangs


@kernel(inline=True)
def _is_steep(p, tan_repose, tilt, x, y):
    """Whether heights that rise by x and y [m per cell] slide."""
    square, upright = _inclination(p, tilt, x, y)
    return square > ((tan_repose + _AT_REST) * upright) ** 2


@kernel(inline=True)
def _corner(p, steepest):
    """Height [m] that soil may drop across a corner, by the tangent of the steepest drop at rest."""
    return (math.sqrt(2.0) * steepest + 2.0 * _AT_REST) * p.cell


@kernel(inline=True)
def _flow(p, tan_repose, tilt, x, y):
    """Heights [m] that flow along x and y where heights that rise by x and y [m per cell] slide.

    On a slope it is a share of the way to the nearest gradient at rest, T = w tan(repose), on the ellipse of such gradients: a Newton step,
    which never leads too far, as T - w tan(repose) is convex, and in the end leads along the line of steepest descent.
    """
    square, upright = _inclination(p, tilt, x, y)
    length = math.sqrt(square)
    ratio = tan_repose * upright / length
    if tilt is not None:
        # T times the gradient of T - w tan(repose) with respect to that of the heights.
        stretch, lean = 1.0 + tilt.x * tilt.x + tilt.y * tilt.y, upright + tan_repose * length
        d_x, d_y = stretch * x + tilt.x * lean, stretch * y + tilt.y * lean
        step = square / (d_x * d_x + d_y * d_y)
        x, y = d_x * step, d_y * step
    share = _SHARE_STEEP + (_SHARE_GENTLE - _SHARE_STEEP) * ratio
    return -share * x * (1.0 - ratio), -share * y * (1.0 - ratio)


@kernel(inline=True)
def _corner_flow(p, n, steepest):
    """Height [m] that flows across a corner with the difference n of the heights of the cells [m]."""
    return _limited(p, math.copysign(_SHARE_CORNER * (abs(n) - (math.sqrt(2.0) * steepest + _AT_REST) * p.cell), n))


@kernel(inline=True)
def _limited(p, flow):
    return quantised(min(max(flow, -_FASTEST * p.cell), _FASTEST * p.cell))


@kernel
def _gather(p, rows, marks, head, ground, frame, stamp, row, i0, i1, j0, j1, tile):
    """Heights of a box and the cells around it; held are those under a tool, and those outside their own tile's box."""
    first, last = EDGE, EDGE + TILE - 1
    for i in range(max(i0 - 1, first), min(i1 + 1, last) + 1):
        a = i - EDGE
        for b in range(TILE):
            held = rows[row, STAMP, a, b] == stamp
            tile.z[i, b + EDGE] = rows[row, BASE, a, b] + (rows[row, FILL, a, b] - rows[row, SINKAGE, a, b])
            if held:
                tile.z[i, b + EDGE] += _laid(p, rows, marks, ground, frame, row, a, b)
            tile.held[i, b + EDGE] = 1.0 if held else 0.0
        tile.held[i, j0 - 1] = tile.held[i, j1 + 1] = 1.0
        if not i0 <= i <= i1:
            for j in range(j0, j1 + 1):
                tile.held[i, j] = 1.0
    if i0 == first:
        _gather_strip(p, rows, marks, head, ground, frame, stamp, row, first - 1, first - 1, j0 - 1, j1 + 1, tile)
    if i1 == last:
        _gather_strip(p, rows, marks, head, ground, frame, stamp, row, last + 1, last + 1, j0 - 1, j1 + 1, tile)
    if j0 == first:
        _gather_strip(p, rows, marks, head, ground, frame, stamp, row, max(i0 - 1, first), min(i1 + 1, last), first - 1, first - 1, tile)
    if j1 == last:
        _gather_strip(p, rows, marks, head, ground, frame, stamp, row, max(i0 - 1, first), min(i1 + 1, last), last + 1, last + 1, tile)


@kernel(inline=True)
def _laid(p, rows, marks, ground, frame, row, a, b):
    """Depth [m] of the hole that a body fills around which the soil was laid: soil leans against it as if there was none."""
    return base_height(p, ground, frame, marks[row, TILE_I] * TILE + a, marks[row, TILE_J] * TILE + b) - rows[row, BASE, a, b]


@kernel
def _gather_strip(p, rows, marks, head, ground, frame, stamp, row, i0, i1, j0, j1, tile):
    """The same for cells of neighbouring tiles."""
    last_a = last_b = 0
    other = row
    for i in range(i0, i1 + 1):
        for j in range(j0, j1 + 1):
            a, b = (i - EDGE + TILE) // TILE - 1, (j - EDGE + TILE) // TILE - 1
            if a != last_a or b != last_b:
                last_a, last_b = a, b
                other = find(marks, head, marks[row, TILE_I] + a, marks[row, TILE_J] + b)
            u, v = i - EDGE - a * TILE, j - EDGE - b * TILE
            held = 1.0
            if other < 0:
                height = base_height(p, ground, frame, (marks[row, TILE_I] + a) * TILE + u, (marks[row, TILE_J] + b) * TILE + v)
            else:
                height = surface_height(rows, other, u, v)
                if rows[other, STAMP, u, v] == stamp:
                    height += _laid(p, rows, marks, ground, frame, other, u, v)
                box = marks[other, BOX] <= u <= marks[other, BOX + 1] and marks[other, BOX + 2] <= v <= marks[other, BOX + 3]
                if box and rows[other, STAMP, u, v] != stamp:
                    held = 0.0
            tile.z[i, j] = height
            tile.held[i, j] = held


@kernel
def settle(p, rows, marks, head, ground, frame, tiles, boxes):
    """Move the soil of all tiles in the queue as ``slide`` found, and queue what may slide next; False if there was no room for all.

    Args:
        tiles: What ``slide`` found for each tile in the queue, records of ``DTYPE``.
        boxes: Memory for the box of cells that moved in each, [n, 4].
    """
    n = head[SLIDING]
    for k in range(n):
        row, moved = head[QUEUE + k], tiles[k].moved
        first_i, last_i, first_j, last_j = TILE, -1, TILE, -1
        for i in range(marks[row, BOX], marks[row, BOX + 1] + 1):
            for j in range(marks[row, BOX + 2], marks[row, BOX + 3] + 1):
                if moved[i + EDGE, j + EDGE] != 0.0:
                    add_soil(rows, row, i, j, moved[i + EDGE, j + EDGE])
                    first_i, last_i, first_j, last_j = min(first_i, i), max(last_i, i), min(first_j, j), max(last_j, j)
        i, j = marks[row, TILE_I] * TILE, marks[row, TILE_J] * TILE
        boxes[k, 0], boxes[k, 1], boxes[k, 2], boxes[k, 3] = i + first_i, i + last_i, j + first_j, j + last_j
        close_box(marks, row)
    head[SLIDING] = 0
    done = True
    for k in range(n):
        if boxes[k, 1] >= boxes[k, 0]:
            done &= let_slide(
                p,
                rows,
                marks,
                head,
                ground,
                frame,
                boxes[k, 0] - _REACH,
                boxes[k, 1] + _REACH,
                boxes[k, 2] - _REACH,
                boxes[k, 3] + _REACH,
            )
    return done
