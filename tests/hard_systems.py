"""A driven rover on fixed and free bodies as a system of FMUs."""

from hard import instances
from systems import same_names

from cdl_fmu.slave.model import Instance
from mbs.driver import Driver
from orchestrator.assemble import Assembly, _connect_rocks
from orchestrator.results import open_result
from orchestrator.rocks import ROCKS
from orchestrator.run import run
from orchestrator.ssp import read_system


def drive(folder, contact, rocks, *, rover=None, hard=None, driver=None, stop_time=1.0, scheme="ij", step=1e-3):
    """Outcome and result of the rover on these bodies, steered by nobody.

    Args:
        contact: Model with bodies.
        rocks: Mesh and start of each of them.
        rover, hard, driver: Parameters; without ``driver`` the wheels are held.
    """
    mover, hard_contact = instances(contact, rocks, rover, hard)
    parts = {"rover": mover, ROCKS: hard_contact}
    connections = _connect_rocks("rover", mover, hard_contact, 2, len(rocks))
    if driver is not None:
        parts["driver"] = Instance(Driver(), steer_at=1e6, **driver)
        connections += same_names("driver", parts["driver"].model, "rover", mover.model)
        connections += same_names("rover", mover.model, "driver", parts["driver"].model)
    path = folder / "system.ssp"
    folder.mkdir(exist_ok=True)
    Assembly("rover_on_rocks", parts, connections, stop_time, step).write(path)
    outcome = run(read_system(path, folder / "unpacked"), folder, scheme=scheme, step=step)
    return outcome, open_result(outcome.result).cdl
