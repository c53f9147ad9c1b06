"""Bodies that lie in the soil from the start: at the first step with a pose the soil is laid around them.

Own choice: always, as a body that would be pressed in at once would be thrown out. Each cell below the body becomes a hole that fits: its
undisturbed surface is the body's lower surface, from which sinkage counts, and nothing has pressed it. Cells without any of the body's
surface keep theirs, and lean against its flanks. Soil on top of a body that widens below is not counted.

A body that has ``settled`` pressed the soil below it before: that was as much higher, at most at the surface, and bears what it bore then.
All that was pressed down counts as compacted or gone long ago; nothing heaves for it.
"""

from __future__ import annotations

import math

from ..slave.kernel import kernel
from ..unloading import unloading_of, unloading_stiffness
from .bodies import window_around
from .columns import AREA, CELLS, KIND, N_Y, N_Z, SETTLED, WIDTH, Y, Z
from .elements import LAYER, LEAST_COVER, lowest_bearing, place_elements
from .features import SURFACE
from .stress import pressure_modulus
from .tiles import BASE, FILL, SINKAGE, STAMP, base_height, in_tile, quantised, row_of


@kernel
def lay_around(p, u, memory, x, *arrays):
    """Lay the soil around each body that has a pose for the first time."""
    rows, marks, head, ground, frame, elements, ranges, shapes, grid, corner, cells, sums = arrays[:12]
    placed, links, poses = arrays[14], arrays[15], arrays[18]
    for i in range(len(u.body)):
        k = len(u.wheel) + i
        if memory.body[i].laid == 0.0 and sums[k, CELLS] >= 0.0:
            around = grid[k], corner[k]
            modulus = pressure_modulus(p, shapes[k, WIDTH])
            x.compacted += _embed(
                p,
                poses[k],
                shapes[k],
                modulus,
                elements,
                ranges[k],
                x.stamp,
                rows,
                marks,
                ground,
                frame,
                around,
                placed[k],
                links[k],
            )


@kernel
def take_back(p, u, memory, x, *arrays):
    """Undo ``lay_around``, in a step that ends with an error."""
    rows, marks, head, ground, frame, elements, ranges, shapes, grid, corner, cells, sums = arrays[:12]
    for i in range(len(u.body)):
        k = len(u.wheel) + i
        if memory.body[i].laid == 0.0 and sums[k, CELLS] >= 0.0:
            x.compacted -= _dig_out(p, arrays[18][k], shapes[k], x.stamp, rows, marks, ground, frame, grid[k], corner[k])


@kernel
def _embed(p, body, shape, modulus, elements, range_, stamp, rows, marks, ground, frame, around, placed, links):
    """Lay the soil around a body, in the cells that no tool has worked on; they are marked as such that one works on now.

    Args:
        modulus: Of the pressure below it [N/m^(n+2)].

    Returns:
        Volume that it has pressed down, as height on one cell [m].
    """
    unloading, pressed = unloading_of(p), 0.0
    grid, corner = around
    i0, i1, j0, j1 = window_around(p, body, shape)
    steep = math.cos(0.25 * math.pi + 0.5 * p.phi)
    is_body = i1 >= i0  # a literal would be another type, for which all is compiled again
    place_elements(p, body, is_body, steep, 1.0, 0.0, rows, ground, frame, grid, corner, i0, i1, j0, j1, elements, range_, placed, links)
    for i in range(i0, i1 + 1):
        for j in range(j0, j1 + 1):
            start = links[(i - i0) * (j1 - j0 + 1) + j - j0]
            row, a, b = row_of(grid, corner, i, j), in_tile(i), in_tile(j)
            if start < 0 or 0.0 <= rows[row, STAMP, a, b] < stamp:
                continue
            bears, plan, z = _lower_surface(p, body, steep, start, i, j, placed, links)
            above = rows[row, BASE, a, b] + rows[row, FILL, a, b] - z
            if plan > 0.0 and above > 0.0:
                depth, floor = min(shape[SETTLED], above) if bears else 0.0, 0.0
                if depth > 0.0:
                    dense = modulus * depth**p.n
                    floor = quantised(depth - dense / unloading_stiffness(unloading, depth, dense, 0.0))
                rows[row, BASE, a, b], rows[row, STAMP, a, b] = z + depth - rows[row, FILL, a, b], stamp
                rows[row, SINKAGE, a, b] = floor
                pressed += floor
                marks[row, 0] = 1
    return pressed


@kernel
def _lower_surface(p, body, steep, start, i, j, placed, links):
    """Whether a body's lower surface in cell (i, j) bears, its plan area [m2], and its mean height [m] there.

    Steep faces alone have to cover the node.
    """
    lowest = lowest_bearing(steep, start, placed, links)
    plan = total = steep_plan = steep_total = 0.0
    e = start
    while e >= 0:
        n_z, z = placed[e, N_Z], placed[e, Z]
        if placed[e, KIND] == SURFACE and n_z < 0.0:
            area = -n_z * placed[e, AREA]
            if n_z > -steep:
                steep_plan, steep_total = steep_plan + area, steep_total + area * z
            elif z < lowest + LAYER * p.cell:
                # Where the element's plane is across the heading, as bearing elements stand for points along it.
                off_y = placed[e, Y] + body.r_0[1] - j * p.cell
                plan, total = plan + area, total + area * (z + off_y * placed[e, N_Y] / n_z)
        e = links[links.shape[0] - placed.shape[0] + e]
    if plan > 0.0:
        return True, plan, body.r_0[2] + total / plan
    if steep_plan >= LEAST_COVER * p.cell * p.cell:
        return False, steep_plan, body.r_0[2] + steep_total / steep_plan
    return False, 0.0, 0.0


@kernel
def _dig_out(p, body, shape, stamp, rows, marks, ground, frame, grid, corner):
    """Undo ``_embed``, before tools have worked on the soil in that step; returns what that returned."""
    pressed = 0.0
    i0, i1, j0, j1 = window_around(p, body, shape)
    for i in range(i0, i1 + 1):
        for j in range(j0, j1 + 1):
            row, a, b = row_of(grid, corner, i, j), in_tile(i), in_tile(j)
            if rows[row, STAMP, a, b] == stamp:
                pressed += rows[row, SINKAGE, a, b]
                rows[row, BASE, a, b], rows[row, STAMP, a, b] = base_height(p, ground, frame, i, j), -1.0
                rows[row, SINKAGE, a, b] = 0.0
                marks[row, 0] = 1
    return pressed
