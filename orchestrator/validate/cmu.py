"""The wheel of Pavlov and Johnson's tests (Carnegie Mellon University) on their sand: what was measured, and points of the testbed."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import numpy as np

from ..measured import Test, read_measured
from .bench import Point

_DATA = Path(__file__).with_name("data")
PLATES = _DATA / "cmu_plates.csv"
SMOOTH_WHEEL = _DATA / "cmu_single_wheel_smooth.csv"

#: What the rows of the smooth wheel are measured against.
NAME = "CMU smooth wheel"

#: Their soil as a shipped set: plates identified, the rest as its file says.
SOIL = "cmu_sand"

_WHEEL = {"wheel.r_w": 0.058, "wheel.b_w": 0.05, "wheel.n_g": 0, "soil.set": SOIL, "carriage_speed": 0.01}
_CELL = 0.005  # m
#: A wheel in strong skid digs on and on: it gets twice the travel [m].
_LONG_SLIP, _LONG_TRAVEL = -0.7, 1.0
#: Those levels that are run where there is little time.
_QUICK = (-1.0, -0.5, 0.0, 0.5, 0.9)


@dataclass(frozen=True)
class Level:
    """All trials at one slip.

    Attributes:
        slip: To two digits.
        trials: The trials.
        load: Mean measured F_z [N].
        pull: Mean measured F_x / load.
        sinkage: Mean [m].
    """

    slip: float
    trials: tuple[Test, ...]
    load: float
    pull: float
    sinkage: float


def levels(quick: bool = False) -> list[Level]:
    """The slips at which the smooth wheel was measured straight ahead, in rising order."""
    tests = sorted(read_measured(SMOOTH_WHEEL).tests, key=lambda test: test.slip)
    found = []
    for slip, group in groupby(tests, key=lambda test: round(test.slip, 2) + 0.0):  # no -0.0
        trials = tuple(group)
        pull, load, sinkage = (
            float(np.mean([trial.values[key] for trial in trials])) for key in ("drawbar_pull_N", "normal_load_N", "sinkage_m")
        )
        found.append(Level(slip, trials, load, pull / load, sinkage))
    return [level for level in found if level.slip in _QUICK] if quick else found


def level_at(slip: float) -> Level:
    """The level of this slip."""
    return next(level for level in levels() if level.slip == slip)


def point(tier: str, level: Level, settings: Point | None = None) -> Point:
    """The smooth wheel at a level's slip and mean load, with further settings in place of those."""
    made = {**_WHEEL, "tier": tier, "slip": level.slip, "load_N": level.load}
    if tier == "SCM":
        made["scm.cell"] = _CELL
    if level.slip <= _LONG_SLIP:
        made["travel"] = _LONG_TRAVEL
    return made | (settings or {})
