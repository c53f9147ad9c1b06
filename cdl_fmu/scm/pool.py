"""The soil of an SCM instance: its tiles, the undisturbed ground, and the memory that a step works in."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba.extending import register_jitable

from ..slave.interface import body_pose
from ..slave.kernel import kernel
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


@register_jitable
def sizes_of(p, n_tools, reach):
    """Sizes for tools whose meshes reach this far from their middles [m].

    Returns:
        Tiles and cells that a tool's surroundings may overlap along an axis, and tiles that one step may touch.
    """
    across = max(p.b_w, 0.5 * p.b_w + p.r_w + p.h_g)  # of a wheel with any camber
    wheel = math.hypot(p.r_w + p.h_g + 0.5 * p.b_w + 4.0 * p.cell, across + 4.0 * p.cell)
    span = max(wheel, reach + 5.0 * p.cell)  # largest horizontal distance from a tool's middle that its contact reads or changes
    tiles = math.ceil(2.0 * span / (p.cell * TILE)) + 2
    return tiles, math.ceil(2.0 * span / p.cell) + 3, n_tools * tiles * tiles + 32


#: Places of the extents of rows, marks, grid, cells and outflow among those of all arrays.
_ROWS, _MARKS, _GRID, _CELLS, _OUTFLOW = 0, 4, 16, 21, 27


@kernel
def resize(p, extents, growth):
    """Extents of the arrays of a pool without meshes."""
    tiles, across, growth[0] = sizes_of(p, extents[_GRID], 0.0)
    growth[1] = int(p.max_tiles)
    extents[_ROWS] = extents[_MARKS] = min(growth[0], growth[1])
    extents[_GRID + 1] = extents[_GRID + 2] = tiles
    extents[_CELLS + 1], extents[_OUTFLOW + 1] = across * across, across


class SoilPool(RowPool):
    """Tiles of soil; the kernels get rows, marks and head, the undisturbed ground, the meshes, and memory that holds nothing between steps.

    Args:
        p: Parameters of the model.
        n_tools: Number of tools.
        base: The undisturbed ground; None: flat.
        meshes: Surfaces of the tools.
    """

    def __init__(self, p: np.recarray, n_tools: int, base: Raster | None, meshes: Meshes):
        tiles, across, per_step = sizes_of(p, n_tools, meshes.reach)
        most = int(np.ptp(meshes.ranges, axis=1).max())  # elements of a tool
        ground, frame = (np.zeros((1, 1)), np.zeros(3)) if base is None else (base.z, (*base.origin, base.spacing))
        super().__init__(
            (FIELDS, TILE, TILE),
            marks=MARKS,
            head=HEAD,
            per_step=per_step,
            limit=int(p.max_tiles),
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
