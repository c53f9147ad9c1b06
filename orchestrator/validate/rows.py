"""What a check finds: rows of the one table, a figure, further tables; and how their numbers are shown."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass

from matplotlib.figure import Figure

#: Unit of a number -> the one in tables, and how many of those one is. A share is of what is expected, W is the wheel's load.
_SHOWN = {"m": ("mm", 1e3), "rad": ("deg", 180.0 / math.pi), "share": ("%", 100.0), "1": ("", 1.0)}
_VERDICTS = {True: "pass", False: "miss", None: ""}

#: Of the one table.
COLUMNS = ("model", "data or closed form", "quantity", "expected", "computed", "error", "bar", "verdict")


@dataclass(frozen=True)
class Row:
    """One line of the table.

    Attributes:
        model: What computes: a tier, or another part of the library.
        against: The data, or the closed form.
        quantity: What is compared, and where.
        expected, computed: Values in ``unit``, or words; None where the error alone counts.
        error: What is judged, in ``error_unit``.
        bar: Least and largest allowed error, None where that side is open; None: nothing is judged.
        stationary: Whether the run behind the number became stationary.
        steady: Whether the bar asks for that too.
    """

    model: str
    against: str
    quantity: str
    expected: float | str | None = None
    computed: float | str | None = None
    unit: str = "1"
    error: float | None = None
    error_unit: str = "1"
    bar: tuple[float | None, float | None] | None = None
    stationary: bool = True
    steady: bool = False

    @property
    def passed(self) -> bool | None:
        """Whether the error is within the bar, None without one. What could not be computed is a miss."""
        if self.bar is None:
            return None
        low, high = self.bar
        known = self.error is not None and math.isfinite(self.error) and (self.stationary or not self.steady)
        return bool(known and (low is None or self.error >= low) and (high is None or self.error <= high))

    def facts(self) -> dict[str, object]:
        """As ``results.json`` has it; SI units."""
        return {key: _finite(value) for key, value in asdict(self).items()} | {"passed": self.passed}

    def cells(self) -> list[str]:
        """Text in each of ``COLUMNS``."""
        ran = self.error is None or math.isfinite(self.error)
        computed = shown(self.computed, self.unit) + ("" if self.stationary or not ran else " (!)")
        values = [shown(self.expected, self.unit), computed, shown(self.error, self.error_unit, 3)]
        bar = self._bar() + (", steady" if self.steady else "")
        return [self.model, self.against, self.quantity, *values, bar, _VERDICTS[self.passed] if ran else "not run"]

    def _bar(self) -> str:
        match self.bar:
            case None:
                return ""
            case (None, high):
                return f"at most {shown(high, self.error_unit)}"
            case (low, None):
                return f"at least {shown(low, self.error_unit)}"
            case (low, high) if low == -high:
                return f"within {shown(high, self.error_unit)}"
            case (low, high):
                return f"{shown(low, self.error_unit)} to {shown(high, self.error_unit)}"


def relative(model: str, against: str, quantity: str, expected: float, computed: float, unit: str, bar: float | None = None, **more) -> Row:
    """A row whose error is a share of what is expected, to both sides within the bar."""
    error = (computed - expected) / abs(expected)
    return Row(model, against, quantity, expected, computed, unit, error, "share", None if bar is None else (-bar, bar), **more)


def absolute(model: str, against: str, quantity: str, expected: float, computed: float, unit: str, bar: float | None = None, **more) -> Row:
    """A row whose error is a difference in the value's unit, to both sides within the bar."""
    return Row(model, against, quantity, expected, computed, unit, computed - expected, unit, None if bar is None else (-bar, bar), **more)


def limited(model: str, against: str, quantity: str, error: float, unit: str, bar: tuple[float | None, float | None] | None, **more) -> Row:
    """A row of one number, such as a root mean square, that may have bounds."""
    return Row(model, against, quantity, error=error, error_unit=unit, bar=bar, **more)


@dataclass(frozen=True)
class Table:
    """A table beside the one of all checks: columns, and rows of numbers and words."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[float | str]]

    def facts(self) -> dict[str, object]:
        """As ``results.json`` has it."""
        return {"title": self.title, "columns": list(self.columns), "rows": [[_finite(cell) for cell in row] for row in self.rows]}


@dataclass(frozen=True)
class Findings:
    """What a check found; ``note`` says what was run, and what has to be known to read rows and figure."""

    rows: Sequence[Row] = ()
    figure: Figure | None = None
    tables: Sequence[Table] = ()
    note: str = ""


def rms(values: Sequence[float]) -> float:
    """Root mean square."""
    return math.sqrt(sum(value * value for value in values) / len(values))


def shown(value: float | str | None, unit: str = "1", digits: int = 4) -> str:
    """A value in the unit of tables."""
    if value is None or isinstance(value, str):
        return value or ""
    unit, factor = _SHOWN.get(unit, (unit, 1.0))
    return f"{value * factor:z.{digits}g} {unit}".rstrip() if math.isfinite(value) else "none"


def _finite(value):
    """JSON knows no other numbers."""
    return None if isinstance(value, float) and not math.isfinite(value) else value
