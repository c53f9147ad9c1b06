"""Direct shear: a sample of a bed between two ribbed plates, periodic at its sides, sheared at constant normal pressure.

Without walls at its sides and without gravity a sample is stressed evenly, and its own strength is what gives way. It is sheared so slowly
that its strength does not depend on speed: by the inertial number v/H d sqrt(rho / p) of the shear rate v/H.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...slave.model import ModelError
from ...soil.measurements import ShearTest
from ...soil.shear import Shear, fit_shear
from ..bed import Bed, porosity_between
from ..particles import V_X, M, R, X
from ..simulation import Simulation, Tool
from .ribs import ribbed_plate

#: Normal pressures of rover wheels [Pa].
PRESSURES = (2e3, 5e3, 1e4, 2e4)
#: Inertial number of the shear: below 1e-3 grains flow as if at rest (GDR MiDi 2004).
INERTIAL_NUMBER = 9e-4
#: Shear displacement over the height of the sample, by which strength is residual; rows of a test, the means of which fluctuate little.
STRAIN, ROWS = 0.5, 100

_APPROACH = 0.1  # own choice: speed at which a plate closes in under its load, over sqrt(p / rho)
_AT_REST = 1e-3  # and below which it has closed in
_LONGEST = 60.0  # heights that it may close in by at that speed
_SUBSTEPS = 10  # of the particles to one of the plate, which is as heavy as the sample
_LEVELS = 12  # where the profile is taken


@dataclass(frozen=True, eq=False)
class ShearRun:
    """A sample sheared under one normal pressure, in rows that are means over equal displacements.

    Attributes:
        p: Normal pressure that is kept [Pa].
        j: Shear displacement [m].
        tau, sigma: Shear stress and normal pressure as measured [Pa].
        porosity: Of the middle of the sample: before the shear, and in each row, one more than rows.
        profile: Mean velocity along the shear over the plate's, in layers of equal height from the bottom to the top.
        inertial_number: Of the shear.
    """

    p: float
    j: np.ndarray
    tau: np.ndarray
    sigma: np.ndarray
    porosity: np.ndarray
    profile: np.ndarray
    inertial_number: float

    @property
    def test(self) -> ShearTest:
        """As ``soil.measurements`` has a test."""
        return ShearTest(f"p{self.p:g}", float(self.sigma.mean()), np.arange(len(self.j)), self.j, self.tau)

    @property
    def peak(self) -> float:
        """Largest shear stress over normal pressure, as ``soil.shear`` takes it."""
        return fit_shear([self.test], c=0.0)[0].tests[0].tau_max / self.test.p

    @property
    def residual(self) -> float:
        """Shear stress over normal pressure, of the last half of the test."""
        half = len(self.j) // 2
        return float(self.tau[half:].mean() / self.sigma[half:].mean())


@dataclass(frozen=True, eq=False)
class VirtualShear:
    """Shear tests of a bed at several normal pressures."""

    runs: tuple[ShearRun, ...]

    @property
    def strength(self) -> Shear:
        """c, phi and K of the largest stresses, as ``cdl identify`` finds them."""
        return fit_shear([run.test for run in self.runs])[0]

    @property
    def strength_without_cohesion(self) -> Shear:
        """The same of a soil that is known to have none."""
        return fit_shear([run.test for run in self.runs], c=0.0)[0]

    @property
    def residual_phi(self) -> float:
        """Angle [rad] of the residual stresses over the pressures, through the origin: mean over the tests, each counting the same."""
        return math.atan(sum(run.residual for run in self.runs) / len(self.runs))

    def write(self, path: str | Path) -> None:
        """Write the tests as a file that ``cdl identify --shear`` reads."""
        with open(path, "w", newline="", encoding="utf-8") as file:
            rows = csv.writer(file)
            rows.writerow(("test", "p_Pa", "j_mm", "tau_Pa"))
            for run in self.runs:
                for j, tau, sigma in zip(run.j, run.tau, run.sigma):
                    rows.writerow((run.test.name, f"{sigma:.6g}", f"{1e3 * j:.6g}", f"{tau:.6g}"))


def shear(
    bed: Bed,
    pressures: Sequence[float] = PRESSURES,
    *,
    strain: float = STRAIN,
    rows: int = ROWS,
    inertial_number: float = INERTIAL_NUMBER,
    threads: int = 1,
    progress: Callable[[float], None] = lambda share: None,
) -> VirtualShear:
    """Shear samples of a bed, each the whole tile, one for each normal pressure.

    Args:
        bed: The tile; its surface and floor are where the plates begin.
        pressures: Normal pressures [Pa].
        strain: Shear displacement over the height of the sample.
        rows: Rows of each test.
        inertial_number: See the module.
        threads: Number of threads.
        progress: Called with the share done.

    Raises:
        ModelError: A pressure is not above 0 Pa, or the sample collapses.
    """
    for p in pressures:
        if not 0.0 < p < math.inf:
            raise ModelError(
                f"normal pressure = {p:g} Pa of a shear test: it must be above 0 Pa and finite; rover wheels have 2e3 to 2e4 Pa"
            )
    runs = []
    for k, p in enumerate(pressures):
        sample = _Sample(bed, p, strain, threads)
        sample.close_in()
        runs.append(sample.run(rows, inertial_number, lambda share, k=k: progress((k + share) / len(pressures))))
    return VirtualShear(tuple(runs))


class _Sample:
    """Particles between two plates, of which the upper one carries a pressure and is moved along x."""

    def __init__(self, bed: Bed, p: float, strain: float, threads: int):
        self.bed, self.p, self.material, self.diameter = bed, p, bed.key.material, bed.key.diameter
        self.area = bed.periods[0] * bed.periods[1]
        top = float((bed.positions[:, 2] + bed.radii).max())
        self.travel = strain * (top - bed.floor)
        plates = [ribbed_plate(bed.periods[0], self.travel, bed.periods[1], self.diameter, down) for down in (False, True)]
        self.bottom, self.top = (
            Tool(self.material, surface=plate, r_0=np.array([0.0, 0.0, z])) for plate, z in zip(plates, (bed.floor, top))
        )
        self.simulation = Simulation(
            bed.positions, bed.radii, self.material, [self.bottom, self.top], gravity=(0.0, 0.0, 0.0), periods=bed.periods, threads=threads
        )
        self.h = _SUBSTEPS * self.simulation.dt
        self.mass = float(self.simulation.bodies[:, M].sum())
        # Force over speed [N.s/m] of a plate that closes in.
        self.damping = p * self.area / (_APPROACH * math.sqrt(p / self.material.density))
        self.speed = 0.0  # of the upper plate, upwards [m/s]

    @property
    def height(self) -> float:
        """Distance of the plates [m]."""
        return float(self.top.r_0[2] - self.bottom.r_0[2])

    def step(self, along: float) -> None:
        """Go on by a step, with the upper plate at a speed [m/s] along x."""
        load = self.top.f_0[2] - self.p * self.area - self.damping * self.speed
        self.speed += self.h * load / self.mass
        self.top.r_0 = self.top.r_0 + self.h * np.array([along, 0.0, self.speed])
        self.simulation.step(self.h)

    def close_in(self) -> None:
        """The plates close in until the sample carries the pressure."""
        speed, steps = _APPROACH * math.sqrt(self.p / self.material.density), 0
        calm = 0
        while calm < 20:
            self.step(0.0)
            steps += 1
            at_rest = abs(self.speed) < _AT_REST * speed / _APPROACH and abs(self.top.f_0[2] / (self.p * self.area) - 1.0) < 0.05
            calm = calm + 1 if at_rest else 0
            if self.height <= 0.0 or steps * self.h * speed > _LONGEST * self.height:
                raise ModelError(
                    f"the sample does not come to rest under p = {self.p:g} Pa: take stiffer particles than E = {self.material.E:g} Pa"
                )

    def run(self, rows: int, inertial_number: float, progress: Callable[[float], None]) -> ShearRun:
        """Shear the sample."""
        along = inertial_number * self.height / self.diameter * math.sqrt(self.p / self.material.density)
        steps = max(round(self.travel / rows / along / self.h), 1)
        j, measured, porosity, profile = [], [], [self._porosity()], np.zeros(_LEVELS)
        begin = self.top.r_0[0]
        for row in range(rows):
            force = np.zeros(2)
            for _ in range(steps):
                self.step(along)
                # The shear is the mean of what both plates feel: the sample between them is at rest but for its fluctuations.
                force += 0.5 * (self.bottom.f_0[0] - self.top.f_0[0]), self.top.f_0[2]
            measured.append(force / steps / self.area)
            j.append(self.top.r_0[0] - begin - 0.5 * steps * self.h * along)
            porosity.append(self._porosity())
            if row >= rows // 2:
                profile += self._profile(along) / (rows - rows // 2)
            progress((row + 1) / rows)
        tau, sigma = np.array(measured).T
        return ShearRun(self.p, np.array(j), tau, sigma, np.array(porosity), profile, inertial_number)

    def _porosity(self) -> float:
        """Of the middle of the sample, half its height."""
        bodies, low = self.simulation.bodies, self.bottom.r_0[2]
        edges = low + self.height * np.array([0.25, 0.75])
        return float(porosity_between(bodies[:, X + 2], bodies[:, R], self.bed.periods, edges)[0])

    def _profile(self, along: float) -> np.ndarray:
        bodies = self.simulation.bodies
        level = np.clip(((bodies[:, X + 2] - self.bottom.r_0[2]) / self.height * _LEVELS).astype(int), 0, _LEVELS - 1)
        number = np.bincount(level, minlength=_LEVELS)
        return np.bincount(level, bodies[:, V_X], _LEVELS) / np.maximum(number, 1) / along
