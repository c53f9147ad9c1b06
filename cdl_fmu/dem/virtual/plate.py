"""Bevameter: round plates pressed into a bed at constant speed, for Bekker's sinkage parameters.

The bed repeats itself at its sides, which act as smooth walls. Sinkage counts from where the plate touches: grains are coarse, and it meets
the highest of them well above the mean surface.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...slave.model import ModelError
from ...soil.measurements import PlateTest
from ...soil.sinkage import Sinkage, fit_sinkage
from ..bed import Bed, replicate
from ..scaling import check_feature
from ..simulation import Tool

#: Diameters of the plates [m], and how deep they are pressed [m].
DIAMETERS, SINKAGE = (0.06, 0.08, 0.1), 0.025
#: Speed of the plates [m/s].
SPEED = 0.05
#: Share of a test's largest pressure with which it has touched the soil; as in ``soil.sinkage``.
TOUCHES = 0.01
#: Least width and depth of the bed in diameters of the plate; the tile is replicated until it is as wide.
WIDTH, DEPTH = 2.0, 1.0
#: Rows of a test.
ROWS = 50

_LYING = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # T of a wheel with its axle upright


@dataclass(frozen=True, eq=False)
class PlateRun:
    """A plate pressed into a bed, in rows that are means over equal sinkages.

    Attributes:
        diameter: Of the plate [m].
        z: Sinkage from where the plate touches [m]; below 0 before.
        p: Pressure [Pa].
    """

    diameter: float
    z: np.ndarray
    p: np.ndarray

    @property
    def test(self) -> PlateTest:
        """As ``soil.measurements`` has a test."""
        kept = (self.z > 0.0) & (self.p > 0.0)
        return PlateTest(f"D{1e3 * self.diameter:g}", 0.5 * self.diameter, np.flatnonzero(kept), self.z[kept], self.p[kept])

    def pressure(self, z: float) -> float:
        """Pressure [Pa] at a sinkage [m]: a straight line through the rows within a fifth of it, which levels their fluctuations."""
        near = np.abs(self.z - z) <= 0.2 * z
        return float(np.polyval(np.polyfit(self.z[near] - z, self.p[near], 1), 0.0))


@dataclass(frozen=True, eq=False)
class VirtualPlates:
    """Plate tests of a bed."""

    runs: tuple[PlateRun, ...]

    @property
    def sinkage(self) -> Sinkage:
        """Bekker's k_c, k_phi and n, as ``cdl identify`` finds them."""
        return fit_sinkage([run.test for run in self.runs])[0]

    def write(self, path: str | Path) -> None:
        """Write the tests as a file that ``cdl identify`` reads."""
        with open(path, "w", newline="", encoding="utf-8") as file:
            rows = csv.writer(file)
            rows.writerow(("test", "plate_diam_mm", "z_mm", "p_Pa"))
            for run in self.runs:
                for z, p in zip(run.test.z, run.test.p):
                    rows.writerow((run.test.name, f"{1e3 * run.diameter:.6g}", f"{1e3 * z:.6g}", f"{p:.6g}"))


def plates(
    bed: Bed,
    diameters: Sequence[float] = DIAMETERS,
    *,
    sinkage: float = SINKAGE,
    speed: float = SPEED,
    rows: int = ROWS,
    threads: int = 1,
    progress: Callable[[float], None] = lambda share: None,
) -> VirtualPlates:
    """Press plates into a bed, each into soil of its own.

    Args:
        bed: The tile.
        diameters: Of the plates [m].
        sinkage: How deep they are pressed from where they touch, at least [m].
        speed: [m/s].
        rows: Rows of each test.
        threads: Number of threads.
        progress: Called with the share done.

    Raises:
        ModelError: The bed is too shallow for a plate, or a plate below 2 diameters of its particles.
    """
    for diameter in diameters:
        check_feature("diameter of the plate", diameter, bed.key.diameter)
        least = DEPTH * diameter + sinkage
        if bed.key.depth < least:
            raise ModelError(
                f"the bed is {bed.key.depth:g} m deep: for a plate of {diameter:g} m pressed in by {sinkage:g} m it must be at least "
                f"{least:g} m ({DEPTH:g} diameters below the plate); make it deeper, or take a smaller plate"
            )
    return VirtualPlates(
        tuple(
            _press(bed, diameter, sinkage, speed, rows, threads, lambda share, k=k: progress((k + share) / len(diameters)))
            for k, diameter in enumerate(diameters)
        )
    )


def _press(bed: Bed, diameter: float, sinkage: float, speed: float, rows: int, threads: int, progress: Callable[[float], None]) -> PlateRun:
    copies = (max(math.ceil(WIDTH * diameter / period - 1e-9), 1) for period in bed.periods)
    wide = replicate(bed, *copies)
    top = float((wide.positions[:, 2] + wide.radii).max())
    thick = 2.0 * (bed.key.diameter + sinkage)  # nothing falls on it
    centre = np.array([0.5 * wide.periods[0], 0.5 * wide.periods[1], 0.5 * thick + top])
    plate = Tool(bed.key.material, wheel=(0.5 * diameter, thick, 0.0, 0.0, 0.0), r_0=centre, T=_LYING)
    simulation = wide.simulation([plate], threads=threads)
    area, row = 0.25 * math.pi * diameter**2, sinkage / rows
    p = []
    # The highest grain may be beside the plate: it touches others within a diameter.
    for k in range(rows + math.ceil(bed.key.diameter / row)):
        plate.r_0 = centre - [0.0, 0.0, (k + 1) * row]
        simulation.step(row / speed)
        p.append(plate.f_0[2] / area)
        progress((k + 1) * row / (sinkage + bed.key.diameter))
    p = np.array(p)
    touched = int(np.argmax(p > TOUCHES * p.max()))
    return PlateRun(diameter, (np.arange(len(p)) - touched + 0.5) * row, p)
