"""Systems that several tests run: the two-wheel rover on one contact model, at rest and without a driver; the shipped experiment."""

import sys
from pathlib import Path

from cdl_fmu.slave.build import cached_fmu
from mbs.rover import Rover
from orchestrator.experiment import load_experiment
from orchestrator.run import run
from orchestrator.soil_map import soil_of
from orchestrator.ssp import Connection, read_system, write_system
from orchestrator.wheels import wheels_of

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


def run_two_wheel(folder, *, tiers, overrides=None, **options):
    """Run the shipped experiment through its FMUs; what :func:`orchestrator.simulate` does, less the picture, which takes most of it."""
    path = folder / "system.ssp"
    folder.mkdir(exist_ok=True)
    load_experiment("two_wheel", tiers=tiers, overrides=overrides).write_system(path)
    system = read_system(path, folder / "unpacked")
    return run(system, folder, soil=soil_of(system), attributes={"wheels": wheels_of(system)}, **options)


#: A rover whose front wheel comes to a rock after half a second; cells are coarse and steps few.
SPARSE_ROCKS = """
title = "One rock"

[run]
stop_time = 1.2

[tiers]
front = "SCM"
rear = "SCM"

[rocks]
tier = "RBC"

[scm]
cell = 0.02

[driver]
wheel_rate = 1.0
start_ramp = 0.1
steer_at = [1e6, 1e6]

[[rock]]
x = 0.82
size = [0.16, 0.16, 0.08]
seed = 3
"""
