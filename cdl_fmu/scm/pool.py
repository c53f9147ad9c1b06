"""The soil of an SCM instance: its tiles, the undisturbed ground, and the memory that a step works in."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..slave.pool import RowPool, SavedRows
from ..terrain.raster import Raster
from .erosion import AROUND
from .flow import OUTFLOWS
from .tiles import BASE, FIELDS, FILL, HEAD, LONGEST_QUEUE, MARKS, SINKAGE, TILE, TILE_I, TILE_J
from .wheel import COLUMNS, SUMS


class SoilPool(RowPool):
    """Tiles of soil; the kernels get ``rows, marks, head, ground, frame`` and, after them, arrays that hold nothing between two steps.

    Args:
        cell: Size of a cell [m].
        spans: Largest horizontal distance from each tool's centre that its contact reads or changes [m].
        limit: Most tiles there may be.
        base: The undisturbed ground; None: flat.
    """

    def __init__(self, cell: float, spans: list[float], limit: int, base: Raster | None):
        n, span = len(spans), max(spans, default=0.0)
        tiles = math.ceil(2.0 * span / (cell * TILE)) + 2  # that a tool's surroundings may overlap along an axis
        across = math.ceil(2.0 * span / cell) + 3  # cells
        memory = (
            np.zeros((n, tiles, tiles), np.int64),  # grid: rows of the tiles around each tool
            np.zeros((n, 2), np.int64),  # corner: its first tile
            np.zeros((n, across * across, COLUMNS)),  # cells: those that each tool presses
            np.zeros((n, SUMS)),
            np.zeros((n, across, OUTFLOWS)),  # outflow
            np.zeros((LONGEST_QUEUE, 2, AROUND, AROUND)),  # around: heights of each tile that slides
            np.zeros((LONGEST_QUEUE, AROUND, AROUND)),  # moved
            np.zeros((LONGEST_QUEUE, 4), np.int64),  # boxes
        )
        ground, frame = (np.zeros((1, 1)), (0.0, 0.0, 1.0)) if base is None else (base.z, (*base.origin, base.spacing))
        super().__init__(
            (FIELDS, TILE, TILE),
            marks=MARKS,
            head=HEAD,
            per_step=n * tiles * tiles + 32,
            limit=limit,
            extra=(ground, np.array(frame)),
            scratch=memory,
        )


@dataclass(frozen=True)
class Heights:
    """Surface of the soil on the bounding rectangle of all touched tiles.

    Attributes:
        origin: World x and y of node [0, 0] [m].
        spacing: Distance of neighbouring nodes [m].
        z: Height [m], shape [n_x, n_y]; NaN where no tile was touched.
    """

    origin: tuple[float, float]
    spacing: float
    z: np.ndarray


def heights(saved: SavedRows, cell: float) -> Heights | None:
    """Surface of a saved soil with cells of this size [m]; None if no tile was touched."""
    if not saved.copies:
        return None
    corners = np.array([(marks[TILE_I], marks[TILE_J]) for _, marks in saved.copies]) * TILE
    first = corners.min(axis=0)
    z = np.full(tuple(corners.max(axis=0) - first + TILE), np.nan)
    for (row, _), (i, j) in zip(saved.copies, corners - first):
        z[i : i + TILE, j : j + TILE] = row[BASE] + (row[FILL] - row[SINKAGE])
    return Heights((float(first[0] * cell), float(first[1] * cell)), cell, z)
