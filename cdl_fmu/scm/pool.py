"""The soil of an SCM instance: its tiles, the undisturbed ground, and the memory that a step works in."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..slave.interface import body_pose
from ..slave.pool import RowPool, SavedRows
from ..slave.records import Real, Record
from ..terrain.raster import Raster
from . import erosion, rim
from .columns import COLUMNS, PLACED, SUMS
from .flow import OUTFLOWS
from .meshes import Meshes
from .tiles import BASE, FIELDS, FILL, HEAD, LONGEST_QUEUE, MARKS, SINKAGE, TILE, TILE_I, TILE_J

#: Pose and twist of a tool with a mesh; mean velocities [m/s], [rad/s] since its contact was worked out last, and the time since [s]; the
#: pose by which its elements are taken to be on cells.
_MORE = Record(
    mean_v=Real(0.0, "m/s", "", (3,)),
    mean_w=Real(0.0, "rad/s", "", (3,)),
    time=Real(0.0, "s", ""),
    seat_0=Real(0.0, "m", "", (3,)),
    seat_T=Real(0.0, "1", "", (3, 3)),
)
_POSE = (body_pose(1).fields["body"].record | _MORE).dtype


class SoilPool(RowPool):
    """Tiles of soil; the kernels get rows, marks and head, the undisturbed ground, the meshes, and memory that holds nothing between steps.

    Args:
        cell: Size of a cell [m].
        span: Largest horizontal distance from a tool's middle that its contact reads or changes [m].
        n_tools: Number of tools.
        limit: Most tiles there may be.
        base: The undisturbed ground; None: flat.
        meshes: Surfaces of the tools.
    """

    def __init__(self, cell: float, span: float, n_tools: int, limit: int, base: Raster | None, meshes: Meshes):
        tiles = math.ceil(2.0 * span / (cell * TILE)) + 2  # that a tool's surroundings may overlap along an axis
        across = math.ceil(2.0 * span / cell) + 3  # cells
        most = int(np.ptp(meshes.ranges, axis=1).max())  # elements of a tool
        ground, frame = (np.zeros((1, 1)), (0.0, 0.0, 1.0)) if base is None else (base.z, (*base.origin, base.spacing))
        super().__init__(
            (FIELDS, TILE, TILE),
            marks=MARKS,
            head=HEAD,
            per_step=n_tools * tiles * tiles + 32,
            limit=limit,
            extra=(ground, np.array(frame), meshes.elements, meshes.ranges, meshes.shapes),
            scratch=(
                np.zeros((n_tools, tiles, tiles), np.int64),  # grid: rows of the tiles around each tool
                np.zeros((n_tools, 2), np.int64),  # corner: its first tile
                np.zeros((n_tools, across * across, COLUMNS)),  # cells: those that each tool presses
                np.zeros((n_tools, SUMS)),
                np.zeros(n_tools, rim.DTYPE),  # blocks: cells that are worked on together
                np.zeros((n_tools, across, OUTFLOWS)),  # outflow
                np.zeros((n_tools, most, PLACED)),  # placed: elements of each tool near the soil
                np.zeros((n_tools, (across * across if most else 0) + most), np.int64),  # links: their chains
                np.zeros(LONGEST_QUEUE, erosion.DTYPE),  # sliding: tiles that slide
                np.zeros((LONGEST_QUEUE, 4), np.int64),  # boxes
                np.zeros(n_tools, _POSE),  # poses: of tools with a mesh
            ),
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
