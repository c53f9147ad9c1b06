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
from .particles import FREE, HISTORY, PARTICLE, V_X, V_Y, V_Z, W_X, W_Y, W_Z, M, R, X, Y, Z, mass_of
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


class Live(NamedTuple):
    """Particles that are in the simulation, and their contacts, which know them by their numbers.

    Attributes:
        bodies: Records, [n, PARTICLE].
        ident: Numbers, int64 [n].
        a, b: Numbers of the particles of each contact, int64 [m].
        history: Of each contact, as of a against b, [m, HISTORY].
        resting: Numbers of particles on the floor, int64 [k].
        kept: History of their contact with it, [k, KEPT].
    """

    bodies: np.ndarray
    ident: np.ndarray
    a: np.ndarray
    b: np.ndarray
    history: np.ndarray
    resting: np.ndarray
    kept: np.ndarray


class _Contacts(NamedTuple):
    """Contacts that are known but not live, by the column of their first particle."""

    a: np.ndarray
    b: np.ndarray
    history: np.ndarray


class SavedGround(NamedTuple):
    """Content of a :class:`Ground`."""

    stored: dict[int, tuple[np.ndarray, np.ndarray]]
    contacts: dict[int, _Contacts]
    resting: dict[int, tuple[np.ndarray, np.ndarray]]
    touched: frozenset[int]


class Ground:
    """Tile and columns.

    Args:
        bed: The tile.
        ground_z: Height of its surface in the world [m].
    """

    def __init__(self, bed: Bed, ground_z: float):
        self.bed, self.ground_z, self.column = bed, ground_z, bed.column
        self.stored: dict[int, tuple[np.ndarray, np.ndarray]] = {}  # records and numbers of particles
        self.contacts: dict[int, _Contacts] = {}
        self.resting: dict[int, tuple[np.ndarray, np.ndarray]] = {}
        self.touched: frozenset[int] = frozenset()
        contacts, n = bed.contacts, bed.counts[0] * bed.counts[1]
        self._history = np.hstack([contacts.shear, contacts.roll])
        self._kept = np.zeros((len(bed.radii), KEPT))
        self._kept[contacts.floor, NORMAL + 2] = 1.0
        self._kept[contacts.floor, SLID : SLID + 3], self._kept[contacts.floor, ROLLED : ROLLED + 3] = (
            contacts.floor_shear,
            contacts.floor_roll,
        )
        place = np.floor(bed.positions[:, :2] / bed.column).astype(np.int64)
        home = place[:, 0] * bed.counts[1] + place[:, 1]
        self._particles = _groups(home, np.arange(len(home)), n)
        self._pairs = _groups(home[contacts.pairs[:, 0]], np.arange(len(contacts.pairs)), n)

    def save(self) -> SavedGround:
        """The content as it is now; nothing in it changes later."""
        return SavedGround(self.stored.copy(), self.contacts.copy(), self.resting.copy(), self.touched)

    def restore(self, saved: SavedGround) -> None:
        """Go back to what was saved."""
        self.stored, self.contacts, self.resting = saved.stored.copy(), saved.contacts.copy(), saved.resting.copy()
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
                found.append(self.stored[key][0])
            if key not in self.touched:
                found.append(self.copy(key)[0])
        return np.concatenate(found)

    def exchange(self, live: Live, active: np.ndarray) -> Live:
        """Make these columns active, and those around them live and held; what else is live is stored.

        Args:
            live: What is live now; particles move in columns that are to be active, or rest.
            active: Numbers of columns, int64.
        """
        columns = around(active)
        keys = self.columns_of(live.bodies)
        stays = np.isin(keys, columns)
        self._store(live, keys, ~stays)
        loaded = [self._load(key) for key in columns.tolist()]
        bodies = np.concatenate([live.bodies[stays], *(bodies for bodies, _ in loaded)])
        ident = np.concatenate([live.ident[stays], *(ident for _, ident in loaded)])
        free = np.isin(self.columns_of(bodies), active)
        bodies[:, FREE] = free
        for column in (V_X, V_Y, V_Z, W_X, W_Y, W_Z):
            bodies[~free, column] = 0.0
        order = np.argsort(ident)
        is_free = dict(ident=ident[order], free=free[order])
        a, b, history = self._wake_contacts(live, keys, columns, is_free)
        resting, kept = self._wake_resting(live, keys, columns, is_free)
        return Live(bodies, ident, a, b, history, resting, kept)

    def _store(self, live: Live, keys: np.ndarray, which: np.ndarray) -> None:
        for key, members in _by_key(keys[which]):
            bodies, ident = live.bodies[which][members], live.ident[which][members]
            if key in self.stored:
                more, numbers = self.stored[key]
                bodies, ident = np.concatenate([more, bodies]), np.concatenate([numbers, ident])
            self.stored[key] = bodies, ident

    def _load(self, key: int) -> tuple[np.ndarray, np.ndarray]:
        """Particles that are to come in with a column: none if it is live already."""
        if key in self.touched:
            return self.stored.pop(key, (np.zeros((0, PARTICLE)), np.zeros(0, np.int64)))
        self.touched |= {key}
        bodies, ident, contacts, resting = self.copy(key)
        self.contacts[key] = _joined(self.contacts.get(key), contacts)
        self.resting[key] = resting
        if key in self.stored:  # what came over from other columns before
            more, numbers = self.stored.pop(key)
            bodies, ident = np.concatenate([bodies, more]), np.concatenate([ident, numbers])
        return bodies, ident

    def copy(self, key: int):
        """Particles, numbers, contacts and contacts with the floor of an untouched column."""
        bed, (n_x, n_y) = self.bed, self.bed.counts
        i, j = places_of(key)
        (u, a), (v, b) = divmod(int(i), n_x), divmod(int(j), n_y)
        members, pairs = self._particles[a * n_y + b], self._pairs[a * n_y + b]
        bodies = np.zeros((len(members), PARTICLE))
        bodies[:, X : Z + 1] = bed.positions[members] + [u * bed.periods[0], v * bed.periods[1], self.ground_z]
        bodies[:, R], bodies[:, M] = bed.radii[members], mass_of(bed.radii[members], bed.key.material.density)
        first, second = bed.contacts.pairs[pairs].T
        image = bed.contacts.images[pairs].astype(np.int64)
        contacts = _Contacts(_ident(u, v, first), _ident(u + image[:, 0], v + image[:, 1], second), self._history[pairs])
        resting = members[self._kept[members, NORMAL + 2] > 0.0]
        return bodies, _ident(u, v, members), contacts, (_ident(u, v, resting), self._kept[resting])

    def _wake_contacts(self, live: Live, keys: np.ndarray, columns: np.ndarray, is_free) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The contacts that are live now; the others are put away by the column of their first particle."""
        known = [(key, self.contacts.pop(key)) for key in columns.tolist() if key in self.contacts]
        order = np.argsort(live.ident)
        homes = keys[order][np.searchsorted(live.ident, live.a, sorter=order)] if len(live.a) else np.zeros(0, np.int64)
        home = np.concatenate([homes, *(np.full(len(c.a), key) for key, c in known)])
        a, b = (np.concatenate([getattr(live, side), *(getattr(c, side) for _, c in known)]) for side in "ab")
        history = np.concatenate([live.history, *(c.history for _, c in known)])
        (in_a, free_a), (in_b, free_b) = _found(a, is_free), _found(b, is_free)
        awake = in_a & in_b & (free_a | free_b)
        for key, members in _by_key(home[~awake]):
            more = _Contacts(a[~awake][members], b[~awake][members], history[~awake][members])
            self.contacts[key] = _joined(self.contacts.get(key), more)
        return a[awake], b[awake], history[awake]

    def _wake_resting(self, live: Live, keys: np.ndarray, columns: np.ndarray, is_free) -> tuple[np.ndarray, np.ndarray]:
        known = [(key, *self.resting.pop(key)) for key in columns.tolist() if key in self.resting]
        order = np.argsort(live.ident)
        homes = keys[order][np.searchsorted(live.ident, live.resting, sorter=order)] if len(live.resting) else np.zeros(0, np.int64)
        home = np.concatenate([homes, *(np.full(len(ident), key) for key, ident, _ in known)])
        ident = np.concatenate([live.resting, *(ident for _, ident, _ in known)])
        kept = np.concatenate([live.kept, *(kept for _, _, kept in known)])
        _, awake = _found(ident, is_free)
        for key, members in _by_key(home[~awake]):
            old, old_kept = self.resting.get(key, (ident[:0], kept[:0]))
            self.resting[key] = np.concatenate([old, ident[~awake][members]]), np.concatenate([old_kept, kept[~awake][members]])
        return ident[awake], kept[awake]


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


def _joined(old: _Contacts | None, new: _Contacts) -> _Contacts:
    if old is None:
        return new
    return _Contacts(*(np.concatenate([getattr(old, f), getattr(new, f)]) for f in ("a", "b", "history")))


def _found(ident: np.ndarray, is_free) -> tuple[np.ndarray, np.ndarray]:
    """Whether particles are live, and whether they move."""
    at = np.minimum(np.searchsorted(is_free["ident"], ident), max(len(is_free["ident"]) - 1, 0))
    found = is_free["ident"][at] == ident if len(is_free["ident"]) else np.zeros(len(ident), bool)
    return found, found & (is_free["free"][at] if len(at) else found)


def ground_to_arrays(saved: SavedGround) -> dict[str, np.ndarray]:
    """What ``Ground.save`` returned, as arrays by name."""
    found = {"touched": np.array(sorted(saved.touched), np.int64)}
    for name in ("stored", "contacts", "resting"):
        columns = getattr(saved, name)
        found[f"{name}_keys"] = np.array(list(columns), np.int64)
        found[f"{name}_ends"] = np.cumsum([len(values[0]) for values in columns.values()], dtype=np.int64)
        for k, empty in enumerate(_EMPTY[name]):
            found[f"{name}_{k}"] = np.concatenate([empty, *(values[k] for values in columns.values())])
    return found


def ground_from_arrays(arrays: dict[str, np.ndarray]) -> SavedGround:
    """The inverse of ``ground_to_arrays``, which takes what it reads out of ``arrays``."""
    found = {"touched": frozenset(arrays.pop("touched").tolist())}
    for name, empty in _EMPTY.items():
        keys, ends = arrays.pop(f"{name}_keys"), arrays.pop(f"{name}_ends")
        parts = [np.split(arrays.pop(f"{name}_{k}"), ends)[:-1] for k in range(len(empty))]
        make = _Contacts._make if name == "contacts" else tuple
        found[name] = {int(key): make(values) for key, values in zip(keys, zip(*parts))}
    return SavedGround(**found)


_NUMBERS = np.zeros(0, np.int64)
_EMPTY = {
    "stored": (np.zeros((0, PARTICLE)), _NUMBERS),
    "contacts": (_NUMBERS, _NUMBERS, np.zeros((0, HISTORY))),
    "resting": (_NUMBERS, np.zeros((0, KEPT))),
}
