"""The soil of particles in columns: what is stored comes back as it was, whatever way the boxes went."""

import beds
import numpy as np
import pytest

from cdl_fmu.dem.columns import Grains, Ground, Live, Resting, Touching, around, ground_from_arrays, ground_to_arrays, keys_of, places_of
from cdl_fmu.dem.particles import FREE, HISTORY, PARTICLE, V_X, V_Z, W_X, M, R, X, Z
from cdl_fmu.dem.tools import KEPT


def nothing() -> Live:
    numbers = np.zeros(0, np.int64)
    grains = Grains(np.zeros((0, PARTICLE)), numbers, np.zeros((0, 0)))
    return Live(grains, Touching(numbers, numbers, np.zeros((0, HISTORY))), Resting(numbers, np.zeros((0, KEPT))))


def box(i, j, n=3, m=2) -> np.ndarray:
    """Numbers of n by m columns from (i, j) on."""
    return keys_of(*np.meshgrid(range(i, i + n), range(j, j + m), indexing="ij")).ravel()


def in_order(live: Live) -> list[np.ndarray]:
    """All that is live, in an order that depends on the numbers of particles alone."""
    grains, touching, resting = live
    g, c, r = np.argsort(grains.ident), np.lexsort((touching.b, touching.a)), np.argsort(resting.ident)
    return [*(a[g] for a in grains), *(a[c] for a in touching), *(a[r] for a in resting)]


def same(a: Live, b: Live) -> bool:
    return all(np.array_equal(x, y) for x, y in zip(in_order(a), in_order(b)))


def everything(ground: Ground, live: Live) -> dict[int, bytes]:
    """Number of each particle that is live or stored -> its record but what says whether it moves."""
    found = {}
    for grains in (live.grains, *ground.stored.values()):
        for ident, body in zip(grains.ident.tolist(), grains.bodies):
            assert ident not in found  # nobody is there twice
            found[ident] = np.delete(body, FREE).tobytes()
    return found


@pytest.fixture
def ground() -> Ground:
    return Ground(beds.bed(), 0.1)


def test_numbers_of_columns_go_both_ways():
    i, j = np.meshgrid([-1000, -1, 0, 7], [-99, 0, 12345], indexing="ij")
    assert all(np.array_equal(a, b) for a, b in zip(places_of(keys_of(i, j)), (i, j)))
    assert len(np.unique(keys_of(i, j))) == i.size and len(around(box(0, 0))) == 5 * 4


def test_columns_are_copies_of_the_tile_that_fit_each_other(ground):
    live = ground.exchange(nothing(), box(-2, -1, 6, 5))
    bed, bodies = ground.bed, live.grains.bodies
    # A tile has 3 by 3 columns, and here are 8 by 7: each column nine times over is a bed.
    per_column = len(bed.radii) / 9
    assert len(bodies) == pytest.approx(56 * per_column, rel=0.05)
    assert (bodies[:, Z] - bodies[:, R]).min() > 0.1 + bed.floor - 2e-4
    # All that moves has the contacts that the bed has, across columns and copies, and they do touch.
    where = {ident: k for k, ident in enumerate(live.grains.ident.tolist())}
    a, b = (np.array([where[ident] for ident in side.tolist()]) for side in live.touching[:2])
    gap = np.linalg.norm(bodies[a, X : Z + 1] - bodies[b, X : Z + 1], axis=1) - bodies[a, R] - bodies[b, R]
    assert gap.max() < 0.0 and gap.min() > -3e-4
    assert np.all(bodies[a, FREE] + bodies[b, FREE] > 0.0)
    free = np.flatnonzero(bodies[:, FREE])
    number = np.bincount(np.concatenate([a, b]), minlength=len(bodies))[free].mean()
    assert number == pytest.approx(2 * len(bed.contacts.pairs) / len(bed.radii), rel=0.05)


def test_there_and_back_nothing_has_changed(ground):
    way = [(0, 0), (1, 0), (3, 1), (9, 1), (4, -2), (1, 0), (-7, 3), (0, 0)]
    first = live = ground.exchange(nothing(), box(*way[0]))
    for place in way[1:]:
        live = ground.exchange(live, box(*place))
    assert same(live, first)
    kept = everything(ground, live)
    mass = sum(ground.copy(key).grains.bodies[:, M].sum() for key in ground.touched)
    assert sum(np.frombuffer(body)[M] for body in kept.values()) == pytest.approx(mass, rel=1e-12)


def test_history_and_motion_of_contacts_survive(ground):
    live = ground.exchange(nothing(), box(0, 0))
    rng = np.random.default_rng(2)
    # What a wheel would leave: contacts of other history, also new ones, none of some, and a turned floor contact.
    history = rng.normal(size=live.touching.history.shape)
    kept = rng.normal(size=live.resting.kept.shape)
    gone = rng.random(len(history)) < 0.1
    live = Live(live.grains, Touching(*(a[~gone] for a in (*live.touching[:2], history))), Resting(live.resting.ident, kept))
    away = ground.exchange(live, box(8, 8))
    assert not np.isin(away.grains.ident, live.grains.ident).any()
    assert same(ground.exchange(away, box(0, 0)), live)
    # By halves: a box that overlaps the old one.
    half = ground.exchange(ground.exchange(live, box(2, 0)), box(0, 0))
    assert same(half, live)


def test_a_particle_that_rolled_into_another_column_stays_there(ground):
    live = ground.exchange(nothing(), box(0, 0))
    moved = int(np.flatnonzero(live.grains.bodies[:, FREE])[0])
    ident, into = live.grains.ident[moved], int(keys_of(3, 1))  # a column beside the box, which is held
    live.grains.bodies[moved, X : Z + 1] = 3.5 * ground.column, 1.5 * ground.column, 0.15
    live.grains.bodies[moved, V_X : V_Z + 1] = 1e-3
    before = everything(ground, live)
    away = ground.exchange(live, box(-8, 0))
    assert ident in ground.stored[into].ident
    # Its new column is loaded without its old one.
    beside = ground.exchange(away, box(5, 1, 2, 2))
    place = np.flatnonzero(beside.grains.ident == ident)
    back = ground.exchange(beside, box(0, 0))
    assert len(place) == (int(into) in around(box(5, 1, 2, 2)).tolist())
    assert everything(ground, back).keys() >= before.keys()
    assert np.count_nonzero(back.grains.ident == ident) == 1


def test_a_particle_may_roll_into_a_column_that_nobody_touched(ground):
    live = ground.exchange(nothing(), box(0, 0))
    far = int(keys_of(6, 0))
    live.grains.bodies[0, X] = 6.5 * ground.column
    live.grains.bodies[0, X + 1] = 0.5 * ground.column
    away = ground.exchange(live, box(-8, 0))
    assert far not in ground.touched and ground.stored[far].ident.tolist() == [live.grains.ident[0]]
    there = ground.exchange(away, box(5, 0))
    assert np.count_nonzero(there.grains.ident == live.grains.ident[0]) == 1
    own = ground.copy(far).grains.ident
    assert np.isin(own, there.grains.ident).all()


def test_what_is_held_does_not_move_and_what_is_freed_may(ground):
    live = ground.exchange(nothing(), box(0, 0))
    assert np.array_equal(live.grains.bodies[:, FREE] > 0, np.isin(ground.columns_of(live.grains.bodies), box(0, 0)))
    live.grains.bodies[:, [V_X, V_Z, W_X]] = 0.1
    after = ground.exchange(live, box(1, 0)).grains.bodies
    moves = after[:, FREE] > 0
    assert not after[~moves][:, [V_X, V_Z, W_X]].any() and (after[moves][:, V_X] == 0.1).any()


def test_boxes_that_overlap_or_lie_apart_hold_each_column_once(ground):
    both = np.union1d(box(0, 0), box(2, 1))
    live = ground.exchange(nothing(), both)
    assert len(np.unique(live.grains.ident)) == len(live.grains.ident)
    apart = ground.exchange(live, np.union1d(box(0, 0), box(20, 0)))
    everything(ground, apart)
    none = ground.exchange(apart, np.zeros(0, np.int64))
    assert len(none.grains.ident) == len(none.touching.a) == 0
    assert same(ground.exchange(none, both), live)


def test_a_saved_ground_stays_as_it_was_and_goes_through_bytes(ground):
    live = ground.exchange(nothing(), box(0, 0))
    live = ground.exchange(live, box(6, 0))
    saved, before = ground.save(), everything(ground, live)
    on = ground.exchange(live, box(0, 0))
    on.grains.bodies[:, Z] += 1.0
    ground.exchange(on, box(12, 0))
    # Another ground of the same bed, from bytes.
    other = Ground(beds.bed(), 0.1)
    arrays = ground_to_arrays(saved)
    other.restore(ground_from_arrays(arrays))
    assert not arrays
    ground.restore(saved)
    for one in (ground, other):
        assert everything(one, live) == before and one.touched == saved.touched
    assert same(ground.exchange(live, box(0, 0)), other.exchange(live, box(0, 0)))
