"""The soil's surface as cells in tiles that are allocated on touch, so that memory grows with the track and not with the map.

Node (i, j) of the grid lies at x = i cell, y = j cell; its cell is the square around it. A tile holds ``TILE`` x ``TILE`` cells.

Heights change by whole multiples of ``QUANTUM`` only, so that sums of them are exact in float64: no rounding, whatever the order
of the summands. Volume is therefore conserved to the last bit, and no result depends on the order in which cells are visited.
"""

from __future__ import annotations

import math

from ..slave.kernel import kernel

TILE = 16
_SHIFT, _MASK = 4, 15

#: Fields of a cell. The soil's surface lies at BASE + FILL - SINKAGE.
BASE = 0  # [m] undisturbed surface
FILL = 1  # [m] soil brought here (> 0) or taken away (< 0): moves the level from which sinkage counts
SINKAGE = 2  # [m] plastic sinkage, mean of the cell
RATIO = 3  # [1] plastic sinkage of the part of the cell that a tool pressed over that of the whole cell, at least 1
SHEAR_X, SHEAR_Y = 4, 5  # [m] shear displacement of tool against soil, in world axes
STAMP = 6  # [1] number of the last step in which a tool pressed on the cell
SLIP = 7  # [m] path of slip of the tool on the cell, which softens dense soil
POINT = 8  # [1] sinkage of four points along the heading of the tool that pressed the cell last, over that of the cell
POINTS = 4
COMPACTED = POINT + POINTS  # [m] height that the column below the cell lost by compaction, wherever soil on it went since
HELD = COMPACTED + 1  # [Pa] friction that the cell could give per area of the body that pressed it last
OWNER = HELD + 1  # [1] number of the tool that pressed on the cell last, from 1
FIELDS = OWNER + 1

#: Marks of a tile: 0 is the pool's own; indices, next tile in the chain of its hash, box of cells that may slide [i0, i1] x [j0, j1].
TILE_I, TILE_J, NEXT, BOX = 1, 2, 3, 4
MARKS = 8
#: Entries of head: 0 is the pool's own (tiles in use), then the number of tiles whose soil may slide, these tiles, and chains of a hash.
SLIDING, QUEUE = 1, 2
LONGEST_QUEUE = 1022
_HASH, _CHAINS = 1024, 1024
HEAD = _HASH + _CHAINS

QUANTUM = 2.0**-40  # [m]
_ROUND = 1.5 * 2.0**52 * QUANTUM


@kernel(inline=True)
def quantised(height):
    """Nearest multiple of QUANTUM [m]; sums of such are exact up to 4096 m."""
    return (height + _ROUND) - _ROUND


@kernel(inline=True)
def _chain(ti, tj):
    return _HASH + ((ti * 73856093) ^ (tj * 19349663)) % _CHAINS


@kernel(inline=True)
def find(marks, head, ti, tj):
    """Row of tile (ti, tj), or -1."""
    row = head[_chain(ti, tj)] - 1
    while row >= 0 and (marks[row, TILE_I] != ti or marks[row, TILE_J] != tj):
        row = marks[row, NEXT] - 1
    return row


@kernel
def base_height(p, ground, frame, i, j):
    """Undisturbed surface [m] at node (i, j)."""
    return base_height_at(p, ground, frame, i * p.cell, j * p.cell)


@kernel
def base_height_at(p, ground, frame, x, y):
    """Undisturbed surface [m] at (x, y) [m]: flat at ground_z, or bilinear in the raster ``ground`` with origin and spacing ``frame``.

    Beyond its edges the raster goes on level: tiles overlap them, tools must not.
    """
    if ground.shape[0] < 2:
        return p.ground_z
    s = min(max((x - frame[0]) / frame[2], 0.0), ground.shape[0] - 1.0)
    q = min(max((y - frame[1]) / frame[2], 0.0), ground.shape[1] - 1.0)
    a, b = min(int(s), ground.shape[0] - 2), min(int(q), ground.shape[1] - 2)
    s, q = s - a, q - b
    low = ground[a, b] * (1.0 - s) + ground[a + 1, b] * s
    return low * (1.0 - q) + (ground[a, b + 1] * (1.0 - s) + ground[a + 1, b + 1] * s) * q


@kernel
def touch(p, rows, marks, head, ground, frame, ti, tj):
    """Row of tile (ti, tj), allocated if it is new; -1 if the pool is full."""
    row = find(marks, head, ti, tj)
    if row >= 0 or head[0] >= rows.shape[0]:
        return row
    row = head[0]
    head[0] += 1
    chain = _chain(ti, tj)
    marks[row, 0] = 1
    marks[row, TILE_I], marks[row, TILE_J], marks[row, NEXT] = ti, tj, head[chain]
    head[chain] = row + 1
    close_box(marks, row)
    for i in range(TILE):
        for j in range(TILE):
            rows[row, BASE, i, j] = base_height(p, ground, frame, (ti << _SHIFT) + i, (tj << _SHIFT) + j)
            for field in range(FILL, FIELDS):
                rows[row, field, i, j] = 0.0
            rows[row, RATIO, i, j] = 1.0
            for k in range(POINTS):
                rows[row, POINT + k, i, j] = 1.0
            rows[row, STAMP, i, j] = -1.0
    return row


@kernel
def close_box(marks, row):
    """No cell of this tile may slide."""
    marks[row, BOX], marks[row, BOX + 1], marks[row, BOX + 2], marks[row, BOX + 3] = TILE, -1, TILE, -1
    marks[row, 0] = 1


@kernel
def let_slide(p, rows, marks, head, ground, frame, i0, i1, j0, j1):
    """Mark the cells [i0, i1] x [j0, j1] as such that may slide; False if the pool or the queue is full."""
    done = True
    for ti in range(i0 >> _SHIFT, (i1 >> _SHIFT) + 1):
        for tj in range(j0 >> _SHIFT, (j1 >> _SHIFT) + 1):
            row = touch(p, rows, marks, head, ground, frame, ti, tj)
            if row < 0:
                done = False
                continue
            if marks[row, BOX + 1] < 0:
                if head[SLIDING] >= LONGEST_QUEUE:
                    done = False
                    continue
                head[QUEUE + head[SLIDING]] = row
                head[SLIDING] += 1
            i, j = ti << _SHIFT, tj << _SHIFT
            marks[row, BOX] = min(marks[row, BOX], max(i0 - i, 0))
            marks[row, BOX + 1] = max(marks[row, BOX + 1], min(i1 - i, TILE - 1))
            marks[row, BOX + 2] = min(marks[row, BOX + 2], max(j0 - j, 0))
            marks[row, BOX + 3] = max(marks[row, BOX + 3], min(j1 - j, TILE - 1))
            marks[row, 0] = 1
    return done


@kernel(inline=True)
def tile_of(i):
    """Tile index of a cell index."""
    return i >> _SHIFT


@kernel
def look_up(marks, head, grid, corner, i0, i1, j0, j1):
    """Fill ``grid`` with the rows of the tiles under the cells [i0, i1] x [j0, j1] (-1: none), and ``corner`` with its first tile."""
    corner[0], corner[1] = i0 >> _SHIFT, j0 >> _SHIFT
    for a in range((i1 >> _SHIFT) - corner[0] + 1):
        for b in range((j1 >> _SHIFT) - corner[1] + 1):
            grid[a, b] = find(marks, head, corner[0] + a, corner[1] + b)


@kernel(inline=True)
def row_of(grid, corner, i, j):
    """Row of the tile that holds cell (i, j), from a ``look_up``."""
    return grid[(i >> _SHIFT) - corner[0], (j >> _SHIFT) - corner[1]]


@kernel(inline=True)
def surface_height(rows, row, i, j):
    """Height [m] of cell (i, j) of the grid in its tile's row."""
    a, b = i & _MASK, j & _MASK
    return rows[row, BASE, a, b] + (rows[row, FILL, a, b] - rows[row, SINKAGE, a, b])


@kernel(inline=True)
def floor_depth(rows, row, a, b):
    """Plastic sinkage [m] of the pressed part of cell (a, b) of a tile."""
    return rows[row, SINKAGE, a, b] * rows[row, RATIO, a, b]


@kernel(inline=True)
def add_soil(rows, row, a, b, height):
    """Put down (> 0) or take away (< 0) soil [m], a multiple of QUANTUM, at cell (a, b) of a tile.

    Loose soil first fills what was pressed down, which loses the strength it had gained there; only what is left raises the level
    from which sinkage counts. Otherwise loose fill would be as strong as what was compacted below it.
    """
    if height > 0.0:
        filled = min(height, rows[row, SINKAGE, a, b])
        rows[row, SINKAGE, a, b] -= filled
        height -= filled
    rows[row, FILL, a, b] += height


@kernel(inline=True)
def in_tile(i):
    """Index of a cell within its tile."""
    return i & _MASK


@kernel(inline=True)
def nearest(x, cell):
    """Index of the node nearest to x [m]."""
    return math.floor(x / cell + 0.5)
