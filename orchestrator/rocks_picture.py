"""The picture of a drive among rocks (Fig. 8.7): the rover on them, and what sand and rocks exert on each wheel."""

from __future__ import annotations

import json

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from .moment import Moment, moment_in_row
from .panels import frame, widen
from .report import Wheel, wheels_of
from .scene import BODY_COLOUR, ROCK_COLOUR, TIER_COLOURS, Scene

_SAND, _ROCK, _Z = "#E69F00", "#4D4D4D", {"front": "#0072B2", "rear": "#D55E00"}
_LINE = {"lw": 0.9}
_FLOOR = 1.5  # [m] across: what is larger is no rock to be shown, but a floor
_HEIGHTS = Normalize(-40.0, 20.0)  # [mm]; holes below rocks are as dark as the deepest ruts
_BEHIND, _AHEAD, _SIDE = 0.25, 0.35, 0.3  # [m] of soil shown behind, ahead and beside the wheels


def rocks_picture(result: xr.Dataset) -> Figure:
    """Two views of the rover, when each wheel is highest on the rocks; below, forces on each wheel by material, and heights, over time.

    Returns:
        A figure to save with ``savefig(path)``, 1800 pixels wide.
    """
    wheels = {wheel.name: wheel for wheel in wheels_of(result)}
    hard = json.loads(result.attrs["hard"])
    rows = [_highest(result, wheel, hard["instance"]) for wheel in wheels.values()]
    moments = [moment_in_row(result, row) for row, _ in rows]
    figure = Figure(figsize=(9.0, 9.6), dpi=200)
    for k, (moment, name) in enumerate(zip(moments, wheels)):
        ax = figure.add_axes((0.5 * k - 0.03, 0.64, 0.56, 0.40), projection="3d", computed_zorder=False)
        _view(moment, ax)
        figure.text(
            0.25 + 0.5 * k,
            0.965,
            f"t = {moment.t:.2f} s: {name} wheel {'on a rock' if rows[k][1] else 'on sand alone'}",
            ha="center",
            fontsize=9,
        )
    handles = [
        Patch(facecolor=TIER_COLOURS.get(t, "0.5"), label=f"wheel on {t} and {hard['tier']}") for t in {w.tier for w in wheels.values()}
    ]
    handles += [Patch(facecolor=ROCK_COLOUR, label="rock"), Patch(facecolor=BODY_COLOUR, label="link and point mass")]
    figure.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, 0.71), ncols=len(handles), frameon=False, fontsize=8)
    grid = figure.add_gridspec(3, len(wheels), left=0.08, right=0.985, bottom=0.05, top=0.655, hspace=0.18, wspace=0.08)
    panels = grid.subplots(sharex=True, sharey="row", squeeze=False)
    for k, wheel in enumerate(wheels.values()):
        _forces(panels[0, k], wheel, hard, "normal_load")
        _forces(panels[1, k], wheel, hard, "drawbar_pull")
        _heights(panels[2, k], wheel, hard)
        panels[0, k].set_title(f"{wheel.name} wheel", fontsize=10)
        panels[2, k].set_xlabel("$t$ [s]")
    for ax, label in zip(panels[:, 0], ("$F_z$ [N]", "$F_x$ [N]", "$z$ above start [mm]")):
        ax.set_ylabel(label)
    panels[0, 0].legend(loc="upper left", ncols=3, frameon=False, fontsize=8)
    panels[2, 0].legend(loc="upper left", ncols=2, frameon=False, fontsize=7)
    figure.align_ylabels()
    return figure


def _highest(result: xr.Dataset, wheel: Wheel, instance: str) -> tuple[int, bool]:
    """Row with a soil map at which the wheel is highest while a rock bears it; the last one if none does, and whether one does."""
    rows = np.searchsorted(result.time.values, result.cdl.soil_times - 1e-9) if result.cdl.soil_times.size else np.arange(len(result.time))
    rows = rows[rows < len(result.time)]
    borne = result.cdl[f"{instance}.diagnostics[{wheel.rover_index}].normal_load"].values[rows] > 0.0
    z = np.where(borne, wheel.centre("z")[rows], -np.inf)
    return int(rows[z.argmax()] if borne.any() else rows[-1]), bool(borne.any())


def _view(moment: Moment, ax) -> None:
    x = [wheel.r_0[0] for wheel in moment.wheels.values()]
    y = [wheel.r_0[1] for wheel in moment.wheels.values()]
    side = min(y) - _SIDE, max(y) + _SIDE
    along = np.array([min(x) - _BEHIND, max(x) + _AHEAD])
    near = [rock for rock in moment.rocks if rock[:, :, 0].max() > along[0] and rock[:, :, 0].min() < along[1]]
    shown = [rock for rock in near if np.ptp(rock[:, :, :2], axis=(0, 1)).max() < _FLOOR]
    # Rocks are shown whole, and no wider a piece of ground than it takes.
    corners = np.concatenate([rock.reshape(-1, 3) for rock in shown] or [np.empty((0, 3))])
    along = (min([along[0], *(corners[:, 0] - 0.03)]), max([along[1], *(corners[:, 0] + 0.03)]))
    side = (min([side[0], *corners[:, 1]]), max([side[1], *corners[:, 1]]))
    low = min([float(moment.surface(along, side).min()), *corners[:, 2]]) - 0.01
    top = max(float(wheel.r_0[2]) for wheel in moment.wheels.values()) + moment.dimensions["r_w"] + moment.dimensions["h_g"]
    scene = Scene(24.0, -62.0, np.array([along, side, (low, top)]))
    scene.add_soil(moment, _HEIGHTS)
    for rock in shown:
        scene.add_triangles(rock, ROCK_COLOUR)
    scene.add_rover(moment)
    scene.draw(ax, zoom=1.0)
    ax.set(ylabel="", zlabel="")


def _forces(ax: Axes, wheel: Wheel, hard: dict, name: str) -> None:
    frame(ax)
    time = wheel.result.time.values
    rock = wheel.result.cdl[f"{hard['instance']}.diagnostics[{wheel.rover_index}].{name}"].values
    ax.plot(time, rock, color=_ROCK, label=f"rock ({hard['tier']})", **_LINE)
    ax.plot(time, wheel.diagnostic(name), color=_SAND, label=f"sand ({wheel.tier})", **_LINE)
    ax.set_xlim(time[0], time[-1])
    widen(ax, 1.0)


def _heights(ax: Axes, wheel: Wheel, hard: dict) -> None:
    frame(ax)
    time = wheel.result.time.values
    z = 1e3 * wheel.centre("z")
    ax.plot(time, z - z[0], color=_Z.get(wheel.name, "black"), label="wheel", **_LINE)
    for k, rock in enumerate(hard["rocks"], 1):
        z = 1e3 * wheel.result.cdl[f"{rock['port']}.r_0[3]"].values
        ax.plot(time, z - z[0], color="0.3", ls=["-", "--", ":", "-."][k % 4], lw=0.8, label=f"rock {k}")
    widen(ax, 1.0)
