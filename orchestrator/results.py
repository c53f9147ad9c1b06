"""Result files: a run's time series in netCDF-4, written while it runs and readable whenever it stops.

One 2-D variable ``series(time, channel)``; a channel's unit and description are coordinates of its name. Everything is float64,
so two runs can be compared, and a run resumed, to the same bits. Any netCDF tool reads the file; :func:`open_result` adds access
by name: ``open_result("result.nc").cdl["front.f_0[3]"]``. A run on deforming soil also keeps snapshots of its surface.
"""

from __future__ import annotations

import difflib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import h5netcdf
import h5py
import numpy as np
import xarray as xr

from .results_soil import SoilWriter, Surface, read_surface

#: Name of the result file in the folder that a run leaves.
FILE_NAME = "result.nc"

#: Rows that are kept in memory before they are written out: what a killed run loses at most.
BLOCK = 1000


class ResultError(Exception):
    """A result file cannot be read, or lacks what is asked of it; the message names the file or channel and the remedy."""


@dataclass(frozen=True)
class Channel:
    """One recorded scalar: its name ``<instance>.<variable>``, unit and description."""

    name: str
    unit: str
    description: str


class ResultWriter:
    """Writes a result file in blocks of ``BLOCK`` rows; each block is on disk before the next begins.

    As a context manager it closes the file with the status that the way out tells: ``complete``, ``interrupted``
    (KeyboardInterrupt) or ``failed: message``. A killed run keeps ``running`` and all its blocks.

    Args:
        path: File to write; an existing one is replaced.
        channels: What the columns of a row are.
        attributes: What a reader must know of the run: the experiment's text, versions, FMU hashes, scheme, step, wheels.
            Anything but text and numbers is stored as JSON.

    Raises:
        ResultError: another process is writing this file.
    """

    def __init__(self, path: str | Path, channels: Sequence[Channel], attributes: Mapping[str, object]):
        # netCDF needs the order of creation. h5netcdf does not flush what lies below it, so both files are held.
        _refuse_while_written(path)
        self._hdf5 = h5py.File(path, "w", track_order=True)
        self._file = h5netcdf.File(self._hdf5, "w")
        self._soil = SoilWriter(self._file)
        self._times = np.empty(BLOCK)
        self._rows = np.empty((BLOCK, len(channels)))
        self._pending = 0
        self._written = 0
        self._layout(channels)
        for name, value in attributes.items():
            self._file.attrs[name] = value if type(value) in (str, int, float) else json.dumps(value)
        self._set_status("running")

    def _layout(self, channels: Sequence[Channel]) -> None:
        file = self._file
        file.dimensions = {"time": None, "channel": len(channels)}
        texts = {
            "channel": [c.name for c in channels],
            "unit": [c.unit for c in channels],
            "description": [c.description for c in channels],
        }
        for name, values in texts.items():
            file.create_variable(name, ("channel",), h5py.string_dtype(), data=np.array(values, dtype=object))
        time = file.create_variable("time", ("time",), "f8", chunks=(BLOCK,))
        time.attrs["units"] = "s"
        # A chunk is a block of one channel, so that one channel is read without the others. Not compressed: gzip took a third of a
        # run's time and float64 of a simulation only shrink by a third.
        series = file.create_variable("series", ("time", "channel"), "f8", chunks=(BLOCK, 1))
        series.attrs["coordinates"] = "unit description"

    def append(self, time: float, row: np.ndarray) -> None:
        """Record all channels [n_channels] at a time [s]; the row is copied."""
        self._times[self._pending] = time
        self._rows[self._pending] = row
        self._pending += 1
        if self._pending == BLOCK:
            self.flush()

    def append_soil(self, time: float, surface: Surface) -> None:
        """Record the soil's surface at a time [s]; the spacing is the same every time.

        A time that is not later than the last snapshot's keeps that one.
        """
        self._soil.append(time, surface)

    def flush(self) -> None:
        """Write out what is pending."""
        first, last = self._written, self._written + self._pending
        if last > first:
            self._file.resize_dimension("time", last)
            self._file["time"][first:last] = self._times[: self._pending]
            self._file["series"][first:last] = self._rows[: self._pending]
            self._written, self._pending = last, 0
        self._soil.flush()
        self._file.flush()
        self._hdf5.flush()

    def _set_status(self, status: str) -> None:
        self._file.attrs["status"] = status
        self.flush()

    def close(self, status: str = "complete") -> None:
        """Write out what is pending and the run's last word, and close the file; a closed file stays as it is."""
        if self._hdf5:
            self._set_status(status)
            self._file.close()
            self._hdf5.close()

    def __enter__(self) -> ResultWriter:
        return self

    def __exit__(self, kind, error, traceback) -> None:
        if error is None:
            self.close()
        elif isinstance(error, KeyboardInterrupt):
            self.close("interrupted")
        else:
            self.close(f"failed: {error}")


def _refuse_while_written(path: str | Path) -> None:
    """HDF5 truncates a file before it asks for the lock, which would destroy what another run is writing."""
    try:
        h5py.File(path, "r+").close()
    except BlockingIOError:
        raise ResultError(f"result file {path} is being written by another run; wait for its end or choose another folder") from None
    except OSError:
        pass  # there is none, or nothing worth keeping


def open_result(path: str | Path) -> xr.Dataset:
    """Read a result file, or the one in a run's folder, into memory; the file is closed again.

    Returns:
        Dataset with ``series(time, channel)``, its coordinates ``unit`` and ``description``, the run's attributes, and the
        accessor ``.cdl[name]`` (:class:`Channels`).

    Raises:
        ResultError: no such file, still being written by another process, or no result file.
    """
    path = Path(path)
    if path.is_dir():
        path /= FILE_NAME
    if not path.exists():
        raise ResultError(f"result file {path} does not exist; `cdl run` writes one")
    try:
        result = xr.load_dataset(path, engine="h5netcdf")
    except BlockingIOError:
        raise ResultError(f"result file {path} is still being written by a run; read it when the run has ended") from None
    except OSError as error:
        raise ResultError(f"{path} cannot be read as netCDF-4: {error}") from error
    if "series" not in result:
        raise ResultError(f"{path} is no result of `cdl run`: it has no variable 'series'; it has {sorted(map(str, result.variables))}")
    return result


@xr.register_dataset_accessor("cdl")
class Channels:
    """The channels of a result by name: ``result.cdl["rover.wheel[1].r_0[3]"]``, ``name in result.cdl``, ``list(result.cdl)``.

    And its soil: ``result.cdl.soil(t)``, ``result.cdl.soil_times``.
    """

    def __init__(self, result: xr.Dataset):
        self._result = result
        self._columns = {str(name): column for column, name in enumerate(result.channel.values)}

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __contains__(self, name: str) -> bool:
        return name in self._columns

    def __getitem__(self, name: str) -> xr.DataArray:
        """One channel [n_times] over time, with ``units`` and ``long_name`` for xarray's plots.

        Raises:
            ResultError: no such channel; the message offers the names nearest to it.
        """
        column = self._columns.get(name)
        if column is None:
            near = difflib.get_close_matches(name, self._columns, n=3, cutoff=0.0)
            raise ResultError(f"the result has no channel {name!r}; the nearest of its {len(self._columns)} are {', '.join(near)}")
        series = self._result.series[:, column]
        attrs = {"units": str(series.unit.item()), "long_name": str(series.description.item())}
        return series.reset_coords(drop=True).rename(name).assign_attrs(attrs)

    @property
    def soil_times(self) -> np.ndarray:
        """Times [s] of the soil's snapshots, shape [n_snapshots]; empty for a run on ground that does not deform."""
        return self._result.soil_time.values if "soil_time" in self._result else np.empty(0)

    def soil(self, t: float) -> xr.DataArray:
        """Surface of the soil, height z(x, y) [m] in world, at the last snapshot at or before ``t`` [s] (attribute ``time``).

        It covers the rectangle around all soil that had been near a wheel by then; in it, what no wheel had come near yet is NaN.

        Raises:
            ResultError: the run was not on deforming soil, or ``t`` lies before its first snapshot.
        """
        times = self.soil_times
        if not times.size:
            raise ResultError("the result has no soil map: none of its wheels ran on soil that deforms; run it with tier SCM")
        n = int(np.searchsorted(times, t + 1e-9))  # times are sums of steps
        if n == 0:
            raise ResultError(f"no soil map at t = {t:g} s: the result's first is of t = {times[0]:g} s; ask for a later time")
        surface = read_surface(self._result, n - 1)
        # Multiples of the spacing, as the same node must have the same place in every map.
        axes = ((round(a / surface.spacing) + np.arange(n_nodes)) * surface.spacing for a, n_nodes in zip(surface.origin, surface.z.shape))
        coordinates = {name: (name, values, {"units": "m"}) for name, values in zip("xy", axes)}
        attrs = {"units": "m", "long_name": "soil surface", "time": float(times[n - 1])}
        return xr.DataArray(surface.z, coordinates, ("x", "y"), name="z", attrs=attrs)
