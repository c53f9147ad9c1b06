"""All the soil there is: a tile that repeats itself for ever, and the square columns of it that were touched, stored or live.

Columns around the tools are live: those in the active boxes move, those around them are held. When the boxes move on, columns that rest are
stored with their particles and the history of their contacts, and come back as they were. Untouched columns are copies of the tile, made
when they are needed; so memory grows with the track, and time does not.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from .bed import Bed
from .particles import FREE, PARTICLE, V_X, V_Y, V_Z, W_X, W_Y, W_Z, M, R, X, Y, Z, mass_of
from .tools import KEPT, NORMAL, ROLLED, SLID

_BITS, _HALF = 21, 1 << 20  # of a column's number along an axis
_COPY_BITS, _COPY_HALF, _TEMPLATE_BITS = 20, 1 << 19, 22  # of a tile's number along an axis, and of a particle in it


def keys_of(i, j):
    """Numbers of the columns (i, j), int64."""
    return ((np.asarray(i, np.int64) + _HALF) << _BITS) + np.asarray(j, np.int64) + _HALF


def places_of(keys):
    """(i, j) of the columns of these numbers."""
    keys = np.asarray(keys, np.int64)
    return (keys >> _BITS) - _HALF, (keys & ((1 << _BITS) - 1)) - _HALF


class Grains(NamedTuple):
    """Particles: records [n, PARTICLE], numbers int64 [n], and quaternions of particles with a shape [n, 4], of spheres [n, 0]."""

    bodies: np.ndarray
    ident: np.ndarray
    orientation: np.ndarray


class Touching(NamedTuple):
    """Contacts of particles: numbers of both, int64 [m], and history as of the first against the second, [m, HISTORY]."""

    a: np.ndarray
    b: np.ndarray
    history: np.ndarray


class Resting(NamedTuple):
    """Contacts with the floor: number of the particle, int64 [k], and history, [k, KEPT]."""

    ident: np.ndarray
    kept: np.ndarray


class Live(NamedTuple):
    """What is in the simulation."""

    grains: Grains
    touching: Touching
    resting: Resting


class SavedGround(NamedTuple):
    """Content of a :class:`Ground`; and what does not change: side of a column, mean diameter at the surface, height of the floor [m]."""

    stored: dict[int, Grains]
    touching: dict[int, Touching]
    resting: dict[int, Resting]
    touched: frozenset[int]
    column: float
    diameter: float
    floor: float


class Ground:
    """Tile and columns.

    Args:
        bed: The tile.
        ground_z: Height of its surface in the world [m].
    """

    def __init__(self, bed: Bed, ground_z: float):
        self.bed, self.ground_z, self.column, self.floor = bed, ground_z, bed.column, ground_z + bed.floor
        # By columns: particles that are stored, and contacts that are known but not live, by the column of their first particle.
        self.stored: dict[int, Grains] = {}
        self.touching: dict[int, Touching] = {}
        self.resting: dict[int, Resting] = {}
        self.touched: frozenset[int] = frozenset()
        contacts, n = bed.contacts, bed.counts[0] * bed.counts[1]
        self._history = np.hstack([contacts.shear, contacts.roll])
        self._kept = np.zeros((len(bed.radii), KEPT))
        self._kept[contacts.on_floor, NORMAL + 2] = 1.0
        self._kept[contacts.on_floor, SLID : SLID + 3], self._kept[contacts.on_floor, ROLLED : ROLLED + 3] = (
            contacts.floor_shear,
            contacts.floor_roll,
        )
        place = np.floor(bed.positions[:, :2] / bed.column).astype(np.int64)
        home = place[:, 0] * bed.counts[1] + place[:, 1]
        self._particles = _groups(home, np.arange(len(home)), n)
        self._pairs = _groups(home[contacts.pairs[:, 0]], np.arange(len(contacts.pairs)), n)

    @property
    def farthest(self) -> float:
        """How far from the origin, along x or y, there are numbers of columns and of copies of the tile [m]."""
        return min(_HALF * self.column, _COPY_HALF * min(self.bed.periods)) - 2.0 * max(self.bed.periods)

    def save(self) -> SavedGround:
        """The content as it is now; nothing in it changes later."""
        of_all = self.column, self.bed.key.diameter, self.floor
        return SavedGround(self.stored.copy(), self.touching.copy(), self.resting.copy(), self.touched, *of_all)

    def restore(self, saved: SavedGround) -> None:
        """Go back to what was saved."""
        self.stored, self.touching, self.resting = saved.stored.copy(), saved.touching.copy(), saved.resting.copy()
        self.touched = saved.touched

    def columns_of(self, bodies: np.ndarray) -> np.ndarray:
        """Numbers of the columns that particles are in, int64 [n]."""
        at = np.floor(bodies[:, X : Y + 1] / self.column).astype(np.int64)
        return keys_of(at[:, 0], at[:, 1])

    def around(self, low: np.ndarray, high: np.ndarray, live: np.ndarray) -> np.ndarray:
        """Records of all particles in and near a rectangle of the plan: those of ``live``, stored ones, and copies of the tile."""
        i, j = (np.arange(math.floor(a / self.column) - 1, math.floor(b / self.column) + 2) for a, b in zip(low, high))
        keys = keys_of(*np.meshgrid(i, j, indexing="ij")).ravel()
        of_live = self.columns_of(live)
        found = [live[np.isin(of_live, keys)]]
        for key in keys.tolist():
            if key in self.stored:
                found.append(self.stored[key].bodies)
            if key not in self.touched:
                found.append(self.copy(key).grains.bodies)
        return np.concatenate(found)

    def exchange(self, live: Live, active: np.ndarray) -> Live:
        """Make these columns active, and those around them live and held; what else is live is stored.

        Args:
            live: What is live now; particles move in columns that are to be active, or rest.
            active: Numbers of columns, int64.
        """
        columns = around(active)
        keys = self.columns_of(live.grains.bodies)
        stays = np.isin(keys, columns)
        for key, members in _by_key(keys[~stays]):
            _add(self.stored, key, _some(_some(live.grains, ~stays), members))
        for key in columns.tolist():
            if key not in self.touched:
                self.touched |= {key}
                new = self.copy(key)
                # There may be particles that came over from other columns before, and their contacts.
                _add(self.stored, key, new.grains)
                _add(self.touching, key, new.touching)
                _add(self.resting, key, new.resting)
        grains = _joined([_some(live.grains, stays), *(self.stored.pop(key) for key in columns.tolist() if key in self.stored)])
        free = np.isin(self.columns_of(grains.bodies), active)
        grains.bodies[:, FREE] = free
        for column in (V_X, V_Y, V_Z, W_X, W_Y, W_Z):
            grains.bodies[~free, column] = 0.0
        order = np.argsort(grains.ident)
        numbers, free = grains.ident[order], free[order]
        homes = _Homes(live.grains.ident, keys)

        def moves(ident):
            """Whether particles are live, and whether they move."""
            if not len(numbers):
                return np.zeros(len(ident), bool), np.zeros(len(ident), bool)
            at = np.minimum(np.searchsorted(numbers, ident), len(numbers) - 1)
            found = numbers[at] == ident
            return found, found & free[at]

        def awake(contacts):
            (in_a, free_a), (in_b, free_b) = moves(contacts.a), moves(contacts.b)
            return in_a & in_b & (free_a | free_b)

        touching = _wake(live.touching, homes.of(live.touching.a), self.touching, columns, awake)
        resting = _wake(live.resting, homes.of(live.resting.ident), self.resting, columns, lambda contacts: moves(contacts.ident)[1])
        return Live(grains, touching, resting)

    def copy(self, key: int) -> Live:
        """What an untouched column holds."""
        bed, (n_x, n_y) = self.bed, self.bed.counts
        i, j = places_of(key)
        (u, a), (v, b) = divmod(int(i), n_x), divmod(int(j), n_y)
        members, pairs = self._particles[a * n_y + b], self._pairs[a * n_y + b]
        bodies = np.zeros((len(members), PARTICLE))
        bodies[:, X : Z + 1] = bed.positions[members] + [u * bed.periods[0], v * bed.periods[1], self.ground_z]
        bodies[:, R], bodies[:, M] = bed.radii[members], mass_of(bed.radii[members], bed.key.material.density)
        orientation = bed.orientations[members] if len(bed.orientations) else np.zeros((len(members), 0))
        first, second = bed.contacts.pairs[pairs].T
        image = bed.contacts.images[pairs].astype(np.int64)
        touching = Touching(_ident(u, v, first), _ident(u + image[:, 0], v + image[:, 1], second), self._history[pairs])
        resting = members[self._kept[members, NORMAL + 2] > 0.0]
        return Live(Grains(bodies, _ident(u, v, members), orientation), touching, Resting(_ident(u, v, resting), self._kept[resting]))


def _wake(live, homes: np.ndarray, known: dict, columns: np.ndarray, awake):
    """The contacts that are live now, of those that were and of those known in these columns; the others are put away by their column."""
    parts = [(key, known.pop(key)) for key in columns.tolist() if key in known]
    homes = np.concatenate([homes, *(np.full(len(part[0]), key) for key, part in parts)])
    contacts = _joined([live, *(part for _, part in parts)])
    which = awake(contacts)
    asleep = _some(contacts, ~which)
    for key, members in _by_key(homes[~which]):
        _add(known, key, _some(asleep, members))
    return _some(contacts, which)


class _Homes:
    """Columns of particles by their numbers."""

    def __init__(self, ident: np.ndarray, keys: np.ndarray):
        order = np.argsort(ident)
        self._ident, self._keys = ident[order], keys[order]

    def of(self, ident: np.ndarray) -> np.ndarray:
        return self._keys[np.searchsorted(self._ident, ident)] if len(ident) else np.zeros(0, np.int64)


def around(keys: np.ndarray) -> np.ndarray:
    """Numbers of these columns and of the eight around each."""
    i, j = places_of(keys)
    return np.unique([keys_of(i + di, j + dj) for di in (-1, 0, 1) for dj in (-1, 0, 1)])


def _ident(u, v, k) -> np.ndarray:
    """Number of particle k of the tile's copy (u, v)."""
    copy = ((np.asarray(u, np.int64) + _COPY_HALF) << _COPY_BITS) + np.asarray(v, np.int64) + _COPY_HALF
    return (copy << _TEMPLATE_BITS) + np.asarray(k, np.int64)


def _groups(home: np.ndarray, values: np.ndarray, n: int) -> list[np.ndarray]:
    order = np.argsort(home, kind="stable")
    return np.split(values[order], np.searchsorted(home[order], np.arange(1, n)))


def _by_key(keys: np.ndarray):
    """Each key with the places where it stands."""
    order = np.argsort(keys, kind="stable")
    different, starts = np.unique(keys[order], return_index=True)
    return zip(different.tolist(), np.split(order, starts[1:]))


def _some(arrays, which):
    """Some rows of a tuple of arrays."""
    return type(arrays)(*(array[which] for array in arrays))


def _joined(parts):
    """Tuples of arrays, one after the other."""
    return type(parts[0])(*map(np.concatenate, zip(*parts)))


def _add(columns: dict, key: int, new) -> None:
    """Add rows to those of a column; what a save holds is not changed."""
    columns[key] = _joined([columns[key], new]) if key in columns else new


_KINDS = {"stored": Grains, "touching": Touching, "resting": Resting}


def ground_to_arrays(saved: SavedGround) -> dict[str, np.ndarray]:
    """What ``Ground.save`` returned, as arrays by name."""
    found = {"touched": np.array(sorted(saved.touched), np.int64), "constants": np.array([saved.column, saved.diameter, saved.floor])}
    for name, kind in _KINDS.items():
        columns = getattr(saved, name)
        found[f"{name}_keys"] = np.array(list(columns), np.int64)
        found[f"{name}_ends"] = np.cumsum([len(values[0]) for values in columns.values()], dtype=np.int64)
        for field, arrays in zip(kind._fields, zip(*columns.values()) if columns else [()] * len(kind._fields)):
            found[f"{name}_{field}"] = np.concatenate(arrays) if arrays else np.zeros(0)
    return found


def ground_from_arrays(arrays: dict[str, np.ndarray]) -> SavedGround:
    """The inverse of ``ground_to_arrays``, which takes what it reads out of ``arrays``."""
    found: dict[str, object] = {"touched": frozenset(arrays.pop("touched").tolist())}
    for name, kind in _KINDS.items():
        keys, ends = arrays.pop(f"{name}_keys").tolist(), arrays.pop(f"{name}_ends")
        parts = [np.split(arrays.pop(f"{name}_{field}"), ends)[:-1] for field in kind._fields]
        found[name] = {key: kind(*values) for key, values in zip(keys, zip(*parts))}
    column, diameter, floor = arrays.pop("constants").tolist()
    return SavedGround(**found, column=column, diameter=diameter, floor=floor)
