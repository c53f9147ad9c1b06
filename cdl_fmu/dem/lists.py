"""Lists of neighbours: particles sorted by cells of a grid, and the pairs that may touch until the lists are made anew.

Each particle has a margin of its own by which it may move: fast particles have a wide one, particles at rest nearly none, so that the
lists hold few pairs that do not touch.
"""

from __future__ import annotations

import math

from ..slave.kernel import kernel
from .particles import (
    CELLS_X,
    CELLS_Y,
    CELLS_Z,
    HISTORY,
    LARGEST_MARGIN,
    LEAST_CELLS,
    LEAST_MARGIN,
    LENGTH,
    MOST_SLABS,
    PAIRS,
    PARTICLE,
    SIDE,
    SLABS,
    STALE,
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
    reach, period_x, period_y = 0.0, grains.periods[0], grains.periods[1]
    for i in range(n):
        if period_x > 0.0:
            old[i, X] -= period_x * math.floor(old[i, X] / period_x)
        if period_y > 0.0:
            old[i, Y] -= period_y * math.floor(old[i, Y] / period_y)
        x, y, z, r = old[i, X], old[i, Y], old[i, Z], old[i, R]
        if not abs(x) + abs(y) + abs(z) < FURTHEST:
            return False
        speed = math.sqrt(old[i, V_X] ** 2 + old[i, V_Y] ** 2 + old[i, V_Z] ** 2)
        margin = min(max(speed * horizon, LEAST_MARGIN * r), LARGEST_MARGIN * r)
        grains.force[i, 0] = margin  # in their old order
        reach = max(reach, r + margin)
        x_0, x_1, y_0, y_1, z_0, z_1 = min(x_0, x), max(x_1, x), min(y_0, y), max(y_1, y), min(z_0, z), max(z_1, z)
    if period_x > 0.0:
        x_0, x_1 = 0.0, period_x
    if period_y > 0.0:
        y_0, y_1 = 0.0, period_y
    side_x = side_y = side_z = 2.0 * reach
    # Longer cells where there are most: a particle that flies far away spoils one direction only, and a period keeps its three cells.
    along_x, along_y, along_z = (x_1 - x_0) / side_x + 1.0, (y_1 - y_0) / side_y + 1.0, (z_1 - z_0) / side_z + 1.0
    while along_x * along_y * along_z > len(grains.cells) - 1:
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
    cells, cell, order = grains.cells, grains.cell, grains.order
    n_cells = n_x * n_y * n_z
    for c in range(n_cells + 1):
        cells[c] = 0
    for i in range(n):
        c_x = min(int((old[i, X] - x_0) / side_x), n_x - 1)
        c_y = min(int((old[i, Y] - y_0) / side_y), n_y - 1)
        c_z = min(int((old[i, Z] - z_0) / side_z), n_z - 1)
        cell[0, i] = (c_x * n_y + c_y) * n_z + c_z
        cells[cell[0, i] + 1] += 1
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
    for i in range(n):
        a = order[i]
        for k in range(PARTICLE):
            new[i, k] = old[a, k]
        grains.ident[1 - side, i] = grains.ident[side, a]
        if grains.orientation.shape[1] > 0:
            for k in range(4):
                grains.orientation[1 - side, i, k] = grains.orientation[side, a, k]
        built[i, 0], built[i, 1], built[i, 2], built[i, 3] = new[i, X], new[i, Y], new[i, Z], grains.force[a, 0]
    for i in range(n):
        grains.force[i, 0] = 0.0
    # Slabs of whole layers of cells, an even number of them.
    slabs = min(2 * ((n_x + 1) // 2), MOST_SLABS)
    if period_x > 0.0 and n_x % 2 == 1:
        slabs = min(n_x - 1, MOST_SLABS)
    for s in range(slabs):
        grains.slabs[s] = cells[min((s * n_x) // slabs if period_x > 0.0 else (s * (n_x + n_x % 2)) // slabs, n_x) * n_y * n_z]
    grains.slabs[slabs] = n
    count[SLABS] = slabs
    return True


@kernel
def find_pairs(grains, slab, fill):
    """Count the pairs of each particle of a slab, or write them where ``first`` says, with the history of those known before."""
    count = grains.count
    old_side = count[SIDE]
    side = 1 - old_side
    body, built, cells, cell = grains.body[side], grains.built, grains.cells, grains.cell[1]
    first, partner, history = grains.first[side], grains.partner[side], grains.history[side]
    n_x, n_y, n_z = count[CELLS_X], count[CELLS_Y], count[CELLS_Z]
    period_x, period_y = grains.periods[0], grains.periods[1]
    for i in range(grains.slabs[slab], grains.slabs[slab + 1]):
        c = cell[i]
        c_z = c % n_z
        c_y = (c // n_z) % n_y
        c_x = c // (n_z * n_y)
        low, high = max(c_z - 1, 0), min(c_z + 1, n_z - 1)
        x, y, z, reach = body[i, X], body[i, Y], body[i, Z], body[i, R] + built[i, 3]
        found = first[i] if fill else 0
        # Runs of cells along z: this cell's rest and the one above, the one beside in y, three in the next layer in x.
        for run in range(5):
            if run == 0:
                begin, end = i + 1, cells[c + high - c_z + 1]
            else:
                b_x, b_y = (c_x, c_y + 1) if run == 1 else (c_x + 1, c_y + run - 3)
                if b_x >= n_x:
                    if period_x == 0.0:
                        continue
                    b_x = 0
                if b_y >= n_y or b_y < 0:
                    if period_y == 0.0:
                        continue
                    b_y = 0 if b_y > 0 else n_y - 1
                row = (b_x * n_y + b_y) * n_z
                begin, end = cells[row + low], cells[row + high + 1]
            for j in range(begin, end):
                d_x, d_y, d_z = x - body[j, X], y - body[j, Y], z - body[j, Z]
                if period_x > 0.0 and abs(d_x) > 0.5 * period_x:
                    d_x -= math.copysign(period_x, d_x)
                if period_y > 0.0 and abs(d_y) > 0.5 * period_y:
                    d_y -= math.copysign(period_y, d_y)
                near = reach + body[j, R] + built[j, 3]
                if d_x * d_x + d_y * d_y + d_z * d_z < near * near:
                    if fill:
                        partner[found] = j
                        recall_pair(grains, old_side, i, j, found, history)
                    found += 1
        if not fill:
            first[i + 1] = found


@kernel
def recall_pair(grains, side, i, j, pair, history):
    """Write the history that particles i and j have of each other on the other side as that of a pair; none: zeros."""
    a, b = grains.order[i], grains.order[j]
    first, partner, old = grains.first[side], grains.partner[side], grains.history[side]
    sign, known = 0.0, 0
    for k in range(first[a], first[a + 1]):
        if partner[k] == b:
            sign, known = 1.0, k
    if sign == 0.0:
        for k in range(first[b], first[b + 1]):
            if partner[k] == a:
                sign, known = -1.0, k
    to = (pair // LENGTH) * HISTORY * LENGTH + pair % LENGTH
    at = (known // LENGTH) * HISTORY * LENGTH + known % LENGTH
    for k in range(HISTORY):
        history[to + k * LENGTH] = sign * old[at + k * LENGTH] if sign != 0.0 else 0.0


@kernel
def place_pairs(grains):
    """Give each particle its place in the list of pairs; False if there is no room for them."""
    count = grains.count
    first = grains.first[1 - count[SIDE]]
    first[0] = 0
    for i in range(count[N]):
        first[i + 1] += first[i]
    return first[count[N]] <= grains.partner.shape[1]


@kernel
def take_lists(grains):
    """The new lists are in use."""
    count = grains.count
    count[SIDE] = 1 - count[SIDE]
    count[PAIRS] = grains.first[count[SIDE], count[N]]
    count[STALE] = 0
