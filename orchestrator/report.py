"""Pictures and numbers of a drive, from its result file alone.

A result names its wheels in the attribute ``wheels``, a JSON list of ``{"name": "front", "tier": "BCM", "instance": "bcm",
"index": 1, "mover": "rover", "rover_index": 1}``: this wheel's contact answers in ``bcm.diagnostics[1].*`` and its pose is
``rover.wheel[1].*``.
``ground_z`` is the height of the undeformed ground [m]. ``hard`` names rocks and what they answer with: see ``wheels.rocks_of``.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .measured import Measured
from .panels import colours, frame, legend, widen
from .results import ResultError

#: Sections of the chapter's drive (8.5.1) and the rear wheel's x [m] at which they begin.
SECTIONS = {"A": 0.0, "B": 0.35, "C": 0.9, "D": 1.2, "E": 1.6}

#: [m] of the last wheel's x: the peak of the start is over (8.5.1) and does not count for the normalisation (8.4.2).
_START = 0.1
_STYLES = (("-", "solid"), ("--", "dashed"))
_LINE = {"lw": 1.0}
_LETTER = {"ha": "center", "va": "bottom", "color": "0.35", "fontsize": 9}


@dataclass(frozen=True)
class Wheel:
    """A wheel of a result."""

    result: xr.Dataset
    name: str
    tier: str
    instance: str
    index: int
    rover_index: int
    mover: str = "rover"

    @property
    def port(self) -> str:
        """Name that the channels of its pose begin with."""
        return f"{self.mover}.wheel[{self.rover_index}]"

    def diagnostic(self, name: str) -> np.ndarray:
        """A contact diagnostic [n_times]; forces are in the heading frame (z global, x along the wheel's heading)."""
        return self.result.cdl[f"{self.instance}.diagnostics[{self.index}].{name}"].values

    def centre(self, axis: str) -> np.ndarray:
        """Coordinate ``x``, ``y`` or ``z`` of the wheel's centre in world [m], z above the undeformed ground, shape [n_times]."""
        r_0 = self.result.cdl[f"{self.port}.r_0[{'xyz'.index(axis) + 1}]"].values
        return r_0 - float(self.result.attrs.get("ground_z", 0.0)) if axis == "z" else r_0


def wheels_of(result: xr.Dataset) -> list[Wheel]:
    """The wheels that a result names.

    Raises:
        ResultError: it names none, or has no rows.
    """
    if not result.sizes["time"]:
        raise ResultError("the result has no rows: its run was stopped before the first of them were written")
    wheels = [Wheel(result, **wheel) for wheel in json.loads(result.attrs.get("wheels", "[]"))]
    if not wheels:
        raise ResultError("the result names no wheels (attribute 'wheels'); plot its channels with `result.cdl[name].plot()`")
    return wheels


def is_testbed(result: xr.Dataset) -> bool:
    """Whether a result is of a single-wheel testbed: it tells in the attribute ``carriage`` what the carriage does."""
    return bool(json.loads(result.attrs.get("carriage", "{}")))


def summary(result: xr.Dataset, last: float = 0.5) -> list[dict[str, str | float]]:
    """Means of every wheel over the ``last`` seconds of a run.

    Returns:
        For each wheel ``name``, ``tier``, ``sinkage_m`` below and ``z_m`` of the centre above the undeformed ground, the contact force
        ``f_long_N``, ``f_lat_N``, ``f_n_N`` on the wheel in the heading frame, ``slip`` and ``slip_angle_rad``, by which it drifts; among
        rocks also ``rocks``, with ``tier`` and the forces of these.
    """
    wheels = wheels_of(result)
    hard = json.loads(result.attrs.get("hard", "{}"))
    time = result.time.values
    rows = slice(int(np.searchsorted(time, time[-1] - last - 1e-9)), None)
    forces = {"f_long_N": "drawbar_pull", "f_lat_N": "lateral_force", "f_n_N": "normal_load"}
    means = forces | {"slip": "slip", "slip_angle_rad": "slip_angle"}

    def on_rocks(wheel: Wheel) -> dict:
        port = f"{hard['instance']}.diagnostics[{wheel.rover_index}]"
        return {"tier": hard["tier"]} | {key: float(result.cdl[f"{port}.{name}"].values[rows].mean()) for key, name in forces.items()}

    return [
        {
            "name": wheel.name,
            "tier": wheel.tier,
            "sinkage_m": float(wheel.diagnostic("sinkage")[rows].mean()),
            "z_m": float(wheel.centre("z")[rows].mean()),
            **{key: float(wheel.diagnostic(name)[rows].mean()) for key, name in means.items()},
            **({"rocks": on_rocks(wheel)} if hard else {}),
        }
        for wheel in wheels
    ]


def plot(result: xr.Dataset, measured: Measured | None = None) -> Figure:
    """The picture of one run: Fig. 8.12's panels if it has a front and a rear wheel, what a testbed measures, else diagnostics over time.

    ``measured`` is laid over what a testbed measures.
    """
    wheels = wheels_of(result)
    if is_testbed(result):
        from .testbed_picture import run_picture  # which reads wheels from here

        return run_picture(result, measured)
    if json.loads(result.attrs.get("hard", "{}")):
        from .rocks_picture import rocks_picture

        return rocks_picture(result)
    if {"front", "rear"} == {wheel.name for wheel in wheels}:
        return figure_8_12({", ".join(f"{wheel.name} {wheel.tier}" for wheel in wheels): result})
    return wheels_over_time(result)


def figure_8_12(runs: Mapping[str, xr.Dataset], wheels: tuple[str, str] = ("front", "rear"), normalise_by: str | None = None) -> Figure:
    """The panels of Fig. 8.12: F_x, F_y and z of two wheels over the last one's x, sections A to E, and the x-y trajectories.

    Args:
        runs: Label of each run and its result, overlaid in this order.
        wheels: Names of the leading and the trailing wheel, columns of panels in this order.
        normalise_by: Label of the run by whose leading wheel's largest F_x after the start's peak the forces are divided (8.4.2).

    Returns:
        A figure to save with ``savefig(path)``, 1800 pixels wide.

    Raises:
        ResultError: a run lacks a wheel's channels, or the one to normalise by ends within the start's peak.
    """
    named = [(label, {wheel.name: wheel for wheel in wheels_of(run)}) for label, run in runs.items()]
    trailing = wheels[-1]
    scale = 1.0
    if normalise_by is not None:
        reference = dict(named)[normalise_by]
        driving = reference[trailing].centre("x") >= _START
        if not driving.any():
            raise ResultError(f"nothing to normalise by: the {trailing} wheel of run {normalise_by!r} does not reach x = {_START} m")
        scale = float(reference[wheels[0]].diagnostic("drawbar_pull")[driving].max())
    force = "$F_{axis}$" + (" [N]" if normalise_by is None else f" / {scale:.1f} N")
    panels = [
        (force.format(axis="x"), lambda wheel: wheel.diagnostic("drawbar_pull") / scale, 1.0 / scale),
        (force.format(axis="y"), lambda wheel: wheel.diagnostic("lateral_force") / scale, 1.0 / scale),
        ("$z$ [mm]", lambda wheel: wheel.centre("z") * 1e3, 1.0),
    ]

    figure = Figure(figsize=(9.0, 8.2), dpi=200, layout="constrained")
    grid = figure.add_gridspec(len(panels) + 1, len(wheels), height_ratios=[1.0] * len(panels) + [1.15])
    top = grid[:-1, :].subgridspec(len(panels), len(wheels)).subplots(sharex=True, sharey="row", squeeze=False)
    x = np.concatenate([by_name[trailing].centre("x") for _, by_name in named])
    begin, end = min(x.min(), 0.0), max(x.max(), 0.05)
    for axes, (label, values, least) in zip(top, panels):
        for ax, name in zip(axes, wheels):
            frame(ax)
            _sections(ax, end)
            for colour, (_, by_name) in zip(colours(), named):
                ax.plot(by_name[trailing].centre("x"), values(by_name[name]), color=colour, **_LINE)
        axes[0].set_ylabel(label)
        widen(axes[0], least)
    for ax, name in zip(top[0], wheels):
        _section_letters(ax, end)
        ax.set_title(f"{name} wheel", fontsize=10, pad=16)
    for ax in top[-1]:
        ax.set_xlabel(f"$x$ of the {trailing} wheel [m]")
        ax.set_xlim(begin, end)
    _trajectories(figure.add_subplot(grid[-1, :]), named, wheels)
    figure.align_ylabels()
    legend(figure, [label for label, _ in named])
    return figure


def wheels_over_time(result: xr.Dataset) -> Figure:
    """Forces in the heading frame and sinkage of every wheel over time."""
    panels = {
        "drawbar_pull": ("$F_x$ [N]", 1.0),
        "lateral_force": ("$F_y$ [N]", 1.0),
        "normal_load": ("$F_z$ [N]", 1.0),
        "sinkage": ("sinkage [mm]", 1e3),
    }
    wheels = wheels_of(result)
    time = result.time.values
    figure = Figure(figsize=(9.0, 7.0), dpi=200, layout="constrained")
    axes = figure.subplots(len(panels), sharex=True)
    for ax, (name, (label, factor)) in zip(axes, panels.items()):
        frame(ax)
        for colour, wheel in zip(colours(), wheels):
            ax.plot(time, wheel.diagnostic(name) * factor, color=colour, **_LINE)
        ax.set_ylabel(label)
        widen(ax, 1.0)
    axes[-1].set_xlabel("$t$ [s]")
    axes[-1].set_xlim(time[0], time[-1])
    figure.align_ylabels()
    legend(figure, [f"{wheel.name} {wheel.tier}" for wheel in wheels])
    return figure


def _trajectories(ax: Axes, named: list[tuple[str, dict[str, Wheel]]], wheels: Sequence[str]) -> None:
    """Paths of the wheels' centres in world; dots where the last wheel enters a section."""
    frame(ax)
    for run, (colour, (_, by_name)) in enumerate(zip(colours(), named)):
        for (style, _), name in zip(_STYLES, wheels):
            ax.plot(by_name[name].centre("x"), by_name[name].centre("y"), ls=style, color=colour, **_LINE)
        x, y = by_name[wheels[-1]].centre("x"), by_name[wheels[-1]].centre("y")
        for letter, begin in SECTIONS.items():
            if x.max() < begin:
                break
            row = int(np.argmax(x >= begin))
            ax.plot(x[row], y[row], "o", ms=3.0, color=colour)
            if run == 0:
                ax.annotate(letter, (x[row], y[row]), (0, 5), textcoords="offset points", **_LETTER)
    ax.set_aspect("equal", adjustable="datalim")
    ax.set_title("trajectories: " + ", ".join(f"{name} wheel {word}" for (_, word), name in zip(_STYLES, wheels)), fontsize=10)
    ax.set_xlabel("$x$ [m]")
    ax.set_ylabel("$y$ [m]")


def _section_bounds(end: float) -> list[tuple[str, float, float]]:
    """Letter, begin and end [m] of the sections that begin before ``end``."""
    begins = list(SECTIONS.values())
    bounds = zip(SECTIONS, begins, [*begins[1:], end])
    return [(letter, begin, min(until, end)) for letter, begin, until in bounds if begin < end]


def _sections(ax: Axes, end: float) -> None:
    for _, begin, until in _section_bounds(end)[1::2]:
        ax.axvspan(begin, until, color="0.94", lw=0, zorder=0)


def _section_letters(ax: Axes, end: float) -> None:
    for letter, begin, until in _section_bounds(end):
        ax.text((begin + until) / 2, 1.02, letter, transform=ax.get_xaxis_transform(), **_LETTER)
