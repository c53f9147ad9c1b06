"""Starts a particle code on a script in a temporary folder, pinned to cores, and reads back what it wrote."""

from __future__ import annotations

import os
import re
import subprocess
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from dem_case import STEP, Bed, Wheel, measures

FINAL = "final.txt"  # id, position, velocity, angular velocity of every particle, after 9 lines of header
WRENCHES = "wheel.txt"  # step, force and torque on the wheel
DATA = "bed.data"
BLOCKS = 5  # runs, one after the other, that the timed steps are split into: best and median tell what other guests of the machine took
COLUMNS = "id x y z vx vy vz omegax omegay omegaz"


class Missing(Exception):
    """A peer is not installed; the message says how to install it."""


def timed_runs(steps: int) -> str:
    """The commands that run `steps` steps in BLOCKS blocks."""
    if steps < BLOCKS or steps % BLOCKS:
        raise ValueError(f"steps = {steps}: timed in {BLOCKS} blocks of the same length; take a multiple of {BLOCKS}")
    return f"run {steps // BLOCKS}\n" * BLOCKS


def launch(command: list[str], script: str, files: dict[str, str], folder: Path) -> str:
    """What the program of `command` prints on `script`, whose name is appended to it; `files` are laid beside it.

    A program that fails raises RuntimeError with the end of its output.
    """
    for name, text in {"script.in": script, **files}.items():
        (folder / name).write_text(text)
    # Open MPI refuses to start for root, as whom containers run, unless both are set.
    environment = {**os.environ, "OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1", "OMP_NUM_THREADS": "1"}
    done = subprocess.run([*command, "-in", "script.in"], cwd=folder, env=environment, capture_output=True, text=True)
    if done.returncode != 0 or not (folder / FINAL).exists():
        raise RuntimeError(f"{' '.join(command)} failed with status {done.returncode}:\n{(done.stdout + done.stderr)[-2000:]}")
    return done.stdout


def particle_data(bed: Bed) -> str:
    """The bed as a data file of atom style sphere, which both peers read."""
    (xl, xh), (yl, yh), (zl, zh) = bed.domain.tolist()
    n = len(bed.radii)
    lines = ["bed", "", f"{n} atoms", "1 atom types", f"{xl:.17g} {xh:.17g} xlo xhi", f"{yl:.17g} {yh:.17g} ylo yhi"]
    lines += [f"{zl:.17g} {zh:.17g} zlo zhi", "", "Atoms", ""]
    density = bed.masses[0] / (4.0 / 3.0 * np.pi * bed.radii[0] ** 3)
    for i, ((x, y, z), radius) in enumerate(zip(bed.positions.tolist(), bed.radii.tolist()), 1):
        lines.append(f"{i} 1 {2.0 * radius:.17g} {density:.17g} {x:.17g} {y:.17g} {z:.17g}")
    lines += ["", "Velocities", ""]
    lines += [f"{i} {x:.17g} {y:.17g} {z:.17g} 0 0 0" for i, (x, y, z) in enumerate(bed.velocities.tolist(), 1)]
    return "\n".join(lines) + "\n"


def final_state(folder: Path, bed: Bed) -> tuple[Bed, np.ndarray]:
    """The bed after a run, and the particles' angular velocities [rad/s], [n, 3]; lost particles raise RuntimeError."""
    rows = np.loadtxt(folder / FINAL, skiprows=9, ndmin=2)
    if len(rows) != len(bed.radii):
        raise RuntimeError(f"{len(bed.radii) - len(rows)} of {len(bed.radii)} particles left the domain; take a smaller time step")
    return replace(bed, positions=rows[:, 1:4], velocities=rows[:, 4:7]), rows[:, 7:10]


def outcome(command: list[str], script: str, files: dict[str, str], bed: Bed, steps: int, wheel: Wheel | None) -> dict:
    """Run a case and return what is compared.

    `wall_s` of the timed steps, without start-up and without what went before them, and `particle_steps_per_s` in each of their blocks,
    [BLOCKS]; final `positions` [m] and `velocities` [m/s], [n, 3]; `coordination`, `packing` and `kinetic_energy` (`dem_case.measures`).
    With a wheel also `time` [s], [m], of its samples since it began to be lowered, `force` [N] and `torque` [N.m] on it about its centre,
    [m, 3] in world axes, and `rolls_from` [s]. The torque is of forces at contacts: rolling friction passes no torque on to the wheel.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        printed = launch(command, script, {DATA: particle_data(bed), **files}, folder)
        final, spins = final_state(folder, bed)
        walls = np.array(re.findall(r"Loop time of (\S+)", printed)[-BLOCKS:], float)
        found = {
            "wall_s": walls.sum(),
            "particle_steps_per_s": len(bed.radii) * steps / BLOCKS / walls,
            "positions": final.positions,
            "velocities": final.velocities,
            **measures(final, spins),
        }
        if wheel is not None:
            rows = np.loadtxt(folder / WRENCHES, ndmin=2)
            found |= {
                "time": rows[:, 0] * STEP,
                "force": rows[:, 1:4],
                "torque": rows[:, 4:7],
                "rolls_from": wheel.lowering_steps(bed) * STEP,
            }
    return found
