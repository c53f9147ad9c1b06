"""Virtual tests of a soil of particles: grains by the a-priori procedure, tested as soil is, with files that ``cdl identify`` reads."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cdl_fmu.dem.apriori import grains_of
from cdl_fmu.dem.bed import BedKey
from cdl_fmu.dem.library import Library
from cdl_fmu.dem.material import Material
from cdl_fmu.dem.memory import check_memory
from cdl_fmu.dem.scaling import check_feature
from cdl_fmu.dem.simulation import check_threads
from cdl_fmu.dem.sizes import Uniform
from cdl_fmu.dem.virtual.plate import DEPTH, DIAMETERS, SINKAGE, WIDTH, plates
from cdl_fmu.dem.virtual.repose import repose
from cdl_fmu.dem.virtual.shear import shear
from cdl_fmu.slave.model import ModelError
from cdl_fmu.soil.identify import Identification, identify

from .terminal import stages

PLATES, SHEAR, SOIL_FILE = "plates.csv", "shear.csv", "soil.toml"
#: Depth at which a plate's pressure is compared [m].
COMPARED = 0.02
_SPREAD = 0.1  # of diameters, each way
# Own choices, in mean diameters: sides and depths of the tiles that are sheared and that stand as a slope.
_SHEARED, _SLOPE = (16.0, 16.0), (40.0, 16.0)
_BREADTH = 8.0


@dataclass(frozen=True, eq=False)
class VirtualSoil:
    """What virtual tests found of a soil.

    Attributes:
        given: phi [rad], c [Pa], rho [kg/m3] that the grains were made from, and the porosity.
        material: The grains.
        found: What ``cdl identify`` finds from the files.
        repose: Angles of repose [rad], one for each seed.
        pressure: Pressure of each plate at ``COMPARED`` [Pa], by its diameter [m].
    """

    given: Mapping[str, float]
    material: Material
    found: Identification
    repose: tuple[float, ...]
    pressure: Mapping[float, float]

    @property
    def grains(self) -> dict[str, float]:
        """Numbers of the grains by their names as parameters."""
        return {name: getattr(self.material, name) for name in ("E", "nu", "e", "mu", "mu_r", "cohesion", "density")}

    def facts(self) -> dict[str, object]:
        """All of it for ``--json``; SI units."""
        values = {key: value.value for key, value in self.found.values.items()}
        return {
            "given": dict(self.given),
            "grains": self.grains,
            "found": values,
            "repose_rad": list(self.repose),
            "pressure_at_20_mm_Pa": {f"{diameter:g}": p for diameter, p in self.pressure.items()},
        }


def run_virtual_tests(
    given: Mapping[str, float],
    out: Path,
    *,
    d: float = 0.008,
    seeds: int = 2,
    threads: int = 1,
    material: Material | None = None,
    status: Callable[[str], None] = lambda text: None,
) -> VirtualSoil:
    """Shear, slope and plates on beds of one soil; leaves ``plates.csv``, ``shear.csv`` and ``soil.toml`` in a folder.

    Args:
        given: phi [rad], c [Pa], rho [kg/m3] and porosity.
        out: Folder.
        d: Mean diameter of the particles [m].
        seeds: Number of beds on which the angle of repose is measured, each in minutes; 0 leaves it out.
        threads: Number of threads.
        material: The grains; None: by the a-priori procedure from ``given``.
        status: Called with what is being done, and the time left of it.

    Raises:
        ModelError: No bed has these parameters, particles are too large for the plates or too many for this machine's memory.
    """
    if not 0.0 < d < math.inf:
        raise ModelError(f"d = {d:g} m: the mean diameter of the particles must be above 0 m and finite")
    check_threads(threads)
    check_feature("diameter of the smallest plate", min(DIAMETERS), d)
    material = material or grains_of(**given)
    library, sizes, widest = Library(), Uniform((1.0 - _SPREAD) * d, (1.0 + _SPREAD) * d), max(DIAMETERS)
    deep = DEPTH * widest + SINKAGE
    check_memory(math.ceil((1.0 - given["porosity"]) * deep * (WIDTH * widest) ** 2 / sizes.mean_volume))
    out.mkdir(parents=True, exist_ok=True)

    def bed(sides: tuple[float, float], depth: float, seed: int = 1):
        key = BedKey(material, sizes, given["porosity"], depth, sides, seed=seed)
        return library.get(key, stages(status, "settling a bed of particles"))

    sheared = shear(bed((_SHEARED[0] * d,) * 2, _SHEARED[1] * d), threads=threads, progress=_one(status, "direct shear"))
    sheared.write(out / SHEAR)
    angles = []
    for seed in range(1, seeds + 1):
        slope = bed((_SLOPE[0] * d, _BREADTH * d), _SLOPE[1] * d, seed)
        angles.append(repose(slope, threads=threads, progress=_one(status, f"angle of repose, {seed} of {seeds}")).angle)
    pressed = plates(bed((WIDTH * widest,) * 2, deep), threads=threads, progress=_one(status, "plates"))
    pressed.write(out / PLATES)
    found = identify(out / PLATES, out / SHEAR, rho=given["rho"])
    found.write(out / SOIL_FILE)
    pressure = {run.diameter: run.pressure(COMPARED) for run in pressed.runs}
    return VirtualSoil(dict(given), material, found, tuple(angles), pressure)


def angle_of_repose(angles: tuple[float, ...]) -> tuple[float, float]:
    """Mean [deg] of angles [rad], and their standard deviation, NaN for one."""
    degrees = np.degrees(angles)
    return float(degrees.mean()), float(degrees.std(ddof=1)) if len(degrees) > 1 else math.nan


def _one(status: Callable[[str], None], stage: str) -> Callable[[float], None]:
    told = stages(status, "virtual tests")
    return lambda share: told(stage, share)
