"""What nothing was measured against: the same wheel with grousers, and at slip angles."""

from __future__ import annotations

import math

from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..panels import colours, frame
from . import cmu
from .bench import Bench
from .rows import Findings, Table

_WHEELS = {"smooth": {}, "24 grousers": {"wheel.n_g": 24, "wheel.h_g": 0.005, "wheel.t_g": 0.001}}
_ANGLES = (0.0, 15.0, 30.0, 45.0)  # deg
_SLIPS = (-0.5, 0.0, 0.5, 0.9)
_QUICK = (0.0, 30.0), (0.5,)
_TIERS = ("SCM", "BCM")
#: Column -> quantity that is measured, as share of the load, or in mm.
_QUANTITIES = {"sinkage [mm]": "sinkage_m", "drawbar pull [W]": "drawbar_pull_N", "lateral force [W]": "lateral_force_N"}


def check(bench: Bench) -> Findings:
    """Predictions: grousers and slip angles"""
    angles, slips = _QUICK if bench.quick else (_ANGLES, _SLIPS)
    cases = [(wheel, angle, slip) for wheel in _WHEELS for angle in angles for slip in slips]
    points = [
        cmu.point(tier, cmu.level_at(slip), {**_WHEELS[wheel], "slip_angle": math.radians(angle)})
        for tier in _TIERS
        for wheel, angle, slip in cases
    ]
    facts = dict(zip(((tier, *case) for tier in _TIERS for case in cases), bench.measure(points)))
    values = {
        case: [fact[key] * 1e3 if key == "sinkage_m" else fact[key] / cmu.level_at(case[3]).load for key in _QUANTITIES.values()]
        for case, fact in facts.items()
    }
    columns = ["wheel", "slip angle [deg]", "slip", *(f"{tier}: {name}" for tier in _TIERS for name in _QUANTITIES), "not stationary"]
    rows = []
    for case in cases:
        drifting = ", ".join(tier for tier in _TIERS if not facts[tier, *case]["stationary"])
        rows.append([*case, *(value for tier in _TIERS for value in values[tier, *case]), drifting])
    note = (
        "Nothing was measured for these here. The smooth wheel, and the same with 24 grousers of 5 mm, under the loads of the tests at the "
        "same slip; slip angles are from the wheel's heading to the left, forces in the heading frame. Lines: SCM, dashed: BCM."
    )
    figure = _figure(values, angles, slips)
    return Findings(figure=figure, tables=[Table("Sinkage and forces", columns, rows)], note=note)


def _figure(values: dict[tuple, list[float]], angles: tuple[float, ...], slips: tuple[float, ...]) -> Figure:
    figure = Figure(figsize=(9.0, 5.2), dpi=90, layout="constrained")
    axes = figure.subplots(len(_WHEELS), len(_QUANTITIES), sharex=True, sharey="col", squeeze=False)
    for row, wheel in zip(axes, _WHEELS):
        for i, (ax, name) in enumerate(zip(row, _QUANTITIES)):
            frame(ax)
            for angle, colour in zip(angles, colours()):
                for tier, style in zip(_TIERS, ("-o", "--s")):
                    line = [values[tier, wheel, angle, slip][i] for slip in slips]
                    ax.plot(slips, line, style, color=colour, lw=1.2, ms=3, mfc=colour if tier == "SCM" else "white")
            if wheel == next(iter(_WHEELS)):
                ax.set_title(name, fontsize=10)
        row[0].set_ylabel(wheel)
    for ax in axes[-1]:
        ax.set_xlabel("slip")
    axes[0, 0].set_ylim(bottom=0.0)
    handles = [Line2D([], [], color=colour, label=f"{angle:g} deg") for angle, colour in zip(angles, colours())]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles), frameon=False, fontsize=9)
    return figure
