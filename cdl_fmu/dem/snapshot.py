"""Particles at an instant with the forces between them: of a simulation, or of what a slave saved."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .law import ELASTIC, HERTZ, LINEAR, PULL, STIFFNESS, TANGENTIAL
from .particles import SHEAR, SIDE, N, R, X, history_of_pairs
from .pool import SavedGrains
from .simulation import Simulation


class Snapshot(NamedTuple):
    """n particles, and m pairs of them that touch.

    Attributes:
        bodies: Records, see ``particles``, [n, PARTICLE]; those of a periodic bed within its periods.
        ident: Numbers by which particles are known for ever, int64 [n].
        a, b: Rows of the first and of the second particle of each pair, [m].
        branch: From the centre of b, or of its nearest image, to that of a [m], [m, 3].
        force: Of b on a [N], [m, 3]: spring, friction and pull, without dampers.
        periods: Lengths after which the bed repeats itself along x and y [m], 0 = not at all, [2].
    """

    bodies: np.ndarray
    ident: np.ndarray
    a: np.ndarray
    b: np.ndarray
    branch: np.ndarray
    force: np.ndarray
    periods: np.ndarray


def of_simulation(simulation: Simulation) -> Snapshot:
    """The particles of a simulation as they are now."""
    grains = simulation.particles
    side, n = grains.count[SIDE], grains.count[N]
    first = grains.first[side, : n + 1]  # ``count`` tells the number of pairs only once there are lists
    a, m = np.repeat(np.arange(n), np.diff(first)), int(first[n])
    bodies = simulation.bodies.copy()
    for axis, period in enumerate(grains.periods):
        if period > 0.0:
            bodies[:, X + axis] %= period
    history = history_of_pairs(grains.history[side], m)
    law = simulation.material.law(simulation.dt)
    return _snapshot(bodies, simulation.ident.copy(), a, grains.partner[side, :m], history, law, grains.periods)


def of_saved(saved: SavedGrains) -> Snapshot:
    """The particles of all soil that was touched, live or stored."""
    arrays, ground = saved.arrays, saved.ground
    bodies = np.concatenate([arrays["body"], *(grains.bodies for grains in ground.stored.values())])
    ident = np.concatenate([arrays["ident"], *(grains.ident for grains in ground.stored.values())])
    first = np.repeat(arrays["ident"], np.diff(arrays["first"]))
    known = ground.touching.values()  # of pairs that are held or stored
    a = np.concatenate([first, *(contacts.a for contacts in known)])
    b = np.concatenate([arrays["ident"][arrays["partner"]], *(contacts.b for contacts in known)])
    history = np.concatenate([arrays["history"], *(contacts.history for contacts in known)])
    order = np.argsort(ident)
    rows = [order[np.minimum(np.searchsorted(ident, numbers, sorter=order), len(ident) - 1)] for numbers in (a, b)]
    here = (ident[rows[0]] == a) & (ident[rows[1]] == b)  # some reach into soil that nothing has touched
    return _snapshot(bodies, ident, rows[0][here], rows[1][here], history[here], arrays["law"], np.zeros(2))


def _snapshot(bodies, ident, a, b, history, law, periods) -> Snapshot:
    """Of pairs that are near each other those that touch, with their forces."""
    branch = bodies[a, X : X + 3] - bodies[b, X : X + 3]
    branch[:, :2] -= np.rint(branch[:, :2] / np.where(periods > 0.0, periods, np.inf)) * periods
    distance = np.linalg.norm(branch, axis=1)
    touch = distance < bodies[a, R] + bodies[b, R]
    a, b, branch, distance, shear = a[touch], b[touch], branch[touch], distance[touch], history[touch, SHEAR : SHEAR + 3]
    r_a, r_b = bodies[a, R], bodies[b, R]
    overlap, r_eff = r_a + r_b - distance, r_a * r_b / (r_a + r_b)
    # As in ``law.respond``.
    stiffness = law[STIFFNESS] * (law[HERTZ] * np.sqrt(r_eff * overlap) + law[LINEAR] * r_eff)
    normal = law[ELASTIC] * stiffness * overlap - law[PULL] * r_eff**2
    force = (normal / distance)[:, None] * branch - (law[TANGENTIAL] * stiffness)[:, None] * shear
    return Snapshot(bodies, ident, a, b, branch, force, np.array(periods))
