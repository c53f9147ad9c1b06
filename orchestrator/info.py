"""What an FMU or a result holds, as tables."""

from __future__ import annotations

import json
import re
from collections.abc import Hashable, Iterator, Mapping
from math import prod
from pathlib import Path

from fmpy.model_description import ScalarVariable
from rich.table import Table

from cdl_fmu.slave.build import cached_fmu
from cdl_fmu.slave.model import ModelError
from fmus import model_of

from .results import ResultError, open_result
from .ssp import UNPACKED
from .ssp.system import Component, load_component
from .terminal import table

_INDEX = re.compile(r"(?<=[\[,])\s*\d+(?=\s*[\],])")
_SHOWN = 9  # start values of an array: those of a matrix


def describe(what: str) -> Iterator[str | Table]:
    """Texts and tables on an FMU (path, or identifier of a model) or a result (path of file or folder).

    Raises:
        ResultError: there is nothing of that name.
        SspError: not a FMI 2.0 co-simulation FMU.
    """
    path = Path(what)
    if path.is_dir() or path.suffix == ".nc":
        return _result(path)
    if not path.exists():
        try:
            path = cached_fmu(model_of(what))
        except ModelError as error:
            raise ResultError(f"no FMU or result {what!r}: give a path, or a name: {error}") from None
    return _fmu(load_component(path.stem, path, UNPACKED))


def fold(facts: Mapping[str, Hashable]) -> Iterator[tuple[str, list[str]]]:
    """Names of array elements that share their facts as one: ``("wheel[1..2].r_0[1..3]", [all six])``.

    Elements that do not fill a whole block of indices stay on their own.
    """
    arrays: dict[Hashable, list[str]] = {}
    for name, fact in facts.items():
        arrays.setdefault((*_INDEX.split(name), fact), []).append(name)
    for (first, *pieces, _), names in arrays.items():
        columns = zip(*([int(index) for index in _INDEX.findall(name)] for name in names))
        bounds = [(min(column), max(column)) for column in columns]
        if prod(high - low + 1 for low, high in bounds) == len(names):
            ranges = (f"{low}" if low == high else f"{low}..{high}" for low, high in bounds)
            yield first + "".join(span + piece for span, piece in zip(ranges, pieces)), names
        else:
            yield from ((name, [name]) for name in names)


def _fmu(component: Component) -> Iterator[str | Table]:
    description = component.model_description
    slave = description.coSimulation
    binaries = sorted(path.name for path in (component.directory / "binaries").glob("*"))
    yield f"{description.modelName} {description.version or ''}"
    if description.description:
        yield description.description
    yield f"guid {description.guid}, made by {description.generationTool or 'an unnamed tool'}"
    yield f"binaries: {', '.join(binaries) or 'none'}"
    can = {"saved": slave.canGetAndSetFMUstate, "serialised": slave.canSerializeFMUstate}
    yield f"its state can be {' and '.join(word for word, able in can.items() if able) or 'neither saved nor serialised'}"
    for causality in ("parameter", "input", "output"):
        variables = {v.name: v for v in description.modelVariables if v.causality == causality}
        if variables:
            columns = ["name", "start", "unit", "bounds", "description"]
            if causality == "output":
                columns.remove("start")
            rows = table(*columns, title=_count(len(variables), causality))
            facts = {name: (v.type, _unit(v), v.min, v.max, v.description) for name, v in variables.items()}
            for folded, names in fold(facts):
                v = variables[names[0]]
                cells = [folded, _unit(v), _bounds(v), _meaning(v)]
                if causality != "output":
                    cells.insert(1, _starts([variables[name] for name in names]))
                rows.add_row(*cells)
            yield rows


def _result(path: Path) -> Iterator[str | Table]:
    result = open_result(path)
    facts = result.attrs
    times = result.time.values
    yield f"{facts.get('title', path)}"
    span = f", {times[0]:g} to {times[-1]:g} s in {_count(len(times), 'row')}" if len(times) else ", no rows"
    yield f"{facts.get('status', 'unknown')}{span}; scheme {facts.get('scheme', 'unknown')}, step {facts.get('step_s', 'unknown')} s"
    for wheel in json.loads(facts.get("wheels", "[]")):
        place = f"{wheel['instance']}.diagnostics[{wheel['index']}], {wheel.get('mover', 'rover')}.wheel[{wheel['rover_index']}]"
        yield f"wheel {wheel['name']}: {wheel['tier']}, {place}"
    environment = json.loads(facts.get("environment", "{}"))
    if environment.get("slope"):
        yield f"x and y lie in a slope of {environment['slope']:g} rad, which rises towards {environment['uphill']:g} rad from x to y"
    if "versions" in facts:
        yield "written with " + ", ".join(f"{name} {version}" for name, version in json.loads(facts["versions"]).items())
    channels = {str(name): facts for name, *facts in zip(result.channel.values, result.unit.values, result.description.values)}
    rows = table("name", "unit", "description", title=_count(len(channels), "channel"))
    for folded, names in fold({name: tuple(facts) for name, facts in channels.items()}):
        rows.add_row(folded, *channels[names[0]])
    yield rows


def _count(n: int, what: str) -> str:
    return f"{n} {what}" if n == 1 else f"{n} {what}s"


def _unit(variable: ScalarVariable) -> str:
    return variable.unit or (variable.declaredType.unit if variable.declaredType else None) or ""


def _short(number: object) -> str:
    """A number without needless digits; FMPy gives numbers as the text they are in the file."""
    try:
        return "" if number is None else f"{float(number):.6g}"
    except ValueError:
        return str(number)


def _bounds(variable: ScalarVariable) -> str:
    low, high = _short(variable.min), _short(variable.max)
    if low and high:
        return f"{low} .. {high}"
    return f">= {low}" if low else f"<= {high}" if high else ""


def _starts(elements: list[ScalarVariable]) -> str:
    starts = [_short(v.start) for v in elements]
    if len(set(starts)) == 1:
        return starts[0]
    return ", ".join(starts[:_SHOWN]) + (", ..." if len(starts) > _SHOWN else "")


def _meaning(variable: ScalarVariable) -> str:
    text = variable.description or ""
    if variable.type == "Enumeration":
        items = ", ".join(f"{item.value} {item.name}" for item in variable.declaredType.items)
        return f"{text}: {items}" if text else items
    return text
