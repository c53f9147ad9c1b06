"""What an SCM step does for each meshed tool, and for bodies other than wheels, beside the contact itself."""

from __future__ import annotations

import math

from ..contact import PATIENCE, has_pose
from ..slave.kernel import kernel
from .cloud import cloud_contact
from .columns import CELLS, DEPTH, HALF, MIDDLE, ROW, WIDTH, A, B
from .flow import heave_around, transport
from .grousers import dragged_layer
from .stress import pressure_modulus
from .tiles import BASE, FILL, TILE, TILE_I, TILE_J, base_height, find, let_slide, nearest, tile_of
from .tools import NEAR, inside, make_ready
from .wheel import contact_length

#: Status numbers of a body; those of wheels and soil come before.
BODY_NO_DATA, BODY_STILL_NO_DATA, BODY_OUTSIDE, BODY_THROUGH, NO_MESH = 9, 10, 11, 12, 13


@kernel
def box_around(tool, shape):
    """Least and largest world x and y [m] of the box around a mesh, and its lowest height."""
    low_x, high_x, low_z = tool.r_0[0], tool.r_0[0], tool.r_0[2]
    low_y, high_y = tool.r_0[1], tool.r_0[1]
    for k in range(3):
        x, y, z = tool.T[k, 0], tool.T[k, 1], tool.T[k, 2]
        low_x += x * shape[MIDDLE + k] - abs(x) * shape[HALF + k]
        high_x += x * shape[MIDDLE + k] + abs(x) * shape[HALF + k]
        low_y += y * shape[MIDDLE + k] - abs(y) * shape[HALF + k]
        high_y += y * shape[MIDDLE + k] + abs(y) * shape[HALF + k]
        low_z += z * shape[MIDDLE + k] - abs(z) * shape[HALF + k]
    return low_x, high_x, low_y, high_y, low_z


@kernel
def window_around(p, tool, shape):
    """Cells [i0, i1] x [j0, j1] that a meshed tool works on: below the box around it, and the ground that heaves around it."""
    low_x, high_x, low_y, high_y, _ = box_around(tool, shape)
    margin = shape[WIDTH] + 4.0 * p.cell
    return (
        nearest(low_x - margin, p.cell),
        nearest(high_x + margin, p.cell),
        nearest(low_y - margin, p.cell),
        nearest(high_y + margin, p.cell),
    )


@kernel
def approach_with_mesh(p, tool, shape, rows, marks, head, ground, frame, grid, corner, sums):
    """As ``approach`` for a tool with a mesh: near if the lowest corner of its box lies below the highest level of the tiles below it."""
    if not _is_near(p, rows, marks, head, ground, frame, tool, shape):
        return True
    sums[CELLS] = 0.0
    i0, i1, j0, j1 = window_around(p, tool, shape)
    return make_ready(p, rows, marks, head, ground, frame, grid, corner, i0, i1, j0, j1)


@kernel
def _is_near(p, rows, marks, head, ground, frame, tool, shape):
    low_x, high_x, low_y, high_y, low_z = box_around(tool, shape)
    low_z -= NEAR
    for a in range(tile_of(nearest(low_x, p.cell)), tile_of(nearest(high_x, p.cell)) + 1):
        for b in range(tile_of(nearest(low_y, p.cell)), tile_of(nearest(high_y, p.cell)) + 1):
            row = find(marks, head, a, b)
            for i in range(TILE):
                for j in range(TILE):
                    if row >= 0:
                        level = rows[row, BASE, i, j] + rows[row, FILL, i, j]
                    else:
                        level = base_height(p, ground, frame, a * TILE + i, b * TILE + j)
                    if level > low_z:
                        return True
    return False


@kernel
def refused_body(p, ground, frame, body, silent, n_elements, shape):
    """Number of the error that a body is in, or 0."""
    if n_elements == 0:
        return NO_MESH
    if not has_pose(body):
        return BODY_STILL_NO_DATA if silent >= PATIENCE else 0
    low_x, high_x, low_y, high_y, _ = box_around(body, shape)
    on_map = inside(p, ground, frame, low_x, low_y) and inside(p, ground, frame, high_x, high_y)
    return 0 if on_map else BODY_OUTSIDE


@kernel
def half_sizes(p, range_, shape):
    """Half width and half length [m] of a wheel with or without a mesh."""
    if range_[1] == range_[0]:
        return 0.5 * p.b_w, p.r_w
    return abs(shape[MIDDLE + 1]) + shape[HALF + 1], math.hypot(shape[HALF], shape[HALF + 2])


@kernel
def wheel_contact_with_mesh(
    p, x, wheel, is_body, modulus, shape, elements, range_, rows, ground, frame, grid, corner, placed, links, cells, sums
):
    """Stresses on a wheel with a mesh, in the axes of ``wheel_contact``."""
    level = math.sqrt(wheel.T[1, 0] ** 2 + wheel.T[1, 1] ** 2)
    h_x, h_y = wheel.T[1, 1] / level, -wheel.T[1, 0] / level
    window = window_around(p, wheel, shape)
    cloud_contact(
        p,
        wheel,
        is_body,
        h_x,
        h_y,
        dragged_layer(p),
        p.b_w,
        contact_length(p, sums[DEPTH]),
        modulus,
        (x.powers, x.pushes),
        x.stamp,
        rows,
        ground,
        frame,
        grid,
        corner,
        window,
        elements,
        range_,
        placed,
        links,
        cells,
        sums,
    )


@kernel
def body_contact(p, x, body, is_body, shape, elements, range_, rows, ground, frame, grid, corner, placed, links, cells, sums):
    """Stresses on a body, in world axes."""
    modulus, window = pressure_modulus(p, shape[WIDTH]), window_around(p, body, shape)
    cloud_contact(
        p,
        body,
        is_body,
        1.0,
        0.0,
        0.5 * p.transport_depth,  # grains, as below a smooth wheel
        shape[WIDTH],
        shape[WIDTH],
        modulus,
        (x.powers, x.pushes),
        x.stamp,
        rows,
        ground,
        frame,
        grid,
        corner,
        window,
        elements,
        range_,
        placed,
        links,
        cells,
        sums,
    )


@kernel
def rearrange_body(p, body, shape, stamp, rows, marks, head, ground, frame, grid, corner, cells, sums):
    """Soil dragged along and soil that heaves, and what may slide after it; False if there was no room for all of that."""
    transport(sums, cells, stamp, rows, marks, grid, corner)
    heave_around(p, sums, cells, body, shape[WIDTH], window_around(p, body, shape), stamp, rows, marks, grid, corner)
    if sums[CELLS] == 0.0:  # soil beside the hole that it leaves was held until now
        i0, i1, j0, j1 = window_around(p, body, shape)
        return let_slide(p, rows, marks, head, ground, frame, i0, i1, j0, j1)
    i0, i1, j0, j1 = 2**62, -(2**62), 2**62, -(2**62)
    for n in range(int(sums[CELLS])):
        row = int(cells[n, ROW])
        i, j = marks[row, TILE_I] * TILE + int(cells[n, A]), marks[row, TILE_J] * TILE + int(cells[n, B])
        i0, i1, j0, j1 = min(i0, i), max(i1, i), min(j0, j), max(j1, j)
    margin = math.ceil(shape[WIDTH] / p.cell) + 4
    return let_slide(p, rows, marks, head, ground, frame, i0 - margin, i1 + margin, j0 - margin, j1 + margin)
