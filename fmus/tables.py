"""Every variable of every shipped FMU, from the models' declarations: ``python -m fmus.tables`` writes ``fmus/tables.md`` anew."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from cdl_fmu.slave.model import Model
from cdl_fmu.slave.records import Array, Choice, Real, Record

from . import SHIPPED

FILE = Path(__file__).with_name("tables.md")
COMMAND = "python -m fmus.tables"

_HEAD = f"""# Variables of the FMUs

Written by `{COMMAND}` from the declarations of the models: do not edit. [README.md](README.md) says what the FMUs are for and how
they are connected.

A row is a variable or an array: `wheel[i].r_0[3]` is `wheel[1].r_0[1]`, `wheel[1].r_0[2]`, `wheel[1].r_0[3]`, then the same of wheel 2.
Start, bounds and meaning hold for each element; elements that start differently are listed, row by row. A choice is an Enumeration, whose
start is named. A file is a String, the path of a file; empty = none. The unit `1` is none. Bounds are inclusive: a parameter or input
beyond them is refused, with its name, unit and bound. Outputs have no start.

Each kind of FMU has its whole table once, for its smallest size; below stands what larger sizes have besides.
"""
_COLUMNS = ("Variable", "Causality", "Unit", "Start", "Min", "Max", "Meaning")
_CAUSALITY = {"parameters": "parameter", "inputs": "input", "outputs": "output"}


def fmu_tables() -> str:
    """The whole file in Markdown."""
    parts = [_HEAD, _table(("FMU", "Parameters", "Inputs", "Outputs", "What it is"), map(_counts, SHIPPED))]
    families: dict[type[Model], list[Model]] = {}
    for model in sorted(SHIPPED, key=lambda model: sum(model.sizes.values())):
        families.setdefault(type(model), []).append(model)
    for models in families.values():
        told: set[tuple[str, str]] = set()
        for model in models:
            rows = {(causality, name): cells for causality, name, *cells in _rows(model)}
            new = {key: cells for key, cells in rows.items() if key not in told}
            if told and new:
                parts.append(f"`{model.identifier}` has besides:\n")
            elif not told:
                parts.append(f"## `{model.identifier}`\n\n{_title(model)}\n{_feedthrough(model)}")
            if new:
                parts.append(_table(_COLUMNS, ((cells[0], causality, *cells[1:]) for (causality, _), cells in new.items())))
            told |= new.keys()
    return "\n".join(parts)


def _title(model: Model) -> str:
    return (type(model).__doc__ or "").split("\n")[0]


def _counts(model: Model) -> tuple[str, ...]:
    n_parameters = len(model.parameters) + len(model.files)
    return f"`{model.identifier}`", str(n_parameters), str(len(model.inputs)), str(len(model.outputs)), _title(model)


def _feedthrough(model: Model) -> str:
    return "" if model.feedthrough else "No output at a time depends on an input at that time: a master may begin here.\n"


def _rows(model: Model) -> Iterator[tuple[str, ...]]:
    """Causality, name that is the same in all sizes, then what the row shows: name with shape, unit, start, bounds, meaning."""
    for part, causality in _CAUSALITY.items():
        for name, field in _fields(getattr(model, part)):
            shape = f"[{','.join(map(str, field.shape))}]" if field.shape else ""
            shown = f"`{name}{shape}`"
            starts = "" if causality == "output" else _starts(field)
            if isinstance(field, Choice):
                options = "; ".join(f"`{option}`: {meaning}" for option, meaning in field.options.items())
                yield causality, name, shown, "choice", starts, "", "", f"{field.description}. {options}"
            else:
                yield causality, name, shown, field.unit, starts, _bound(field.min), _bound(field.max), field.description
        if part == "parameters":
            for name, description in model.files.items():
                name = name.replace("[1]", "[i]")
                yield causality, name, f"`{name}`", "file", "", "", "", description


def _fields(record: Record, prefix: str = "", indices: str = "ij") -> Iterator[tuple[str, Real | Choice]]:
    for name, field in record.fields.items():
        if isinstance(field, Array):
            if field.n:
                yield from _fields(field.record, f"{prefix}{name}[{indices[0]}].", indices[1:])
        elif isinstance(field, Record):
            yield from _fields(field, f"{prefix}{name}.", indices)
        else:
            yield f"{prefix}{name}", field


def _starts(field: Real | Choice) -> str:
    starts = field.starts()
    if isinstance(field, Choice):
        return list(field.options)[int(starts) - 1]
    if starts.ndim == 2 and np.array_equal(starts, np.eye(len(starts))):
        return "identity"
    numbers = [f"{start:.6g}" for start in starts.flat]
    return numbers[0] if len(set(numbers)) == 1 else ", ".join(numbers)


def _bound(bound: float) -> str:
    return f"{bound:.6g}" if np.isfinite(bound) else ""


def _table(columns, rows) -> str:
    lines = [columns, ("---",) * len(columns), *([cell.replace("|", r"\|") for cell in row] for row in rows)]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


if __name__ == "__main__":
    FILE.write_text(fmu_tables(), encoding="utf-8")
    print(FILE)
