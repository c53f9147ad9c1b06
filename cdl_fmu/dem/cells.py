"""Particles sorted by the cells of a grid, and slabs of it for threads.

Each particle has a margin of its own by which it may move until the lists are made anew: among fast particles a wide one, among those at
rest nearly none, so that the lists hold few pairs that do not touch.
"""

from __future__ import annotations

import math

from ..slave.kernel import kernel
from .particles import (
    CELLS_EACH,
    CELLS_X,
    CELLS_Y,
    CELLS_Z,
    LARGEST_MARGIN,
    LEAST_CELLS,
    LEAST_MARGIN,
    MOST_SLABS,
    PARTICLE,
    SIDE,
    SLABS,
    SPARE_CELLS,
    V_X,
    V_Y,
    V_Z,
    N,
    R,
    X,
    Y,
    Z,
)

#: Sum of the coordinates [m] beyond which a particle is lost. Own choice.
FURTHEST = 1e6


@kernel
def sort_particles(grains, horizon):
    """Sort the particles by cells, with margins for ``horizon`` [s]; their pairs are to be found next.

    Returns False, with nothing done, if a particle is nowhere: its position is no number or beyond ``FURTHEST``.
    """
    count = grains.count
    n, side = count[N], count[SIDE]
    old, new, built = grains.body[side], grains.body[1 - side], grains.built
    x_0 = y_0 = z_0 = math.inf
    x_1 = y_1 = z_1 = -math.inf
    reach, largest, period_x, period_y = 0.0, 0.0, grains.periods[0], grains.periods[1]
    for i in range(n):
        if period_x > 0.0:
            old[i, X] -= period_x * math.floor(old[i, X] / period_x)
        if period_y > 0.0:
            old[i, Y] -= period_y * math.floor(old[i, Y] / period_y)
        x, y, z, r = old[i, X], old[i, Y], old[i, Z], old[i, R]
        if not abs(x) + abs(y) + abs(z) < FURTHEST:
            return False
        speed = math.sqrt(old[i, V_X] ** 2 + old[i, V_Y] ** 2 + old[i, V_Z] ** 2)
        grains.force[i, 0] = speed  # in their old order
        reach = max(reach, r)
        largest = max(largest, speed)
        x_0, x_1, y_0, y_1, z_0, z_1 = min(x_0, x), max(x_1, x), min(y_0, y), max(y_1, y), min(z_0, z), max(z_1, z)
    if n == 0:  # all are at rest and stored: one empty cell
        x_0 = x_1 = y_0 = y_1 = z_0 = z_1 = 0.0
        reach = 1.0
    if period_x > 0.0:
        x_0, x_1 = 0.0, period_x
    if period_y > 0.0:
        y_0, y_1 = 0.0, period_y
    side_x = side_y = side_z = 2.0 * (reach + min(max(largest * horizon, LEAST_MARGIN * reach), LARGEST_MARGIN * reach))
    # Longer cells where there are most: a particle that flies far away spoils one direction only, and a period keeps its three cells.
    along_x, along_y, along_z = (x_1 - x_0) / side_x + 1.0, (y_1 - y_0) / side_y + 1.0, (z_1 - z_0) / side_z + 1.0
    # By the number of particles, not by the room that there is: what comes out must not depend on that.
    while along_x * along_y * along_z > CELLS_EACH * n + SPARE_CELLS - 1:
        if along_x >= along_y and along_x >= along_z:
            side_x *= 1.2
        elif along_y >= along_z:
            side_y *= 1.2
        else:
            side_z *= 1.2
        along_x, along_y, along_z = (x_1 - x_0) / side_x + 1.0, (y_1 - y_0) / side_y + 1.0, (z_1 - z_0) / side_z + 1.0
    n_x, n_y, n_z = math.floor((x_1 - x_0) / side_x) + 1, math.floor((y_1 - y_0) / side_y) + 1, math.floor((z_1 - z_0) / side_z) + 1
    if period_x > 0.0:
        n_x = max(n_x - 1, LEAST_CELLS)
        side_x = period_x / n_x
    if period_y > 0.0:
        n_y = max(n_y - 1, LEAST_CELLS)
        side_y = period_y / n_y
    count[CELLS_X], count[CELLS_Y], count[CELLS_Z] = n_x, n_y, n_z
    # Counting sort by cells, z fastest.
    cells, cell, order, fastest = grains.cells, grains.cell, grains.order, grains.fastest
    n_cells = n_x * n_y * n_z
    for c in range(n_cells + 1):
        cells[c] = 0
        fastest[0, c] = 0.0
    for i in range(n):
        c_x = min(int((old[i, X] - x_0) / side_x), n_x - 1)
        c_y = min(int((old[i, Y] - y_0) / side_y), n_y - 1)
        c_z = min(int((old[i, Z] - z_0) / side_z), n_z - 1)
        cell[0, i] = (c_x * n_y + c_y) * n_z + c_z
        cells[cell[0, i] + 1] += 1
        fastest[0, cell[0, i]] = max(fastest[0, cell[0, i]], grains.force[i, 0])
    for c in range(n_cells):
        cells[c + 1] += cells[c]
    for i in range(n):  # cells[c] is the next free place of cell c, and in the end where cell c + 1 begins
        c = cell[0, i]
        place = cells[c]
        cells[c] += 1
        order[place], cell[1, place] = i, c
    for c in range(n_cells, 0, -1):
        cells[c] = cells[c - 1]
    cells[0] = 0
    # What lies beside fast particles will be as fast soon.
    for c in range(n_cells):
        if cells[c + 1] > cells[c]:
            c_x, c_y, c_z, fast = c // (n_z * n_y), (c // n_z) % n_y, c % n_z, 0.0
            for b_x in range(max(c_x - 1, 0), min(c_x + 2, n_x)):
                for b_y in range(max(c_y - 1, 0), min(c_y + 2, n_y)):
                    for b_z in range(max(c_z - 1, 0), min(c_z + 2, n_z)):
                        fast = max(fast, fastest[0, (b_x * n_y + b_y) * n_z + b_z])
            fastest[1, c] = fast
    for i in range(n):
        a = order[i]
        for k in range(PARTICLE):
            new[i, k] = old[a, k]
        grains.ident[1 - side, i] = grains.ident[side, a]
        if grains.orientation.shape[1] > 0:
            for k in range(4):
                grains.orientation[1 - side, i, k] = grains.orientation[side, a, k]
        margin = min(max(fastest[1, cell[1, i]] * horizon, LEAST_MARGIN * new[i, R]), LARGEST_MARGIN * new[i, R])
        built[i, 0], built[i, 1], built[i, 2], built[i, 3] = new[i, X], new[i, Y], new[i, Z], new[i, R] + margin
    for i in range(n):
        grains.force[i, 0] = 0.0
    # Slabs of whole layers of cells.
    slabs = min(n_x, MOST_SLABS)
    for s in range(slabs):
        grains.slabs[s] = cells[(s * n_x) // slabs * n_y * n_z]
    grains.slabs[slabs] = n
    count[SLABS] = slabs
    return True
