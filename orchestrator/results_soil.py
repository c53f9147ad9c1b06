"""Soil maps in a result file: snapshots of the surface, of which only the heights that changed since the one before are stored.

A map covers a rectangle of grid nodes that grows with the track; node (i, j) lies at x = i spacing, y = j spacing. Snapshot n holds
at ``soil_time[n]`` the nodes i0 <= i < i1, j0 <= j < j1 of ``soil_rectangle[n]``, each with the last height among the first
``soil_end[n]`` of ``soil_i``, ``soil_j``, ``soil_z``; a node that has none is not known yet. Heights are float32: 10 nm at 0.1 m.
"""

from __future__ import annotations

from typing import NamedTuple

import h5netcdf
import numpy as np
import xarray as xr

_CHUNK = 8192  # nodes: what a wheel of Table 8.2 changes in some ten snapshots
_CORNERS = ("i0", "i1", "j0", "j1")
_OF_NODES = ("soil_i", "soil_j", "soil_z")
_OF_SNAPSHOTS = ("soil_time", "soil_end", "soil_rectangle")


class Surface(NamedTuple):
    """Heights of a soil's surface on a rectangle of nodes.

    Attributes:
        origin: World x and y of node [0, 0] [m], multiples of the spacing.
        spacing: Distance of neighbouring nodes [m].
        z: Height [m], shape [n_x, n_y]; NaN = not known.
    """

    origin: tuple[float, float]
    spacing: float
    z: np.ndarray


class SoilWriter:
    """Adds snapshots to a result file; the first ones lay out their variables."""

    def __init__(self, file: h5netcdf.File):
        self._file = file
        self._snapshots = self._nodes = 0
        self._pending: dict[str, list] = {name: [] for name in (*_OF_NODES, *_OF_SNAPSHOTS)}
        self._time = -np.inf
        self._spacing = 0.0
        self._heights = np.empty((0, 0), np.float32)
        self._first = (0, 0)  # node of _heights[0, 0]

    def append(self, time: float, surface: Surface) -> None:
        """Take the surface at a time [s], to be stored by ``flush``.

        Its spacing is the same in every snapshot, and a node once known stays so. A time that is not later than the last snapshot's
        keeps that one.
        """
        if time <= self._time:
            return
        self._time = time
        self._spacing = surface.spacing
        first = tuple(round(start / surface.spacing) for start in surface.origin)
        heights = surface.z.astype(np.float32)
        i, j = np.nonzero(self._changed(first, heights))
        self._nodes += i.size
        rectangle = [first[0], first[0] + heights.shape[0], first[1], first[1] + heights.shape[1]]
        taken = (i + first[0], j + first[1], heights[i, j], [time], [self._nodes], [rectangle])
        for values, column in zip(self._pending.values(), taken):
            values.append(column)
        self._heights, self._first = heights, first

    def flush(self) -> None:
        """Store what is pending."""
        if not self._pending["soil_time"]:
            return
        if self._snapshots == 0:
            self._layout()
        for dimension, names in (("node", _OF_NODES), ("snapshot", _OF_SNAPSHOTS)):
            columns = {name: np.concatenate(self._pending[name]) for name in names}
            last = self._nodes if dimension == "node" else self._snapshots + len(columns["soil_time"])
            self._file.resize_dimension(dimension, last)
            for name, values in columns.items():
                self._file[name][last - len(values) : last] = values
                self._pending[name].clear()
        self._snapshots = last

    def _changed(self, first: tuple[int, int], heights: np.ndarray) -> np.ndarray:
        """Where ``heights`` are known and not those of the last snapshot, or lie outside it."""
        changed = np.ones(heights.shape, bool)
        low = np.maximum(first, self._first)
        high = np.minimum(np.add(first, heights.shape), np.add(self._first, self._heights.shape))
        if np.all(high > low):
            here, there = (tuple(slice(a, b) for a, b in zip(low - f, high - f)) for f in (first, self._first))
            changed[here] = heights[here] != self._heights[there]
        return changed & ~np.isnan(heights)

    def _layout(self) -> None:
        file = self._file
        file.dimensions.update({"snapshot": None, "node": None, "corner": len(_CORNERS)})
        file.create_variable("corner", ("corner",), "S2", data=np.array(_CORNERS, "S2"))
        time = file.create_variable("soil_time", ("snapshot",), "f8", chunks=(64,))
        time.attrs["units"] = "s"
        file.create_variable("soil_end", ("snapshot",), "i8", chunks=(64,))
        file.create_variable("soil_rectangle", ("snapshot", "corner"), "i4", chunks=(64, len(_CORNERS)))
        for name in ("soil_i", "soil_j"):
            file.create_variable(name, ("node",), "i4", chunks=(_CHUNK,))
        z = file.create_variable("soil_z", ("node",), "f4", chunks=(_CHUNK,))
        z.attrs["units"] = "m"
        z.attrs["spacing"] = self._spacing


def read_surface(result: xr.Dataset, snapshot: int) -> Surface:
    """The surface at a snapshot of a result that has some."""
    i0, i1, j0, j1 = result.soil_rectangle.values[snapshot].tolist()
    i, j, z = (result[name].values[: int(result.soil_end[snapshot])] for name in ("soil_i", "soil_j", "soil_z"))
    inside = (i0 <= i) & (i < i1) & (j0 <= j) & (j < j1)
    heights = np.full((i1 - i0, j1 - j0), np.nan)
    heights[i[inside] - i0, j[inside] - j0] = z[inside]  # of equal nodes the last one stays
    spacing = float(result.soil_z.attrs["spacing"])
    return Surface((i0 * spacing, j0 * spacing), spacing, heights)
