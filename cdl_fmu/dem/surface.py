"""The surface of particles as heights over a grid."""

from __future__ import annotations

import math

import numpy as np

from ..slave.kernel import kernel
from .particles import PARTICLE, R, X, Y, Z

#: Height of a node that no particle is below [m]: so low that nothing reaches it, and a number, which patches must hold.
NOTHING = -1e6


@kernel
def fill_heights(bodies, n, origin, spacing, heights):
    """Height of the highest particle over each node of a grid.

    Args:
        bodies: Records of particles, see ``particles``, [n or more, PARTICLE].
        n: Number of particles.
        origin: x, y of node (0, 0) [m], [2].
        spacing: Distance of nodes [m].
        heights: Heights [m] that are written, [n_x, n_y]; NOTHING where no particle is below.
    """
    n_x, n_y = heights.shape
    for i in range(n_x):
        for j in range(n_y):
            heights[i, j] = NOTHING
    for k in range(n):
        x, y, z, r = bodies[k, X] - origin[0], bodies[k, Y] - origin[1], bodies[k, Z], bodies[k, R]
        # Whole numbers from clipped ones: a particle that flew far away has none.
        low = math.ceil(min(max((x - r) / spacing, 0.0), float(n_x)))
        high = math.floor(min(max((x + r) / spacing, -1.0), n_x - 1.0))
        front = math.ceil(min(max((y - r) / spacing, 0.0), float(n_y)))
        back = math.floor(min(max((y + r) / spacing, -1.0), n_y - 1.0))
        for i in range(low, high + 1):
            across = r * r - (i * spacing - x) ** 2
            for j in range(front, back + 1):
                square = across - (j * spacing - y) ** 2
                if square >= 0.0:
                    heights[i, j] = max(heights[i, j], z + math.sqrt(square))


def mean_height(positions: np.ndarray, radii: np.ndarray, periods: tuple[float, float], spacing: float) -> float:
    """Mean height [m] of the surface of a periodic bed: of the highest particle over the centre of each cell of a grid.

    Args:
        positions: Centres within the periods [m], [n, 3].
        radii: [m], [n].
        periods: Lengths after which the bed repeats itself along x and y [m].
        spacing: Width of a cell, of which both periods are whole multiples [m].
    """
    # Particles that reach over an edge are there on the other side, too.
    points, sizes = np.asarray(positions), np.asarray(radii)
    for axis in range(2):
        low, high = points[:, axis] < sizes, points[:, axis] > periods[axis] - sizes
        step = np.eye(3)[axis] * periods[axis]
        points = np.concatenate([points, points[low] + step, points[high] - step])
        sizes = np.concatenate([sizes, sizes[low], sizes[high]])
    bodies = np.zeros((len(points), PARTICLE))
    bodies[:, X : X + 3], bodies[:, R] = points, sizes
    heights = np.zeros([round(period / spacing) for period in periods])
    fill_heights(bodies, len(bodies), np.full(2, 0.5 * spacing), spacing, heights)
    return float(heights.mean())
