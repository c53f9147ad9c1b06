"""The training set of ``cdl_fmu.dem.apriori``: virtual shear of beds over a grid of frictions and porosities, written as a table.

    python benchmarks/dem_apriori.py

One load: without cohesion strength is in proportion to it. A porosity that a bed cannot have leaves a row with the loosest that it has.
Rows that the table has already are left as they are. Ten minutes on one core.
"""

from __future__ import annotations

import csv
import itertools
import math
import re
import warnings
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from cdl_fmu.dem.bed import BedKey
from cdl_fmu.dem.material import Material
from cdl_fmu.dem.settle import settle
from cdl_fmu.dem.sizes import Uniform
from cdl_fmu.dem.virtual.shear import shear
from cdl_fmu.slave.model import ModelError

#: Friction and rolling friction: the line along which strength grows, see ``apriori``; and porosities.
FRICTIONS = ((0.3, 0.0), (0.5, 0.0), (0.5, 0.1), (0.5, 0.25), (0.5, 0.6), (0.8, 0.6), (0.8, 1.2))
POROSITIES, SEEDS = (0.46, 0.43, 0.4), (0, 1)
PRESSURE, INERTIAL_NUMBER, STRAIN = 1e4, 3e-3, 0.35
SIZES, DEPTH, SIZE = Uniform(4.5e-3, 5.5e-3), 0.06, (0.066, 0.066)
COLUMNS = ("mu", "mu_r", "porosity", "seed", "tan_peak", "tan_residual", "porosity_before", "porosity_residual", "loosest")


def row_of(mu: float, mu_r: float, porosity: float, seed: int) -> tuple[float, ...]:
    """A row of the table."""
    material = Material(E=3.3e7, mu=mu, mu_r=mu_r)
    try:
        bed = settle(BedKey(material, SIZES, porosity, DEPTH, SIZE, seed=seed))
    except ModelError as error:
        return mu, mu_r, porosity, seed, *(math.nan,) * 4, float(re.findall(r"(?:to at most |and )(0\.\d+)", str(error))[0])
    (run,) = shear(bed, [PRESSURE], strain=STRAIN, inertial_number=INERTIAL_NUMBER).runs
    half = len(run.j) // 2
    return mu, mu_r, porosity, seed, run.peak, run.residual, run.porosity[0], float(np.mean(run.porosity[half:])), math.nan


def fitted(table: Path) -> tuple[dict[tuple[float, float], float], float, float, float]:
    """T of the frictions, B, T_0, and root mean square of what is left of phi [rad], by least squares.

    tan(phi) = T + B max(T - T_0, 0) (0.43 - porosity).
    """
    with table.open(newline="", encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["tan_peak"] != "nan"]
    line = [FRICTIONS.index((float(row["mu"]), float(row["mu_r"]))) for row in rows]
    tan, denser = (np.array([float(row[name]) for row in rows]) for name in ("tan_peak", "porosity"))
    denser = 0.43 - denser

    def off(unknown: np.ndarray) -> np.ndarray:
        strength, (effect, least) = unknown[line], unknown[-2:]
        return strength + effect * np.maximum(strength - least, 0.0) * denser - tan

    found = least_squares(off, [*np.linspace(0.35, 0.8, len(FRICTIONS)), 3.0, 0.4])
    left = np.arctan(found.fun + tan) - np.arctan(tan)
    return dict(zip(FRICTIONS, found.x.tolist())), *found.x[-2:].tolist(), float(np.sqrt(np.mean(left**2)))


def main() -> None:
    """Write the table beside this file, row by row."""
    warnings.simplefilter("ignore")
    path = Path(__file__).with_suffix(".csv")
    if not path.exists():
        path.write_text(",".join(COLUMNS) + "\n", encoding="utf-8")
    with path.open(newline="", encoding="utf-8") as file:
        known = {tuple(float(row[name]) for name in COLUMNS[:4]) for row in csv.DictReader(file)}
    for seed, porosity in itertools.product(SEEDS, POROSITIES):
        for mu, mu_r in FRICTIONS if seed == 0 else FRICTIONS[3:]:  # weaker grains are steadier
            if (mu, mu_r, porosity, seed) not in known:
                with path.open("a", newline="", encoding="utf-8") as file:
                    csv.writer(file).writerow([f"{x:.4f}" for x in row_of(mu, mu_r, porosity, seed)])
    strengths, effect, least, left = fitted(path)
    for (mu, mu_r), strength in strengths.items():
        print(f"mu {mu:g}, mu_r {mu_r:g}: T = {strength:.3f}")
    print(f"B = {effect:.3g}, T_0 = {least:.3g}; left: {math.degrees(left):.2g} deg")


if __name__ == "__main__":
    main()
