"""A wheel on the soil's cells: footprint, stresses, force on the wheel, and what the step does to each cell.

The lower surface of the rim is exact. A cell's footprint is averaged over its area: its share across the width that the rim covers,
and four points along the heading, each with its own depth, so that stress grows and falls within a cell as it does within the soil.
Grousers are lines finer than a cell: they press with the area of their tips and push with their faces, but leave no mark of their own,
as loose soil closes behind them.

All work reads the soil as it was at the step's begin and writes to the wheel's own memory only, so wheels can run in parallel.
"""

from __future__ import annotations

import math

import numpy as np

from ..slave.kernel import kernel
from ..strength import CRITICAL_STATE, strength_of
from ..terramechanics import flow_value, janosi_displacement, rankine_wall, unit_weight
from .columns import (
    ACROSS,
    ALONG,
    ALONG_MAX,
    ALONG_MIN,
    BARE,
    CELLS,
    D_Z,
    DEEPEST,
    DEPTH,
    F_X,
    F_Y,
    F_Z,
    FIRST,
    FLOOR,
    FLUX_X,
    FLUX_Y,
    J_X,
    J_Y,
    K_X,
    K_Y,
    K_Z,
    MEAN,
    OFF,
    PATH,
    PRESSURE,
    PUSH_ACROSS,
    PUSH_AHEAD,
    PUSH_SPEED,
    PUSHED_X,
    PUSHED_Y,
    ROW,
    SIDE_ACROSS,
    T_X,
    T_Y,
    T_Z,
    A,
    B,
    add_force,
    clear,
)
from .density import density_of
from .erosion import repose_of
from .grousers import dragged_layer, grousers
from .rim import BLOCK, STEEPEST, attitude, press_and_shear
from .stress import counted, nodes_per_root, remembered, secant_share, whole
from .tiles import (
    BASE,
    COMPACTED,
    FILL,
    POINT,
    POINTS,
    SHEAR_X,
    SHEAR_Y,
    SINKAGE,
    SLIP,
    STAMP,
    TILE,
    floor_depth,
    in_tile,
    nearest,
    row_of,
    surface_height,
)

CLEARANCE = 0.2  # cells between rim and soil below which no soil slides in


@kernel(inline=True)
def limited_difference(low, middle, high):
    """Difference of a field per cell: the mean where it is smooth, 0 at its edges (van Leer's monotonised central limiter)."""
    a, b = middle - low, high - middle
    if a * b <= 0.0:
        return 0.0
    return math.copysign(min(0.5 * abs(a + b), 2.0 * abs(a), 2.0 * abs(b)), a)


@kernel(inline=True)
def floor_slope(p, rows, grid, corner, i, j, h_x, h_y):
    """Rise of the pressed floor's depth [1] along the direction h around cell (i, j).

    Its height counts, not its sinkage: where a mound was pressed flat the level from which sinkage counts has a slope of its own.
    """
    row, a, b = row_of(grid, corner, i, j), in_tile(i), in_tile(j)
    here = _pressed_level(rows, row, a, b)
    if 0 < a < TILE - 1 and 0 < b < TILE - 1:
        low_x, high_x = _pressed_level(rows, row, a - 1, b), _pressed_level(rows, row, a + 1, b)
        low_y, high_y = _pressed_level(rows, row, a, b - 1), _pressed_level(rows, row, a, b + 1)
    else:
        low_x, high_x = _level_at(rows, grid, corner, i - 1, j), _level_at(rows, grid, corner, i + 1, j)
        low_y, high_y = _level_at(rows, grid, corner, i, j - 1), _level_at(rows, grid, corner, i, j + 1)
    return (limited_difference(low_x, here, high_x) * h_x + limited_difference(low_y, here, high_y) * h_y) / p.cell


@kernel(inline=True)
def _pressed_level(rows, row, a, b):
    """Depth [m] of the pressed part of a cell below height 0."""
    return floor_depth(rows, row, a, b) - (rows[row, BASE, a, b] + rows[row, FILL, a, b])


@kernel
def _level_at(rows, grid, corner, i, j):
    return _pressed_level(rows, row_of(grid, corner, i, j), in_tile(i), in_tile(j))


@kernel
def contact_length(p, depth):
    """Length [m] of a wheel's contact at a depth [m]: from where it enters level ground to its nadir."""
    depth = min(depth, p.r_w)
    return math.sqrt(depth * (2.0 * p.r_w - depth))


@kernel
def wheel_contact(p, wheel, tables, modulus, h, stamp, rows, grid, corner, block, cells, sums):
    """Stresses on a wheel with soil under it.

    Args:
        wheel: Its input record.
        tables: Powers of the depth, see ``tabulate``, and what pushes leave, see ``tabulate_pushes``.
        modulus: k of the pressure law [N/m^(n+2)].
        h: Length of the step [s].
        stamp: Number of the step.
        rows, grid, corner: Soil, and the look-up of the wheel's surroundings.
        block: Memory for the cells that are worked on together, a record of ``rim.DTYPE``.
        cells: Filled with the pressed cells, [n, COLUMNS].
        sums: Filled with the sums, [SUMS].
    """
    clear(sums)
    r_0, r, half, cell = wheel.r_0, p.r_w, 0.5 * p.b_w, p.cell
    level, h_x, h_y, tilt = attitude(wheel)
    l_x, l_y, per_level = -h_y, h_x, 1.0 / level
    speed = wheel.v_0[0] * h_x + wheel.v_0[1] * h_y
    strength = strength_of(p, p.strength == CRITICAL_STATE, repose_of(p), p.b_w, contact_length(p, sums[DEPTH]), sums[DEPTH], speed)
    density = density_of(p)
    sideward = wheel.v_0[0] * l_x + wheel.v_0[1] * l_y
    # Soil beside a wheel that slides is sheared in the passive wedge of the side that pushes it, as deep as it is when it gets below.
    wedge = p.preshear * math.sqrt(flow_value(p.phi)) * abs(sideward) / max(math.hypot(wheel.v_0[0], wheel.v_0[1]), 1e-9)
    step = cell / POINTS
    span_x = r * abs(h_x) + (half * level + r * abs(tilt) + cell) * abs(l_x)
    span_y = r * abs(h_y) + (half * level + r * abs(tilt) + cell) * abs(l_y)
    n = m = np.int64(0)  # cells in the list, and in the block; a literal would be a type of its own, and compile their kernels once more
    for i in range(nearest(r_0[0] - span_x, cell), nearest(r_0[0] + span_x, cell) + 1):
        for j in range(nearest(r_0[1] - span_y, cell), nearest(r_0[1] + span_y, cell) + 1):
            d_x, d_y = i * cell - r_0[0], j * cell - r_0[1]
            along, across = d_x * h_x + d_y * h_y, d_x * l_x + d_y * l_y
            low = max(abs(along) - 0.5 * cell, 0.0)
            row, a, b = row_of(grid, corner, i, j), in_tile(i), in_tile(j)
            fill = rows[row, FILL, a, b]
            surface = rows[row, BASE, a, b] + fill - r_0[2]
            # The rim rises by at least low^2 / (2 r): most cells are ruled out without a root.
            depth = surface - (low * low / (2.0 * r) - r - abs(across * tilt)) * per_level
            if depth <= 0.0 or low >= STEEPEST * r:
                continue
            kept = rows[row, STAMP, a, b] == stamp - 1.0
            if not kept and rows[row, SINKAGE, a, b] > depth + 0.5 * cell:  # the rut behind
                continue
            xi = (across - math.sqrt(r * r - low * low) * tilt) * per_level
            cover = min((half - abs(xi)) * level / cell + 0.5, 1.0)
            if cover <= 0.0:
                continue
            if cover < 1.0:  # the middle of the covered part
                across -= math.copysign(0.5 * (1.0 - cover) * cell, xi)
            block.row[m], block.a[m], block.b[m] = row, a, b
            block.along[m], block.across[m], block.lift[m], block.cover[m] = along, across, across * tilt, cover
            block.surface[m], block.fill[m] = surface, fill
            sinkage = rows[row, SINKAGE, a, b]
            block.compacted[m], block.sinkage[m] = rows[row, COMPACTED, a, b], sinkage
            if kept:
                block.j_x[m], block.j_y[m], block.path[m] = rows[row, SHEAR_X, a, b], rows[row, SHEAR_Y, a, b], rows[row, SLIP, a, b]
                for k in range(POINTS):
                    block.before[k, m] = sinkage * rows[row, POINT + k, a, b]
            else:  # it was not in contact
                block.j_x[m], block.j_y[m] = sums[PUSHED_X], sums[PUSHED_Y]
                block.path[m] = math.hypot(sums[PUSHED_X], sums[PUSHED_Y])
                if across * sideward > 0.0:
                    rim = math.sqrt(max(r * r - along * along, 0.0))
                    entered = surface + rim - abs(along) / max(rim, 0.1 * r) * cell
                    block.path[m] += wedge * max(entered - floor_depth(rows, row, a, b), 0.0)
                floor, slope = floor_depth(rows, row, a, b), floor_slope(p, rows, grid, corner, i, j, h_x, h_y)
                for k in range(POINTS):
                    block.before[k, m] = max(floor + slope * ((k + 0.5) * step - 0.5 * cell), 0.0)
            m += 1
            if m == BLOCK:
                n = _bear(p, wheel, m, n, strength, density, tables, modulus, h, rows, block, cells, sums)
                m = 0
    n = _bear(p, wheel, m, n, strength, density, tables, modulus, h, rows, block, cells, sums)
    sums[CELLS] = n
    push_ahead(p, wheel, h, sums)
    if p.n_g > 0.0 and p.h_g > 0.0:
        grousers(p, wheel, strength, density, modulus, tables, stamp, rows, grid, corner, sums)
    if n > 0:
        _sides(p, wheel, strength, h, rows, grid, corner, sums)
    else:
        sums[SIDE_ACROSS] = 0.0


@kernel
def _bear(p, wheel, n_block, n, strength, density, tables, modulus, h, rows, block, cells, sums):
    """Add the cells of a block to the sums and, after n others, to the list of pressed cells; returns their number then."""
    per_root = nodes_per_root(p, tables[0])
    press_and_shear(p, wheel, n_block, strength, density, modulus, tables, per_root, h, block)
    level, r = attitude(wheel)[0], p.r_w
    layer = dragged_layer(p) * h / p.cell
    speed = math.hypot(wheel.v_0[0], wheel.v_0[1])
    d_x, d_y = wheel.v_0[0] / max(speed, 1e-9), wheel.v_0[1] / max(speed, 1e-9)
    for m in range(n_block):
        row, a, b, along = int(block.row[m]), int(block.a[m]), int(block.b[m]), block.along[m]
        if block.total[m] <= 0.0:
            rim = (block.lift[m] - math.sqrt(max(r * r - along * along, 0.0))) / level
            gap = rim - block.surface[m] + rows[row, SINKAGE, a, b]
            if gap < CLEARANCE * p.cell:
                cells[n, ROW], cells[n, A], cells[n, B] = row, a, b
                cells[n, FLOOR] = BARE if gap < p.transport_depth else OFF
                n += 1
            continue
        sums[F_X] += block.f_x[m]
        sums[F_Y] += block.f_y[m]
        sums[F_Z] += block.f_z[m]
        sums[T_X] += block.t_x[m]
        sums[T_Y] += block.t_y[m]
        sums[T_Z] += block.t_z[m]
        sums[K_X] += block.k_xy[m]
        sums[K_Y] += block.k_xy[m]
        sums[K_Z] += block.k_z[m]
        sums[D_Z] += block.d_z[m]
        pressed, cover = block.floors[m] / POINTS, block.cover[m]
        sums[DEEPEST] = max(sums[DEEPEST], pressed - block.fill[m])
        sums[ALONG_MIN], sums[ALONG_MAX] = min(sums[ALONG_MIN], along), max(sums[ALONG_MAX], along)
        cells[n, ROW], cells[n, A], cells[n, B] = row, a, b
        cells[n, FLOOR], cells[n, MEAN] = pressed, cover * pressed
        cells[n, J_X], cells[n, J_Y], cells[n, PATH] = block.j_x[m], block.j_y[m], block.path[m]
        sums[PRESSURE] += whole(block.total[m])
        sums[PUSH_SPEED] += whole(block.total[m] * (block.u_x[m] * d_x + block.u_y[m] * d_y))
        sums[PUSH_AHEAD] += whole(block.total[m] * max(block.push_ahead[m], 0.0))
        sums[PUSH_ACROSS] += whole(block.total[m] * block.push_across[m])
        cells[n, ALONG], cells[n, ACROSS] = along, block.across[m]
        dragged = layer * block.share[m] * cover
        cells[n, FLUX_X], cells[n, FLUX_Y] = dragged * block.u_x[m], dragged * block.u_y[m]
        for k in range(POINTS):
            cells[n, FIRST + k] = block.after[k, m]
        n += 1
    return n


@kernel
def push_ahead(p, tool, h, sums):
    """The displacement of soil that a tool pushes ahead of it, when it gets below the tool.

    A wheel in skid drags a passive wedge along, as long as Rankine's at the depth of the contact. Soil is on its way through it, mean of
    all depths, over half of that length, and is displaced meanwhile with the rim's mean speed in the direction of travel.
    """
    if sums[CELLS] == 0.0 or sums[PRESSURE] <= 0.0:
        sums[PUSHED_X] = sums[PUSHED_Y] = 0.0
        return
    v_x, v_y = tool.v_0[0], tool.v_0[1]
    speed, push = math.hypot(v_x, v_y), max(sums[PUSH_SPEED] / sums[PRESSURE], 0.0)
    wedge = p.preshear * sums[DEEPEST] * math.sqrt(flow_value(p.phi))
    kept = wedge / (wedge + speed * h) if wedge > 0.0 else 0.0
    per_speed = h / max(speed, 1e-9)
    sums[PUSHED_X], sums[PUSHED_Y] = (sums[PUSHED_X] + push * v_x * per_speed) * kept, (sums[PUSHED_Y] + push * v_y * per_speed) * kept


@kernel
def _sides(p, wheel, strength, h, rows, grid, corner, sums):
    """Passive earth pressure of the soil beside the wheel, mobilised by its displacement across.

    Own choice: soil beside a rolling wheel is left behind and replaced by soil that was not displaced yet, so displacement relaxes over
    the length of contact.
    """
    level, h_x, h_y, tilt = attitude(wheel)
    v_0, w_0 = wheel.v_0, wheel.w_0
    v_x, v_y, w_x = v_0[0] * h_x + v_0[1] * h_y, v_0[1] * h_x - v_0[0] * h_y, w_0[0] * h_x + w_0[1] * h_y
    cell, gamma_s, N_phi = p.cell, unit_weight(p.rho, p.gravity, p.slope), flow_value(p.phi)
    length = max(sums[ALONG_MAX] - sums[ALONG_MIN], cell)
    u = v_y + w_x * p.r_w  # of the rim's lowest point
    modulus = strength.wall_modulus
    side, _ = remembered(modulus, (sums[SIDE_ACROSS] + u * h) / (1.0 + abs(v_x) * h / length), 0.0)
    sums[SIDE_ACROSS] = side
    m, _, moved = counted(p.tau_r, side, 0.0, u, 0.0)
    secant = secant_share(modulus, moved, janosi_displacement(moved, modulus))
    r_0 = wheel.r_0
    edge = math.copysign(0.5 * p.b_w * level, m)  # the side that pushes
    beside = edge + math.copysign(1.5 * cell, m)  # clear of the cells that the rim covers in part
    reach = math.floor(p.r_w / cell)
    for k in range(-reach, reach + 1):
        x = k * cell
        if abs(x) >= STEEPEST * p.r_w:
            continue
        bottom = edge / level * tilt - math.sqrt(p.r_w**2 - x * x) * level
        wall = _surface_at(cell, rows, grid, corner, r_0[0] + x * h_x - beside * h_y, r_0[1] + x * h_y + beside * h_x) - r_0[2] - bottom
        if wall <= 0.0:
            continue
        stiffness = strength.wall * rankine_wall(gamma_s, wall, 0.0, 0.0, p.c, N_phi) * secant * cell
        # A pressure that grows with depth acts at a third of the height.
        add_force(sums, x, edge, bottom + wall / 3.0, 0.0, -stiffness * m, 0.0)
        sums[K_Y] += whole(stiffness)


@kernel
def _surface_at(cell, rows, grid, corner, x, y):
    """Height [m] of the surface at (x, y) [m], bilinear between nodes, so that a wall does not jump from cell to cell."""
    i, j = math.floor(x / cell), math.floor(y / cell)
    s, q = x / cell - i, y / cell - j
    near = surface_height(rows, row_of(grid, corner, i, j), i, j) * (1.0 - s)
    near += surface_height(rows, row_of(grid, corner, i + 1, j), i + 1, j) * s
    far = surface_height(rows, row_of(grid, corner, i, j + 1), i, j + 1) * (1.0 - s)
    far += surface_height(rows, row_of(grid, corner, i + 1, j + 1), i + 1, j + 1) * s
    return near * (1.0 - q) + far * q
