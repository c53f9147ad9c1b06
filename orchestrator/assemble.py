"""An experiment as a system: its parts connected by name, started at rest, written as an SSP package."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from cdl_fmu.slave.build import cached_fmu
from cdl_fmu.slave.model import Instance, ModelError
from cdl_fmu.slave.records import Choice
from cdl_fmu.terrain.raster import load_raster

from .settle import Wires, settle
from .ssp import Connection, write_system

#: Wheels of the rover, in the order of its ports.
WHEELS = ("front", "rear")


@dataclass
class Assembly:
    """The parts of an experiment, ready to start: instances by name and their connections."""

    name: str
    instances: dict[str, Instance]
    connections: list[Connection]
    stop_time: float
    step: float

    def write(self, path: Path) -> None:
        """Write an SSP package whose FMUs hold all start values, so that any master starts alike."""
        starts = {name: _changed_starts(i) for name, i in self.instances.items()}
        write_system(
            path,
            self.name,
            {name: cached_fmu(i.model, starts[name], _given_files(i)) for name, i in self.instances.items()},
            self.connections,
            parameters={name: _parameters(i, starts[name]) for name, i in self.instances.items()},
            stop_time=self.stop_time,
            step_size=self.step,
            observed=[
                (name, s.name) for name, i in self.instances.items() for s in i.model.scalars["y"] if s.name.startswith("diagnostics[")
            ],
        )


def assemble(experiment) -> Assembly:
    """Connect the parts of an :class:`~orchestrator.experiment.Experiment` and set them to its start, at rest on the ground.

    Raises ModelError if values do not fit together.
    """
    instances = experiment.instances()
    rover, driver = instances["rover"], instances["driver"]
    connections = _connect("rover", rover, "driver", driver) + _connect("driver", driver, "rover", rover)
    contacts = {}
    for name, instance in instances.items():
        wheels = [i for i, wheel in enumerate(WHEELS) if experiment.tiers[wheel].lower() == name]
        if not wheels:
            continue
        others = [i for i in range(len(WHEELS)) if i not in wheels]
        own = {f"{port}[{j + 1}]": f"{port}[{i + 1}]" for i, j in enumerate(wheels) for port in ("wheel", "contact")}
        trailing = {f"wheel[{j + 1}]": f"trailing[{k + 1}]" for k, j in enumerate(others)}
        connections += _connect("rover", rover, name, instance, own | trailing)
        connections += _connect(name, instance, "rover", rover, {there: here for here, there in own.items()})
        for before, (other, _) in contacts.items():
            connections += _connect(before, other, name, instance)
        contacts[name] = instance, wheels
    _start(rover, contacts, Wires(instances, connections), experiment.start_is_given)
    settings = experiment.settings
    return Assembly(experiment.name, instances, connections, settings.stop_time, settings.step)


def _start(rover: Instance, contacts: Mapping[str, tuple[Instance, list[int]]], wires: Wires, is_given: bool) -> None:
    """Set the rover's start pose to rest on the ground, unless the user gives one, and the contacts' start inputs to match."""
    p = next(iter(contacts.values()))[0].p
    r_w = float(p.r_w)
    rover.initialise()
    centres = np.array(rover.y["wheel"]["r_0"])
    ground = _ground(contacts, centres)
    if is_given:
        for name, z, low in zip(WHEELS, centres[:, 2], ground):
            where = f"rover.start.z = {float(rover.p.start.z):g} m puts the axle of wheel {name} {abs(z - low):.4g} m"
            remedy = f"use a start.z between {low:g} and {low + 2 * r_w:g} m, or leave it out to start from equilibrium"
            if z < low:
                raise ModelError(f"{where} below the surface: {remedy}")
            if z > low + 2 * r_w:
                raise ModelError(f"{where} above the surface, its rim more than the wheel's radius above it: {remedy}")
    else:
        (front, rear), apart = ground, float(np.linalg.norm((centres[0] - centres[1])[:2]))
        over = {"start.z": float(np.mean(ground)) + r_w + float(p.h_g), "start.pitch": math.atan2(rear - front, apart)}
        rover.set_starts(over)
        rover.set_starts(settle(rover, contacts, wires))
        rover.initialise()
    for name, (contact, _) in contacts.items():
        wires.feed(name)
        contact.initialise()


def _ground(contacts: Mapping[str, tuple[Instance, list[int]]], points: np.ndarray) -> np.ndarray:
    """Heights [m] of the undisturbed ground at points [n, 2 or more]."""
    (first, p), *rest = ((name, contact.p) for name, (contact, _) in contacts.items())
    for name, other in rest:
        if other.ground_z != p.ground_z:
            both = f"{name}.ground_z = {other.ground_z:g} m, but {first}.ground_z = {p.ground_z:g} m"
            raise ModelError(f"{both}: the wheels stand on one ground; set both alike")
    base = next((contact.files["base"] for contact, _ in contacts.values() if contact.files.get("base")), None)
    if base is None:
        return np.full(len(points), float(p.ground_z))
    raster = load_raster(base)
    axes = [first + raster.spacing * np.arange(n) for first, n in zip(raster.origin, raster.z.shape)]
    # Beyond the raster the last slope goes on: the contact that stands there refuses by name.
    return RegularGridInterpolator(axes, raster.z, bounds_error=False, fill_value=None)(points[:, :2])


def _connect(source: str, a: Instance, target: str, b: Instance, ports: Mapping[str, str] | None = None) -> list[Connection]:
    """Connect outputs of a to the inputs of b that have the same name; where ``ports`` are given, those of wheels and contacts by them.

    ``ports`` maps ports of a to ports of b, ``{"wheel[2]": "trailing[1]"}``; a port of a that is not in it is left alone.
    """
    inputs = {s.name for s in b.model.scalars["u"]}
    connections = []
    for scalar in a.model.scalars["y"]:
        name = scalar.name
        if ports is not None and (port := re.match(r"(wheel|contact)\[\d+\]", name)):
            if port[0] not in ports:
                continue
            name = ports[port[0]] + name[port.end() :]
        if name in inputs:
            connections.append(Connection(source, scalar.name, target, name))
    return connections


def _given_files(instance: Instance) -> dict[str, Path]:
    return {name: Path(path) for name, path in instance.files.items() if path}


def _changed_starts(instance: Instance) -> dict[str, float]:
    """Start values of parameters and inputs that differ from the records'."""
    block = instance.block
    return {
        s.name: float(block[instance.slices[part].start + s.offset])
        for part in ("p", "u")
        for s in instance.model.scalars[part]
        if block[instance.slices[part].start + s.offset] != s.start
    }


def _parameters(instance: Instance, starts: Mapping[str, float]) -> dict[str, float | int]:
    fields = {s.name: s.field for s in instance.model.scalars["p"]}
    return {name: int(v) if isinstance(fields[name], Choice) else v for name, v in starts.items() if name in fields}
