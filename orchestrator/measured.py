"""Measurements of real testbeds, to be laid over what ours gives: tables of the mean of one test a line."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

#: Quantity -> columns of its mean and standard deviation, and SI units per unit of the table; forces are those on the wheel.
COLUMNS = {
    "drawbar_pull_N": ("Fx_N", "sdFx", 1.0),
    "lateral_force_N": ("Fy_N", "sdFy", 1.0),
    "torque_Nm": ("Ty_Nm", "sdTy", 1.0),
    "sinkage_m": ("sinkage_mm", "sdZ", 1e-3),
    "normal_load_N": ("Fz_N", "sdFz", 1.0),
}
_SCALED = ("drawbar_pull_N", "lateral_force_N", "torque_Nm")  # with the load

#: What a test's slip and slip angle [rad] may be off those of a run.
SLIP_TOLERANCE, ANGLE_TOLERANCE = 0.03, math.radians(2.0)


class MeasuredError(ValueError):
    """A table of measurements cannot be read; the message names file, line and remedy."""


@dataclass(frozen=True)
class Test:
    """One test: slip, slip angle [rad], and its quantities and their standard deviations in SI units, as far as the table has them."""

    slip: float
    slip_angle: float
    values: Mapping[str, float]
    deviations: Mapping[str, float]

    def at_load(self, load: float | None) -> Test:
        """The test with forces and torque scaled from its measured normal load to another [N]; as it is if it has none."""
        if load is None or not self.values.get("normal_load_N"):
            return self
        factor = {quantity: load / self.values["normal_load_N"] if quantity in _SCALED else 1.0 for quantity in self.values}
        scaled = ({q: factor[q] * v for q, v in values.items()} for values in (self.values, self.deviations))
        return Test(self.slip, self.slip_angle, *scaled)


@dataclass(frozen=True)
class Measured:
    """The tests of a table."""

    name: str
    tests: Sequence[Test]

    def near(self, *, slip: float | None = None, slip_angle: float | None = None) -> list[Test]:
        """Tests at this slip and slip angle [rad], each where it is given, within their tolerances."""
        return [
            test
            for test in self.tests
            if (slip is None or abs(test.slip - slip) <= SLIP_TOLERANCE)
            and (slip_angle is None or abs(test.slip_angle - slip_angle) <= ANGLE_TOLERANCE)
        ]


def read_measured(path: str | Path) -> Measured:
    """Read a CSV table with the columns ``slip`` and, as far as measured, ``beta_deg`` and those of ``COLUMNS``; others are left alone.

    Raises:
        MeasuredError: no such file, a column is missing, or a number is none.
    """
    path = Path(path)
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            table = csv.DictReader(file)
            columns = table.fieldnames or []
            known = [mean for mean, _, _ in COLUMNS.values() if mean in columns]
            if "slip" not in columns or not known:
                means = ", ".join(mean for mean, _, _ in COLUMNS.values())
                raise MeasuredError(f"{path}: a table of measurements needs a column slip, and one of {means}; it has {', '.join(columns)}")
            return Measured(path.name, [_test(row, f"{path}, line {table.line_num}") for row in table])
    except OSError as error:
        raise MeasuredError(f"{path}: {error.strerror}; give a CSV table of measurements") from None
    except UnicodeDecodeError as error:
        raise MeasuredError(f"{path} is no text in UTF-8 ({error}): give a CSV table of measurements") from None


def _test(row: Mapping[str, str], where: str) -> Test:
    def number(column: str) -> float | None:
        text = row.get(column)
        if not text:
            return None
        try:
            return float(text)
        except ValueError:
            raise MeasuredError(f"{where}: {column} = {text!r} is no number; leave it empty if it was not measured") from None

    slip = number("slip")
    if slip is None:
        raise MeasuredError(f"{where}: slip is missing; each test needs one")
    values, deviations = {}, {}
    for quantity, (mean, deviation, unit) in COLUMNS.items():
        if (value := number(mean)) is not None:
            values[quantity], deviations[quantity] = unit * value, unit * (number(deviation) or 0.0)
    return Test(slip, math.radians(number("beta_deg") or 0.0), values, deviations)
