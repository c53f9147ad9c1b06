"""What becomes of the soil that a tool displaces: compaction, flow to the sides and ahead, and transport below the tool.

A share ``plasticity`` of the volume that is pressed down plastically flows out from below the tool, the rest is compacted, which stays with
the cell; what soil as dense as can be would have to lose flows out too. It leaves across the nearer edge of the footprint of a wheel, as in
the failure of a strip, or to all sides of a body, and heaves the ground beside it over the width of a Rankine passive wedge, depth
tan(pi/4 + phi/2), most of it at the tool. Where friction pushes the soil ahead of a wheel in skid, or to a side, a share ``ahead`` of what
flows out goes there.
"""

from __future__ import annotations

import math

from ..contact import SLIP_FLOOR
from ..slave.kernel import kernel
from .columns import (
    ACROSS,
    ALONG,
    ALONG_MAX,
    ALONG_MIN,
    CELLS,
    FIRST,
    FLOOR,
    FLUX_X,
    FLUX_Y,
    FRICTION,
    J_X,
    J_Y,
    MEAN,
    OFF,
    PATH,
    PRESSURE,
    PUSH_ACROSS,
    PUSH_AHEAD,
    ROW,
    A,
    B,
)
from .density import density_of
from .tiles import (
    COMPACTED,
    FILL,
    HELD,
    OWNER,
    POINT,
    POINTS,
    RATIO,
    SHEAR_X,
    SHEAR_Y,
    SINKAGE,
    SLIP,
    STAMP,
    TILE,
    TILE_I,
    TILE_J,
    add_soil,
    in_tile,
    nearest,
    quantised,
    row_of,
)

#: Outflow of a footprint by strip: volume to the right and to the left, depth of the strip; volume ahead by column.
RIGHT, LEFT, DEPTH, AHEAD = range(4)
OUTFLOWS = 4
#: What a pressed cell's mean depth becomes: the volume that flows out of it, as height on one cell [m].
DISPLACED = MEAN


@kernel
def press(p, number, sums, cells, stamp, rows, marks):
    """Press the footprint of a tool into the soil, and leave what each cell displaces in DISPLACED of the list of cells.

    Args:
        number: Of the tool, from 0.

    Returns:
        Compacted volume, as height on one cell [m].
    """
    compacted, most = 0.0, density_of(p).most
    for n in range(int(sums[CELLS])):
        row, a, b = int(cells[n, ROW]), int(cells[n, A]), int(cells[n, B])
        marks[row, 0] = 1
        rows[row, OWNER, a, b] = number + 1.0
        if cells[n, FLOOR] < 0.0:
            # Soil that lost a few grains to the tool that drags them along is still sheared by it.
            if cells[n, FLOOR] == OFF or rows[row, STAMP, a, b] != stamp - 1.0:
                rows[row, SHEAR_X, a, b] = rows[row, SHEAR_Y, a, b] = 0.0
            rows[row, STAMP, a, b] = stamp
            cells[n, DISPLACED] = 0.0
            continue
        before = rows[row, SINKAGE, a, b]
        after = max(before, quantised(cells[n, MEAN]))
        rows[row, SINKAGE, a, b] = after
        rows[row, RATIO, a, b] = max(cells[n, FLOOR] / after, 1.0) if after > 0.0 else 1.0
        for k in range(POINTS):
            rows[row, POINT + k, a, b] = cells[n, FIRST + k] / after if after > 0.0 else 1.0
        rows[row, SHEAR_X, a, b], rows[row, SHEAR_Y, a, b] = cells[n, J_X], cells[n, J_Y]
        rows[row, SLIP, a, b], rows[row, HELD, a, b] = cells[n, PATH], cells[n, FRICTION]
        rows[row, STAMP, a, b] = stamp
        denser = min((after - before) - quantised(p.plasticity * (after - before)), most - rows[row, COMPACTED, a, b])
        rows[row, COMPACTED, a, b] += denser
        compacted += denser
        cells[n, DISPLACED] = (after - before) - denser
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
def heave(p, sums, cells, wheel, half, half_length, outflow, rows, grid, corner):
    """Put down what a wheel displaced: beside each strip of one cell along it, and ahead of each column.

    Args:
        half, half_length: Half width and half length of the wheel [m].
        outflow: Memory for what leaves each strip and column, [n, OUTFLOWS].
    """
    T, r_0, cell = wheel.T, wheel.r_0, p.cell
    level = math.sqrt(T[1, 0] * T[1, 0] + T[1, 1] * T[1, 1])
    h_x, h_y = T[1, 1] / level, -T[1, 0] / level
    v = wheel.v_0[0] * h_x + wheel.v_0[1] * h_y
    wedge = _wedge(p)
    _flow_out(p, sums, cells, half, half_length, outflow)
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
        across = (k - outflow.shape[0] // 2) * cell
        backward = quantised(ends_share(v)[1] * outflow[k, AHEAD])
        for end in range(2):
            height, sign = (backward, -1.0) if end else (outflow[k, AHEAD] - backward, 1.0)
            if height > 0.0:
                along = sums[ALONG_MIN if end else ALONG_MAX] + sign * cell
                x, y = r_0[0] + along * h_x - across * h_y, r_0[1] + along * h_y + across * h_x
                _spread(p, height, x, y, sign * h_x, sign * h_y, wedge * deepest, half, rows, grid, corner)


@kernel(inline=True)
def ends_share(v):
    """Shares of what flows out ahead of a wheel that rolls at v [m/s] along its heading: to its front end and to its back end."""
    if abs(v) < SLIP_FLOOR:
        return 0.5, 0.5
    return (1.0, 0.0) if v > 0.0 else (0.0, 1.0)


@kernel
def _wedge(p):
    """Width of a Rankine passive wedge over its depth."""
    return math.tan(0.25 * math.pi + 0.5 * p.phi)


@kernel
def _flow_out(p, sums, cells, half, half_length, outflow):
    """Fill ``outflow``: soil leaves across the nearer edge, and more of it where the wheel pushes it."""
    per_pressure = p.ahead / max(sums[PRESSURE], 1e-9)
    ahead_share, across_share = per_pressure * sums[PUSH_AHEAD], per_pressure * sums[PUSH_ACROSS]
    for k in range(outflow.shape[0]):
        for m in range(OUTFLOWS):
            outflow[k, m] = 0.0
    for n in range(int(sums[CELLS])):
        displaced = cells[n, DISPLACED]
        if displaced > 0.0:
            # The footprint of a cambered wheel lies partly beside its middle's.
            strip = max(math.floor((cells[n, ALONG] + half_length) / p.cell), -1) + 1
            column = math.floor(cells[n, ACROSS] / p.cell + 0.5) + outflow.shape[0] // 2
            ahead = quantised(ahead_share * displaced)
            left = quantised((displaced - ahead) * min(max(0.5 + 0.5 * cells[n, ACROSS] / half + across_share, 0.0), 1.0))
            outflow[column, AHEAD] += ahead
            outflow[strip, LEFT] += left
            outflow[strip, RIGHT] += displaced - ahead - left
            outflow[strip, DEPTH] = max(outflow[strip, DEPTH], cells[n, FLOOR])


@kernel
def heave_around(p, sums, cells, body, widest, window, stamp, rows, marks, grid, corner):
    """Put down what a body displaced around its footprint: along rays from its middle, from its edge on.

    Args:
        widest: Largest width of the heaved ground [m].
        window: Cells [i0, i1] x [j0, j1] around the body, among them ``widest`` of ground around it.
    """
    reserve = math.ceil(widest / p.cell) + 3
    inner = window[0] + reserve, window[1] - reserve, window[2] + reserve, window[3] - reserve
    x_m, y_m, n_pressed = 0.0, 0.0, 0
    for n in range(int(sums[CELLS])):
        if cells[n, FLOOR] >= 0.0:
            x, y = _node(p, cells, n, marks)
            x_m, y_m, n_pressed = x_m + (x - body.r_0[0]), y_m + (y - body.r_0[1]), n_pressed + 1
    for n in range(int(sums[CELLS])):
        displaced = cells[n, DISPLACED]
        if displaced > 0.0:
            x, y = _node(p, cells, n, marks)
            # By quarters of the cell: all that lies on one ray would heap up at its end.
            quarter = quantised(0.25 * displaced)
            for k in range(4):
                q_x, q_y = x + (0.25 if k % 2 else -0.25) * p.cell, y + (0.25 if k // 2 else -0.25) * p.cell
                d_x, d_y = q_x - body.r_0[0] - x_m / n_pressed, q_y - body.r_0[1] - y_m / n_pressed
                distance, part = math.hypot(d_x, d_y), quarter if k else displaced - 3.0 * quarter
                if distance > 0.0:
                    d_x, d_y = d_x / distance, d_y / distance
                else:
                    d_x, d_y = 1.0, 0.0
                _outwards(p, part, q_x, q_y, d_x, d_y, _wedge(p) * cells[n, FLOOR], widest, inner, stamp, rows, grid, corner)


@kernel(inline=True)
def _node(p, cells, n, marks):
    """World x and y [m] of the node of a cell in the list."""
    row = int(cells[n, ROW])
    return (marks[row, TILE_I] * TILE + int(cells[n, A])) * p.cell, (marks[row, TILE_J] * TILE + int(cells[n, B])) * p.cell


@kernel
def _outwards(p, height, x, y, d_x, d_y, width, widest, inner, stamp, rows, grid, corner):
    """Put down a height [m] on one cell's area in the direction d from (x, y), from the first cell on that no tool is on."""
    step = 0.3 * p.cell
    while True:
        x, y = x + step * d_x, y + step * d_y
        i, j = nearest(x, p.cell), nearest(y, p.cell)
        if not (inner[0] < i < inner[1] and inner[2] < j < inner[3]):
            break  # onto another tool's cells, if these are that near
        if rows[row_of(grid, corner, i, j), STAMP, in_tile(i), in_tile(j)] != stamp:
            break
    _spread(p, height, x + step * d_x, y + step * d_y, d_x, d_y, width, widest, rows, grid, corner)


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
