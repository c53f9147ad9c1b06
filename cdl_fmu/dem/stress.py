"""Stress, share of solid and velocity of particles, averaged in the cells of a grid.

Stress is that of Love and Weber, 1/V sum f (x) l over contacts, of force f and branch l (Weber 1966), positive in compression. Contacts
with wheels, bodies and the floor do not count, so that cells within a particle of them tell less than there is; nor does the momentum that
particles carry about, which is nothing in soil that does not fly.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..slave.model import ModelError
from .particles import V_X, R, X
from .snapshot import Snapshot

#: Size of cells that is chosen, in diameters of the largest particle. Own choice: smaller ones hold few particles, larger ones blur.
_CELL = 3.0


class Grid(NamedTuple):
    """Cells along x, y and z.

    Attributes:
        origin: Corner of cell (0, 0, 0) [m], [3].
        spacing: Size of a cell [m], [3].
        shape: Number of cells.
    """

    origin: np.ndarray
    spacing: np.ndarray
    shape: tuple[int, int, int]

    @property
    def volume(self) -> float:
        """Of a cell [m3]."""
        return float(np.prod(self.spacing))


class Averages(NamedTuple):
    """Means in the cells of a grid.

    Attributes:
        stress: Stress [Pa], compression positive: component i, j is the force along i through the face across j, [n_x, n_y, n_z, 3, 3].
        solid: Volume of particles over volume, [n_x, n_y, n_z].
        velocity: Mean velocity [m/s], 0 where there is no particle, [n_x, n_y, n_z, 3].
    """

    stress: np.ndarray
    solid: np.ndarray
    velocity: np.ndarray


def coordination(snapshot: Snapshot) -> np.ndarray:
    """Number of particles that touch each particle, int64 [n]."""
    return np.bincount(np.concatenate([snapshot.a, snapshot.b]), minlength=len(snapshot.bodies))


def pressure(snapshot: Snapshot) -> np.ndarray:
    """Mean stress in each particle [Pa], [n]."""
    return np.trace(moments(snapshot), axis1=1, axis2=2) / 3.0 / _volumes(snapshot)


def moments(snapshot: Snapshot) -> np.ndarray:
    """Volume times stress of each particle [N.m]: sum of forces on it times its part of the branch, [n, 3, 3].

    The contact divides the branch: each particle has the part from there to its centre. So all of them make up sum f (x) l.
    """
    bodies, a, b, branch, force = snapshot[0], *snapshot[2:6]
    overlap = bodies[a, R] + bodies[b, R] - np.linalg.norm(branch, axis=1)
    share = (bodies[a, R] - 0.5 * overlap) / (bodies[a, R] + bodies[b, R] - overlap)  # arms as in ``pairs``
    found = np.empty((len(bodies), 3, 3))
    for i in range(3):
        for j in range(3):
            product = force[:, i] * branch[:, j]
            found[:, i, j] = np.bincount(a, share * product, len(bodies)) + np.bincount(b, (1.0 - share) * product, len(bodies))
    return found


def grid_around(snapshot: Snapshot, spacing: float | None = None) -> Grid:
    """A grid around all particles that touch others: one that flew away does not make it large.

    Cells are at multiples of their size from the world's origin, so that those of two instants fit together; a periodic bed has whole
    cells in its periods, each somewhat larger than asked for.

    Args:
        snapshot: The particles.
        spacing: Size of a cell [m]; None: 3 diameters of the largest particle.

    Raises ModelError if a cell is smaller than the largest particle.
    """
    bodies = snapshot.bodies[coordination(snapshot) > 0] if len(snapshot.a) else snapshot.bodies
    largest = 2.0 * float(bodies[:, R].max())
    spacing = _CELL * largest if spacing is None else spacing
    if not largest <= spacing < math.inf:
        raise ModelError(f"spacing = {spacing:g} m of cells: at least the diameter of the largest particle is needed, {largest:g} m")
    sizes = np.full(3, spacing)
    low, high = (bodies[:, X : X + 3] - bodies[:, R, None]).min(axis=0), (bodies[:, X : X + 3] + bodies[:, R, None]).max(axis=0)
    for axis, period in enumerate(snapshot.periods):
        if period > 0.0:
            sizes[axis] = period / max(math.floor(period / spacing + 1e-9), 1)
            low[axis], high[axis] = 0.0, period
    first = np.floor(low / sizes + 1e-9)
    shape = np.maximum(np.ceil(high / sizes - 1e-9) - first, 1.0).astype(int)
    return Grid(first * sizes, sizes, tuple(shape.tolist()))


def average(snapshot: Snapshot, grid: Grid) -> Averages:
    """Means in the cells of a grid, none of which is smaller than the largest particle.

    Each particle is spread over the cells as the cube of its volume is, about its centre: own choice, for its sums are exact, and it is
    smoother than to count centres. What lies outside the grid is left out.
    """
    n_x, n_y, n_z = grid.shape
    volumes = _volumes(snapshot)
    carried = np.column_stack([moments(snapshot).reshape(-1, 9), volumes, volumes[:, None] * snapshot.bodies[:, V_X : V_X + 3]])
    side = np.cbrt(volumes)[:, None] / grid.spacing
    low = (snapshot.bodies[:, X : X + 3] - grid.origin) / grid.spacing - 0.5 * side
    first = np.floor(low)
    in_first = np.minimum((first + 1.0 - low) / side, 1.0)
    sums = np.zeros((n_x * n_y * n_z, carried.shape[1]))
    for corner in np.ndindex(2, 2, 2):
        cell = first.astype(np.int64) + corner
        for axis, period in enumerate(snapshot.periods):
            if period > 0.0:
                cell[:, axis] %= round(period / grid.spacing[axis])
        inside = ((cell >= 0) & (cell < grid.shape)).all(axis=1)
        weights = np.where(corner, 1.0 - in_first, in_first).prod(axis=1)[inside]
        flat = np.ravel_multi_index(cell[inside].T, grid.shape)
        for column in range(carried.shape[1]):
            sums[:, column] += np.bincount(flat, weights * carried[inside, column], len(sums))
    solid = sums[:, 9]
    velocity = sums[:, 10:] / np.where(solid > 0.0, solid, 1.0)[:, None]
    shape = grid.shape
    return Averages((sums[:, :9] / grid.volume).reshape(*shape, 3, 3), (solid / grid.volume).reshape(shape), velocity.reshape(*shape, 3))


def _volumes(snapshot: Snapshot) -> np.ndarray:
    """Of the particles [m3], [n]."""
    return 4.0 / 3.0 * math.pi * snapshot.bodies[:, R] ** 3
