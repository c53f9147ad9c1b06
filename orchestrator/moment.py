"""A drive at one time: where its wheels and its point mass are, how large they are, and what the soil looks like."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from .report import Wheel, wheels_of
from .results import ResultError

#: [m] between the nodes of ground that no result has a map of.
_SPACING = 0.01


@dataclass(frozen=True)
class Pose:
    """A wheel: its name, tier, centre r_0 [3] [m] and rotation T [3, 3] from world to wheel, whose second row is the axle."""

    name: str
    tier: str
    r_0: np.ndarray
    T: np.ndarray

    @property
    def heading(self) -> np.ndarray:
        """Horizontal unit vector [3] along which the wheel rolls."""
        axle = self.T[1]
        return np.array([axle[1], -axle[0], 0.0]) / np.hypot(axle[0], axle[1])


@dataclass(frozen=True)
class Moment:
    """A result at one of its times.

    Attributes:
        t: Time [s].
        wheels: Pose of every wheel by name.
        mass: Position of the rover's point mass [3] [m].
        dimensions: ``r_w, b_w, h_g, mass_height`` [m], ``n_g`` [1].
        ground: Height of the undeformed ground [m].
        rocks: Triangles of each rock in world, [n, 3, 3] [m].
    """

    result: xr.Dataset
    t: float
    wheels: dict[str, Pose]
    mass: np.ndarray
    dimensions: dict[str, float]
    ground: float
    rocks: list[np.ndarray]

    def surface(self, x: tuple[float, float], y: tuple[float, float]) -> xr.DataArray:
        """Soil z(x, y) [m] on all nodes within the bounds [m]; flat ground if nothing of this run deforms.

        What lies beyond the result's map has the height of its edge, and what it does not know that of the undeformed ground.
        """
        on_soil = self.result.cdl.soil_times.size > 0
        spacing = float(self.result.soil_z.attrs["spacing"]) if on_soil else _SPACING
        axes = {}
        for axis, (low, high) in zip("xy", (x, y)):
            axes[axis] = spacing * np.arange(np.floor(low / spacing), np.ceil(high / spacing) + 1)
        if on_soil:
            return self.result.cdl.soil(self.t).reindex(axes, method="nearest").fillna(self.ground)
        return xr.DataArray(np.full([len(a) for a in axes.values()], self.ground), axes, ("x", "y"))


def moment_at(result: xr.Dataset, x_rear: float) -> Moment:
    """The time at which the rear wheel's centre is nearest to ``x_rear`` [m]; of those that have a soil map, if the run has any.

    ``x_rear`` = inf is the end.

    Raises:
        ResultError: the result lacks the wheels front and rear, their poses or their dimensions.
    """
    wheels = {wheel.name: wheel for wheel in wheels_of(result)}
    if set(wheels) != {"front", "rear"}:
        raise ResultError(f"the pictures of a drive need the wheels front and rear; this result names {', '.join(wheels)}")
    times = result.time.values
    rows = np.searchsorted(times, result.cdl.soil_times - 1e-9).clip(max=times.size - 1)
    if not rows.size:
        rows = np.arange(times.size)
    x = wheels["rear"].centre("x")[rows]
    return moment_in_row(result, int(rows[np.abs(x - np.clip(x_rear, x.min(), x.max())).argmin()]))


def moment_in_row(result: xr.Dataset, row: int) -> Moment:
    """The time of a row of the result.

    Raises:
        ResultError: the result lacks its wheels' poses or their dimensions.
    """
    dimensions = json.loads(result.attrs.get("dimensions", "{}"))
    missing = {"r_w", "b_w", "n_g", "h_g", "mass_height"} - set(dimensions)
    if missing:
        raise ResultError(f"the result does not tell {', '.join(sorted(missing))} (attribute 'dimensions'): run the experiment again")
    yaw, pitch = (float(result.cdl[f"rover.body.{angle}"][row]) for angle in ("yaw", "pitch"))
    up = np.array([np.sin(pitch) * np.cos(yaw), np.sin(pitch) * np.sin(yaw), np.cos(pitch)])
    return Moment(
        result,
        float(result.time[row]),
        {wheel.name: _pose(wheel, row) for wheel in wheels_of(result)},
        _values(result, "rover.body.r_0[{}]", "123", row) + dimensions["mass_height"] * up,
        dimensions,
        float(result.attrs.get("ground_z", 0.0)),
        [_triangles(result, rock, row) for rock in json.loads(result.attrs.get("hard", "{}")).get("rocks", [])],
    )


def _triangles(result: xr.Dataset, rock: dict, row: int) -> np.ndarray:
    indices = [f"{a},{b}" for a in "123" for b in "123"]
    T = _values(result, rock["port"] + ".T[{}]", indices, row).reshape(3, 3)
    vertices = _values(result, rock["port"] + ".r_0[{}]", "123", row) + np.array(rock["vertices"]) @ T
    return vertices[np.array(rock["faces"])]


def _pose(wheel: Wheel, row: int) -> Pose:
    indices = [f"{a},{b}" for a in "123" for b in "123"]
    r_0 = _values(wheel.result, wheel.port + ".r_0[{}]", "123", row)
    return Pose(wheel.name, wheel.tier, r_0, _values(wheel.result, wheel.port + ".T[{}]", indices, row).reshape(3, 3))


def _values(result: xr.Dataset, channel: str, indices: Sequence[str], row: int) -> np.ndarray:
    return np.array([float(result.cdl[channel.format(index)][row]) for index in indices])
