"""Systems that several tests run: the two-wheel rover on one contact model, wheels at rest, without a driver."""

import sys
from pathlib import Path

from cdl_fmu.slave.build import cached_fmu
from mbs.rover import Rover
from orchestrator.ssp import Connection, read_system, write_system

sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))


def same_names(source, a, target, b):
    """Connections of a's outputs to the inputs of b that have the same name."""
    inputs = {s.name for s in b.scalars["u"]}
    return [Connection(source, s.name, target, s.name) for s in a.scalars["y"] if s.name in inputs]


def rover_on(folder, contact, *, start_z, stop_time=1.0, rover=None, **parameters):
    """The rover on a contact model, read back from the SSP package that it is written to."""
    model, path = Rover(), folder / "system.ssp"
    write_system(
        path,
        "rover_on_contact",
        {"rover": cached_fmu(model), "contact": cached_fmu(contact)},
        same_names("rover", model, "contact", contact) + same_names("contact", contact, "rover", model),
        parameters={"rover": {"start.z": start_z, **(rover or {})}, "contact": parameters},
        stop_time=stop_time,
        step_size=1e-3,
    )
    return read_system(path, folder / "unpacked")
