"""Which wheel of the rover runs on which contact slave, and how large it is: read off a system, for reports."""

from __future__ import annotations

import re

from .ssp import System

_FORCE = re.compile(r"wheel\[(\d+)\]\.f_0\[1\]")
_TIER = re.compile(r"cdl_([a-z]+)_w\d+")


def wheels_of(system: System) -> list[dict[str, str | int]]:
    """Wheels of a system as a result names them: name, tier, contact instance, its wheel number there and at the rover, from 1.

    A rover with two wheels has a front wheel (1) and a rear wheel (2).
    """
    found = []
    for connection in system.connections:
        source = _FORCE.fullmatch(connection.source_variable)
        target = _FORCE.fullmatch(connection.target_variable)
        if source and target:
            model = system.components[connection.source_component].model_description.modelName
            tier = _TIER.match(model)
            found.append(
                {
                    "tier": tier[1].upper() if tier else model,
                    "instance": connection.source_component,
                    "index": int(source[1]),
                    "rover_index": int(target[1]),
                }
            )
    found.sort(key=lambda wheel: wheel["rover_index"])
    names = ["front", "rear"] if len(found) == 2 else [f"wheel {w['rover_index']}" for w in found]
    return [{"name": name, **wheel} for name, wheel in zip(names, found)]


def ground_of(system: System) -> float:
    """Height of the undeformed ground [m] that the contacts stand on; 0 where none says."""
    for wheel in wheels_of(system):
        component = system.components[wheel["instance"]]
        for variable in component.model_description.modelVariables:
            if variable.name == "ground_z":
                return float(component.parameters.get("ground_z", variable.start))
    return 0.0


def dimensions_of(system: System) -> dict[str, float]:
    """What pictures draw a rover by, as far as its FMUs declare it: ``r_w, b_w, h_g, mass_height`` [m] and the number ``n_g``."""
    found: dict[str, float] = {}
    for component in system.components.values():
        for variable in component.model_description.modelVariables:
            if variable.name in ("r_w", "b_w", "n_g", "h_g", "mass_height") and variable.name not in found:
                found[variable.name] = float(component.parameters.get(variable.name, variable.start))
    return found
