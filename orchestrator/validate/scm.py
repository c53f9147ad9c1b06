"""SCM against itself and against what must hold of any soil: grid, landslides, volume."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cdl_fmu.scm import SCM
from cdl_fmu.slave.model import Instance

from . import cmu, sand
from .bench import ROVER_WHEEL_LOAD, Bench, Point
from .rows import Findings, Row, absolute, limited, relative

# Bars: sinkage relative, forces in loads W.
_ORIENTATION, _CELLS = 0.03, 0.05
_REPOSE = math.radians(1.0)

_HEADING = math.radians(45.0)
#: Slips, and those that are run where there is little time.
_TURNED_SLIPS, _FINE_SLIPS, _TABLE_8_2_SLIPS = ((-0.5, 0.0, 0.5), (0.5,)), ((-0.5, 0.0, 0.5, 0.9), (0.0,)), ((0.0, 0.5), (0.0,))
_FINE, _MIDDLE, _COARSE = 0.0025, 0.005, 0.01  # cells [m]
#: The wheel of Table 8.2, under its load in the two-wheel rover and about as fast.
_TABLE_8_2: Point = {"tier": "SCM", "load_N": ROVER_WHEEL_LOAD, "carriage_speed": 0.1, "soil.set": "mss_d"}
_REPOSE_ANGLES = (29.0, 36.7)  # deg


@dataclass(frozen=True)
class _Pair:
    """Two runs whose grids alone differ: how, for which wheel, and how far they may be apart."""

    one: str
    other: str
    wheel: str
    bar: float
    points: tuple[Point, Point]

    def rows(self, one: Mapping, other: Mapping) -> list[Row]:
        """By what both measure."""
        load, more = self.points[0]["load_N"], {"stationary": one["stationary"] and other["stationary"]}
        rows = [relative("SCM", self.one, self._name("sinkage"), one["sinkage_m"], other["sinkage_m"], "m", self.bar, **more)]
        for force in ("drawbar pull", "lateral force"):
            values = (facts[f"{force.replace(' ', '_')}_N"] / load for facts in (one, other))
            rows.append(absolute("SCM", self.one, self._name(force), *values, "W", self.bar, **more))
        return rows

    def _name(self, quantity: str) -> str:
        return f"{quantity}, {self.other}, {self.wheel}"


def grid(bench: Bench) -> Findings:
    """Independence of SCM from its grid"""
    pairs = [_turned(slip) for slip in _TURNED_SLIPS[bench.quick]]
    pairs += [_finer(slip) for slip in _FINE_SLIPS[bench.quick]]
    pairs += [_table_8_2(slip) for slip in _TABLE_8_2_SLIPS[bench.quick]]
    facts = iter(bench.measure([point for pair in pairs for point in pair.points]))
    rows = [row for pair in pairs for row in pair.rows(next(facts), next(facts))]
    note = "Runs on the testbed whose grids alone differ; the wheels are the smooth one above and the one of Table 8.2."
    return Findings(rows, note=note)


def _turned(slip: float) -> _Pair:
    points = cmu.point("SCM", level := cmu.level_at(slip)), cmu.point("SCM", level, {"carriage.heading": _HEADING})
    return _Pair("travel along x", "travel along 45 deg", f"{cmu.NAME}, s = {slip:g}", _ORIENTATION, points)


def _finer(slip: float) -> _Pair:
    points = cmu.point("SCM", level := cmu.level_at(slip)), cmu.point("SCM", level, {"scm.cell": _FINE})
    return _Pair(_cells(points[0]), _cells(points[1]), f"{cmu.NAME}, s = {slip:g}", _CELLS, points)


def _table_8_2(slip: float) -> _Pair:
    one, other = ({**_TABLE_8_2, "slip": slip, "scm.cell": cell} for cell in (_COARSE, _MIDDLE))
    return _Pair(_cells(one), _cells(other), f"wheel of Table 8.2, s = {slip:g}", _CELLS, (one, other))


def _cells(point: Point) -> str:
    return f"cells of {1e3 * point['scm.cell']:g} mm"


def soil(bench: Bench) -> Findings:
    """Landslides and volume of SCM"""
    rows = [row for degrees in _REPOSE_ANGLES for row in _heap(degrees)]
    rows.append(limited("SCM", "conservation", "soil moved and compacted by a slipping wheel, sum", _rut(), "m3", (0.0, 0.0)))
    note = "A cone of 56 deg slides until it rests, and its slope is read in 32 directions: the one farthest off counts."
    return Findings(rows, note=note)


def _heap(degrees: float) -> list[Row]:
    instance = sand.heap(lambda x, y: np.maximum(0.0, 0.15 - 1.5 * np.hypot(x, y)), 0.3, repose=math.radians(degrees))
    before = sand.volume_error(instance)
    sand.wait_for_rest(instance)
    slopes = sand.slopes(instance, float(np.nanmax(sand.surface(instance).z)))
    repose = math.radians(degrees)
    worst = float(slopes[np.argmax(np.abs(slopes - repose))])
    cell = float(instance.p.cell)
    lost = (sand.volume_error(instance) - before) * cell**2
    return [
        absolute("SCM", "angle of repose", f"slope of a heap, repose = {degrees:g} deg", repose, worst, "rad", _REPOSE),
        limited("SCM", "conservation", f"volume of that heap, {degrees:g} deg, after less before", lost, "m3", (0.0, 0.0)),
    ]


def _rut(sinkage=0.03, speed=0.1, slip=0.5, seconds=1.0, h=1e-3) -> float:
    """Volume [m3] that a wheel of Table 8.2 at a given sinkage leaves unaccounted for."""
    instance = Instance(SCM(1), "scm")
    instance.initialise()
    wheel, r = instance.u.wheel[0], float(instance.p.r_w)
    wheel.v_0[0], wheel.w_0[1] = speed, speed / (1.0 - slip) / r
    for k in range(round(seconds / h)):
        angle = wheel.w_0[1] * k * h
        wheel["T"][:] = [[math.cos(angle), 0.0, -math.sin(angle)], [0.0, 1.0, 0.0], [math.sin(angle), 0.0, math.cos(angle)]]
        wheel.r_0[:] = speed * k * h, 0.0, r - min(sinkage, speed * k * h)
        instance.step(k * h, h)
    return sand.volume_error(instance) * float(instance.p.cell) ** 2
