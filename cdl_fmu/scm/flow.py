"""What becomes of the soil that a tool displaces: compaction, flow to the sides and ahead, and transport below the tool.

A share ``plasticity`` of the volume that is pressed down plastically flows out from below the tool, the rest is compacted. It leaves
across the nearer edge of the footprint, as in the failure of a strip, and heaves the ground beside it over the width of a
Rankine passive wedge, depth tan(pi/4 + phi/2), most of it at the tool; a small share ``ahead`` is pushed along the direction of travel.
"""

from __future__ import annotations

import math

from ..slave.kernel import kernel
from .tiles import FILL, RATIO, SHEAR_X, SHEAR_Y, SINKAGE, STAMP, TILE, TILE_I, TILE_J, add_soil, in_tile, quantised, row_of
from .wheel import ACROSS, ALONG, ALONG_MAX, ALONG_MIN, CELLS, FLOOR, FLUX_X, FLUX_Y, J_X, J_Y, MEAN, ROW, A, B

#: Outflow of a footprint by strip: volume to the right and to the left, depth of the strip; volume ahead by column.
RIGHT, LEFT, DEPTH, AHEAD = range(4)
OUTFLOWS = 4


@kernel
def press(p, sums, cells, stamp, rows, marks, half, half_length, outflow):
    """Press the footprint of a tool into the soil.

    Args:
        half, half_length: Half width and half length of the tool [m].
        outflow: Filled with the volume that leaves each strip of one cell along the tool, as height on one cell [m], [n, OUTFLOWS].

    Returns:
        Compacted volume, as height on one cell [m].
    """
    for k in range(outflow.shape[0]):
        for m in range(OUTFLOWS):
            outflow[k, m] = 0.0
    compacted = 0.0
    for n in range(int(sums[CELLS])):
        row, a, b = int(cells[n, ROW]), int(cells[n, A]), int(cells[n, B])
        marks[row, 0] = 1
        if cells[n, FLOOR] < 0.0:
            rows[row, STAMP, a, b] = stamp
            rows[row, SHEAR_X, a, b] = rows[row, SHEAR_Y, a, b] = 0.0
            continue
        before = rows[row, SINKAGE, a, b]
        after = max(before, quantised(cells[n, MEAN]))
        rows[row, SINKAGE, a, b] = after
        rows[row, RATIO, a, b] = max(cells[n, FLOOR] / after, 1.0) if after > 0.0 else 1.0
        rows[row, SHEAR_X, a, b], rows[row, SHEAR_Y, a, b] = cells[n, J_X], cells[n, J_Y]
        rows[row, STAMP, a, b] = stamp
        displaced = quantised(p.plasticity * (after - before))
        compacted += (after - before) - displaced
        if displaced > 0.0:
            strip = int((cells[n, ALONG] + half_length) / p.cell) + 1
            column = int((cells[n, ACROSS] + half) / p.cell) + 1
            ahead = quantised(p.ahead * displaced)
            left = quantised((displaced - ahead) * min(max(0.5 + 0.5 * cells[n, ACROSS] / half, 0.0), 1.0))
            outflow[column, AHEAD] += ahead
            outflow[strip, LEFT] += left
            outflow[strip, RIGHT] += displaced - ahead - left
            outflow[strip, DEPTH] = max(outflow[strip, DEPTH], cells[n, FLOOR])
    return compacted


@kernel
def transport(sums, cells, stamp, rows, marks, grid, corner):
    """Move the soil that a tool drags along from each pressed cell to its neighbours downstream: slip sinkage."""
    for n in range(int(sums[CELLS])):
        row, a, b = int(cells[n, ROW]), int(cells[n, A]), int(cells[n, B])
        if cells[n, FLOOR] < 0.0:
            continue
        i, j = marks[row, TILE_I] * TILE + a, marks[row, TILE_J] * TILE + b
        x, y = quantised(cells[n, FLUX_X]), quantised(cells[n, FLUX_Y])
        rows[row, FILL, a, b] -= abs(x) + abs(y)
        _arrive(abs(x), stamp, rows, grid, corner, i + (1 if x > 0.0 else -1), j)
        _arrive(abs(y), stamp, rows, grid, corner, i, j + (1 if y > 0.0 else -1))


@kernel(inline=True)
def _arrive(height, stamp, rows, grid, corner, i, j):
    row, a, b = row_of(grid, corner, i, j), in_tile(i), in_tile(j)
    if rows[row, STAMP, a, b] == stamp:  # below the tool what flows in replaces what flows out
        rows[row, FILL, a, b] += height
    else:
        add_soil(rows, row, a, b, height)


@kernel
def heave(p, sums, wheel, half, half_length, outflow, rows, grid, corner):
    """Put down what flowed out from below a wheel: beside each strip, and ahead of each column."""
    T, r_0, cell = wheel.T, wheel.r_0, p.cell
    level = math.sqrt(T[1, 0] * T[1, 0] + T[1, 1] * T[1, 1])
    h_x, h_y = T[1, 1] / level, -T[1, 0] / level
    forward = 1.0 if wheel.v_0[0] * h_x + wheel.v_0[1] * h_y >= 0.0 else -1.0
    front = (sums[ALONG_MAX] if forward > 0.0 else sums[ALONG_MIN]) + forward * cell
    wedge = math.tan(0.25 * math.pi + 0.5 * p.phi)
    deepest = 0.0
    for k in range(outflow.shape[0]):
        along = (k - 0.5) * cell - half_length
        deepest = max(deepest, outflow[k, DEPTH])
        for side in range(2):
            height = outflow[k, LEFT if side else RIGHT]
            if height > 0.0:
                sign = 1.0 if side else -1.0
                across = sign * (half + cell)
                x, y = r_0[0] + along * h_x - across * h_y, r_0[1] + along * h_y + across * h_x
                _spread(p, height, x, y, -sign * h_y, sign * h_x, wedge * outflow[k, DEPTH], half, rows, grid, corner)
    for k in range(outflow.shape[0]):
        height = outflow[k, AHEAD]
        if height > 0.0:
            across = (k - 0.5) * cell - half
            x, y = r_0[0] + front * h_x - across * h_y, r_0[1] + front * h_y + across * h_x
            _spread(p, height, x, y, forward * h_x, forward * h_y, wedge * deepest, half, rows, grid, corner)


@kernel
def _spread(p, height, x, y, d_x, d_y, width, widest, rows, grid, corner):
    """Put down a height [m] on one cell's area from the point (x, y) on in the direction d, falling linearly to 0 over a width [m]."""
    n = math.ceil(max(min(width, widest), p.cell) / p.cell)
    left = height
    for k in range(n - 1, -1, -1):
        part = left if k == 0 else quantised(height * (2.0 * (n - k) - 1.0) / (n * n))
        left -= part
        _put(part, x + k * p.cell * d_x, y + k * p.cell * d_y, p.cell, rows, grid, corner)


@kernel(inline=True)
def _put(height, x, y, cell, rows, grid, corner):
    """Put down a height [m] on one cell's area around (x, y), shared among the four nearest cells."""
    i, j = math.floor(x / cell), math.floor(y / cell)
    s, q = x / cell - i, y / cell - j
    h_10, h_01, h_11 = quantised(height * s * (1.0 - q)), quantised(height * (1.0 - s) * q), quantised(height * s * q)
    add_soil(rows, row_of(grid, corner, i, j), in_tile(i), in_tile(j), height - h_10 - h_01 - h_11)
    add_soil(rows, row_of(grid, corner, i + 1, j), in_tile(i + 1), in_tile(j), h_10)
    add_soil(rows, row_of(grid, corner, i, j + 1), in_tile(i), in_tile(j + 1), h_01)
    add_soil(rows, row_of(grid, corner, i + 1, j + 1), in_tile(i + 1), in_tile(j + 1), h_11)
