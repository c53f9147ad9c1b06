"""Sinkage and drawbar pull of a smooth wheel over slip, against tests."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..panels import colours, frame
from . import cmu
from .bench import Bench
from .cmu import Level
from .rows import Findings, Row, absolute, limited, relative, rms

#: First and last slip that roots of mean squares are taken over.
_FIRST, _LAST = -0.5, 0.9
#: Settings that switch on BCM's law of slip sinkage.
_SLIP_SINKAGE = {"bcm.strength": "critical_state"}
_WITH_LAW = "BCM, slip sinkage"

# Bars: sinkage relative to the measured one, drawbar pull in loads W.
_SCM_SINKAGE_RMS, _SCM_SINKAGE_WORST = 0.10, 0.15
_SCM_PULL_RMS = 0.07
_DRIVING_PULL_RMS, _DRIVING_PULL_WORST = 0.04, 0.06  # slip >= 0
_LEAST_RISE = 0.05  # of the pull from slip 0 to 0.9
_RATIO_SLIPS, _RATIO = (0.5, 0.75, 0.9), (0.4, 2.5)  # of computed to measured pull
_SKID_SINKAGE, _SKID_PULL = 0.25, 0.4  # below slip -0.5, where the sinkage must be stationary too
_BCM_PULL_RMS, _BCM_PULL_WORST = 0.08, 0.15
_BCM_SINKAGE = 0.30  # with the law of slip sinkage


@dataclass(frozen=True)
class Point:
    """What a model makes of a level: sinkage [m], drawbar pull [W], and whether they are stationary."""

    level: Level
    sinkage: float
    pull: float
    stationary: bool

    @property
    def sinkage_error(self) -> float:
        """Relative to what was measured."""
        return self.sinkage / self.level.sinkage - 1.0

    @property
    def pull_error(self) -> float:
        """In loads W."""
        return self.pull - self.level.pull


def check(bench: Bench) -> Findings:
    """Smooth wheel over slip"""
    levels = cmu.levels()  # BCM takes a second each
    models = {"SCM": ("SCM", {}, cmu.levels(bench.quick)), "BCM": ("BCM", {}, levels), _WITH_LAW: ("BCM", _SLIP_SINKAGE, levels)}
    facts = iter(bench.measure([cmu.point(tier, level, settings) for tier, settings, own in models.values() for level in own]))
    curves = {model: [_point(level, next(facts)) for level in own] for model, (_, _, own) in models.items()}
    rows = [*_scm(curves["SCM"]), *_bcm(curves["BCM"]), *_slip_sinkage(curves[_WITH_LAW])]
    note = (
        "Wheel of 58 mm radius and 50 mm width at 10 mm/s on dry sand whose law of sinkage is from plate tests, under the mean load W of "
        "the trials at each slip; errors are from the mean of the trials. The figure has each trial with its standard deviation; hollow: "
        "not stationary, mean over the last quarter. Constants of SCM were chosen on these tests (marked in the sensitivities): its errors "
        "here are fit errors; BCM's are not."
    )
    return Findings(rows, _figure(curves, levels), note=note)


def _point(level: Level, facts: Mapping) -> Point:
    return Point(level, facts["sinkage_m"], facts["drawbar_pull_N"] / level.load, facts["stationary"])


def _scm(points: Sequence[Point]) -> list[Row]:
    inside = [p for p in points if _FIRST <= p.level.slip <= _LAST]
    driving = [p for p in inside if p.level.slip >= 0.0]
    rows = []
    for p in points:
        skids, drives = p.level.slip < _FIRST, p.level.slip >= 0.0
        rows.append(_sinkage("SCM", p, _SKID_SINKAGE if skids else _SCM_SINKAGE_WORST, steady=skids))
        rows.append(_pull("SCM", p, _SKID_PULL if skids else _DRIVING_PULL_WORST if drives else None))
    over = f"s = {_FIRST:g} to {_LAST:g}"
    rows.append(_limited("SCM", f"sinkage, rms over {over}", rms([p.sinkage_error for p in inside]), "share", (None, _SCM_SINKAGE_RMS)))
    rows.append(_limited("SCM", f"drawbar pull, rms over {over}", rms([p.pull_error for p in inside]), "W", (None, _SCM_PULL_RMS)))
    pulling = rms([p.pull_error for p in driving])
    rows.append(_limited("SCM", f"drawbar pull, rms over s = 0 to {_LAST:g}", pulling, "W", (None, _DRIVING_PULL_RMS)))
    first, last = (next(p for p in points if p.level.slip == slip) for slip in (0.0, _LAST))
    rise = last.pull - first.pull
    rows.append(_limited("SCM", f"drawbar pull, rise from s = 0 to {_LAST:g}", rise, "W", (_LEAST_RISE, None)))
    for p in driving:
        if p.level.slip in _RATIO_SLIPS:
            quantity = f"drawbar pull, computed / measured, s = {p.level.slip:g}"
            rows.append(_limited("SCM", quantity, p.pull / p.level.pull, "1", _RATIO))
    return rows


def _bcm(points: Sequence[Point]) -> list[Row]:
    inside = [p for p in points if _FIRST <= p.level.slip <= _LAST]
    rows = []
    for p in points:
        rows.append(_sinkage("BCM", p))
        rows.append(_pull("BCM", p, _BCM_PULL_WORST if p in inside else None))
    over = f"s = {_FIRST:g} to {_LAST:g}"
    rows.append(_limited("BCM", f"drawbar pull, rms over {over}", rms([p.pull_error for p in inside]), "W", (None, _BCM_PULL_RMS)))
    return rows


def _slip_sinkage(points: Sequence[Point]) -> list[Row]:
    return [_sinkage(_WITH_LAW, p, _BCM_SINKAGE) for p in points if _FIRST <= p.level.slip <= _LAST]


def _sinkage(model: str, p: Point, bar: float | None = None, steady: bool = False) -> Row:
    quantity = f"sinkage, s = {p.level.slip:g}"
    return relative(model, cmu.NAME, quantity, p.level.sinkage, p.sinkage, "m", bar, stationary=p.stationary, steady=steady)


def _pull(model: str, p: Point, bar: float | None = None) -> Row:
    quantity = f"drawbar pull, s = {p.level.slip:g}"
    return absolute(model, cmu.NAME, quantity, p.level.pull, p.pull, "W", bar, stationary=p.stationary)


def _limited(model: str, quantity: str, error: float, unit: str, bar: tuple[float | None, float | None]) -> Row:
    return limited(model, cmu.NAME, quantity, error, unit, bar)


def _figure(curves: dict[str, list[Point]], levels: Sequence[Level]) -> Figure:
    figure = Figure(figsize=(9.0, 3.8), dpi=110, layout="constrained")
    axes = figure.subplots(1, 2)
    trials = [trial for level in levels for trial in level.trials]
    slip = [trial.slip for trial in trials]
    marks = {"fmt": "o", "ms": 4, "mfc": "none", "color": "black", "capsize": 2, "lw": 1.0, "zorder": 3}
    loads = [trial.values["normal_load_N"] for trial in trials]
    for ax, key, units in ((axes[0], "sinkage_m", [1e-3] * len(trials)), (axes[1], "drawbar_pull_N", loads)):
        mean, bars = ([part[key] / unit for part, unit in zip(parts, units)] for parts in zip(*((t.values, t.deviations) for t in trials)))
        ax.errorbar(slip, mean, bars, **marks)
        frame(ax)
        ax.set_xlabel("slip")
    handles = [Line2D([], [], ls="", marker="o", mfc="none", color="black", label="measured")]
    for colour, (model, points) in zip(colours(), curves.items()):
        s, steady = np.array([p.level.slip for p in points]), np.array([p.stationary for p in points])
        for ax, values in zip(axes, ([1e3 * p.sinkage for p in points], [p.pull for p in points])):
            ax.plot(s, values, "-o", color=colour, lw=1.2, ms=4, mfc="white")
            ax.plot(s[steady], np.array(values)[steady], "o", color=colour, ms=4)
        handles.append(Line2D([], [], color=colour, marker="o", ms=4, label=model))
    axes[0].set_ylabel("sinkage [mm]")
    axes[0].set_ylim(bottom=0.0)
    axes[1].set_ylabel("drawbar pull / load")
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles), frameon=False, fontsize=9)
    return figure
