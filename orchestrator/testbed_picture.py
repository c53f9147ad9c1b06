"""Pictures of a single-wheel testbed: one run over its travel, and a sweep with measurements laid over it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from .measured import Measured, Test
from .measurement import measure_result
from .panels import colours, frame, widen

#: Quantity -> label of its panel, units of the panel per SI unit, least span of the panel in its unit.
_PANELS = {
    "drawbar_pull_N": ("drawbar pull $F_x$ [N]", 1.0, 1.0),
    "lateral_force_N": ("lateral force $F_y$ [N]", 1.0, 1.0),
    "torque_Nm": ("drive torque [N m]", 1.0, 0.1),
    "sinkage_m": ("sinkage [mm]", 1e3, 1.0),
    "normal_load_N": ("load $F_z$ [N]", 1.0, 1.0),
}
_SWEPT = ("drawbar_pull_N", "lateral_force_N", "torque_Nm", "sinkage_m")
_KEYS = ("slip", "slip_angle")  # along which tests can be laid
_MARKERS = "o^sDvP"
_MEASURED = {"color": "black", "lw": 1.0}
_STATIONARY, _DRIFTING = "#009E73", "#D55E00"


def run_picture(result: xr.Dataset, measured: Measured | None = None) -> Figure:
    """Sinkage, forces and torque over the travel, the stationary part shaded, with its mean and that of tests at its slip and slip angle.

    Raises:
        ResultError: the result is of no testbed, or has no rows.
    """
    measurement = measure_result(result)
    facts, path, part = measurement.facts(), measurement.path, measurement.part
    tests = [] if measured is None else measured.near(slip=facts["slip"], slip_angle=facts["slip_angle"])
    tests = [test.at_load(facts["load_N"]) for test in tests]
    figure = Figure(figsize=(9.0, 8.5), dpi=200, layout="constrained")
    axes = figure.subplots(len(_PANELS), sharex=True)
    colour = _STATIONARY if part.stationary else _DRIFTING
    for ax, (quantity, (label, factor, least)) in zip(axes, _PANELS.items()):
        frame(ax)
        ax.axvspan(path[part.first], path[-1], color=colour, alpha=0.12, lw=0)
        # The first row comes before the contact's first step: it has a pose, but no force.
        ax.plot(path[1:], measurement.series(quantity)[1:] * factor, color=next(colours()), lw=0.8)
        mean, deviation = facts[quantity] * factor, facts[f"{quantity}_std"] * factor
        ax.plot([path[part.first], path[-1]], [mean, mean], color=colour, lw=1.5)
        ax.text(1.005, 0.5, f"{mean:z.3g}\n± {deviation:.2g}", transform=ax.transAxes, va="center", fontsize=9, color=colour)
        if values := [test.values[quantity] * factor for test in tests if quantity in test.values]:
            ax.axhline(float(np.mean(values)), ls="--", **_MEASURED)
        ax.set_ylabel(label)
        widen(ax, least)
    axes[-1].set_xlabel("travel [m]" if facts["carriage_speed"] > 0.0 else "path of the rim [m]")
    found = "stationary part, its mean and standard deviation" if part.stationary else "last quarter: NOT stationary"
    handles = [Patch(color=colour, alpha=0.3, label=found)]
    if measured is not None:
        handles.append(Line2D([], [], ls="--", label=_tests(tests, measured), **_MEASURED))
    figure.legend(handles=handles, loc="outside lower center", ncols=2, frameon=False, fontsize=9)
    settings = f"slip {facts['slip']:.4g}, slip angle {facts['slip_angle']:.4g} rad, {facts['load_N']:g} N, {facts['carriage_speed']:g} m/s"
    figure.suptitle(f"{facts['tier']}, {settings}", fontsize=10)
    figure.align_ylabels()
    return figure


def sweep_picture(keys: Mapping[str, Sequence], rows: Sequence[Mapping], measured: Measured | None = None) -> Figure:
    """Drawbar pull, lateral force, torque and sinkage over a swept key, a line for each combination of the others.

    Args:
        keys: Swept key -> its values; the one with most numbers becomes the axis.
        rows: Its finished points, as ``sweep.json`` has them.
        measured: Tests that are laid over it: over slip those at the points' slip angles, over slip angle those at the points' slips.
    """
    along = _axis(keys)
    others = [key for key in keys if key != along]
    lines: dict[tuple, list[Mapping]] = {}
    for row in rows:
        lines.setdefault(tuple(str(row[key]) for key in others), []).append(row)
    figure = Figure(figsize=(9.0, 7.0), dpi=200, layout="constrained")
    axes = figure.subplots(2, 2, sharex=True).ravel()
    handles = []
    for ax, quantity in zip(axes, _SWEPT):
        label, factor, _ = _PANELS[quantity]
        frame(ax)
        for colour, points in zip(colours(), lines.values()):
            _draw_line(ax, [_place(keys[along], point[along]) for point in points], points, quantity, factor, colour)
        ax.set_ylabel(label)
    for colour, names in zip(colours(), lines):
        label = ", ".join(f"{key} = {name}" for key, name in zip(others, names)) or ", ".join({row["tier"] for row in rows})
        handles.append(Line2D([], [], color=colour, marker="o", ms=4, label=label))
    notes = ["bars: standard deviation"]
    if not all(row["stationary"] for row in rows):
        notes.append("hollow: NOT stationary")
    if measured is not None:
        found, more = _lay_over(axes, along, rows, measured)
        handles += more
        notes.append(_tests(found, measured))
    for ax, quantity in zip(axes, _SWEPT):
        widen(ax, _PANELS[quantity][2])
    for ax in axes[2:]:
        ax.set_xlabel(f"{along} [rad]" if along == "slip_angle" else along)
        if not _is_numeric(keys[along]):
            ax.set_xticks(range(len(keys[along])), [str(value) for value in keys[along]])
    figure.legend(handles=handles, loc="outside upper center", ncols=3, frameon=False, fontsize=9)
    figure.supxlabel("; ".join(notes), fontsize=8, color="0.35")
    figure.align_ylabels()
    return figure


def _axis(keys: Mapping[str, Sequence]) -> str:
    numeric = {key: len(values) for key, values in keys.items() if _is_numeric(values)}
    return max(numeric, key=lambda key: numeric[key]) if numeric else next(iter(keys))


def _is_numeric(values: Sequence) -> bool:
    return all(isinstance(value, (int, float)) for value in values)


def _place(values: Sequence, value) -> float:
    """Where a value lies on the axis: words stand side by side."""
    return value if _is_numeric(values) else list(values).index(value)


def _draw_line(ax: Axes, x: Sequence[float], points: Sequence[Mapping], quantity: str, factor: float, colour: str) -> None:
    order = np.argsort(x)
    x = np.asarray(x, dtype=float)[order]
    mean, deviation = (factor * np.array([point[key] for point in points])[order] for key in (quantity, f"{quantity}_std"))
    stationary = np.array([point["stationary"] for point in points])[order]
    ax.errorbar(x, mean, deviation, color=colour, lw=1.0, capsize=2, elinewidth=0.8)
    ax.plot(x, mean, "o", ms=4, color=colour, mfc="white")
    ax.plot(x[stationary], mean[stationary], "o", ms=4, color=colour)


def _lay_over(axes: Sequence[Axes], along: str, rows: Sequence[Mapping], measured: Measured) -> tuple[list[Test], list[Line2D]]:
    """Draw the tests that belong to the rows; returns them, scaled to the rows' load, and what their markers stand for."""
    if along not in _KEYS:
        return [], []
    (fixed,) = (key for key in _KEYS if key != along)
    loads = {row["load_N"] for row in rows}
    load = loads.pop() if len(loads) == 1 else None
    drawn, handles = [], []
    for marker, value in zip(_MARKERS, sorted({row[fixed] for row in rows})):
        tests = [test.at_load(load) for test in measured.near(**{fixed: value})]
        if not tests:
            continue
        for ax, quantity in zip(axes, _SWEPT):
            _, factor, _ = _PANELS[quantity]
            found = [test for test in tests if quantity in test.values]
            x, mean = [getattr(test, along) for test in found], [factor * test.values[quantity] for test in found]
            bars = [factor * test.deviations[quantity] for test in found]
            ax.errorbar(x, mean, bars, fmt=marker, ms=4, mfc="none", capsize=2, zorder=3, **_MEASURED)
        handles.append(Line2D([], [], ls="", marker=marker, mfc="none", label=f"measured, {fixed} = {value:g}", **_MEASURED))
        drawn += tests
    return drawn, handles


def _tests(tests: Sequence[Test], measured: Measured) -> str:
    """How many tests of a table are shown, and what was done to them."""
    if not tests:
        return f"{measured.name} has no test at such a slip and slip angle"
    scaled = ", forces times load / measured $F_z$" if any("normal_load_N" in test.values for test in tests) else ""
    return f"{len(tests)} test{'s' if len(tests) > 1 else ''} of {measured.name}{scaled}"
