"""Speed of particle codes on one bed of spheres, without and with a wheel that rolls through it.

    python benchmarks/dem_peers.py BED.npz ... [--steps N] [--processes 1 2]

`dem_case` says what a bed is and what all codes compute. Million particle-steps per second, best / median over blocks of steps: the best is
the machine undisturbed. The wheel is lowered 20 mm into the bed before time is taken, and rolls at 0.1 m/s and slip 0.2. Processes are
pinned to cores. `--settle N` writes BED.npz first: N spheres, thrown about by `--seed` and settled.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import dem_cdl
import dem_lammps
import dem_liggghts
import numpy as np
from dem_case import Bed, Wheel, load, loose
from dem_launch import Missing
from speed import calibration

PEERS = (dem_cdl, dem_liggghts, dem_lammps)
QUICK = Wheel(lowering_speed=0.4)  # which is not timed
AREA = 0.64 * 0.37 / 45000  # m2 of floor a particle: a bed 0.18 m deep


def settled_bed(n: int, seed: int) -> Bed:
    """`n` spheres at rest in a box, 0.18 m deep and 1.73 times as long as wide; settled by LIGGGHTS, whose Missing it raises."""
    width = math.sqrt(AREA * n / 1.73)
    return dem_liggghts.settle(loose(n, 1.73 * width, width, seed))


def speed(peer, bed: Bed, steps: int, processes: int, wheel: Wheel | None) -> str:
    """Best and median of a peer's million particle-steps per second."""
    found = peer.run(bed, steps, processes, wheel)["particle_steps_per_s"] / 1e6
    return f"{found.max():.2f} / {np.median(found):.2f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("beds", nargs="+", type=Path, metavar="BED.npz")
    parser.add_argument("--steps", type=int, default=2000, help="timed steps")
    parser.add_argument("--processes", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--settle", type=int, metavar="N", help="write the bed first: N spheres, settled by LIGGGHTS")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    if options.settle:
        for path in options.beds:
            settled_bed(options.settle, options.seed).save(path)
    print(f"calibration loop {calibration():.3f} s; million particle-steps per second, best / median\n")
    print("| peer | particles | processes | bed | bed and wheel |\n|---|---|---|---|---|")
    missing = []
    for peer in PEERS:
        try:
            name = peer.version()
        except Missing as error:
            missing.append(str(error))
            continue
        for path in options.beds:
            bed = load(path)
            for processes in options.processes:
                speeds = " | ".join(speed(peer, bed, options.steps, processes, wheel) for wheel in (None, QUICK))
                print(f"| {name} | {len(bed.radii)} | {processes} | {speeds} |", flush=True)
    print("\n".join(["", *missing]))


if __name__ == "__main__":
    main()
