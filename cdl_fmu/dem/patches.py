"""Heights of the particles' surface: as patches for wheels of other tiers, and as a map of all that was touched."""

from __future__ import annotations

import math

import numpy as np

from .columns import Ground, SavedGround, keys_of, places_of
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
    low = np.asarray(origin) - 0.5 * spacing
    bodies = ground.around(low, low + spacing * np.array(nodes), live)
    return mean_heights(bodies, origin, spacing, nodes, ground.bed.key.diameter, ground.floor)


def mean_heights(bodies: np.ndarray, origin: np.ndarray, spacing: float, nodes: tuple[int, int], diameter: float, floor: float):
    """Heights [m] of nodes, each the mean surface of particles in the square around it, shape ``nodes``.

    Args:
        bodies: Records of the particles in and near the squares.
        origin, spacing, nodes: As for ``patch_heights``.
        diameter: Mean diameter of the particles at the surface [m].
        floor: Height where there is no particle [m].
    """
    parts = math.ceil(2.0 * spacing / diameter)
    fine = spacing / parts
    heights = np.empty([n * parts for n in nodes])
    fill_heights(bodies, len(bodies), np.asarray(origin) - 0.5 * (spacing - fine), fine, heights)
    heights[heights == NOTHING] = floor
    return heights.reshape(nodes[0], parts, nodes[1], parts).mean(axis=(1, 3))


def touched_heights(saved: SavedGround, live: np.ndarray, spacing: float) -> tuple[np.ndarray, np.ndarray] | None:
    """Surface of all columns that were touched: where node (0, 0) is, x and y [m]; heights [m], NaN elsewhere. None: none was touched.

    Args:
        saved: A saved ground.
        live: Records of the particles that were live then.
        spacing: Distance of nodes, which are at multiples of it [m].
    """
    if not saved.touched:
        return None
    places = np.stack(places_of(sorted(saved.touched)), axis=1)
    first = np.ceil(places.min(axis=0) * saved.column / spacing - 1e-9)
    last = np.floor((places.max(axis=0) + 1) * saved.column / spacing - 1e-9)
    nodes = tuple((last - first + 1).astype(int))
    bodies = np.concatenate([live, *(grains.bodies for grains in saved.stored.values())])
    z = mean_heights(bodies, first * spacing, spacing, nodes, saved.diameter, saved.floor)
    x, y = (np.floor((a + np.arange(n)) * spacing / saved.column + 1e-9).astype(np.int64) for a, n in zip(first, nodes))
    known = np.isin(keys_of(x[:, None], y[None, :]), list(saved.touched))
    return first * spacing, np.where(known, z, np.nan)
