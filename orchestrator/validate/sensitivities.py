"""What SCM's constants are worth: sinkage and drawbar pull of the smooth wheel with each changed alone."""

from __future__ import annotations

from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from cdl_fmu.scm import SCM
from cdl_fmu.soil import load_soil

from ..panels import colours, frame
from . import cmu
from .bench import Bench
from .rows import Findings, Table, shown

#: Constants, and whether they were chosen on tests of this wheel.
_CONSTANTS = (
    ("scm.softening", True),
    ("scm.fan", True),
    ("scm.behind", True),
    ("scm.preshear", True),
    ("scm.ahead", True),
    ("scm.unloading_ratio", True),
    ("scm.transport_depth", True),
    ("scm.plasticity", False),
    ("soil.K", False),
)
_SLIPS = (-0.5, 0.0, 0.5, 0.9)
_CHANGES = (-0.3, 0.3)


def check(bench: Bench) -> Findings:
    """Sensitivities of SCM"""
    levels = [cmu.level_at(slip) for slip in _SLIPS]
    cases = [(name, change) for name, _ in _CONSTANTS for change in _CHANGES]
    points = [cmu.point("SCM", level, settings) for settings in ({}, *({name: _changed(name, c)} for name, c in cases)) for level in levels]
    facts = bench.measure(points)
    as_it_is, rest = facts[: len(levels)], iter(facts[len(levels) :])
    #: (constant, change, slip) -> change of sinkage relative to it, of drawbar pull in W
    changes = {}
    for name, change in cases:
        for level, before in zip(levels, as_it_is):
            now = next(rest)
            pull = (now["drawbar_pull_N"] - before["drawbar_pull_N"]) / level.load
            changes[name, change, level.slip] = now["sinkage_m"] / before["sinkage_m"] - 1.0, pull
    less, more = (shown(change, "share") for change in _CHANGES)
    columns = ["constant", "value", "slip", *(f"{what}, {by}" for what in ("sinkage [%]", "drawbar pull [W]") for by in (less, f"+{more}"))]
    rows = [
        [name + (" (fitted)" if fitted else ""), _value(name), slip]
        + [factor * changes[name, change, slip][i] for i, factor in ((0, 100.0), (1, 1.0)) for change in _CHANGES]
        for name, fitted in _CONSTANTS
        for slip in _SLIPS
    ]
    marked = "Those marked as fitted were chosen on tests of this wheel. " if any(fitted for _, fitted in _CONSTANTS) else ""
    note = f"Smooth wheel as above, each constant changed alone by {less} and +{more}. {marked}Dots: {less}, circles: +{more}."
    return Findings(figure=_figure(changes), tables=[Table("Change of sinkage and drawbar pull", columns, rows)], note=note)


def _value(name: str) -> float:
    section, _, key = name.partition(".")
    return load_soil(cmu.SOIL)[key] if section == "soil" else SCM.parameters.fields[key].start


def _changed(name: str, change: float) -> float:
    field = SCM.parameters.fields[name.partition(".")[2]]
    return min(_value(name) * (1.0 + change), field.max)


def _figure(changes: dict[tuple[str, float, float], tuple[float, float]]) -> Figure:
    figure = Figure(figsize=(9.0, 3.8), dpi=110, layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    names = [name for name, _ in _CONSTANTS]
    for k, (slip, colour) in enumerate(zip(_SLIPS, colours())):
        for row, name in enumerate(names):
            y = row + 0.18 * (k - 0.5 * (len(_SLIPS) - 1))
            for ax, i, factor in ((axes[0], 0, 100.0), (axes[1], 1, 1.0)):
                low, high = (factor * changes[name, change, slip][i] for change in _CHANGES)
                ax.plot([low, high], [y, y], color=colour, lw=1.5)
                ax.plot(low, y, "o", color=colour, ms=3)
                ax.plot(high, y, "o", color=colour, ms=4, mfc="white")
    for ax, label in zip(axes, ("change of sinkage [%]", "change of drawbar pull / load")):
        frame(ax)
        ax.axvline(0.0, color="0.6", lw=0.8)
        ax.set_xlabel(label)
    axes[0].set_yticks(range(len(names)), names)
    axes[0].invert_yaxis()
    handles = [Line2D([], [], color=colour, label=f"s = {slip:g}") for slip, colour in zip(_SLIPS, colours())]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles), frameon=False, fontsize=9)
    return figure
