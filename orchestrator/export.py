"""Results for other tools: CSV as FMPy writes and reads it, and MAT trajectory files as Dymola and OpenModelica do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr
from scipy.io import savemat


def to_csv(result: xr.Dataset, path: str | Path) -> None:
    """Write a result in FMPy's CSV format: quoted names, ``time`` first, values that read back to the same bits.

    FMPy's reader splits names at every comma, quoted or not, so a matrix element ``T[1,2]`` is written as ``T[1][2]``.
    """
    names = ["time", *(name.replace(",", "][") for name in result.cdl)]
    table = np.column_stack([result.time.values, result.series.values])
    with open(path, "w", encoding="utf-8", newline="\n") as csv:
        csv.write(",".join(f'"{name}"' for name in names) + "\n")
        for row in table:
            csv.write(",".join(map(repr, row.tolist())) + "\n")


def to_mat(result: xr.Dataset, path: str | Path) -> None:
    """Write a result as a Modelica trajectory file 1.1 (MAT v4, ``binTrans``), for Dymola, OpenModelica and their readers.

    All matrices but ``Aclass`` are stored transposed: one column of ``name``, ``description`` and ``dataInfo`` a variable, one
    column of ``data_2`` a time. Units follow the description in brackets, as both tools expect. ``data_1``, the parameters, holds
    time's first and last value alone.

    Source: OpenModelica User's Guide, "The MATv4 Result File Format".
    """
    names = ["time", *result.cdl]
    units = ["s", *result.unit.values]
    descriptions = ["Simulation time", *result.description.values]
    data = np.vstack([result.time.values, result.series.values.T])
    n = len(names)
    info = np.empty((4, n), np.int32)
    info[0] = 2  # the variable lies in data_2 ...
    info[1] = np.arange(1, n + 1)  # ... in this row
    info[2] = 0  # interpolated linearly between samples
    info[3] = -1  # not defined outside the time range
    info[0, 0] = 0  # time is the abscissa of every data matrix
    savemat(
        path,
        {
            "Aclass": _characters(["Atrajectory", "1.1", "", "binTrans"]),
            "name": _characters(names).T,
            "description": _characters([f"{d} [{u}]" for d, u in zip(descriptions, units)]).T,
            "dataInfo": info,
            "data_1": data[:1, [0, -1]],
            "data_2": data,
        },
        appendmat=False,
        format="4",
    )


def _characters(texts: list[str]) -> np.ndarray:
    """Matrix of single bytes [n_texts, length of the longest in UTF-8], padded with spaces."""
    encoded = [text.encode() for text in texts]
    width = max(map(len, encoded))
    return np.array([list(text.ljust(width)) for text in encoded], np.uint8).view("S1")
