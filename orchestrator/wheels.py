"""Which wheel runs on which contact slave, how large it is, and what a carriage does with it: read off a system, for reports."""

from __future__ import annotations

import re

import trimesh

from .slip import slip_of
from .ssp import System
from .ssp.system import Component

_FORCE = re.compile(r"wheel\[(\d+)\]\.f_0\[1\]")
_TIER = re.compile(r"cdl_([a-z]+)_w\d+")
_HARD, _BODY = re.compile(r"cdl_(rbc|vem)_w\d+b\d+"), re.compile(r"body\[(\d+)\]\.r_0\[1\]")
#: What a result says of a carriage, by the keys of experiments -> the carriage's parameter.
_CARRIAGE = {"load_N": "load", "carriage_speed": "speed", "slip_angle": "slip_angle", "wheel_rate": "wheel_rate"}


def wheels_of(system: System) -> list[dict[str, str | int]]:
    """Wheels of a system as a result names them: name, tier, contact instance, what moves it, its wheel number here and there, from 1.

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
                    "mover": connection.target_component,
                    "rover_index": int(target[1]),
                }
            )
    found.sort(key=lambda wheel: wheel["rover_index"])
    some = {1: ["wheel"], 2: ["front", "rear"]}
    names = some.get(len(found), [f"wheel {w['rover_index']}" for w in found])
    return [{"name": name, **wheel} for name, wheel in zip(names, found)]


def rocks_of(system: System) -> dict[str, object]:
    """The contact of wheels and rocks, and the rocks, as a result names them; empty for a system without.

    ``tier``, ``instance``, and ``rocks``, a list of ``{"port": "rover.rock[1]", "vertices": [[x, y, z], ...], "faces": [[i, j, k], ...]}``:
    the channels of each rock's pose, and its mesh in its own frame [m], from the FMU's resources.
    """
    for component in system.components.values():
        hard = _HARD.fullmatch(component.model_description.modelName)
        ports = {
            int(body[1]): f"{connection.source_component}.{connection.source_variable.rpartition('.')[0]}"
            for connection in system.connections
            if hard and connection.target_component == component.name and (body := _BODY.fullmatch(connection.target_variable))
        }
        if ports:
            rocks = [{"port": ports[j], **_mesh(component, f"body[{j}].mesh")} for j in sorted(ports)]
            return {"tier": hard[1].upper(), "instance": component.name, "rocks": rocks}
    return {}


def _mesh(component: Component, name: str) -> dict[str, list]:
    starts = {variable.name: variable.start for variable in component.model_description.modelVariables}
    path = component.directory / "resources" / str(component.parameters.get(name, starts[name]))
    mesh = trimesh.load_mesh(path)
    return {"vertices": mesh.vertices.round(5).tolist(), "faces": mesh.faces.tolist()}


def ground_of(system: System) -> float:
    """Height of the undeformed ground [m] that the contacts stand on; 0 where none says."""
    for wheel in wheels_of(system):
        if found := parameters_of(system.components[wheel["instance"]], ["ground_z"]):
            return found["ground_z"]
    return 0.0


def environment_of(system: System) -> dict[str, float]:
    """``gravity`` [m/s2], and ``slope`` and ``uphill`` [rad] of the ground, as far as the FMUs of a system declare them."""
    found: dict[str, float] = {}
    for component in system.components.values():
        found = parameters_of(component, ["gravity", "slope", "uphill"]) | found
    return found


def dimensions_of(system: System) -> dict[str, float]:
    """What pictures draw a rover by, as far as its FMUs declare it: ``r_w, b_w, h_g, mass_height`` [m] and the number ``n_g``."""
    found: dict[str, float] = {}
    for component in system.components.values():
        found = parameters_of(component, ["r_w", "b_w", "n_g", "h_g", "mass_height"]) | found
    return found


def carriage_of(system: System) -> dict[str, float]:
    """What the carriage of a single-wheel testbed does, empty for other systems; SI units.

    Returns:
        ``load_N, carriage_speed, slip, slip_angle, wheel_rate`` as experiments have them, and ``full_speed_s``, the time from which on.
    """
    for wheel in wheels_of(system):
        mover = system.components[wheel["mover"]]
        if mover.model_description.modelName.startswith("cdl_carriage_"):
            p = parameters_of(mover, [*_CARRIAGE.values(), "lowering_time", "start_ramp"])
            slip = slip_of(p["speed"], p["wheel_rate"], dimensions_of(system)["r_w"])
            given = {key: p[name] for key, name in _CARRIAGE.items()}
            return given | {"slip": round(slip, 12), "full_speed_s": p["lowering_time"] + p["start_ramp"]}  # 12: as it was asked for
    return {}


def parameters_of(component: Component, names: list[str]) -> dict[str, float]:
    """Values of those of these parameters that a component has."""
    starts = {variable.name: variable.start for variable in component.model_description.modelVariables}
    return {name: float(component.parameters.get(name, starts[name])) for name in names if name in starts}
