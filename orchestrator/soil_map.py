"""The soil's surface, read from the state of the slave that holds it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from .master import Master
from .results_soil import Surface
from .ssp import System
from .ssp.system import Component

if TYPE_CHECKING:
    from cdl_fmu.slave.pool import Pool


#: Distance of nodes in the map of a soil of particles [m]: as cells of SCM are by default.
_SPACING = 0.01


def soil_of(system: System) -> Callable[[Master], Surface | None] | None:
    """What tells the surface of a system's deforming soil from its master, for :func:`orchestrator.run.run`.

    Returns:
        None if no FMU of the system is an SCM or a DEM. The function returns None while no soil was touched. Of several, each of which
        has a soil of its own, it is the first one's.
    """
    for component in system.components.values():
        identifier = component.model_description.modelName
        if identifier.startswith("cdl_scm_"):
            return _of(component, _cells(component))
        if identifier.startswith("cdl_dem_"):
            return _of(component, _particles())
    return None


def _of(component: Component, soil: tuple[type[Pool], Callable[[object], Surface | None]]) -> Callable[[Master], Surface | None]:
    from cdl_fmu.slave.state import State

    pool_class, surface_of = soil

    def surface(master: Master) -> Surface | None:
        data = next(s for s in master.slaves if s.name == component.name).to_bytes()
        state = State.from_bytes(data[len(component.model_description.guid) :], pool_class)  # our FMUs write their GUID first
        return surface_of(state.pool)

    return surface


# These load numba, which takes a second; systems without soil do without.


def _cells(component: Component) -> tuple[type[Pool], Callable[[object], Surface | None]]:
    from cdl_fmu.scm.pool import SoilPool, heights

    start = next(v.start for v in component.model_description.modelVariables if v.name == "cell")
    cell = float(component.parameters.get("cell", start))

    def surface(saved) -> Surface | None:
        found = heights(saved, cell)
        return found and Surface(found.origin, found.spacing, found.z)

    return SoilPool, surface


def _particles() -> tuple[type[Pool], Callable[[object], Surface | None]]:
    from cdl_fmu.dem.patches import touched_heights
    from cdl_fmu.dem.pool import GrainPool

    def surface(saved) -> Surface | None:
        found = touched_heights(saved.ground, saved.arrays["body"], _SPACING)
        return found and Surface(tuple(found[0].tolist()), _SPACING, found[1])

    return GrainPool, surface
