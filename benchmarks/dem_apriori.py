"""The training set of ``cdl_fmu.dem.apriori``: virtual shear of beds over a grid of frictions and porosities, written as a table.

    python benchmarks/dem_apriori.py

Grains of a middle size, one load: without cohesion strength is in proportion to the load. A porosity that a bed cannot have leaves a row
with the loosest that it has. An hour on one core.
"""

from __future__ import annotations

import csv
import math
import re
import sys
import warnings
from pathlib import Path

import numpy as np

from cdl_fmu.dem.bed import BedKey
from cdl_fmu.dem.material import Material
from cdl_fmu.dem.settle import settle
from cdl_fmu.dem.sizes import Uniform
from cdl_fmu.dem.virtual.shear import shear
from cdl_fmu.slave.model import ModelError

FRICTIONS, ROLLING, POROSITIES = (0.3, 0.5, 0.8), (0.0, 0.1, 0.25, 0.6), (0.46, 0.42, 0.39)
PRESSURE, INERTIAL_NUMBER, STRAIN = 1e4, 2e-3, 0.45
SIZES, DEPTH, SIZE = Uniform(4.5e-3, 5.5e-3), 0.06, (0.088, 0.066)
COLUMNS = ("mu", "mu_r", "porosity", "tan_peak", "tan_residual", "porosity_before", "porosity_residual", "loosest")


def row_of(mu: float, mu_r: float, porosity: float) -> tuple[float, ...]:
    """A row of the table."""
    material = Material(E=3.3e7, mu=mu, mu_r=mu_r)
    try:
        bed = settle(BedKey(material, SIZES, porosity, DEPTH, SIZE))
    except ModelError as error:
        return mu, mu_r, porosity, *(math.nan,) * 4, float(re.findall(r"(?:to at most |and )(0\.\d+)", str(error))[0])
    (run,) = shear(bed, [PRESSURE], strain=STRAIN, inertial_number=INERTIAL_NUMBER).runs
    half = len(run.j) // 2
    return mu, mu_r, porosity, run.peak, run.residual, run.porosity[0], float(np.mean(run.porosity[half:])), math.nan


def main() -> None:
    """Write the table beside this file, row by row."""
    warnings.simplefilter("ignore")
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_suffix(".csv")
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(COLUMNS)
        for porosity in POROSITIES:
            for mu in FRICTIONS:
                for mu_r in ROLLING:
                    table.writerow([f"{x:.4f}" for x in row_of(mu, mu_r, porosity)])
                    file.flush()


if __name__ == "__main__":
    main()
