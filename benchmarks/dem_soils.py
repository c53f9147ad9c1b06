"""Beds made a priori of three soils, none of which the procedure was built with, in virtual tests, beside what is known of the soils.

    python benchmarks/dem_soils.py [soil ...]

Grains' density is 2650 kg/m3 where porosity is not known; a porosity out of reach is replaced by the nearest. An hour on one core.
"""

from __future__ import annotations

import json
import math
import sys
import time
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np

from cdl_fmu import load_soil
from cdl_fmu.dem.apriori import POROSITIES, grains_of
from cdl_fmu.dem.bed import BedKey
from cdl_fmu.dem.settle import settle
from cdl_fmu.dem.sizes import Uniform
from cdl_fmu.dem.virtual.plate import plates
from cdl_fmu.dem.virtual.repose import repose
from cdl_fmu.dem.virtual.shear import shear

EARTH, MOON = (0.0, 0.0, -9.81), (0.0, 0.0, -1.62)
#: Soils, and gravity where their plates were pressed: Apollo's on the Moon.
SOILS = {"cmu_sand": EARTH, "mss_d": EARTH, "lunar_nominal": MOON}
GRAINS = 2650.0  # quartz [kg/m3]
FINE, COARSE = Uniform(4.5e-3, 5.5e-3), Uniform(7.2e-3, 8.8e-3)
PRESSURES, SEEDS = (4e3, 1e4, 2e4), (0, 1)
SINKAGE = 0.02


def measured(name: str) -> dict[str, object]:
    """Virtual tests of a soil."""
    soil = load_soil(name)
    own = 1.0 - soil["rho"] / GRAINS
    porosity = min(max(own, POROSITIES[0]), POROSITIES[1])
    grains = grains_of(soil["phi"], soil["c"], soil["rho"], porosity)
    result: dict[str, object] = dict(
        soil=name,
        porosity_own=own,
        porosity=porosity,
        mu=grains.mu,
        mu_r=grains.mu_r,
        cohesion=grains.cohesion,
        density=grains.density,
        E=grains.E,
    )

    def tell(**more):
        result.update(more)
        print(f"{time.strftime('%H:%M:%S')} {name} {more}", flush=True)

    tell(**{key: result[key] for key in ("porosity_own", "porosity", "mu", "mu_r", "cohesion", "density")})
    bed = settle(BedKey(grains, FINE, porosity, 0.06, (0.066, 0.066)))
    tests = shear(bed, PRESSURES, strain=0.3, inertial_number=2e-3)
    strength = tests.strength
    tell(
        phi_input=math.degrees(soil["phi"]), phi=math.degrees(strength.phi), c_input=soil["c"], c=strength.c,
        residual=math.degrees(tests.residual_phi), K=strength.K, peaks=[math.degrees(math.atan(run.peak)) for run in tests.runs],
        porosity_before=[float(run.porosity[0]) for run in tests.runs], porosity_after=[float(run.porosity[-1]) for run in tests.runs],
    )  # fmt: skip
    angles = [
        math.degrees(repose(settle(BedKey(grains, FINE, porosity, 0.06, (0.09, 0.03), seed=seed)), wall_speed=0.2).angle) for seed in SEEDS
    ]
    tell(repose=float(np.mean(angles)), repose_of_seeds=angles)
    bed = settle(BedKey(grains, COARSE, porosity, 0.13, (0.1, 0.1)))
    tests = plates(replace(bed, key=replace(bed.key, gravity=SOILS[name])), speed=0.1)
    law = tests.sinkage
    b = 0.04
    known = (soil["k_c"] / b + soil["k_phi"]) * SINKAGE ** soil["n"]
    fitted = (law.k_c / b + law.k_phi) * SINKAGE**law.n
    tell(
        p_soil=known, p_fitted=fitted, p=[run.pressure(SINKAGE) for run in tests.runs],
        p_soil_each=[(soil["k_c"] / run.diameter * 2.0 + soil["k_phi"]) * SINKAGE ** soil["n"] for run in tests.runs],
        k_c=law.k_c, k_phi=law.k_phi, n=law.n, ratio=fitted / known,
    )  # fmt: skip
    return result


def main() -> None:
    """Print the results, and write them beside this file."""
    warnings.simplefilter("ignore")
    path = Path(__file__).with_suffix(".json")
    found = json.loads(path.read_text()) if path.exists() else {}
    for name in sys.argv[1:] or SOILS:
        found[name] = measured(name)
        path.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
