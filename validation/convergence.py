"""Error and cost of every coupling scheme on the two-wheel drive (BxB), against an in-process reference.

    python -m validation.convergence

Reference: RK4 with substeps of 0.05 ms that calls the same contact kernel at every stage (validation/reference.py), itself compared
with 0.025 ms. Compared are the contact forces of every wheel in the heading frame, normal and traction, at the time of the pose that
they were evaluated for. Left out are 0.3 s after the start of the wheels and 20 ms around the start and end of each steering motion.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

from orchestrator.assemble import assemble
from orchestrator.experiment import load_experiment
from orchestrator.results import open_result
from orchestrator.run import run
from orchestrator.schemes import SCHEMES
from orchestrator.ssp import UNPACKED, read_system

from .reference import simulate_reference

#: Steps between the pose that a row's contact forces were evaluated for and the row.
POSE_AGE = {"ij": 1.0, "gs": 1.0, "jacobi": 1.0, "gs-mid": 0.5, "aitken": 0.0}
FORCES = {"normal": ("normal_load", 2), "traction": ("drawbar_pull", 0)}


def kept_times(t: np.ndarray, steer_angle: np.ndarray, steer_rate: float) -> np.ndarray:
    """Mask of the times that count, from the reference's steering angle."""
    rate = np.abs(np.gradient(steer_angle, t))
    keep = t >= 0.3
    saturated = rate > 0.99 * steer_rate
    moving = rate > 0.01 * steer_rate
    for mask in (saturated, moving):
        for k in np.flatnonzero(np.diff(mask.astype(int))):
            keep &= np.abs(t - t[k]) > 0.02
    return keep


def reference(dt: float, stop_time: float) -> dict[str, np.ndarray]:
    """The reference drive from the experiment's settled start."""
    parts = assemble(load_experiment("two_wheel")).instances
    return simulate_reference(parts["bcm"], parts["rover"], parts["driver"], stop_time=stop_time, dt=dt)


def main(step: float = 1e-3) -> None:
    experiment = load_experiment("two_wheel")
    stop_time = experiment.settings.stop_time
    wheel_load = 0.5 * 54.0 * 9.81
    fine, finer = reference(5e-5, stop_time), reference(2.5e-5, stop_time)
    keep = kept_times(fine["t"], fine["steer_angle"], 0.8)
    print(f"left out: {100 * (1 - keep.mean()):.1f} % of the run")
    change = np.sqrt(np.mean((fine["f"] - finer["f"])[keep] ** 2, axis=0)) / wheel_load
    print(f"reference 0.05 ms against 0.025 ms: {100 * change[:, [0, 2]].max():.1e} % of wheel load rms at worst")
    with tempfile.TemporaryDirectory() as folder:
        package = Path(folder, "system.ssp")
        experiment.write_system(package)
        system = read_system(package, UNPACKED)
        print("| scheme | step ms | front normal | front traction | rear normal | rear traction | simulated s / wall s |")
        print("|---|---|---|---|---|---|---|")
        for scheme in SCHEMES:
            outcome = run(system, Path(folder, scheme), scheme=scheme, step=step, stop_time=stop_time)
            errors = _errors(open_result(outcome.result), finer, keep, POSE_AGE[scheme] * step, wheel_load)
            cells = " | ".join(f"{100 * e:.3f}" for e in errors)
            print(f"| {scheme} | {1e3 * step:g} | {cells} | {stop_time / outcome.wall_s:.1f} |", flush=True)


def _errors(result, exact, keep, age: float, wheel_load: float) -> list[float]:
    t = exact["t"][keep]
    out = []
    for wheel in (0, 1):
        for diagnostic, axis in FORCES.values():
            values = result.cdl[f"bcm.diagnostics[{wheel + 1}].{diagnostic}"].values
            # The first row comes before the first step and has no forces.
            at_pose = np.interp(t, result.time.values[1:] - age, values[1:])
            out.append(float(np.sqrt(np.mean((at_pose - exact["f"][keep, wheel, axis]) ** 2))) / wheel_load)
    return out


if __name__ == "__main__":
    main(*map(float, sys.argv[1:]))
