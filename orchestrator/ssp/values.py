"""Parameter values: parameter sets (SSV) with their mappings (SSM), and their fit to an FMU's variables."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from fmpy.model_description import ModelVariable

from .archive import SspError
from .units import Transform, Unit, unit_of, units_of_file
from .xml import Node, parse_ssp


@dataclass(frozen=True)
class Value:
    """A parameter value: as its file states it, and what it undergoes on its way to a variable."""

    type: str
    text: str
    transform: Transform
    where: str

    def into(self, unit: Unit | None, mapping: Mapping) -> Value:
        """On its way into something of another unit, through a mapping."""
        try:
            transform = self.transform.into(unit, mapping.factor, mapping.offset, mapping.suppress_conversion)
        except ValueError as error:
            raise SspError(f"{self.where}: parameter value {self.text} {error}; state it in a unit of the same quantity") from None
        if self.type != "Real" and not transform.is_identity:
            raise SspError(
                f"{self.where}: a transformation of the {self.type} value {self.text}; only Real values can be transformed, remove it"
            )
        return replace(self, transform=transform)


@dataclass(frozen=True)
class Mapping:
    """Where a parameter of a set goes, and how."""

    target: str
    factor: float = 1.0
    offset: float = 0.0
    suppress_conversion: bool = False


def linear_transformation(node: Node) -> dict[str, float | bool]:
    """Arguments of Transform.into that a connection or mapping entry states."""
    linear = node.child("LinearTransformation")
    factor, offset = (linear.number("factor", 1.0), linear.number("offset", 0.0)) if linear is not None else (1.0, 0.0)
    return {"factor": factor, "offset": offset, "suppress_conversion": node.flag("suppressUnitConversion")}


def bound_values(element: Node, folders: dict[str, Path]) -> Iterator[tuple[Value, Mapping]]:
    """Values and their targets (names within the element) from all parameter bindings of a system or component, the last one counts.

    ``folders`` holds the base folder of relative URIs for each ``sourceBase``.
    """
    for binding in element.children("ParameterBindings", "ParameterBinding"):
        _require_type(binding, "application/x-ssp-parameter-set")
        values = _parameter_set(_document(binding, binding.child("ParameterValues"), "ParameterSet", folders))
        prefix = binding.get("prefix", "")
        mapping = binding.child("ParameterMapping")
        if mapping is None:
            yield from ((value, Mapping(prefix + name)) for name, value in values.items())
            continue
        _require_type(mapping, "application/x-ssp-parameter-mapping")
        for entry in _document(mapping, mapping, "ParameterMapping", folders).children("MappingEntry"):
            source = entry.required("source")
            value = values.get(source.removeprefix(prefix)) if source.startswith(prefix) else None
            if value is None:
                raise SspError(f"{entry.where}: parameter {source!r} is not in the parameter set; add it or remove the mapping entry")
            yield value, Mapping(entry.required("target"), **linear_transformation(entry))


def _document(owner: Node, inline: Node | None, root: str, folders: dict[str, Path]) -> Node:
    """The parameter set or mapping that a binding holds or refers to."""
    if owner.get("source") is not None:
        base = owner.get("sourceBase", "SSD")
        if base not in folders:
            raise SspError(f"{owner.where}: sourceBase = {base!r} of a {owner.local} in a system; use 'SSD'")
        return parse_ssp(owner.path("source", folders[base]), root)
    found = inline.child(root) if inline is not None else None
    if found is None:
        raise SspError(f"{owner.where}: {owner.local} has neither a source nor a {root}; add one")
    return found


def _require_type(node: Node, supported: str) -> None:
    if (kind := node.get("type", supported)) != supported:
        raise SspError(f"{node.where}: {node.local} of type {kind!r} is not supported; use {supported!r}")


def _parameter_set(root: Node) -> dict[str, Value]:
    units = units_of_file(root)
    values: dict[str, Value] = {}
    for parameter in root.children("Parameters", "Parameter"):
        name = parameter.required("name")
        data = next((child for child in parameter if child.local != "Annotations"), None)
        if data is None:
            raise SspError(f"{parameter.where}: parameter {name!r} has no value; add one")
        if name in values:
            raise SspError(f"{parameter.where}: parameter {name!r} occurs twice in its set; remove one")
        values[name] = Value(data.local, data.required("value"), Transform(unit_of(data, units)), data.where)
    return values


def fitted(variable: ModelVariable, value: Value, label: str) -> float | int | bool | str:
    """The value a variable gets, in its own unit; ``label`` names the variable. Raises SspError if its type or bounds do not allow it."""
    items = {item.name: int(item.value) for item in variable.declaredType.items} if variable.type == "Enumeration" else {}
    try:
        match variable.type, value.type:
            case "Real", "Real" | "Integer":
                number = value.transform.factor * float(value.text) + value.transform.offset
            case ("Integer", "Integer") | ("Enumeration", "Integer"):
                number = int(value.text)
            case "Enumeration", "Enumeration":
                number = items[value.text]
            case "Boolean", "Boolean":
                return {"true": True, "1": True, "false": False, "0": False}[value.text]
            case "String", "String":
                return value.text
            case _:
                raise SspError(
                    f"{value.where}: {label} is {variable.type}, its value {value.text!r} is {value.type}; state a {variable.type} value"
                )
    except (ValueError, KeyError):
        allowed = f"one of {', '.join(items)}" if items else f"a {variable.type} value"
        raise SspError(f"{value.where}: {label} = {value.text!r} is not {allowed}; correct it") from None
    if variable.type == "Enumeration" and number not in items.values():
        raise SspError(f"{value.where}: {label} = {number} is no item; use one of {', '.join(items)}")
    low, high = (_bound(variable, side) for side in ("min", "max"))
    unit = f" {variable_unit(variable)}" if variable_unit(variable) else ""
    if not (math.isfinite(number) and low <= number <= high):
        raise SspError(f"{value.where}: {label} = {number:g}{unit} is outside [{low:g}, {high:g}]{unit}; use a value inside")
    return number


def variable_unit(variable: ModelVariable) -> str | None:
    """Name of a variable's unit, its own or its declared type's."""
    return variable.unit or (variable.declaredType.unit if variable.declaredType else None)


def _bound(variable: ModelVariable, side: str) -> float:
    text = getattr(variable, side) or (getattr(variable.declaredType, side) if variable.declaredType else None)
    if text is not None:
        return float(text)
    low, high = (-(2**31), 2**31 - 1) if variable.type == "Integer" else (-math.inf, math.inf)
    return low if side == "min" else high
