"""Particles, tools and stress as VTK files, for ParaView and the like: a folder of instants, which ``particles.pvd`` opens as one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from pyevtk.hl import imageToVTK, pointsToVTK, unstructuredGridToVTK
from pyevtk.vtk import VtkGroup, VtkTriangle

from ..wheel_mesh import wheel_mesh
from .particles import FREE, V_X, W_X, R, X
from .simulation import Simulation
from .snapshot import Snapshot, of_simulation
from .stress import average, coordination, grid_around, pressure

#: Name of the file in the folder that lists all others by time.
COLLECTION = "particles.pvd"

_PARTS = ("particles", "stress", "tools")
_THIN = 0.01  # a grouser without thickness is drawn so thick, in radii of the wheel


def add_instant(folder: Path, t: float, snapshot: Snapshot, tools: Sequence[np.ndarray]) -> None:
    """Add an instant to a folder, made if needed; what it holds of this time and later, of a run before, is deleted.

    Of each particle: radius [m], velocity [m/s], spin [rad/s], ident, free (1 where it moves, 0 where it is held), coordination (number
    of particles that touch it) and pressure (mean stress in it) [Pa]. Of each cell of the grid of ``stress``: stress_xx and so on [Pa],
    compression positive, pressure (their mean) [Pa], solid (share of volume) and velocity [m/s].

    Args:
        folder: Where to.
        t: Time [s].
        snapshot: Particles; of none nothing is added.
        tools: Wheels and bodies, each as the corners of its triangles in the world [m], [n, 3, 3].
    """
    folder.mkdir(parents=True, exist_ok=True)
    listed = _before(folder, t)
    number = 1 + max((int(Path(name).stem.rpartition("_")[2]) for _, name, _ in listed), default=-1)
    written = [_write_particles, _write_stress, *([_write_tools] if tools else [])] if len(snapshot.bodies) else []
    for part, (kind, write) in enumerate(zip(_PARTS, written)):
        path = write(str(folder / f"{kind}_{number:04d}"), tools if kind == "tools" else snapshot)
        listed.append((t, Path(path).name, part))
    partial = folder / "listed"
    group = VtkGroup(str(partial))
    for time, name, part in listed:
        group.addFile(str(folder / name), time, part=str(part), name=_PARTS[part])
    group.save()
    partial.with_suffix(".pvd").replace(folder / COLLECTION)


def add_simulation(folder: Path, simulation: Simulation) -> None:
    """Add what a simulation is now to a folder, at its own time; planes are not drawn. See ``add_instant``."""
    tools = []
    for tool in simulation.tools:
        if tool.surface:
            tools.append(placed(tool.surface.triangles, tool.r_0, tool.T))
        elif tool.wheel:
            tools.append(placed(wheel_triangles(*tool.wheel), tool.r_0, tool.T))
    add_instant(folder, simulation.time, of_simulation(simulation), tools)


def wheel_triangles(r_w: float, b_w: float, n_g: float, h_g: float, t_g: float) -> np.ndarray:
    """Corners of the triangles [m] of the wheel of ``cdl_fmu.wheel.WHEEL`` in its own frame, [n, 3, 3]."""
    return np.array(wheel_mesh(r_w, b_w, n_g, h_g, t_g or _THIN * r_w).triangles)


def placed(triangles: np.ndarray, r_0: np.ndarray, T: np.ndarray) -> np.ndarray:
    """Triangles [m] in the world of a body at r_0 [m] that T turns the world to."""
    return r_0 + triangles @ T


def _before(folder: Path, t: float) -> list[tuple[float, str, int]]:
    """Time, name and part of the files in a folder that are older than t [s]; the others are deleted."""
    path, kept = folder / COLLECTION, []
    if path.exists():
        for entry in ElementTree.parse(path).iter("DataSet"):
            if float(entry.get("timestep")) < t - 1e-9:
                kept.append((float(entry.get("timestep")), entry.get("file"), int(entry.get("part"))))
            else:
                (folder / entry.get("file")).unlink(missing_ok=True)
    return kept


def _write_particles(path: str, snapshot: Snapshot) -> str:
    bodies = snapshot.bodies
    data = dict(
        radius=bodies[:, R].copy(),
        velocity=_vector(bodies[:, V_X : V_X + 3]),
        spin=_vector(bodies[:, W_X : W_X + 3]),
        ident=snapshot.ident,
        free=bodies[:, FREE].astype(np.uint8),
        coordination=coordination(snapshot).astype(np.int32),
        pressure=pressure(snapshot),
    )
    return pointsToVTK(path, *_vector(bodies[:, X : X + 3]), data=data)


def _write_stress(path: str, snapshot: Snapshot) -> str:
    grid = grid_around(snapshot)
    means = average(snapshot, grid)
    # pyevtk knows no tensors; and this one is symmetric at rest only.
    data = {f"stress_{'xyz'[i]}{'xyz'[j]}": means.stress[..., i, j].copy() for i in range(3) for j in range(3)}
    data |= {"pressure": np.trace(means.stress, axis1=3, axis2=4) / 3.0, "solid": means.solid, "velocity": _vector(means.velocity)}
    return imageToVTK(path, tuple(grid.origin.tolist()), tuple(grid.spacing.tolist()), cellData=data)


def _write_tools(path: str, tools: Sequence[np.ndarray]) -> str:
    corners = np.concatenate(tools).reshape(-1, 3)
    n = len(corners) // 3
    number = np.repeat(np.arange(len(tools), dtype=np.int32), [len(tool) for tool in tools])
    cells = np.arange(3 * n, dtype=np.int32), np.arange(3, 3 * n + 1, 3, dtype=np.int32), np.full(n, VtkTriangle.tid, np.uint8)
    return unstructuredGridToVTK(path, *_vector(corners), *cells, cellData={"tool": number})


def _vector(values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Components, each in memory of its own, as pyevtk wants them."""
    return tuple(np.ascontiguousarray(values[..., k]) for k in range(3))
