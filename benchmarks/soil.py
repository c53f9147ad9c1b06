"""Speed and memory of SCM: its step alone, the whole co-simulation, and a long drive.

    python benchmarks/soil.py

Costs are best / median over steps of wheels with grousers that roll at 0.12 m/s and 31 mm sinkage, displacement and landslides on.
Absolute figures are read beside the calibration loop of ``benchmarks/speed.py``.
"""

from __future__ import annotations

import math
import os
import resource
import statistics
import tempfile
import time
from pathlib import Path

import numpy as np
from speed import calibration

import orchestrator
from cdl_fmu.scm import SCM
from cdl_fmu.slave.model import Instance

H = 1e-3
SINKAGE = 0.031  # [m] about that of the two-wheel drive


def rolling(n_wheels: int, steps: int, speed: float = 0.12, yaw: float = 0.0, **parameters) -> tuple[np.ndarray, Instance]:
    """Wall time of each step [s] of wheels rolling in tracks 1 m apart, two to a track with 0.6 m between them, and the instance."""
    soil = Instance(SCM(n_wheels), **parameters)
    soil.initialise()
    heading = np.array([math.cos(yaw), math.sin(yaw)])
    left = np.array([-heading[1], heading[0]])
    rate, wheel, times = speed / 0.12, soil.u["wheel"], np.empty(steps)
    wheel["v_0"][:, :2], wheel["w_0"][:, :2] = speed * heading, rate * left
    for k in range(steps):
        spin = np.array(
            [[math.cos(rate * k * H), 0, -math.sin(rate * k * H)], [0, 1, 0], [math.sin(rate * k * H), 0, math.cos(rate * k * H)]]
        )
        wheel["T"][:] = spin @ np.array([[*heading, 0], [*left, 0], [0, 0, 1]])
        for i in range(n_wheels):
            wheel["r_0"][i, :2] = (speed * k * H - 0.6 * (i % 2)) * heading + (i // 2) * left
        wheel["r_0"][:, 2] = 0.125 - min(SINKAGE, 1e-4 * k)
        start = time.perf_counter()
        soil.step(k * H, H)
        times[k] = time.perf_counter() - start
    return times, soil


def step_cost(**case) -> str:
    """Best and median [us] of a step, after the wheels have sunk and rolled some way."""
    times, _ = rolling(steps=6000, **case)
    late = np.sort(times[2000:]) * 1e6
    return f"{late[len(late) // 50]:.1f} / {np.median(late):.1f}"


def main() -> None:
    for n_wheels in (1, 2, 6):  # before this process is kept on one core
        for threads in (1, 2):
            print(f"{n_wheels} wheels, 10 mm, {threads} threads{'':9s}{step_cost(n_wheels=n_wheels, threads=threads)} us a step")
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    print(f"calibration loop                 {calibration():.3f} s")
    for text, case in {
        "two wheels, 10 mm": dict(n_wheels=2),
        "two wheels, 10 mm, heading 40 deg": dict(n_wheels=2, yaw=0.7),
        "two wheels, 5 mm": dict(n_wheels=2, cell=0.005),
        "one wheel, 10 mm": dict(n_wheels=1),
        "six wheels, 10 mm": dict(n_wheels=6),
        "two wheels, no landslides": dict(n_wheels=2, erosion_sweeps=0),
    }.items():
        print(f"{text:33s}{step_cost(**case)} us a step")
    with tempfile.TemporaryDirectory() as folder:
        for tiers in (["BCM", "BCM"], ["SCM", "BCM"], ["SCM", "SCM"]):
            rates = []
            for i in range(3):
                outcome = orchestrator.simulate("two_wheel", Path(folder, f"{tiers}{i}"), tiers=tiers)
                rates.append(outcome.simulated_s / outcome.wall_s)
            name = "x".join(tier[0] for tier in tiers)
            print(f"{name}, co-simulation through FMUs     {statistics.median(rates):.2f} simulated s per wall s (best {max(rates):.2f})")
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    _, soil = rolling(1, steps=100_000, speed=1.0)
    tiles = int(soil.pool.head[0])
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    used = tiles * soil.pool.rows[0].nbytes / 2**20
    print(f"100 m straight, unbounded map    {tiles} tiles, {used:.0f} MiB used; process grew by {grown:.0f} MiB")


if __name__ == "__main__":
    main()
