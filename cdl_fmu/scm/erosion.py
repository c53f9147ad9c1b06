"""Landslides: soil slides wherever its slope exceeds the angle of repose.

Across the face between two cells flows a share of the excess of the slope, whose size is that of the whole gradient at the face: the
difference across it, and along it the mean of the neighbours', diagonal ones included. The slope at rest therefore does not depend on its
direction. All cells flow at once, on the heights before the sweep, so that the order in which cells are visited does not matter. Cells
under a tool are held by it. Only cells near such that moved in the sweep before, or that a tool has worked on, are looked at.
"""

from __future__ import annotations

import math

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
_SHARE_STEEP, _SHARE_GENTLE = 0.2, 0.45
_SHARE_CORNER = 0.2  # the same between two cells that share a corner
_FASTEST = 0.05  # of a cell that may flow across a face in a sweep, so that soil does not shoot into a gap below a tool
_AT_REST = 0.004  # excess of the slope that stays: below the 0.01 of a cell that is asked for
_REACH = 2  # cells around one that moved whose faces feel it
#: Width of the surroundings of a tile: a cell on each side.
AROUND = TILE + 2


@kernel
def slide(p, rows, marks, head, ground, frame, stamp, k, around, moved):
    """What a sweep does to the tile at place k of the queue.

    Args:
        around: Memory for its heights and whether they are held, [2, AROUND, AROUND].
        moved: Filled with the change of each cell in its box [m], [AROUND, AROUND] with a margin of one cell.
    """
    row = head[QUEUE + k]
    i0, i1, j0, j1 = marks[row, BOX] + 1, marks[row, BOX + 1] + 1, marks[row, BOX + 2] + 1, marks[row, BOX + 3] + 1
    _gather(p, rows, marks, head, ground, frame, stamp, row, i0, i1, j0, j1, around)
    for i in range(i0 - 1, i1 + 2):
        for j in range(j0 - 1, j1 + 2):
            moved[i, j] = 0.0
    tan_repose = math.tan(p.repose)
    low = ((tan_repose + _AT_REST) * p.cell) ** 2
    corner = (math.sqrt(2.0) * tan_repose + 2.0 * _AT_REST) * p.cell
    for i in range(i0 - 1, i1 + 1):
        for j in range(j0 - 1, j1 + 1):
            here, beside, before, beyond = around[0, i, j], around[0, i + 1, j], around[0, i, j + 1], around[0, i + 1, j + 1]
            if j >= j0:
                n = here - beside
                t = 0.25 * ((before - around[0, i, j - 1]) + (beyond - around[0, i + 1, j - 1]))
                if n * n + t * t > low and around[1, i, j] + around[1, i + 1, j] == 0.0:
                    flow = _flow(p, n, t, tan_repose)
                    moved[i, j] -= flow
                    moved[i + 1, j] += flow
            if i >= i0:
                n = here - before
                t = 0.25 * ((beside - around[0, i - 1, j]) + (beyond - around[0, i - 1, j + 1]))
                if n * n + t * t > low and around[1, i, j] + around[1, i, j + 1] == 0.0:
                    flow = _flow(p, n, t, tan_repose)
                    moved[i, j] -= flow
                    moved[i, j + 1] += flow
            # Across corners: only where the faces leave an edge that is too steep.
            n = here - beyond
            if abs(n) > corner and around[1, i, j] + around[1, i + 1, j + 1] == 0.0:
                flow = _corner_flow(p, n, tan_repose)
                moved[i, j] -= flow
                moved[i + 1, j + 1] += flow
            n = beside - before
            if abs(n) > corner and around[1, i + 1, j] + around[1, i, j + 1] == 0.0:
                flow = _corner_flow(p, n, tan_repose)
                moved[i + 1, j] -= flow
                moved[i, j + 1] += flow


@kernel(inline=True)
def _flow(p, n, t, tan_repose):
    """Height [m] that flows across a face with the differences of height n across and t along it [m per cell]."""
    ratio = tan_repose * p.cell / math.sqrt(n * n + t * t)
    return _limited(p, (_SHARE_STEEP + (_SHARE_GENTLE - _SHARE_STEEP) * ratio) * n * (1.0 - ratio))


@kernel(inline=True)
def _corner_flow(p, n, tan_repose):
    """The same across a corner, with the difference n of the heights of the cells [m]."""
    return _limited(p, math.copysign(_SHARE_CORNER * (abs(n) - (math.sqrt(2.0) * tan_repose + _AT_REST) * p.cell), n))


@kernel(inline=True)
def _limited(p, flow):
    return quantised(min(max(flow, -_FASTEST * p.cell), _FASTEST * p.cell))


@kernel
def _gather(p, rows, marks, head, ground, frame, stamp, row, i0, i1, j0, j1, around):
    """Heights of a box and the cells around it; held (1) are those under a tool, and those outside their own tile's box.

    Indices count from the cell before the tile's first.
    """
    for i in range(max(i0 - 1, 1), min(i1 + 1, TILE) + 1):
        for j in range(max(j0 - 1, 1), min(j1 + 1, TILE) + 1):
            around[0, i, j] = rows[row, BASE, i - 1, j - 1] + (rows[row, FILL, i - 1, j - 1] - rows[row, SINKAGE, i - 1, j - 1])
            inside = i0 <= i <= i1 and j0 <= j <= j1
            around[1, i, j] = 0.0 if inside and rows[row, STAMP, i - 1, j - 1] != stamp else 1.0
    if i0 == 1:
        _gather_strip(p, rows, marks, head, ground, frame, stamp, row, 0, 0, j0 - 1, j1 + 1, around)
    if i1 == TILE:
        _gather_strip(p, rows, marks, head, ground, frame, stamp, row, TILE + 1, TILE + 1, j0 - 1, j1 + 1, around)
    if j0 == 1:
        _gather_strip(p, rows, marks, head, ground, frame, stamp, row, max(i0 - 1, 1), min(i1 + 1, TILE), 0, 0, around)
    if j1 == TILE:
        _gather_strip(p, rows, marks, head, ground, frame, stamp, row, max(i0 - 1, 1), min(i1 + 1, TILE), TILE + 1, TILE + 1, around)


@kernel
def _gather_strip(p, rows, marks, head, ground, frame, stamp, row, i0, i1, j0, j1, around):
    """The same for cells of neighbouring tiles."""
    last_a = last_b = 0
    other = row
    for i in range(i0, i1 + 1):
        for j in range(j0, j1 + 1):
            a, b = (i + TILE - 1) // TILE - 1, (j + TILE - 1) // TILE - 1
            if a != last_a or b != last_b:
                last_a, last_b = a, b
                other = find(marks, head, marks[row, TILE_I] + a, marks[row, TILE_J] + b)
            u, v = i - 1 - a * TILE, j - 1 - b * TILE
            held = 1.0
            if other < 0:
                height = base_height(p, ground, frame, (marks[row, TILE_I] + a) * TILE + u, (marks[row, TILE_J] + b) * TILE + v)
            else:
                height = surface_height(rows, other, u, v)
                box = marks[other, BOX] <= u <= marks[other, BOX + 1] and marks[other, BOX + 2] <= v <= marks[other, BOX + 3]
                if box and rows[other, STAMP, u, v] != stamp:
                    held = 0.0
            around[0, i, j] = height
            around[1, i, j] = held


@kernel
def settle(p, rows, marks, head, ground, frame, moved, boxes):
    """Move the soil of all tiles in the queue as ``slide`` found, and queue what may slide next.

    Args:
        moved: Changes of the cells of each tile in the queue [m], [n, AROUND, AROUND].
        boxes: Memory for the box of cells that moved in each, [n, 4].
    """
    n = head[SLIDING]
    for k in range(n):
        row = head[QUEUE + k]
        first_i, last_i, first_j, last_j = TILE, -1, TILE, -1
        for i in range(marks[row, BOX], marks[row, BOX + 1] + 1):
            for j in range(marks[row, BOX + 2], marks[row, BOX + 3] + 1):
                if moved[k, i + 1, j + 1] != 0.0:
                    add_soil(rows, row, i, j, moved[k, i + 1, j + 1])
                    first_i, last_i, first_j, last_j = min(first_i, i), max(last_i, i), min(first_j, j), max(last_j, j)
        i, j = marks[row, TILE_I] * TILE, marks[row, TILE_J] * TILE
        boxes[k, 0], boxes[k, 1], boxes[k, 2], boxes[k, 3] = i + first_i, i + last_i, j + first_j, j + last_j
        close_box(marks, row)
    head[SLIDING] = 0
    for k in range(n):
        if boxes[k, 1] >= boxes[k, 0]:
            let_slide(
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
