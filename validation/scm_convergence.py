"""How far the two-wheel drive on SCM depends on the communication step and on the size of the cells.

    python -m validation.scm_convergence [stop time in s]

Steps: SxS and SxB at 1 ms against 0.1 ms through the FMUs, as the drive is run. Compared are the contact forces of both wheels in the
heading frame, normal and traction, over the x of the rear wheel at the pose that they were evaluated for. Left out are 0.3 s after the
start of the wheels and 20 ms around the start and end of each steering motion, as for BxB (validation/convergence.py). Landslides sweep
by the clock of the simulated time, so both steps see as many.

Cells: one loaded, smooth wheel on SCM at 20 % slip, in process; and the speed of the drive SxS.
"""

from __future__ import annotations

import sys
import tempfile

import numpy as np

import orchestrator
from cdl_fmu.scm import SCM
from cdl_fmu.slave.model import Instance

from .convergence import FORCES, POSE_AGE, kept_times

WHEEL_LOAD = 0.5 * 54.0 * 9.81
RUNS = {"SxS": (("SCM", "SCM"), ("scm", 1), ("scm", 2)), "SxB": (("SCM", "BCM"), ("scm", 1), ("bcm", 1))}
CELLS = (0.02, 0.01, 0.005)


class Drive:
    """Forces of a run of the drive over the rear wheel's x at the pose that they were evaluated for.

    Attributes:
        x: Position of the rear wheel [m], [n].
        forces: Front normal, front traction, rear normal, rear traction [N], [n, 4].
        keep: Mask of the rows that count.
        speed: Simulated seconds per wall second.
    """

    def __init__(self, tiers, sources, *, step: float, stop_time: float, overrides=None):
        with tempfile.TemporaryDirectory() as folder:
            outcome = orchestrator.simulate("two_wheel", folder, tiers=tiers, step=step, stop_time=stop_time, overrides=overrides)
            result = orchestrator.open_result(outcome.result).load()
        t = result.time.values
        x = result.cdl["rover.wheel[2].r_0[1]"].values
        # The first row comes before the first step and has no forces.
        self.x = np.interp(t - POSE_AGE["ij"] * step, t, x)[1:]
        names = [f"{name}.diagnostics[{i}].{diagnostic}" for name, i in sources for diagnostic, _ in FORCES.values()]
        self.forces = np.stack([result.cdl[name].values[1:] for name in names], axis=1)
        self.keep = kept_times(t, result.cdl["rover.joint.steer_angle[2]"].values, 0.8)[1:]
        self.speed = outcome.simulated_s / outcome.wall_s

    def difference(self, finer: Drive) -> np.ndarray:
        """Difference of the forces where the finer run's rows count [N], [n, 4]."""
        ordered = np.maximum.accumulate(self.x)
        x = finer.x[finer.keep]
        inside = (x > ordered[0]) & (x < ordered[-1])
        here = np.stack([np.interp(x[inside], ordered, f) for f in self.forces.T], axis=1)
        return here - finer.forces[finer.keep][inside]


def rolled(cell: float, seconds=4.0, h=1e-3) -> np.ndarray:
    """Sinkage [m], traction [N] and normal force [N] of a loaded smooth wheel that rolls at 20 % slip, last half of the run, [n, 3].

    Without grousers, whose forces come and go, what is left of ripple is the cells'.
    """
    soil = Instance(SCM(), cell=cell, n_g=0)
    wheel, mass, rate, v_z = soil.u.wheel[0], WHEEL_LOAD / 9.81, 1.0, 0.0
    wheel.r_0[2] = soil.p.r_w
    soil.initialise()
    rows = []
    for k in range(round((seconds + 1.0) / h)):
        rolling = k * h > 1.0  # after it was put down
        wheel.v_0[:] = (0.8 * soil.p.r_w * rate if rolling else 0.0), 0.0, v_z
        wheel.w_0[1] = rate if rolling else 0.0
        soil.step(k * h, h)
        contact, f_0 = soil.y.contact[0], soil.y.wheel[0].f_0
        rows.append((soil.p.r_w - wheel.r_0[2], f_0[0], f_0[2]))
        # Implicit in height, by the interface Jacobian; put down against a damper, so that the wheel does not overshoot.
        D, K = contact.D[2] + (0.0 if rolling else 1e4), contact.K[2]
        v_z = (mass * v_z + h * (f_0[2] - WHEEL_LOAD + contact.D[2] * v_z)) / (mass + h * D + h * h * K)
        wheel.r_0[:] += h * np.array([wheel.v_0[0], 0.0, v_z])
    return np.array(rows[-round(0.5 * seconds / h) :])


def speed(cell: float, stop_time=2.0) -> float:
    """Simulated seconds per wall second of the drive SxS."""
    tiers, *sources = RUNS["SxS"]
    return Drive(tiers, sources, step=1e-3, stop_time=stop_time, overrides={"scm.cell": cell}).speed


def main(stop_time: float = 18.0) -> None:
    print("| run | front normal | front traction | rear normal | rear traction | simulated s / wall s at 1 ms | at 0.1 ms |")
    print("|---|---|---|---|---|---|---|")
    for run, (tiers, *sources) in RUNS.items():
        coarse, fine = (Drive(tiers, sources, step=step, stop_time=stop_time) for step in (1e-3, 1e-4))
        rms = 100 * np.sqrt(np.mean(coarse.difference(fine) ** 2, axis=0)) / WHEEL_LOAD
        print(f"| {run} | {' | '.join(f'{e:.2f}' for e in rms)} | {coarse.speed:.2f} | {fine.speed:.2f} |", flush=True)
    print()
    print("| cell mm | sinkage mm | traction N | ripple of traction, % of wheel load rms | of normal force | SxS: simulated s / wall s |")
    print("|---|---|---|---|---|---|")
    for cell in CELLS:
        readings = rolled(cell)
        (sinkage, traction, _), (_, *ripple) = readings.mean(axis=0), 100 * readings.std(axis=0) / WHEEL_LOAD
        cells = f"{1e3 * sinkage:.2f} | {traction:.2f} | {ripple[0]:.2f} | {ripple[1]:.2f} | {speed(cell):.2f}"
        print(f"| {1e3 * cell:g} | {cells} |", flush=True)


if __name__ == "__main__":
    main(*map(float, sys.argv[1:]))
