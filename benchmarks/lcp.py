"""Speed of rigid contact: sweeps from the impulses of the step before, and Lemke's method alone, both on one core.

    python benchmarks/lcp.py

The relative velocities without contact change by 3 % from step to step; sweeps end at 1e-5 m/s, friction has 8 directions. Costs are best /
median over blocks of calls from Python, to be read beside the calibration loop of ``benchmarks/speed.py``.
"""

from __future__ import annotations

import os
import sys
from itertools import cycle
from pathlib import Path

import numpy as np
from speed import calibration, cost

from cdl_fmu.rbc.lemke import lemke
from cdl_fmu.rbc.solve import scratch, solve
from cdl_fmu.slave.kernel import compiled

sys.path.append(str(Path(__file__).parents[1] / "tests"))
from rigid import GROUND, LEVEL, Scene, scene, stack

H, GRAVITY, MU, TOLERANCE = 1e-3, 9.81, 0.7, 1e-5
STEPS, CHANGE = 250, 0.03
MOST_SWEEPS = 200
AXLES = [np.array([x, y, -0.2]) for x in (-0.5, 0.0, 0.5) for y in (-0.4, 0.4)]


def on_rock(body: int, point, rng) -> tuple:
    """A contact on ground that is inclined anyhow, by some 0.2 rad."""
    normal = np.array([*rng.normal(0.0, 0.2, 2), 1.0])
    normal /= np.linalg.norm(normal)
    first = np.cross([0.0, 1.0, 0.0], normal)
    first /= np.linalg.norm(first)
    return body, np.array(point), GROUND, None, np.array([normal, first, np.cross(normal, first)])


def rigid_rover(rng) -> Scene:
    """One body on six wheels with 3 contacts each, and 2 rocks below its belly."""
    feet = [axle + np.array([dx, 0.0, -0.12]) for axle in AXLES for dx in (-0.08, 0.0, 0.08)]
    return scene([(60.0, (3.0, 5.0, 7.0))], [on_rock(0, r, rng) for r in (*feet, (0.6, 0.4, -0.25), (0.6, -0.4, -0.25))])


def loose_rover(rng) -> Scene:
    """A chassis that lies on six wheels, each with 2 contacts on rock, and on 2 rocks."""
    contacts = []
    for wheel, axle in enumerate(AXLES):
        contacts += [on_rock(wheel, (dx, 0.0, -0.12), rng) for dx in (-0.05, 0.05)]
        contacts.append((6, axle, wheel, np.array([0.0, 0.0, 0.12]), LEVEL))
    contacts += [on_rock(6, (0.6, y, -0.2), rng) for y in (-0.4, 0.4)]
    return scene([(4.0, (0.03, 0.04, 0.03))] * 6 + [(30.0, (2.0, 3.0, 4.0))], contacts)


def measure(name: str, bodies: Scene, rng) -> None:
    G, n = bodies.G, np.int64(len(bodies.J) // 3)
    free = np.zeros((len(bodies.per_mass) // 6, 6))  # velocities of the bodies after a step without contact
    free[:, :2], free[:, 2] = rng.normal(0.0, 2e-3, (len(free), 2)), -GRAVITY * H
    b = [bodies.J @ (free * (1.0 + CHANGE * rng.normal(size=free.shape))).ravel() for _ in range(STEPS)]
    target, mu, p, v = np.zeros(n), np.full(n, MU), np.zeros(3 * n), np.zeros(3 * n)
    work = scratch(n, 8)
    directions, _, tableau, basis = work
    steps, most = cycle(b), np.int64(MOST_SWEEPS)
    solve(n, G, b[-1], target, mu, p, v, TOLERANCE, most, *work)
    results = np.array([solve(n, G, next(steps), target, mu, p, v, TOLERANCE, most, *work) for _ in range(STEPS)])
    step = compiled(solve, n, G, b[0], target, mu, p, v, TOLERANCE, most, *work)
    warm = cost(lambda: step(n, G, next(steps), target, mu, p, v, TOLERANCE, most, *work), STEPS)
    q = np.zeros(3 * n)
    pivots = [lemke(n, G, b_k, target, mu, q, directions, tableau, basis)[1] for b_k in b]
    alone = cost(lambda: lemke(n, G, next(steps), target, mu, q, directions, tableau, basis), 10)
    sweeps = f"{np.median(results[:, 1]):.0f} / {results[:, 1].max():.0f}"
    print(f"{name:38s} {n:8d} {warm:>15s} {sweeps:>10s} {np.count_nonzero(results[:, 0]):9d} {alone:>18s} {np.median(pivots):7.0f}")


def main() -> None:
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    print(f"calibration loop {calibration():.3f} s")
    print(f"{'':38s} contacts   warm step [us]     sweeps not swept   Lemke alone [us]  pivots")
    rng = np.random.default_rng(0)
    measure("rover, rigid, on 18 points and 2 rocks", rigid_rover(rng), rng)
    measure("rover, 7 bodies, on rock", loose_rover(rng), rng)
    measure("5 boxes in a stack", stack(5, 1.0), rng)
    measure("10 boxes in a stack", stack(10, 1.0), rng)


if __name__ == "__main__":
    main()
