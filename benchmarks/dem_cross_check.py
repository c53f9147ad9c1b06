"""The same beds, plate and wheel in LIGGGHTS and here: packing, coordination, pressure of the plate, forces on the wheel.

    python benchmarks/dem_cross_check.py BED.npz ...

Each bed, of a seed of its own, is the start of both codes, and wheel and plate are the same triangles. The plate is pressed in by 20 mm,
the wheel lowered by 20 mm and driven at slip 0.2, in all about 1 s; means over the beds, their difference, and the standard error of the
beds' differences. The pull is near 0, so that what it differs by is told as a share of the load.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from collections.abc import Callable
from pathlib import Path

import dem_cdl
import dem_liggghts
import numpy as np
from dem_case import SAMPLE, STEP, Bed, Wheel, load

from cdl_fmu.mesh.surface import load_surface

PLATE = Wheel(radius=0.04, width=0.02, lying=True, lowering_speed=0.1)
WHEEL = Wheel()
SECONDS = 1.0  # of a wheel's case, lowering included
LATE = 0.2  # s of the plate's way that its pressure is the mean of
BLOCK = 5 * SAMPLE


def with_mesh(bed: Bed, steps: int, processes: int, wheel: Wheel) -> dict:
    """`dem_cdl.run` with the triangles that LIGGGHTS gets: on an exact cylinder particles roll a little differently."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "wheel.stl"
        path.write_text(dem_liggghts.stl(wheel))
        return dem_cdl.run(bed, steps, processes, wheel, surface=load_surface(path))


def measured(run: Callable[..., dict], bed: Bed) -> dict[str, float]:
    """What one code finds of one bed."""
    steps = round((SECONDS / STEP - WHEEL.lowering_steps(bed)) / BLOCK) * BLOCK
    rolled = run(bed, steps, 1, WHEEL)
    pressed = run(bed, BLOCK, 1, PLATE)
    late = (pressed["time"] <= pressed["rolls_from"]) & (pressed["time"] > pressed["rolls_from"] - LATE * pressed["rolls_from"])
    rolls = rolled["time"] > rolled["rolls_from"] + 0.1  # s, by when it has left where it was lowered
    force, torque = rolled["force"][rolls].mean(axis=0), rolled["torque"][rolls].mean(axis=0)
    return {
        "packing": rolled["packing"],
        "coordination number": rolled["coordination"],
        "plate, pressure [kPa]": 1e-3 * pressed["force"][late, 2].mean() / (math.pi * PLATE.radius**2),
        "wheel, load [N]": force[2],
        "wheel, pull [N]": force[0],
        "wheel, torque [N.m]": -torque[1],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("beds", nargs="+", type=Path, metavar="BED.npz")
    here, there = [], []
    print(f"{dem_cdl.version()} and {dem_liggghts.version()}, {SECONDS:g} s")
    for path in parser.parse_args().beds:
        bed = load(path)
        here.append(measured(with_mesh, bed))
        there.append(measured(dem_liggghts.run, bed))
        print(path.name, here[-1], there[-1], sep="\n", flush=True)
    print("| | here | LIGGGHTS | difference | its standard error |\n|---|---|---|---|---|")
    for name in here[0]:
        a, b = (np.array([found[name] for found in code]) for code in (here, there))
        error = (a - b).std(ddof=1) / math.sqrt(len(a)) if len(a) > 1 else math.nan
        scale = abs(np.mean([found["wheel, load [N]"] for found in there])) if "pull" in name else abs(b.mean())
        print(f"| {name} | {a.mean():.4g} | {b.mean():.4g} | {100.0 * (a - b).mean() / scale:+.2g} % | {100.0 * error / scale:.2g} % |")


if __name__ == "__main__":
    main()
