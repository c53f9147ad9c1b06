"""Checks of the connections between FMU variables."""

from __future__ import annotations

import re
from collections.abc import Mapping

from fmpy.model_description import ModelVariable

from .archive import SspError
from .system import Component, Connection

_ELEMENT = re.compile(r"(.+)\[([0-9, ]+)\]")


def check_same_type(source: ModelVariable, target: ModelVariable, what: str) -> None:
    """Raises SspError unless both variables have one type, enumerations the same items too; ``what`` names the connection."""
    if source.type != target.type:
        raise SspError(f"{what}: {source.type} to {target.type}; connect variables of one type")
    if source.type == "Enumeration":
        items = [[(item.name, int(item.value)) for item in variable.declaredType.items] for variable in (source, target)]
        if items[0] != items[1]:
            names = [", ".join(name for name, _ in side) for side in items]
            raise SspError(f"{what}: enumerations of different items ({names[0]} to {names[1]}); connect variables of one enumeration")


def check_arrays(components: Mapping[str, Component], connections: list[Connection], values: Mapping[str, Mapping[str, object]]) -> None:
    """Input arrays are fed whole, and from arrays of the same size where one array feeds the other element by element.

    Arrays are known only in FMUs of the structured naming convention. ``values`` are the start values of each component. Raises SspError.
    """
    arrays = {name: _arrays(component) for name, component in components.items()}
    sources = {(c.target_component, c.target_variable): c for c in connections}
    for (component, variable), connection in sources.items():
        array = _split(variable)[0]
        elements = arrays[component].get(array, {})
        if variable != next((name for name in elements.values() if (component, name) in sources), None):
            continue  # each array once, at its first connected element
        missing = [name for name in elements.values() if (component, name) not in sources and name not in values[component]]
        if missing:
            raise SspError(
                f"{component}.{array} has {len(elements)} elements, of which {', '.join(missing)} get no value (size mismatch); "
                "connect all elements or set values"
            )
        feeding = [sources[component, name] for name in elements.values() if (component, name) in sources]
        source_array = _split(connection.source_variable)[0]
        source_elements = arrays[connection.source_component].get(source_array, {})
        whole = [(connection.source_component, source_elements.get(index)) for index in elements]
        if [(c.source_component, c.source_variable) for c in feeding] == whole and len(source_elements) != len(elements):
            raise SspError(
                f"{connection.source_component}.{source_array} has {len(source_elements)} elements, "
                f"{component}.{array} has {len(elements)} (size mismatch); connect arrays of one size"
            )


def _arrays(component: Component) -> dict[str, dict[str, str]]:
    """Array -> index -> variable, of the inputs and outputs."""
    arrays: dict[str, dict[str, str]] = {}
    if component.model_description.variableNamingConvention == "structured":
        for variable in component.model_description.modelVariables:
            array, index = _split(variable.name)
            if index and variable.causality in ("input", "output"):
                arrays.setdefault(array, {})[index] = variable.name
    return arrays


def _split(name: str) -> tuple[str, str]:
    """``wheel[1].T[2,3]`` -> (``wheel[1].T``, ``2,3``); no index: an empty one."""
    match = _ELEMENT.fullmatch(name)
    return (match[1], match[2]) if match else (name, "")
