"""The soil's surface, read from the state of the slave that holds it."""

from __future__ import annotations

from collections.abc import Callable

from .master import Master
from .results_soil import Surface
from .ssp import System


def soil_of(system: System) -> Callable[[Master], Surface | None] | None:
    """What tells the surface of a system's deforming soil from its master, for :func:`orchestrator.run.run`.

    Returns:
        None if no FMU of the system is an SCM. The function returns None while no soil was touched. Of several SCMs, each of which
        has a soil of its own, it is the first one's.
    """
    scm = next((c for c in system.components.values() if c.model_description.modelName.startswith("cdl_scm_")), None)
    if scm is None:
        return None
    # These load numba, which takes a second; systems without soil do without.
    from cdl_fmu.scm.pool import SoilPool, heights
    from cdl_fmu.slave.state import State

    start = next(v.start for v in scm.model_description.modelVariables if v.name == "cell")
    cell = float(scm.parameters.get("cell", start))

    def surface(master: Master) -> Surface | None:
        data = next(s for s in master.slaves if s.name == scm.name).to_bytes()
        state = State.from_bytes(data[len(scm.model_description.guid) :], SoilPool)  # our FMUs write their GUID first
        found = heights(state.pool, cell)
        return found and Surface(found.origin, found.spacing, found.z)

    return surface
