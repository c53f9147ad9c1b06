"""Particles, read from the state of the slave that holds them: as VTK files while it runs, and as they are at the end."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import trimesh

from .master import Master
from .ssp import System
from .ssp.system import Component
from .wheels import parameters_of

if TYPE_CHECKING:
    from cdl_fmu.dem.pool import SavedGrains

#: Name of the folder of VTK files in the folder that a run leaves.
FOLDER = "particles"

_SIZES = re.compile(r"cdl_dem_w(\d+)(?:p\d+)?(?:b(\d+))?")
_WHEEL = ("r_w", "b_w", "n_g", "h_g", "t_g")


class Wheel(NamedTuple):
    """A wheel among particles: its centre [m], its axle to the left (unit vector), and the corners of its triangles [m], [n, 3, 3]."""

    centre: np.ndarray
    axle: np.ndarray
    triangles: np.ndarray


class Instant(NamedTuple):
    """Particles and the wheels among them at a time.

    Attributes:
        t: Time [s].
        centres: Centres of the particles [m], [n, 3].
        radii: [m], [n].
        speeds: Of their centres [m/s], [n].
        pressures: Mean stress in each [Pa], [n].
        wheels: The wheels that are there.
    """

    t: float
    centres: np.ndarray
    radii: np.ndarray
    speeds: np.ndarray
    pressures: np.ndarray
    wheels: list[Wheel]


class Film:
    """Looks at the particles of a system each time that it is called with the time [s] and the system's master.

    Args:
        component: The DEM slave.
        folder: Where VTK files of each look go; None: nowhere.

    Attributes:
        last: What the last look saw; None before it, and where there is no particle.
    """

    def __init__(self, component: Component, folder: Path | None):
        self._component, self._folder = component, folder
        self.last: Instant | None = None
        n_wheels, n_bodies = (int(number or 0) for number in _SIZES.fullmatch(component.model_description.modelName).groups())
        files = ["wheel_mesh"] * n_wheels + [f"body[{j + 1}].mesh" for j in range(n_bodies)]
        self._n_wheels, self._shapes = n_wheels, [_triangles(component, name) for name in files]

    def __call__(self, t: float, master: Master) -> None:
        # These load numba, which takes a second; systems without particles do without.
        from cdl_fmu.dem.particles import V_X, R, X
        from cdl_fmu.dem.snapshot import of_saved
        from cdl_fmu.dem.stress import pressure
        from cdl_fmu.dem.tools import POSITION, ROTATION
        from cdl_fmu.dem.vtk import add_instant, placed

        saved = self._saved(master)
        snapshot = of_saved(saved)
        bodies = snapshot.bodies
        tools = []
        for shape, pose, present in zip(self._shapes, saved.arrays["poses"][1:], saved.arrays["present"][1:]):
            centre, T = pose[POSITION : POSITION + 3], pose[ROTATION : ROTATION + 9].reshape(3, 3)
            tools.append(Wheel(centre, T[1], placed(shape, centre, T)) if present else None)
        if self._folder is not None:
            add_instant(self._folder, t, snapshot, [tool.triangles for tool in tools if tool])
        speeds, wheels = np.linalg.norm(bodies[:, V_X : V_X + 3], axis=1), [wheel for wheel in tools[: self._n_wheels] if wheel]
        if len(bodies):
            self.last = Instant(t, bodies[:, X : X + 3], bodies[:, R], speeds, pressure(snapshot), wheels)

    def _saved(self, master: Master) -> SavedGrains:
        from cdl_fmu.dem.pool import GrainPool
        from cdl_fmu.slave.state import State

        data = next(s for s in master.slaves if s.name == self._component.name).to_bytes()
        guid = self._component.model_description.guid  # our FMUs write it first
        return State.from_bytes(data[len(guid) :], GrainPool).pool


def film_of(system: System, folder: Path | None) -> Film | None:
    """A film of the particles of a system, for :func:`orchestrator.run.run`; None if no FMU of it is a DEM with a wheel."""
    for component in system.components.values():
        if _SIZES.fullmatch(component.model_description.modelName):
            return Film(component, folder)
    return None


def _triangles(component: Component, file: str) -> np.ndarray:
    """Corners of the triangles [m] of a wheel or body in its own frame, [n, 3, 3]."""
    from cdl_fmu.dem.vtk import wheel_triangles

    starts = {variable.name: variable.start for variable in component.model_description.modelVariables}
    if path := str(component.parameters.get(file, starts[file]) or ""):
        return np.array(trimesh.load_mesh(component.directory / "resources" / path).triangles)
    return wheel_triangles(**parameters_of(component, list(_WHEEL)))
