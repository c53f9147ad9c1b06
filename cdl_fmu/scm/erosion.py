"""Landslides: soil slides wherever its slope exceeds the angle of repose.

Across the face between two cells flows a share of the excess of the slope, whose size is that of the whole gradient at the face: the
difference across it, and along it the mean of the neighbours', diagonal ones included. The slope at rest therefore does not depend on its
direction. All cells flow at once, on the heights before the sweep, so that the order in which cells are visited does not matter. Cells
under a tool are held by it. Only cells near such that moved in the sweep before, or that a tool has worked on, are looked at.
"""

from __future__ import annotations

import math

import numpy as np

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
_REACH = 2  # cells around one that moved whose faces feel it

#: Cell a of a tile has the index a + EDGE in its surroundings, so that no neighbour of a cell around the tile has an index below 0.
EDGE = 2
_AROUND = TILE + EDGE + 1
#: Memory for a tile that slides: heights [m] and whether they are held (0 or 1) of its cells and those around it, the change of each [m],
#: and whether soil may flow from a cell of the row that is looked at (0 or 1). Of fixed sizes, so that loops become vector instructions.
DTYPE = np.dtype([(name, np.float64, (_AROUND, _AROUND)) for name in ("z", "held", "moved")] + [("steep", np.float64, (_AROUND,))])


@kernel
def repose_of(p):
    """Angle of repose [rad]: ``repose``, or phi where that is 0."""
    return max(p.repose if p.repose > 0.0 else p.phi, _LEAST_REPOSE)


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
    low = ((tan_repose + _AT_REST) * p.cell) ** 2
    corner = (math.sqrt(2.0) * tan_repose + 2.0 * _AT_REST) * p.cell
    for i in range(i0 - 1, i1 + 1):
        if not _may_flow(i, low, corner, tile):
            continue
        for j in range(j0 - 1, j1 + 1):
            if tile.steep[j] == 0.0:
                continue
            here, beside, before, beyond = tile.z[i, j], tile.z[i + 1, j], tile.z[i, j + 1], tile.z[i + 1, j + 1]
            if j >= j0:
                n, t = _across_x(i, j, tile)
                if n * n + t * t > low and tile.held[i, j] + tile.held[i + 1, j] == 0.0:
                    flow = _flow(p, n, t, tan_repose)
                    tile.moved[i, j] -= flow
                    tile.moved[i + 1, j] += flow
            if i >= i0:
                n, t = _across_y(i, j, tile)
                if n * n + t * t > low and tile.held[i, j] + tile.held[i, j + 1] == 0.0:
                    flow = _flow(p, n, t, tan_repose)
                    tile.moved[i, j] -= flow
                    tile.moved[i, j + 1] += flow
            # Across corners: only where the faces leave an edge that is too steep.
            n = here - beyond
            if abs(n) > corner and tile.held[i, j] + tile.held[i + 1, j + 1] == 0.0:
                flow = _corner_flow(p, n, tan_repose)
                tile.moved[i, j] -= flow
                tile.moved[i + 1, j + 1] += flow
            n = beside - before
            if abs(n) > corner and tile.held[i + 1, j] + tile.held[i, j + 1] == 0.0:
                flow = _corner_flow(p, n, tan_repose)
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
def _may_flow(i, low, corner, tile):
    """Mark the cells of row i one of whose four faces and corners towards higher indices is too steep; True if there is one.

    All of a row at once, box or not: most faces are at rest, and vector instructions tell in a fraction of the time.
    """
    n_steep = 0
    for m in range(_AROUND - 2):
        j = m + 1
        n_x, t_x = _across_x(i, j, tile)
        n_y, t_y = _across_y(i, j, tile)
        faces = max(n_x * n_x + t_x * t_x, n_y * n_y + t_y * t_y)
        corners = max(abs(tile.z[i, j] - tile.z[i + 1, j + 1]), abs(tile.z[i + 1, j] - tile.z[i, j + 1]))
        steep = faces > low or corners > corner
        tile.steep[j] = 1.0 if steep else 0.0
        n_steep += 1 if steep else 0
    return n_steep > 0


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
def _gather(p, rows, marks, head, ground, frame, stamp, row, i0, i1, j0, j1, tile):
    """Heights of a box and the cells around it; held are those under a tool, and those outside their own tile's box."""
    first, last = EDGE, EDGE + TILE - 1
    for i in range(max(i0 - 1, first), min(i1 + 1, last) + 1):
        a = i - EDGE
        for b in range(TILE):
            tile.z[i, b + EDGE] = rows[row, BASE, a, b] + (rows[row, FILL, a, b] - rows[row, SINKAGE, a, b])
            tile.held[i, b + EDGE] = 1.0 if rows[row, STAMP, a, b] == stamp else 0.0
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
