"""The marks of benchmarks/table_8_1.py, and what it sees of particles."""

import sys
from pathlib import Path

import numpy as np
import pytest
from beds import R_W, D, dem, highest_particle, place

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

from dem_tier import across, moved, places
from marks import CHAPTER, EFFECTS, below, of_deformation, of_effects, reading, shows

SOFT = dict(sinkage=0.02, sinkage_of_twice_the_load=0.03, slip_sinkage=0.01, loss=0.1, pull_00=-0.1, pull_01=0.1, pull_03=0.3, pull_06=0.4)
MORE = dict(grousers=0.02, lateral=0.3, rut=0.02, berm=0.01, second_pull=0.05, stiffness=3e4)


@pytest.fixture(scope="module")
def pressed():
    """Surface across a wheel and places of particles, before and after it was pressed into them; and how deep it is."""
    instance = dem()
    wheel, top = instance.u.wheel[0], R_W + highest_particle()
    place(wheel, (0.0, 0.0, top))
    instance.initialise()
    instance.step(0.0, 1e-3)
    before = across(instance, 0.0), places(instance)
    for k in range(1, 41):
        place(wheel, (0.0, 0.0, top - 5e-4 * k), (0.0, 0.0, -0.5))
        instance.step(1e-3 * k, 1e-3)
    return before, (across(instance, 0.0), places(instance)), 0.02 - highest_particle()


def test_a_wheel_lowers_the_surface_below_it_and_leaves_it_where_it_is_far_away(pressed):
    (level, _), (after, _), depth = pressed
    rise = after - level
    assert -1.5 * depth < rise.min() < -1e-3
    assert abs(rise.argmin() - len(rise) / 2) <= 1.5
    assert rise[0] == rise[-1] == 0.0


def test_particles_below_a_wheel_move_the_less_the_deeper_they_lie(pressed):
    (_, was), (_, now), depth = pressed
    near, deep = (moved(was, now, 0.0, top) for top in (-D, -4.0 * D))
    assert depth > near > deep
    assert near > 1e-3
    assert moved(was, was, 0.0, -D) == 0.0


def test_of_particles_only_those_count_that_were_known_before(pressed):
    (_, (ident, was)), (_, now), _ = pressed
    some = np.random.default_rng(1).permutation(len(ident))[: len(ident) // 2]
    assert moved((ident[some], was[some]), now, 0.0, -D) == pytest.approx(moved((ident, was), now, 0.0, -D), rel=0.5)


def test_a_tier_that_meets_no_stone_has_no_mark_for_stones_and_a_full_one_for_soil():
    answers = SOFT | MORE | {"on_a_stone": -0.2, "rebounds": [("soil", 0.1)], "creep": 1e-4}
    assert of_effects(answers, "soil") == "++"
    assert of_effects(answers, "stone") == "n/a"
    assert of_effects(answers) == "+"


def test_effects_that_were_not_measured_are_not_shown_and_read_as_none():
    assert [reading(effect, SOFT) for effect in EFFECTS if effect.of == "stone"] == ["none"] * 5
    assert not any(shows(effect, SOFT) for effect in EFFECTS if effect.of == "stone")


@pytest.mark.parametrize(
    ("rut", "berm", "deeper", "mark"),
    [(0.0, 0.0, 0.0, "n/a"), (0.02, 0.0, 0.0, "-"), (0.02, 0.0, 0.01, "-"), (0.02, 0.01, 5e-4, "+"), (0.02, 0.01, 0.01, "++")],
)
def test_the_mark_of_deformation_is_full_only_where_soil_moves_below_rut_and_berm(rut, berm, deeper, mark):
    assert of_deformation({"rut": rut, "berm": berm, "below": deeper}) == mark


def test_a_surface_without_particles_below_has_no_full_mark():
    assert of_deformation({"rut": 0.02, "berm": 0.01}) == "+"


def test_marks_are_by_upper_bounds_that_belong_to_the_better_mark():
    assert [below(value, (0.5, 2.0, 10.0)) for value in (0.5, 2.0, 10.0, 10.1)] == ["++", "+", "-", "--"]


def test_the_chapter_marks_the_same_tiers_in_all_rows():
    assert all(list(row) == ["RBC", "VEM", "BCM", "SCM", "DEM"] for row in CHAPTER.values())
