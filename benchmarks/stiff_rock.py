"""Error of stiff contacts at 1 ms: the rover's front wheel climbs a fixed rock. ``python -m benchmarks.stiff_rock`` prints the table."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import trimesh

from cdl_fmu.mesh.rocks import rock
from cdl_fmu.rbc import RBC
from cdl_fmu.slave.model import KernelModel, ModelError
from cdl_fmu.vem import VEM
from orchestrator.validate.coupled import Coupled

_WHEEL_LOAD = 27.0 * 9.81  # N
_FINE, _STEP = 5e-5, 1e-3  # s
_TIME, _RATE, _RAMP = 1.2, 2.0, 0.2  # s, rad/s, s


def crossing(bodies: list, contact: KernelModel, hard: dict, h: float, jacobi: bool = False) -> np.ndarray:
    """Height [m] and loads of both wheels [N], each the mean over a millisecond."""
    system = Coupled(contact, bodies, {"start.z": 0.135, "start.x": 0.34}, hard, h=h, jacobi=jacobi)
    rows = []
    for k in range(round(_TIME / h)):
        system.rover.u.command.wheel_rate[:] = _RATE * min(1.0, k * h / _RAMP)
        system.step()
        rows.append((system.rover.y.body.r_0[2], *system.rover.y.applied["f_0"][:, 2]))
    return np.array(rows).reshape(-1, round(_STEP / h), 3).mean(axis=1)


def errors(found: np.ndarray, reference: np.ndarray) -> str:
    """Cells: rms of the load by millisecond and over 20 ms in % of the wheel load, of the height in mm, and the largest load [N]."""
    window, off = np.ones(20) / 20, found - reference
    smooth = np.stack([np.convolve(off[:, i], window, "valid") for i in (1, 2)])
    of_load = [100.0 * np.sqrt(np.mean(values**2)) / _WHEEL_LOAD for values in (off[:, 1:], smooth)]
    return f"{of_load[0]:.0f} | {of_load[1]:.1f} | {1e3 * np.sqrt(np.mean(off[:, 0] ** 2)):.2f} | {found[:, 1:].max():.0f}"


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        slab, stone = trimesh.creation.box((8.0, 2.0, 0.2)), rock(3, (0.22, 0.20, 0.10))
        slab.apply_translation((0.0, 0.0, -0.1))
        slab.export(Path(folder, "floor.stl"))
        stone.export(Path(folder, "rock.stl"))
        bodies = [(Path(folder, "floor.stl"), {"fixed": "on"}), (Path(folder, "rock.stl"), {"fixed": "on", "x": 0.85})]
        print(
            "| contact | scheme | load, 1 ms, % | load, 20 ms, % | height, mm | largest load, N | in the reference |\n" + "|---" * 7 + "|"
        )
        for k in (1e6, 1e7, 1e8):
            for ratio in (0.05, 0.3, 1.0):
                law = {f"body[{j}].{name}": value for j in (1, 2) for name, value in (("k", k), ("damping_ratio", ratio))}
                _compare(f"VEM, {k:.0e} N/m, {ratio:g}", bodies, VEM(2, 0, 2), law | {"effective_mass": 5.0}, ("ij", "jacobi"))
        _compare("RBC", bodies, RBC(2, 2), {}, ("ij",))


def _compare(name: str, bodies: list, contact: KernelModel, hard: dict, schemes: tuple[str, ...]) -> None:
    reference = crossing(bodies, contact, hard, _FINE)
    for scheme in schemes:
        try:
            cells = errors(crossing(bodies, contact, hard, _STEP, scheme == "jacobi"), reference)
        except ModelError as error:
            cells = f"{error} | | |"
        print(f"| {name} | {scheme} | {cells} | {reference[:, 1:].max():.0f} |", flush=True)


if __name__ == "__main__":
    main()
