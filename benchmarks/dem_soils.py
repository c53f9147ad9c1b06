"""Beds made a priori of three soils, none of which the procedure was built with, in virtual tests, beside what is known of the soils.

    python benchmarks/dem_soils.py [soil[:test] ...]

Porosity, where no source tells it, is from rho and grains of 2650 kg/m3; where spheres cannot have it, the nearest is taken. The angle of
repose is that of the grains without cohesion: a heap of cohesive soil stands by its cohesion as high as heaps in a laboratory are. Half an
hour on one core.
"""

from __future__ import annotations

import json
import math
import sys
import time
import warnings
from dataclasses import replace
from pathlib import Path

from cdl_fmu import load_soil
from cdl_fmu.dem.apriori import POROSITIES, grains_of
from cdl_fmu.dem.bed import Bed, BedKey
from cdl_fmu.dem.settle import settle
from cdl_fmu.dem.sizes import Uniform
from cdl_fmu.dem.virtual.plate import plates
from cdl_fmu.dem.virtual.repose import repose
from cdl_fmu.dem.virtual.shear import shear

EARTH, MOON = (0.0, 0.0, -9.81), (0.0, 0.0, -1.62)
#: Soils, and gravity where their plates were pressed: Apollo's on the Moon.
SOILS = {"cmu_sand": EARTH, "mss_d": EARTH, "lunar_nominal": MOON}
QUARTZ = 2650.0  # kg/m3
SPREAD = 0.1  # of the diameters, about their mean
PRESSURES, SINKAGE, WIDTH = (4e3, 1e4, 2e4), 0.02, 0.08


class Case:
    """A soil and its grains."""

    def __init__(self, name: str):
        self.name, self.soil = name, load_soil(name)
        self.own_porosity = 1.0 - self.soil["rho"] / QUARTZ
        self.porosity = min(max(self.own_porosity, POROSITIES[0]), POROSITIES[1])
        self.grains = grains_of(*(self.soil[key] for key in ("phi", "c", "rho")), self.porosity)

    def bed(self, diameter: float, depth: float, size: tuple[float, float], grains=None) -> Bed:
        """A bed of the soil."""
        sizes = Uniform((1.0 - SPREAD) * diameter, (1.0 + SPREAD) * diameter)
        return settle(BedKey(grains or self.grains, sizes, self.porosity, depth, size))

    def grain(self) -> dict[str, object]:
        """The grains."""
        found = {key: getattr(self.grains, key) for key in ("E", "mu", "mu_r", "cohesion", "density")}
        return dict(own_porosity=self.own_porosity, porosity=self.porosity) | found

    def shear(self) -> dict[str, object]:
        """Direct shear; phi through the origin where the soil has no cohesion, as the sets of soils were found."""
        tests = shear(self.bed(0.005, 0.06, (0.066, 0.066)), PRESSURES, strain=0.3, inertial_number=2e-3)
        strength = tests.strength if self.soil["c"] > 0.0 else tests.strength_without_cohesion
        return dict(
            phi=math.degrees(strength.phi),
            input=math.degrees(self.soil["phi"]),
            c=strength.c,
            input_c=self.soil["c"],
            residual=math.degrees(tests.residual_phi),
            K=strength.K,
            peaks=[math.degrees(math.atan(run.peak)) for run in tests.runs],
        )

    def repose(self) -> dict[str, object]:
        """Angle of repose."""
        heap = repose(self.bed(0.005, 0.08, (0.132, 0.022), replace(self.grains, cohesion=0.0)), wall_speed=0.2)
        return dict(angle=math.degrees(heap.angle), input=math.degrees(self.soil["phi"]))

    def plates(self) -> dict[str, object]:
        """Plates, k_eq at 20 mm for the middle one."""
        bed = self.bed(0.008, 0.13, (0.1, 0.1))
        tests = plates(replace(bed, key=replace(bed.key, gravity=SOILS[self.name])), speed=0.1)
        law, soil = tests.sinkage, self.soil

        def stiffness(k_c: float, k_phi: float, n: float, diameter: float) -> float:
            return (k_c / (0.5 * diameter) + k_phi) * SINKAGE ** (n - 1.0)

        own = {run.diameter: stiffness(soil["k_c"], soil["k_phi"], soil["n"], run.diameter) for run in tests.runs}
        found = {run.diameter: stiffness(law.k_c, law.k_phi, law.n, run.diameter) for run in tests.runs}
        return dict(
            own={f"{d:g}": p for d, p in own.items()},
            found={f"{d:g}": p for d, p in found.items()},
            ratio=found[WIDTH] / own[WIDTH],
            k_c=law.k_c,
            k_phi=law.k_phi,
            n=law.n,
        )

    def bearing(self) -> dict[str, object]:
        """k_eq at 20 mm [Pa/m] of the middle plate on rigid-plastic soil of this phi, c and rho (Meyerhof 1963), and over the soil's."""
        phi, c, rho, g = (*(self.soil[key] for key in ("phi", "c", "rho")), math.hypot(*SOILS[self.name]))
        passive = math.tan(math.pi / 4.0 + phi / 2.0) ** 2
        n_q = passive * math.exp(math.pi * math.tan(phi))
        of_cohesion = (n_q - 1.0) / math.tan(phi) * (1.0 + 0.2 * passive)  # factors of shape: a plate as wide as long
        of_depth, of_width = n_q, (n_q - 1.0) * math.tan(1.4 * phi)
        p = c * of_cohesion + rho * g * (SINKAGE * of_depth + 0.5 * WIDTH * of_width) * (1.0 + 0.1 * passive)
        own = (self.soil["k_c"] / (0.5 * WIDTH) + self.soil["k_phi"]) * SINKAGE ** (self.soil["n"] - 1.0)
        return dict(k_eq=p / SINKAGE, over_own=p / SINKAGE / own)


def main() -> None:
    """Print the results, and write them beside this file."""
    warnings.simplefilter("ignore")
    path = Path(__file__).with_suffix(".json")
    found = json.loads(path.read_text()) if path.exists() else {}
    for asked in sys.argv[1:] or SOILS:
        name, _, test = asked.partition(":")
        case = Case(name)
        for one in [test] if test else ("grain", "bearing", "shear", "repose", "plates"):
            result = getattr(case, one)()
            found.setdefault(name, {})[one] = result
            path.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
            print(f"{time.strftime('%H:%M:%S')} {name} {one} {result}", flush=True)


if __name__ == "__main__":
    main()
