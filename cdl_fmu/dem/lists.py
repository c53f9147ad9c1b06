"""Lists of neighbours: the pairs that may touch until the lists are made anew, with the history of those that did before."""

from __future__ import annotations

import math

from ..slave.kernel import kernel
from .particles import CELLS_X, CELLS_Y, CELLS_Z, CROWDED, FREE, HISTORY, LENGTH, PAIRS, PAIRS_EACH, SIDE, STALE, N


@kernel
def find_pairs(grains, slab):
    """Find the pairs of each particle of a slab, and count them; of two particles that are held nobody asks.

    Says in ``count[CROWDED]`` if there is no room.
    """
    count, built, cells, cell, found = grains.count, grains.built, grains.cells, grains.cell[1], grains.found
    side = 1 - count[SIDE]
    body, first = grains.body[side], grains.first[side]
    n_x, n_y, n_z = count[CELLS_X], count[CELLS_Y], count[CELLS_Z]
    period_x, period_y = grains.periods[0], grains.periods[1]
    place, last = PAIRS_EACH * grains.slabs[slab], PAIRS_EACH * grains.slabs[slab + 1]
    for i in range(grains.slabs[slab], grains.slabs[slab + 1]):
        c = cell[i]
        c_z = c % n_z
        c_y = (c // n_z) % n_y
        c_x = c // (n_z * n_y)
        low, high = max(c_z - 1, 0), min(c_z + 1, n_z - 1)
        x, y, z, reach, free = built[i, 0], built[i, 1], built[i, 2], built[i, 3], body[i, FREE]
        before = place
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
                d_x, d_y, d_z = x - built[j, 0], y - built[j, 1], z - built[j, 2]
                if period_x > 0.0 and abs(d_x) > 0.5 * period_x:
                    d_x -= math.copysign(period_x, d_x)
                if period_y > 0.0 and abs(d_y) > 0.5 * period_y:
                    d_y -= math.copysign(period_y, d_y)
                near = reach + built[j, 3]
                if d_x * d_x + d_y * d_y + d_z * d_z < near * near and (free > 0.0 or body[j, FREE] > 0.0):
                    if place == last:
                        count[CROWDED] = 1  # a sum over threads would need memory
                        return
                    found[place] = j
                    place += 1
        first[i + 1] = place - before


@kernel
def place_pairs(grains):
    """Give each particle its place in the list of pairs."""
    count = grains.count
    first = grains.first[1 - count[SIDE]]
    first[0] = 0
    for i in range(count[N]):
        first[i + 1] += first[i]


@kernel
def fill_pairs(grains, slab):
    """Write the pairs of a slab in their places, with the history of those known before."""
    old_side = grains.count[SIDE]
    side = 1 - old_side
    order, first, partner, history = grains.order, grains.first[side], grains.partner[side], grains.history[side]
    old_first, old_partner, old = grains.first[old_side], grains.partner[old_side], grains.history[old_side]
    begin = grains.slabs[slab]
    shift = PAIRS_EACH * begin - first[begin]
    for i in range(begin, grains.slabs[slab + 1]):
        a = order[i]
        for pair in range(first[i], first[i + 1]):
            j = grains.found[pair + shift]
            partner[pair] = j
            b = order[j]
            sign, known = 0.0, 0
            for k in range(old_first[a], old_first[a + 1]):
                if old_partner[k] == b:
                    sign, known = 1.0, k
            if sign == 0.0:
                for k in range(old_first[b], old_first[b + 1]):
                    if old_partner[k] == a:
                        sign, known = -1.0, k
            to = (pair // LENGTH) * HISTORY * LENGTH + pair % LENGTH
            at = (known // LENGTH) * HISTORY * LENGTH + known % LENGTH
            for k in range(HISTORY):
                history[to + k * LENGTH] = sign * old[at + k * LENGTH] if sign != 0.0 else 0.0


@kernel
def take_lists(grains):
    """The new lists are in use."""
    count = grains.count
    count[SIDE] = 1 - count[SIDE]
    count[PAIRS] = grains.first[count[SIDE], count[N]]
    count[STALE] = 0
