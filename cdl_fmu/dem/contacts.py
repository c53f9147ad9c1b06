"""Contacts of particles at rest with each other and with their floor: taken out of a simulation, and put into another one."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .law import ELASTIC, HERTZ, LINEAR, STIFFNESS
from .particles import PAIRS, ROLL, SHEAR, SIDE, N, R, X, history_of_pairs, set_history_of_pairs
from .simulation import Simulation
from .tools import NORMAL, ROLLED, SLID


class Contacts(NamedTuple):
    """Contacts of m pairs of particles, and of k particles with the floor. Particles go by their number.

    Attributes:
        pairs: Both particles of each pair, int32 [m, 2].
        images: Which image of the second one the first one touches: moved by so many periods along x and y, int8 [m, 2].
        shear: Tangential displacement of the first particle against the second [m], [m, 3].
        roll: Rolling angle of the first particle against the second [rad], [m, 3].
        on_floor: Particles that touch the floor, int32 [k].
        floor_shear, floor_roll: As ``shear`` and ``roll``, against the floor, [k, 3].
    """

    pairs: np.ndarray
    images: np.ndarray
    shear: np.ndarray
    roll: np.ndarray
    on_floor: np.ndarray
    floor_shear: np.ndarray
    floor_roll: np.ndarray


def no_contacts() -> Contacts:
    """Contacts of particles that touch nothing."""
    vectors = np.zeros((0, 3))
    pairs, images = np.zeros((0, 2), np.int32), np.zeros((0, 2), np.int8)
    return Contacts(pairs, images, vectors, vectors, np.zeros(0, np.int32), vectors, vectors)


def contacts_of(simulation: Simulation) -> Contacts:
    """The contacts of a simulation, by the numbers of its particles, in ascending order; its first tool is the floor."""
    grains, tools = simulation.particles, simulation._tools
    side, ident = grains.count[SIDE], simulation.ident
    first, second, away, images = _listed(simulation)
    radii = simulation.bodies[:, R]
    touch = np.flatnonzero((away**2).sum(axis=1) < (radii[first] + radii[second]) ** 2)
    history = history_of_pairs(grains.history[side], grains.count[PAIRS])[touch]
    pairs = np.stack([ident[first[touch]], ident[second[touch]]], axis=1).astype(np.int32)
    order = np.lexsort(pairs.T[::-1])
    begin, end = tools.first[side, :2]
    kept = tools.kept[side, begin:end, 0]  # a plane has one row
    met = kept[:, NORMAL : NORMAL + 3].any(axis=1)
    on_floor = ident[tools.particle[side, begin:end]][met].astype(np.int32)
    by_number = np.argsort(on_floor)
    return Contacts(
        pairs=pairs[order],
        images=images[touch][order],
        shear=history[order, SHEAR : SHEAR + 3].astype(float),
        roll=history[order, ROLL : ROLL + 3].astype(float),
        on_floor=on_floor[by_number],
        floor_shear=kept[met][by_number, SLID : SLID + 3],
        floor_roll=kept[met][by_number, ROLLED : ROLLED + 3],
    )


def put_contacts(simulation: Simulation, contacts: Contacts) -> None:
    """Give a simulation that has made no step yet these contacts; its first tool is the floor, below."""
    grains, tools = simulation.particles, simulation._tools
    order = np.argsort(contacts.pairs[:, 0], kind="stable")
    m, n = len(order), grains.count[N]
    grains.partner[0, :m] = contacts.pairs[order, 1]
    grains.first[0, 1:] = np.cumsum(np.bincount(contacts.pairs[:, 0], minlength=n))
    set_history_of_pairs(grains.history[0], np.hstack([contacts.shear, contacts.roll])[order])
    k = len(contacts.on_floor)
    tools.first[0, 1:] = k
    tools.particle[0, :k] = contacts.on_floor
    tools.kept[0, :k, 0, NORMAL + 2] = 1.0
    tools.kept[0, :k, 0, SLID : SLID + 3] = contacts.floor_shear
    tools.kept[0, :k, 0, ROLLED : ROLLED + 3] = contacts.floor_roll


def contacts_among(contacts: Contacts, kept: np.ndarray) -> Contacts:
    """Contacts that are left, by new numbers, where only some particles are kept, bool [n]."""
    number = (np.cumsum(kept) - 1).astype(np.int32)
    both, floored = kept[contacts.pairs].all(axis=1), kept[contacts.on_floor]
    return Contacts(
        number[contacts.pairs[both]],
        contacts.images[both],
        contacts.shear[both],
        contacts.roll[both],
        number[contacts.on_floor[floored]],
        contacts.floor_shear[floored],
        contacts.floor_roll[floored],
    )


def overlaps_of(simulation: Simulation) -> np.ndarray:
    """Overlaps [m] of the pairs that touch, [m]."""
    return _touching(simulation)[0]


def normal_forces(simulation: Simulation) -> np.ndarray:
    """Elastic normal forces [N] of the pairs that touch, [m]."""
    law = simulation.material.law(simulation.dt)
    overlap, r_eff = _touching(simulation)
    stiffness = law[STIFFNESS] * (law[HERTZ] * np.sqrt(r_eff * overlap) + law[LINEAR] * r_eff)  # as in ``law.respond``
    return law[ELASTIC] * stiffness * overlap


def _touching(simulation: Simulation) -> tuple[np.ndarray, np.ndarray]:
    """Overlap and effective radius of each pair that touches [m]."""
    first, second, away, _ = _listed(simulation)
    a, b = simulation.bodies[first, R], simulation.bodies[second, R]
    overlap = a + b - np.sqrt((away**2).sum(axis=1))
    return overlap[overlap > 0.0], (a * b / (a + b))[overlap > 0.0]


def _listed(simulation: Simulation) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Both particles of each pair that is listed, the way from the nearest image of the second to the first [m], and that image."""
    grains = simulation.particles
    side, n = grains.count[SIDE], grains.count[N]
    first = np.repeat(np.arange(n), np.diff(grains.first[side, : n + 1]))
    second = grains.partner[side, : grains.count[PAIRS]]
    at = simulation.bodies[:, X : X + 3].copy()
    for axis, period in enumerate(grains.periods):  # who has left the tile since the last list is back
        if period > 0.0:
            at[:, axis] %= period
    away = at[first] - at[second]
    images = np.rint(away[:, :2] / np.where(grains.periods > 0.0, grains.periods, np.inf))
    away[:, :2] -= images * grains.periods
    return first, second, away, images.astype(np.int8)
