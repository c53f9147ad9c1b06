"""A plate pressed into SCM's soil, unloaded and loaded again, against Wong's law of repetitive loading."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cdl_fmu.scm import SCM
from cdl_fmu.slave.model import Instance
from cdl_fmu.soil import load_soil

from .bench import Bench
from .rows import Findings, Row, limited

# Bars: pressure relative to the law's, and the work that a loop dissipates over the work of pressing the plate in.
_PRESSURE, _LOOP = 0.02, 1e-6

_SET, _RADIUS, _CELL = "mss_d", 0.05, 0.005  # [m]
#: Depths [m] from which the plate is measured, where SCM's table of powers is exact, where it is unloaded, and to which it is pressed on.
_FIRST, _DEPTH, _DEEPEST = 0.005, 0.02, 0.03
_POINTS = 100  # of each branch
_LAW = "Wong: p_u - k_u (z_u - z)"
_RATIO = SCM.parameters.fields["unloading_ratio"].start
#: How stiff soil is that is unloaded: constants of the law as SCM has them.
_STIFFNESSES: dict[str, Mapping[str, float]] = {
    "k_0 = 2e7 Pa/m": {"k_0": 2e7},
    "A_u = 5.03e8 Pa/m2": {"A_u": 5.03e8},  # dry sand, LETE sand of Wong's tables
    f"{_RATIO:g} times the slope of Bekker's law": {"unloading_ratio": _RATIO},
}
#: Soil that is pressed and nothing else, and no damping.
_STILL = {"c_d": 0.0, "strength": "plates", "plasticity": 0.0, "transport_depth": 0.0, "erosion_sweeps": 0.0}


@dataclass(frozen=True)
class Branch:
    """One branch of a loading: depths [m], and pressures [Pa] computed and by the law."""

    depth: np.ndarray
    pressure: np.ndarray
    law: np.ndarray

    @property
    def error(self) -> float:
        """Largest error of the pressure, relative to the law's, with its sign."""
        errors = self.pressure / self.law - 1.0
        return float(errors[np.argmax(np.abs(errors))])

    @property
    def work(self) -> float:
        """Work [J/m2] done on the soil."""
        return float(np.trapezoid(self.pressure, self.depth))


def check(bench: Bench) -> Findings:
    """Repetitive loading of SCM"""
    rows = [row for name, stiffness in _STIFFNESSES.items() for row in _rows(name, load(stiffness))]
    note = (
        f"Round plate of {2e3 * _RADIUS:g} mm on the soil of Table 8.2, pressed {1e3 * _DEPTH:g} mm deep, unloaded to half its pressure, "
        f"loaded again and pressed on to {1e3 * _DEEPEST:g} mm; largest errors on each branch. k_u = k_0 + A_u z_u, or unloading_ratio "
        "times the slope of Bekker's law at z_u."
    )
    return Findings(rows, note=note)


def load(stiffness: Mapping[str, float]) -> dict[str, Branch]:
    """The four branches of a loading by their names, on soil of this stiffness: ``k_0`` [Pa/m], ``A_u`` [Pa/m2], ``unloading_ratio``."""
    soil = load_soil(_SET)
    modulus, n = soil["k_c"] / _RADIUS + soil["k_phi"], soil["n"]
    bore = modulus * _DEPTH**n
    k_u = stiffness.get("k_0", 0.0) + stiffness.get("A_u", 0.0) * _DEPTH or stiffness["unloading_ratio"] * n * bore / _DEPTH
    lifted = _DEPTH - 0.5 * bore / k_u
    ends = {
        "loading": (_FIRST, _DEPTH),
        "unloading": (_DEPTH, lifted),
        "reloading": (lifted, _DEPTH),
        "further loading": (_DEPTH, _DEEPEST),
    }
    depths = {name: np.linspace(start, end, _POINTS) for name, (start, end) in ends.items()}
    pressures = _pressures(np.concatenate(list(depths.values())), soil | stiffness).reshape(len(ends), _POINTS)
    laws = {name: bore - k_u * (_DEPTH - z) if name in ("unloading", "reloading") else modulus * z**n for name, z in depths.items()}
    return {name: Branch(depths[name], pressure, laws[name]) for name, pressure in zip(ends, pressures)}


def _pressures(depths: np.ndarray, parameters: Mapping[str, float]) -> np.ndarray:
    """Mean pressure [Pa] below a plate at these depths [m], one after another."""
    import trimesh  # takes most of a second

    with tempfile.TemporaryDirectory() as folder:
        mesh, path = trimesh.creation.cylinder(_RADIUS, 0.02, sections=128), Path(folder, "plate.stl")
        mesh.apply_translation([0.0, 0.0, 0.01])
        mesh.export(path)
        instance = Instance(SCM(1, 0, 1), "scm", **{"body[1].mesh": path, "cell": _CELL}, **_STILL, **parameters)
        instance.u.wheel["active"] = 0.0
        instance.initialise()
    body, forces, h = instance.u.body[0], [], 1e-2
    body["T"][:], body.r_0[2] = np.eye(3), _CELL  # from above: soil is laid around a body that begins in it
    instance.step(0.0, 0.0)
    for k, depth in enumerate(depths):
        body.r_0[2] = -depth
        instance.step(k * h, h)
        forces.append(float(instance.y.body[0].f_0[2]))
    return np.array(forces) / (math.pi * _RADIUS**2)


def _rows(name: str, branches: Mapping[str, Branch]) -> list[Row]:
    laws = {branch: _LAW if branch in ("unloading", "reloading") else "Bekker's law" for branch in branches}
    rows = [
        limited("SCM", laws[branch], f"pressure, {branch}, {name}", found.error, "share", (-_PRESSURE, _PRESSURE))
        for branch, found in branches.items()
    ]
    lost = sum(branches[branch].work for branch in ("unloading", "reloading")) / branches["loading"].work
    return [*rows, limited("SCM", "elastic loop", f"work lost by unloading and reloading, {name}", lost, "share", (-_LOOP, _LOOP))]
