"""An experiment as a system: its parts connected by name, started on the ground, written as an SSP package."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cdl_fmu.slave.build import cached_fmu
from cdl_fmu.slave.interface import n_pairs
from cdl_fmu.slave.model import Instance, ModelError
from cdl_fmu.slave.native.build import cached_native_fmu
from cdl_fmu.slave.records import Choice
from cdl_fmu.wheel_mesh import wheel_mesh

from .overlaps import overlapping
from .rigs import Contacts, ground_under, start
from .rocks import ROCKS, bed, place
from .settle import Wires
from .ssp import Connection, write_system

#: Outputs that feed nothing and are shown in other tools all the same.
_OBSERVED = ("diagnostics[", "travel", "applied_load")


@dataclass
class Assembly:
    """The parts of an experiment, ready to start: instances by name and their connections."""

    name: str
    instances: dict[str, Instance]
    connections: list[Connection]
    stop_time: float | None
    step: float

    def write(self, path: Path, native: bool = False) -> list[str]:
        """Write an SSP package whose FMUs hold all start values, so that any master starts alike.

        With ``native`` they are native FMUs; where there is none, the FMU is one in Python. Returns what is to be warned of.
        """
        starts = {name: i.changed_starts() for name, i in self.instances.items()}
        in_python = {name: i.model.needs_python for name, i in self.instances.items() if i.model.needs_python or not native}
        write_system(
            path,
            self.name,
            {
                name: (cached_fmu if name in in_python else cached_native_fmu)(i.model, starts[name], _given_files(i))
                for name, i in self.instances.items()
            },
            self.connections,
            parameters={name: _parameters(i, starts[name]) for name, i in self.instances.items()},
            stop_time=self.stop_time,
            step_size=self.step,
            observed=[(name, s.name) for name, i in self.instances.items() for s in i.model.scalars["y"] if s.name.startswith(_OBSERVED)],
        )
        return [f"{name} needs Python in a native system, too: {why}" for name, why in in_python.items() if native]


def assemble(experiment) -> Assembly:
    """Connect the parts of an :class:`~orchestrator.experiment.Experiment` and set them to its start on the ground.

    Raises ModelError if values do not fit together.
    """
    rig, instances = experiment.rig, experiment.instances()
    mover, connections, n_rocks = instances[rig.mover], [], len(experiment.rocks)
    for other in rig.parts:
        if other != rig.mover:
            connections += _connect(rig.mover, mover, other, instances[other]) + _connect(other, instances[other], rig.mover, mover)
    contacts = {}
    for name, instance in instances.items():
        wheels = [i for i, wheel in enumerate(rig.tiers) if experiment.tiers[wheel].lower() == name]
        if not wheels:
            continue
        others = [i for i in range(len(rig.tiers)) if i not in wheels]
        own = {f"{port}[{j + 1}]": f"{port}[{i + 1}]" for i, j in enumerate(wheels) for port in ("wheel", "contact")}
        trailing = {f"wheel[{j + 1}]": f"trailing[{k + 1}]" for k, j in enumerate(others)}
        bodies = {
            f"{rock}[{j + 1}]": f"{body}[{j + 1}]" for j in range(n_rocks) for rock, body in (("rock", "body"), ("support", "support"))
        }
        connections += _connect(rig.mover, mover, name, instance, own | trailing | bodies)
        connections += _connect(name, instance, rig.mover, mover, {there: here for here, there in (own | bodies).items()})
        for before, (other, _) in contacts.items():
            connections += _connect(before, other, name, instance)
        contacts[name] = instance, wheels
    if n_rocks:
        connections += _connect_rocks(rig.mover, mover, instances[ROCKS], len(rig.tiers), n_rocks)
        ground = ground_under(contacts, np.array([(rock.values["x"], rock.values["y"]) for rock in experiment.rocks]))
        place(experiment.rocks, mover, ground)
    wires = Wires(instances, connections)
    start(rig, mover, contacts, wires, experiment.start_is_given)
    if n_rocks:
        _refuse_overlaps(experiment, mover, contacts)
    if n_rocks and "scm" in contacts:
        bed(experiment.rocks, "scm", contacts["scm"][0], wires, float(mover.p.gravity) * math.cos(float(mover.p.slope)))
    settings = experiment.settings
    return Assembly(experiment.name, instances, connections, settings.stop_time, settings.step)


def _refuse_overlaps(experiment, mover: Instance, contacts: Contacts) -> None:
    """Raise ModelError if rocks overlap each other, or one a wheel where it starts."""
    p = next(iter(contacts.values()))[0].p
    tire = wheel_mesh(p.r_w, p.b_w, 0.0, 0.0, 0.0, spacing=0.05)
    placed = enumerate(zip(experiment.rocks, mover.y["rock"]), 1)
    bodies = {f"rock[{j}]": _in_world(rock.surface.triangles, pose) for j, (rock, pose) in placed}
    bodies |= {f"the {name} wheel": _in_world(tire.triangles, pose) for name, pose in zip(experiment.rig.tiers, mover.y["wheel"])}
    if found := overlapping(bodies):
        of_wheel = "move the rock (x, y or buried) or the rover (rover.start.x)"
        remedy = of_wheel if "wheel" in found[1] else "move them apart (x, y), or give them as one mesh"
        raise ModelError(f"{found[0]} and {found[1]} overlap at the start: {remedy}")


def _in_world(triangles: np.ndarray, pose) -> np.ndarray:
    return pose["r_0"] + triangles @ pose["T"]


def _connect_rocks(mover: str, rover: Instance, rocks: Instance, n_wheels: int, n_rocks: int) -> list[Connection]:
    """Connections of a rover and the contact of its wheels with rocks."""
    poses = {f"wheel[{i + 1}]": f"wheel[{i + 1}]" for i in range(n_wheels)} | {f"rock[{j + 1}]": f"body[{j + 1}]" for j in range(n_rocks)}
    answers = {
        f"{port}[{k + 1}]": f"hard[1].{port}[{k + 1}]"
        for port, number in (("wheel", n_wheels), ("body", n_rocks), ("pair", n_pairs(n_wheels, n_rocks)), ("anchor", n_wheels + n_rocks))
        for k in range(number)
    }
    there = _connect(mover, rover, ROCKS, rocks, poses)
    if "inverse_inertia" in rocks.model.inputs.fields:
        rover.set_parameter("with_inverse_inertia", "on")
    return there + _connect(ROCKS, rocks, mover, rover, answers)


def _connect(source: str, a: Instance, target: str, b: Instance, ports: Mapping[str, str] | None = None) -> list[Connection]:
    """Connect outputs of a to the inputs of b that have the same name; where ``ports`` are given, those of wheels and bodies by them.

    ``ports`` maps ports of a to ports of b, ``{"wheel[2]": "trailing[1]"}``; a port of a that is not in it is left alone.
    """
    inputs = {s.name for s in b.model.scalars["u"]}
    connections = []
    for scalar in a.model.scalars["y"]:
        name = scalar.name
        if ports is not None and (port := re.match(r"(wheel|contact|rock|body|support|pair|anchor)\[\d+\]", name)):
            if port[0] not in ports:
                continue
            name = ports[port[0]] + name[port.end() :]
        if name in inputs:
            connections.append(Connection(source, scalar.name, target, name))
    return connections


def _given_files(instance: Instance) -> dict[str, Path]:
    return {name: Path(path) for name, path in instance.files.items() if path}


def _parameters(instance: Instance, starts: Mapping[str, float]) -> dict[str, float | int]:
    fields = {s.name: s.field for s in instance.model.scalars["p"]}
    return {name: int(v) if isinstance(fields[name], Choice) else v for name, v in starts.items() if name in fields}
