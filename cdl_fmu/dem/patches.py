"""Heights of the particles' surface as patches for wheels of other tiers."""

from __future__ import annotations

import math

import numpy as np

from .columns import Ground
from .surface import NOTHING, fill_heights


def patch_heights(ground: Ground, live: np.ndarray, origin: np.ndarray, spacing: float, nodes: tuple[int, int]) -> np.ndarray:
    """Heights [m] of nodes, each the mean surface of the square around it, shape ``nodes``.

    The surface is that by which the bed's own level counts: of the highest particle over each point of a grid, finer than the particles.

    Args:
        ground: All the soil.
        live: Records of the particles that are live.
        origin: x, y of node (0, 0) [m], [2].
        spacing: Distance of nodes [m].
        nodes: Number of nodes along x and y.
    """
    parts = math.ceil(2.0 * spacing / ground.bed.key.diameter)
    fine = spacing / parts
    corner = np.asarray(origin) - 0.5 * spacing + 0.5 * fine
    low, high = corner, corner + fine * (np.array(nodes) * parts - 1)
    bodies = ground.around(low, high, live)
    heights = np.empty([n * parts for n in nodes])
    fill_heights(bodies, len(bodies), corner, fine, heights)
    heights[heights == NOTHING] = ground.ground_z + ground.bed.floor
    return heights.reshape(nodes[0], parts, nodes[1], parts).mean(axis=(1, 3))
