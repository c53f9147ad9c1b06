"""What a bed of particles is in memory: packed records of particles, their lists of neighbours, and the history of their contacts."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..slave.model import ModelError
from .shape import FIGURE, Shape, orientations

#: Columns of a particle: centre [m], radius [m], velocity [m/s], mass [kg], angular velocity [rad/s], and 1 if it moves, 0 if it is held.
#: What one contact reads of a particle lies together.
X, Y, Z, R, V_X, V_Y, V_Z, M, W_X, W_Y, W_Z, FREE = range(12)
PARTICLE = 12

#: Contacts of a block. Their history lies as a structure of arrays, so that a loop over a block is vectorised; a power of two would make
#: all its rows compete for the same lines of the processor's cache.
LENGTH = 136
#: Rows of a block's history: tangential displacement of the pair's first particle against the second, and rolling angle, in world axes.
SHEAR, ROLL, HISTORY = 0, 3, 6

#: Places in ``count``: particles; which of both sides of the arrays is in use; pairs; slabs; cells along x, y, z; 1 if lists are too old;
#: 1 if there is no room for all pairs.
N, SIDE, PAIRS, SLABS, CELLS_X, CELLS_Y, CELLS_Z, STALE, CROWDED, COUNT = range(10)

#: Room for pairs, for each particle; spheres of two sizes have about 3 that touch.
PAIRS_EACH = 8
#: Rows of the memory in which a slab works on a block: what ``pairs`` gathers, and in place of D, A and B the force and torque on both
#: particles; with shapes, their quaternions, relative angular velocity, and in place of U what the contact points to.
D_X, D_Y, D_Z, U_X, U_Y, U_Z, A_X, A_Y, A_Z, B_X, B_Y, B_Z, R_A, R_B, BUFFER = range(15)
Q_A, Q_B, TURNING, SHAPED_BUFFER = BUFFER, BUFFER + 4, BUFFER + 8, BUFFER + 11

#: Margins of lists [radii]: of a particle at rest, and the largest one. Own choice, by speed.
LEAST_MARGIN, LARGEST_MARGIN = 0.01, 0.25
#: Cells of a period, at least: with fewer, a cell's neighbours on both sides would be one.
LEAST_CELLS = 3
#: Most cells, for each particle and beside.
CELLS_EACH, SPARE_CELLS = 4, 1000
#: Least period [radii of the largest particle].
LEAST_PERIOD = LEAST_CELLS * 2.0 * (1.0 + LARGEST_MARGIN)

#: Most slabs of the bed, cut across x, that threads work on at once.
MOST_SLABS = 256


class Particles(NamedTuple):
    """Arrays of a bed of n particles with room for m pairs. Lists are made anew from one side of an array to the other.

    Attributes:
        count: Numbers, int64 [COUNT].
        periods: Lengths after which the bed repeats itself along x and y [m], 0 = not at all, [2].
        body: Records of particles, [2, n, PARTICLE].
        ident: Numbers by which particles are known for ever, int64 [2, n].
        force: Force [N] and torque [N.m] on each particle, [n, 6].
        built: Position of each particle as its list was made, and its radius with the margin by which it may move until the list is too
            old [m], [n, 4].
        first: Where the pairs of each particle begin, int64 [2, n + 1].
        partner: The other particle of each pair, int32 [2, m].
        history: Of the pairs, in blocks: flat, [2, blocks * HISTORY * LENGTH].
        found: Partners as they are found, slab by slab, int32 [m].
        cell: Cell of each particle in the old and in the new order, int64 [2, n].
        cells: Where the particles of each cell begin, int64.
        fastest: Largest speed in each cell, and in it and around it [m/s].
        order: Index that each particle had before its list was made, int64 [n].
        slabs: Where the particles of each slab begin, int64 [MOST_SLABS + 1].
        blocks: Memory of each slab's work, [MOST_SLABS, BUFFER * LENGTH], or SHAPED_BUFFER.
        orientation: Of each particle with a shape, quaternions from its frame to the world, [2, n, 4]; [2, 0, 4] of spheres.
        figure: Numbers of the shape, [FIGURE].
    """

    count: np.ndarray
    periods: np.ndarray
    body: np.ndarray
    ident: np.ndarray
    force: np.ndarray
    built: np.ndarray
    first: np.ndarray
    partner: np.ndarray
    history: np.ndarray
    found: np.ndarray
    cell: np.ndarray
    cells: np.ndarray
    fastest: np.ndarray
    order: np.ndarray
    slabs: np.ndarray
    blocks: np.ndarray
    orientation: np.ndarray
    figure: np.ndarray


def empty_particles(n: int, *, periods=(0.0, 0.0), precision=np.float64, shape: Shape | None = None) -> Particles:
    """Room for n particles.

    Args:
        n: Most particles.
        periods: As in ``Particles``.
        precision: Type of the numbers of contacts, float64 or float32; positions and velocities are float64.
        shape: Of all particles; None: spheres.
    """
    pairs = PAIRS_EACH * n
    return Particles(
        count=np.zeros(COUNT, np.int64),
        periods=np.array(periods, float),
        body=np.zeros((2, n, PARTICLE)),
        ident=np.zeros((2, n), np.int64),
        force=np.zeros((n, 6)),
        built=np.zeros((n, 4)),
        first=np.zeros((2, n + 1), np.int64),
        partner=np.zeros((2, pairs), np.int32),
        history=np.zeros((2, (pairs // LENGTH + 1) * HISTORY * LENGTH), precision),
        found=np.zeros(pairs, np.int32),
        cell=np.zeros((2, n), np.int64),
        cells=np.zeros(CELLS_EACH * n + SPARE_CELLS, np.int64),
        fastest=np.zeros((2, CELLS_EACH * n + SPARE_CELLS)),
        order=np.arange(n),
        slabs=np.zeros(MOST_SLABS + 1, np.int64),
        blocks=np.zeros((MOST_SLABS, (SHAPED_BUFFER if shape else BUFFER) * LENGTH), precision),
        orientation=np.zeros((2, n if shape else 0, 4)),
        figure=shape.figure() if shape else np.zeros(FIGURE),
    )


def particles_of(positions, radii, density, **options) -> Particles:
    """Particles at rest, of any orientation.

    Args:
        positions: Centres [m], [n, 3].
        radii: [m], [n].
        density: Of the grains [kg/m3].
        **options: As for ``empty_particles``.

    Raises ModelError if a period is too short for particles of this size.
    """
    n, least = len(positions), LEAST_PERIOD * float(np.max(radii))
    for axis, period in zip("xy", options.get("periods", ())):
        if 0.0 < period < least:
            raise ModelError(
                f"the period along {axis} is {period:g} m, but at least {least:g} m is needed, {LEAST_PERIOD:g} radii of the largest "
                "particle: lengthen it, or take smaller particles"
            )
    particles = empty_particles(n, **options)
    body = particles.body[0]
    body[:, X : X + 3], body[:, R], body[:, FREE] = positions, radii, 1.0
    body[:, M] = mass_of(np.asarray(radii), density)
    particles.ident[0] = np.arange(n)
    if options.get("shape"):
        particles.orientation[0] = orientations(particles.ident[0])
    particles.count[N], particles.count[STALE] = n, 1
    return particles


def mass_of(radius, density):
    """Mass of a sphere [kg]."""
    return 4.0 / 3.0 * math.pi * density * radius**3


def history_of_pairs(history: np.ndarray, n: int) -> np.ndarray:
    """History of the first n pairs, [n, HISTORY], from the blocks of one side."""
    return history.reshape(-1, HISTORY, LENGTH).transpose(0, 2, 1).reshape(-1, HISTORY)[:n].copy()


def set_history_of_pairs(history: np.ndarray, values: np.ndarray) -> None:
    """Write the history of the first pairs, [n, HISTORY], into the blocks of one side."""
    block, place = np.divmod(np.arange(len(values)), LENGTH)
    history.reshape(-1, HISTORY, LENGTH)[block, :, place] = values
