"""The chapter's pictures of the heterogeneous drive (Figs. 8.4, 8.5, 8.8 to 8.12) from the results of its runs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colorbar import Colorbar
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon
from matplotlib.patheffects import withStroke
from mpl_toolkits.mplot3d import Axes3D

from .moment import Moment, moment_at, moment_in_row
from .plane_picture import PLANE_COLOUR, figure_8_4, plane_under
from .report import SECTIONS, figure_8_12, wheels_of
from .results import ResultError
from .scene import BODY_COLOUR, HEIGHTS, TIER_COLOURS, Scene, direction, lit

# x of the rear wheel [m] at which pictures are taken
_BEFORE_THE_RUT = 0.3
_IN_THE_RUT = 0.75
_STEERED_BACK = 1.2  # as the chapter says of Fig. 8.11
_AT_THE_END = np.inf

_TRACES = {"front": ("black", "-"), "rear": ("#D55E00", "--")}
_START = {"color": "0.3", "ls": (0, (4, 2))}
_SECTION = {"color": "black", "ls": ":", "lw": 0.8}
_HALO = [withStroke(linewidth=3.0, foreground="white")]
_NO_SOIL_SCALE = (-10.0, 10.0)  # [mm]


def write(runs: Mapping[str, xr.Dataset], out: Path) -> list[Path]:
    """Write all pictures as PNG, 1800 pixels wide.

    A run that ends before its rear wheel is where a picture is taken is shown at its end; titles tell the x that it reached.

    Args:
        runs: Results of the runs, ``BxB``, ``SxB`` and ``SxS`` among them, in the order of Fig. 8.12's legend.
        out: Folder, which exists.

    Returns:
        Paths of what was written: ``fig_8_4.png`` and so on.

    Raises:
        ResultError: a result lacks wheels, their poses or dimensions.
    """
    heights = _scale(runs)
    in_rut = moment_at(runs["SxB"], _IN_THE_RUT)
    title = f"SxB, contact plane of the rear wheel in the front wheel's rut at {_where(in_rut)}"
    figures = {
        "fig_8_4": figure_8_4(plane_under(in_rut, in_rut.wheels["rear"]), title),
        "fig_8_5": _rut(moment_at(runs["SxS"], _BEFORE_THE_RUT), heights),
        "fig_8_8": _plane_in_the_rut(in_rut, heights),
        "fig_8_9": _top_view(moment_at(runs["SxS"], _AT_THE_END), heights),
        "fig_8_10": _setups({name: moment_at(runs[name], _STEERED_BACK) for name in ("SxS", "SxB", "BxB")}, heights),
        "fig_8_11": _top_view(moment_at(runs["SxS"], _STEERED_BACK), heights),
        "fig_8_12": _forces(runs),
    }
    paths = []
    for name, figure in figures.items():
        paths.append(out / f"{name}.png")
        figure.savefig(paths[-1])
    return paths


def _rut(moment: Moment, heights: Normalize) -> Figure:
    """Fig. 8.5: the rut behind the front wheel."""
    figure = _canvas(5.0, f"SxS, rut of the front wheel, {_where(moment)}")
    x, y, _ = moment.wheels["front"].r_0
    scene = Scene(30.0, -128.0, _bounds(moment, (x - 0.45, x + 0.2), (y - 0.25, y + 0.25)))
    scene.add_soil(moment, heights)
    scene.add_wheel(moment, moment.wheels["front"])
    scene.draw(_view(figure, 0.02, 0.88), zoom=0.75)
    _finish(figure, heights, _wheel_handles([moment]))
    return figure


def _plane_in_the_rut(moment: Moment, heights: Normalize) -> Figure:
    """Fig. 8.8: the rover, the BCM wheel's plane in the SCM wheel's rut."""
    figure = _canvas(4.5, f"SxB, contact plane of the rear wheel in the front wheel's rut, {_where(moment)}")
    x_front, x_rear = (moment.wheels[name].r_0[0] for name in ("front", "rear"))
    scene = Scene(32.0, -108.0, _bounds(moment, (x_rear - 0.3, x_front + 0.25), (-0.25, 0.25)))
    scene.add_soil(moment, heights)
    scene.add_rover(moment, rear_opacity=0.4)
    handles = [*_wheel_handles([moment]), _mass_handle()]
    fit = plane_under(moment, moment.wheels["rear"])
    if fit.found:
        scene.add(fit.sheet, PLANE_COLOUR, ahead=0.015)  # or it would vanish in the soil that it is fitted to
        handles.append(Patch(facecolor=PLANE_COLOUR, label="contact plane of the rear wheel"))
    scene.draw(_view(figure, 0.0, 0.92), zoom=0.88)
    _finish(figure, heights, handles)
    return figure


def _setups(moments: Mapping[str, Moment], heights: Normalize) -> Figure:
    """Fig. 8.10: the three runs side by side."""
    figure = _canvas(2.8, None)
    share = 0.9 / len(moments)
    for column, (name, moment) in enumerate(moments.items()):
        x_front, x_rear = (moment.wheels[wheel].r_0[0] for wheel in ("front", "rear"))
        scene = Scene(32.0, -66.0, _bounds(moment, (x_rear - 0.35, x_front + 0.25), (-0.25, 0.35)))
        scene.add_soil(moment, heights)
        scene.add_rover(moment)
        ax = _view(figure, column * share, share)
        scene.draw(ax, zoom=0.88)
        ax.set(ylabel="", zlabel="")  # there is no room
        figure.text((column + 0.5) * share, 0.93, f"{name}, {_where(moment)}", ha="center", fontsize=8)
    _finish(figure, heights, [*_wheel_handles(moments.values()), _mass_handle()])
    return figure


def _top_view(moment: Moment, heights: Normalize) -> Figure:
    """Figs. 8.9 and 8.11: soil and traces from above, the rover where it is and where it started."""
    wheels = {wheel.name: wheel for wheel in wheels_of(moment.result)}
    driven = moment.result.time.values <= moment.t + 1e-9
    paths = {name: (wheel.centre("x")[driven], wheel.centre("y")[driven]) for name, wheel in wheels.items()}
    x, y = (np.concatenate([path[axis] for path in paths.values()]) for axis in (0, 1))
    z = moment.surface((x.min() - 0.2, x.max() + 0.25), (y.min() - 0.2, y.max() + 0.2))
    left, right, low, high = (float(edge) for axis in (z.x, z.y) for edge in axis[[0, -1]])
    figure = Figure(figsize=(9.0, 1.5 + 7.6 * (high - low) / (right - left)), dpi=200, layout="constrained")
    ax = figure.add_subplot()
    slopes = np.gradient(z.values, z.x.values, z.y.values)
    normals = np.stack([-slopes[0], -slopes[1], np.ones(z.shape)], axis=2)
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    colours = HEIGHTS(heights(1e3 * (z.values - moment.ground)))[:, :, :3]
    half = float(z.x[1] - z.x[0]) / 2
    soil = lit(colours, normals, direction(40.0, 135.0)).swapaxes(0, 1)
    ax.imshow(soil, origin="lower", extent=(left - half, right + half, low - half, high + half), interpolation="nearest")
    for name, (colour, style) in _TRACES.items():
        ax.plot(*paths[name], color=colour, ls=style, lw=1.5, path_effects=_HALO)
    _wheels_from_above(ax, moment_in_row(moment.result, 0), **_START)
    _wheels_from_above(ax, moment, color="black")
    ends = np.array([wheel.r_0[:2] for wheel in moment.wheels.values()])
    ax.plot(*ends.T, color="black", lw=1.2, path_effects=_HALO)
    ax.plot(*moment.mass[:2], "o", color="black", ms=5)
    for letter, begin in SECTIONS.items():
        if begin <= paths["rear"][0][-1]:
            ax.axvline(begin, **_SECTION)
            label = f"{letter}\n{begin:g} m"
            ax.text(begin, 1.02, label, transform=ax.get_xaxis_transform(), ha="center", va="bottom", fontsize=8)
    ax.set(xlabel="x [m]", ylabel="y [m]")
    ax.set_title(f"SxS, traces of both wheels, {_where(moment)}", fontsize=10, pad=30)
    handles = [Line2D([], [], color=colour, ls=style, label=f"{name} wheel") for name, (colour, style) in _TRACES.items()]
    handles += [
        Line2D([], [], **_START, label="at the start"),
        Line2D([], [], **_SECTION, label="x of the rear wheel where sections begin"),
    ]
    bar = figure.colorbar(ScalarMappable(heights, HEIGHTS), cax=ax.inset_axes((1.01, 0.0, 0.012, 1.0)))
    _label_heights(bar)
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False, fontsize=8)
    return figure


def _forces(runs: Mapping[str, xr.Dataset]) -> Figure:
    """Fig. 8.12, in N where SxS is too short to normalise by."""
    try:
        return figure_8_12(runs, normalise_by="SxS")
    except ResultError:
        return figure_8_12(runs)


def _wheels_from_above(ax: Axes, moment: Moment, **line) -> None:
    """Outlines of the wheels with their grousers."""
    half = np.array([moment.dimensions["r_w"] + moment.dimensions["h_g"], moment.dimensions["b_w"] / 2])
    corners = half * [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    for wheel in moment.wheels.values():
        ahead = wheel.heading[:2]
        axes = np.array([ahead, (-ahead[1], ahead[0])])
        ax.add_patch(Polygon(wheel.r_0[:2] + corners @ axes, fill=False, lw=1.2, path_effects=_HALO, **line))


def _bounds(moment: Moment, x: tuple[float, float], y: tuple[float, float]) -> np.ndarray:
    """Bounds of a scene, from below the soil to above the rover."""
    low = float(moment.surface(x, y).min()) - 0.01
    return np.array([x, y, (low, moment.ground + 2 * moment.dimensions["r_w"] + moment.dimensions["h_g"])])


def _scale(runs: Mapping[str, xr.Dataset]) -> Normalize:
    """Scale of heights [mm] above the undeformed ground that all pictures share."""
    low, high = _NO_SOIL_SCALE
    for run in runs.values():
        if run.cdl.soil_times.size:
            z = 1e3 * (run.cdl.soil(np.inf).values - float(run.attrs.get("ground_z", 0.0)))
            low, high = min(low, np.floor(np.nanmin(z) / 5) * 5), max(high, np.ceil(np.nanmax(z) / 5) * 5)
    return Normalize(low, high)


def _where(moment: Moment) -> str:
    return f"x of the rear wheel = {moment.wheels['rear'].r_0[0]:.2f} m"


def _canvas(height: float, title: str | None) -> Figure:
    """A figure for perspectives, 9 inches wide."""
    figure = Figure(figsize=(9.0, height), dpi=200)
    if title:
        figure.suptitle(title, fontsize=10)
    return figure


def _view(figure: Figure, left: float, width: float) -> Axes3D:
    """Axes over a share of a canvas' width, square as matplotlib wants them in space, and beyond the canvas where that is flat."""
    height = width * figure.get_figwidth() / figure.get_figheight()
    return figure.add_axes((left, 0.53 - height / 2, width, height), projection="3d", computed_zorder=False)


def _wheel_handles(moments) -> list[Patch]:
    tiers = sorted({wheel.tier for moment in moments for wheel in moment.wheels.values()}, reverse=True)
    return [Patch(facecolor=TIER_COLOURS.get(tier, "0.5"), label=f"{tier} wheel") for tier in tiers]


def _mass_handle() -> Line2D:
    return Line2D([], [], color=BODY_COLOUR, marker="o", ms=7, lw=3, label="link and point mass")


def _finish(figure: Figure, heights: Normalize, handles: list) -> None:
    """Scale of heights to the right of a canvas, legend below."""
    _label_heights(figure.colorbar(ScalarMappable(heights, HEIGHTS), cax=figure.add_axes((0.925, 0.2, 0.012, 0.6))))
    figure.legend(handles=handles, loc="lower center", ncols=len(handles), frameon=False, fontsize=8)


def _label_heights(bar: Colorbar) -> None:
    bar.set_label("height above undeformed ground [mm]", fontsize=8)
    bar.ax.tick_params(labelsize=7)
