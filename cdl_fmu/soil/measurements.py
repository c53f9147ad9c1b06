"""A bevameter's tests, plates and shear, from CSV files: what people write there is checked here."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import numpy as np


class IdentifyError(ValueError):
    """Soil parameters cannot be found from what was given; the message names file, line, column, value, unit and remedy."""


@dataclass(frozen=True, eq=False)
class PlateTest:
    """A plate pressed into the soil.

    Attributes:
        name: What the file calls the test.
        b: Radius of the plate [m].
        lines, z, p: Line in the file, sinkage [m] > 0 and pressure [Pa] > 0 of each row.
    """

    name: str
    b: float
    lines: np.ndarray
    z: np.ndarray
    p: np.ndarray


@dataclass(frozen=True, eq=False)
class ShearTest:
    """Soil sheared under a constant normal pressure.

    Attributes:
        name: What the file calls the test.
        p: Normal pressure [Pa].
        lines, j, tau: Line in the file, shear displacement [m] and shear stress [Pa] of each row.
    """

    name: str
    p: float
    lines: np.ndarray
    j: np.ndarray
    tau: np.ndarray


@dataclass(frozen=True)
class _Quantity:
    """Units by which a column's name may end, and between what the largest value of a file lies [SI] if its unit is right."""

    description: str
    units: dict[str, float]
    low: float
    high: float


_LENGTHS, _PRESSURES = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}, {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6}
_QUANTITIES = {
    "plate_diam": _Quantity("diameter of the plate", _LENGTHS, 5e-3, 2.0),
    "z": _Quantity("sinkage", _LENGTHS, 1e-3, 1.0),
    "p": _Quantity("normal pressure", _PRESSURES, 100.0, 1e7),
    "j": _Quantity("shear displacement", _LENGTHS, 1e-3, 1.0),
    "tau": _Quantity("shear stress", _PRESSURES, 10.0, 1e7),
}
#: Rows that a test needs: two numbers are fitted to it.
LEAST_ROWS = 3
_STEADY = 0.1  # share of the normal pressure by which it may vary in a shear test unnoticed


def read_plates(path: str | Path) -> tuple[list[PlateTest], list[str]]:
    """Plate tests of a CSV file, and what the user should know of it.

    Columns ``test``, ``plate_diam_mm``, ``z_mm``, ``p_Pa`` in any order, others are ignored. A name may end in another unit: ``_cm``,
    ``_m``, ``_kPa``, ``_MPa``. Values are separated by commas, or by semicolons and then with a point or a comma before decimals. Rows of
    a test and a plate belong together wherever they stand. Rows without sinkage or without pressure are left out, which is told.

    Raises:
        IdentifyError: A column, value or unit is wrong, or there is too little of it.
        OSError: The file cannot be read.
    """
    table = _read(Path(path), ("plate_diam", "z", "p"))
    table.refuse(table["plate_diam"] <= 0.0, "plate_diam", "it must be positive")
    for name in ("z", "p"):
        table.refuse_turned(name)
    kept = (table["z"] > 0.0) & (table["p"] > 0.0)
    notes = []
    if not kept.all():
        where = spans(table.lines[~kept])
        notes.append(f"{table.file}: rows without sinkage or without pressure left out, {np.count_nonzero(~kept)} of {kept.size}: {where}")
    tests = []
    for (name, diameter), rows in table.groups(table["plate_diam"]):
        rows = rows[kept[rows]]
        z, p = table["z"][rows], table["p"][rows]
        table.refuse_short(name, rows, "z > 0 and p > 0")
        if np.ptp(z) == 0.0:
            raise IdentifyError(f"{table.file}: test {name} has one sinkage alone, z = {z[0]:g} m: give its whole curve, or remove it")
        tests.append(PlateTest(name, 0.5 * diameter, table.lines[rows], z, p))
    return tests, notes


def read_shear(path: str | Path) -> tuple[list[ShearTest], list[str]]:
    """Shear tests of a CSV file, and what the user should know of it.

    As :func:`read_plates`, with the columns ``test``, ``p_Pa``, ``j_mm``, ``tau_Pa``. The normal pressure of a test is its rows' mean.
    """
    table = _read(Path(path), ("p", "j", "tau"))
    table.refuse(table["p"] <= 0.0, "p", "the normal pressure must be positive")
    for name in ("j", "tau"):
        table.refuse_turned(name)
    kept = table["j"] >= 0.0
    notes = []
    if not kept.all():
        where = spans(table.lines[~kept])
        notes.append(f"{table.file}: rows with j < 0 left out, {np.count_nonzero(~kept)} of {kept.size}: {where}")
    tests = []
    for (name, _), rows in table.groups(np.zeros(kept.size)):
        rows = rows[kept[rows]]
        table.refuse_short(name, rows, "j >= 0")
        p = table["p"][rows]
        if np.ptp(p) > _STEADY * p.mean():
            notes.append(f"{table.file}: p of test {name} varies from {p.min():g} to {p.max():g} Pa; its mean, {p.mean():.4g} Pa, is taken")
        order = rows[np.argsort(table["j"][rows], kind="stable")]
        tests.append(ShearTest(name, float(p.mean()), table.lines[order], table["j"][order], table["tau"][order]))
    return tests, notes


def spans(lines: np.ndarray) -> str:
    """Lines of a file as people say them: ``lines 2-14, 40``."""
    runs = [[line for _, line in run] for _, run in groupby(enumerate(np.sort(lines)), lambda pair: pair[1] - pair[0])]
    return f"line{'s' if len(lines) > 1 else ''} " + ", ".join(f"{run[0]}-{run[-1]}" if len(run) > 1 else f"{run[0]}" for run in runs)


@dataclass(frozen=True)
class _Table:
    """Columns of a file in SI units, by quantity; ``columns`` are their names in the file, ``names`` the test of each row."""

    file: str
    names: list[str]
    lines: np.ndarray
    values: dict[str, np.ndarray]
    columns: dict[str, str]

    def __getitem__(self, quantity: str) -> np.ndarray:
        return self.values[quantity]

    def groups(self, more: np.ndarray):
        """``((name, value of more), rows)`` of each test, in the order of the file."""
        found: dict[tuple[str, float], list[int]] = {}
        for row, key in enumerate(zip(self.names, more.tolist())):
            found.setdefault(key, []).append(row)
        return [(key, np.array(rows)) for key, rows in found.items()]

    def written(self, quantity: str, row: int) -> str:
        """``z_mm = -1.5`` as it stands in the file."""
        column = self.columns[quantity]
        return f"{column} = {self[quantity][row] / _factor(quantity, column):.6g}"

    def refuse(self, wrong: np.ndarray, quantity: str, remedy: str) -> None:
        for row in np.flatnonzero(wrong)[:1]:
            raise IdentifyError(f"{self.file}, line {self.lines[row]}: {self.written(quantity, row)}: {remedy}")

    def refuse_turned(self, quantity: str) -> None:
        """Noise around zero is no mistake; a test most of which is negative has the other sign."""
        for (name, _), rows in self.groups(np.zeros(self.lines.size)):
            negative = rows[self[quantity][rows] < 0.0]
            if 2 * negative.size > rows.size:
                first, what = negative[0], _QUANTITIES[quantity].description
                raise IdentifyError(
                    f"{self.file}, line {self.lines[first]}: {self.written(quantity, first)}, and of test {name} {negative.size} of "
                    f"{rows.size} rows are negative: {what} is positive here; turn its sign"
                )

    def refuse_short(self, name: str, rows: np.ndarray, what: str) -> None:
        if rows.size < LEAST_ROWS:
            few = "no row" if rows.size == 0 else f"{rows.size} row{'s' if rows.size > 1 else ''}"
            raise IdentifyError(
                f"{self.file}: test {name} has {few} with {what}, and {LEAST_ROWS} are needed: add rows, or remove the test"
            )


def _factor(quantity: str, column: str) -> float:
    return _QUANTITIES[quantity].units[column.rpartition("_")[2]]


def _read(path: Path, quantities: tuple[str, ...]) -> _Table:
    try:
        text = path.read_text(encoding="utf-8-sig")  # Windows' programs write a byte order mark
    except UnicodeDecodeError as error:
        raise IdentifyError(f"{path.name} is no text in UTF-8 ({error}): save the table as CSV") from None
    separator = ";" if ";" in text.partition("\n")[0] else ","
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator)
    header = [cell.strip() for cell in next(reader, [])]
    columns = {quantity: _column(path.name, header, quantity) for quantity in quantities}
    if "test" not in header:
        raise IdentifyError(f"{path.name} has no column test, which tells the tests apart; its columns are {_listed(header)}")
    names, lines, rows = [], [], []
    for cells in reader:
        if not any(cell.strip() for cell in cells):
            continue
        if len(cells) != len(header):
            raise IdentifyError(f"{path.name}, line {reader.line_num}: {len(cells)} values under {len(header)} columns: give one for each")
        row = dict(zip(header, cells))
        names.append(row["test"].strip())
        lines.append(reader.line_num)
        rows.append([_number(f"{path.name}, line {reader.line_num}", c, row[c].strip(), separator) for c in columns.values()])
    if not rows:
        raise IdentifyError(f"{path.name} has no rows below its header: give one for each reading")
    factors = [_factor(quantity, column) for quantity, column in columns.items()]
    values = dict(zip(quantities, (np.array(rows) * factors).T))
    for quantity in quantities:
        _refuse_unit(path.name, quantity, columns[quantity], float(np.abs(values[quantity]).max()))
    return _Table(path.name, names, np.array(lines), values, columns)


def _column(file: str, header: list[str], quantity: str) -> str:
    possible = [f"{quantity}_{unit}" for unit in _QUANTITIES[quantity].units]
    found = [column for column in header if column in possible]
    if not found:
        what = _QUANTITIES[quantity].description
        raise IdentifyError(f"{file} has no column {possible[0]} ({what}; or {', '.join(possible[1:])}); its columns are {_listed(header)}")
    if len(found) > 1:
        raise IdentifyError(f"{file} has the columns {_listed(found)}: keep one of them")
    return found[0]


def _listed(columns: list[str]) -> str:
    return ", ".join(columns) or "none: the file is empty"


def _number(place: str, column: str, text: str, separator: str) -> float:
    quantity, _, unit = column.rpartition("_")
    try:
        value = float(text.replace(",", ".") if separator == ";" else text)
    except ValueError:
        written = f"{column} = {text!r}" if text else f"{column} is empty"
        raise IdentifyError(f"{place}: {written}: a number in {unit} is needed ({_QUANTITIES[quantity].description})") from None
    if not np.isfinite(value):
        raise IdentifyError(f"{place}: {column} = {text}: it must be finite ({_QUANTITIES[quantity].description} in {unit})")
    return value


def _refuse_unit(file: str, quantity: str, column: str, largest: float) -> None:
    """Refuse a column whose values can hardly be in the unit that its name says."""
    known = _QUANTITIES[quantity]
    if known.low <= largest <= known.high:
        return
    unit = column.rpartition("_")[2]
    written = largest / known.units[unit]
    fitting = [other for other, factor in known.units.items() if known.low <= written * factor <= known.high]
    remedy = f"it is most likely in {fitting[0]}; name the column {quantity}_{fitting[0]}" if fitting else "correct its unit"
    low, high = (bound / known.units[unit] for bound in (known.low, known.high))
    raise IdentifyError(
        f"{file}: {column} is at most {written:.4g} {unit}, and a {known.description} of {low:g} to {high:g} {unit} is expected: {remedy}"
    )
