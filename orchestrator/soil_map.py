"""The soil's surface, read from the state of the slave that holds it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import xarray as xr

from .master import Master
from .ssp import System


def soil_of(system: System) -> Callable[[Master], xr.DataArray | None] | None:
    """What tells the surface z(x, y) [m] of a system's deforming soil from its master, for :func:`orchestrator.run.run`.

    Returns:
        None if no FMU of the system is an SCM. The function returns None while no soil was touched. Of several SCMs, each of which
        has a soil of its own, it is the first one's.
    """
    name = next((n for n, c in system.components.items() if c.model_description.modelName.startswith("cdl_scm_")), None)
    if name is None:
        return None
    from cdl_fmu.scm.tiles import heights_of  # its kernels take a second to load; systems without soil do without

    def surface(master: Master) -> xr.DataArray | None:
        slave = next(s for s in master.slaves if s.name == name)
        found = heights_of(slave.to_bytes())
        if found is None:
            return None
        axes = {axis: first + found.spacing * np.arange(n) for axis, first, n in zip("xy", found.origin, found.z.shape)}
        return xr.DataArray(found.z, axes, ("x", "y"))

    return surface
