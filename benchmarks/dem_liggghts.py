"""The case of `dem_case` in LIGGGHTS: Hertz, Mindlin with history, epsd2 rolling friction; the wheel is a mesh of 256 triangles."""

from __future__ import annotations

import math
import re
import shutil
import subprocess
import tempfile
from itertools import pairwise
from pathlib import Path

import numpy as np
from dem_case import FRICTION, GRAVITY, POISSON, RESTITUTION, ROLLING_FRICTION, SAMPLE, SKIN, STEP, YOUNG, Bed, Wheel
from dem_launch import COLUMNS, DATA, FINAL, WRENCHES, Missing, final_state, launch, outcome, particle_data, timed_runs

INSTALL = "LIGGGHTS is missing: apt-get install liggghts (Debian, Ubuntu), or build it from github.com/CFDEMproject/LIGGGHTS-PUBLIC"
MODEL = "model hertz tangential history rolling_friction epsd2"
SEGMENTS = 64  # of the wheel's rim: 2 triangles each on the rim and 1 on each cap
MESH = "wheel.stl"


def version() -> str:
    """Name and version; raises Missing."""
    program = _program()
    with tempfile.TemporaryDirectory() as folder:  # it leaves a log wherever it is called
        text = subprocess.run([program, "-h"], capture_output=True, text=True, stdin=subprocess.DEVNULL, cwd=folder).stdout
    return "LIGGGHTS " + re.search(r"LIGGGHTS-PUBLIC ([\d.]+)", text).group(1)


def run(bed: Bed, steps: int, processes: int = 1, wheel: Wheel | None = None) -> dict:
    """`steps` steps of the bed, with a wheel after it was lowered; `dem_launch.outcome` says what comes back. Raises Missing."""
    script = _setting(bed, processes)
    files = {}
    if wheel is not None:
        script += _lowered_wheel(bed, wheel)
        files[MESH] = stl(wheel)
    script += timed_runs(steps) + _write_final()
    return outcome(_command(processes), script, files, bed, steps, wheel)


def settle(bed: Bed, energy: float = 1e-9) -> Bed:
    """The bed when it has come to rest: `energy` [J] of translation a particle or less, looked at every 1000 steps.

    Raises RuntimeError where it has not in 3 s. Raises Missing.
    """
    script = _setting(bed, 1) + "\n".join(
        [
            f"variable rest equal ke<{energy * len(bed.radii):.17g}",
            "variable turn loop 60",
            "label turn",
            "run 1000",
            'if "${rest} == 1" then "jump SELF rest"',
            "next turn",
            "jump SELF turn",
            "quit",  # without a final state, by which it is known
            "label rest",
            _write_final(),
        ]
    )
    with tempfile.TemporaryDirectory() as name:
        launch([_program()], script, {DATA: particle_data(bed)}, Path(name))
        settled, _ = final_state(Path(name), bed)
    settled.box[2, 1] = (settled.positions[:, 2] + settled.radii).max()
    return settled


def stl(wheel: Wheel) -> str:
    """The wheel or plate about the origin as ASCII STL; the corners of its rim lie on the circle, so its flats are 0.15 mm inside."""
    angle = 2.0 * math.pi * np.arange(SEGMENTS + 1) / SEGMENTS
    ring = np.column_stack([wheel.radius * np.sin(angle), np.zeros(SEGMENTS + 1), wheel.radius * np.cos(angle)])
    aside = np.array([0.0, wheel.width / 2.0, 0.0])
    triangles = []
    for a, b in pairwise(ring):
        triangles += [(a - aside, b + aside, a + aside), (a - aside, b - aside, b + aside)]
        triangles += [(aside, a + aside, b + aside), (-aside, b - aside, a - aside)]
    lines = ["solid wheel"]
    turned = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]) if wheel.lying else np.eye(3)
    for corners in np.array(triangles) @ turned.T:
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        lines.append("facet normal {:.9g} {:.9g} {:.9g}\nouter loop".format(*(normal / np.linalg.norm(normal))))
        lines += ["vertex {:.12g} {:.12g} {:.12g}".format(*corner) for corner in corners]
        lines.append("endloop\nendfacet")
    return "\n".join([*lines, "endsolid wheel\n"])


def _program() -> str:
    program = shutil.which("liggghts")
    if program is None:
        raise Missing(INSTALL)
    return program


def _command(processes: int) -> list[str]:
    # Debian's LIGGGHTS is built on Open MPI; under another one's launcher each process would run the whole case.
    launcher = shutil.which("mpirun.openmpi") or "mpirun"
    return [launcher, "--bind-to", "core", "-np", str(processes), _program()]


def _setting(bed: Bed, processes: int) -> str:
    walls = [f"fix wall_{axis}{side} all wall/gran {MODEL} primitive type 1 {axis}plane {place:.17g}" for axis, side, place in _walls(bed)]
    return "\n".join(
        [
            "units si",
            "atom_style granular",
            "boundary f f f",
            "newton off",
            "communicate single vel yes",
            f"processors {processes} 1 1",
            f"read_data {DATA}",
            f"neighbor {SKIN} bin",
            "neigh_modify delay 0",
            f"fix m1 all property/global youngsModulus peratomtype {YOUNG}",
            f"fix m2 all property/global poissonsRatio peratomtype {POISSON}",
            f"fix m3 all property/global coefficientRestitution peratomtypepair 1 {RESTITUTION}",
            f"fix m4 all property/global coefficientFriction peratomtypepair 1 {FRICTION}",
            f"fix m5 all property/global coefficientRollingFriction peratomtypepair 1 {ROLLING_FRICTION}",
            f"pair_style gran {MODEL}",
            "pair_coeff * *",
            f"timestep {STEP}",
            f"fix gravity all gravity {GRAVITY} vector 0 0 -1",
            *walls,
            "fix motion all nve/sphere",
            "thermo_style custom step atoms ke cpu",
            "thermo 1000",
            "thermo_modify norm no lost ignore",
            "",
        ]
    )


def _walls(bed: Bed) -> list[tuple[str, int, float]]:
    (xl, xh), (yl, yh), (zl, _) = bed.box.tolist()
    return [("x", 1, xl), ("x", 2, xh), ("y", 1, yl), ("y", 2, yh), ("z", 1, zl)]


def _lowered_wheel(bed: Bed, wheel: Wheel) -> str:
    steps = wheel.lowering_steps(bed)
    x, y, z = wheel.start(bed).tolist()
    centre = f"{x:.17g} {y:.17g} {z:.17g}"
    wrench = " ".join(f"f_wheel[{i}]" for i in range(1, 7))
    return "\n".join(
        [
            # The reference point is where the mesh was read, and moves and turns with it.
            f"fix wheel all mesh/surface/stress file {MESH} type 1 move {centre} reference_point {centre}",
            f"fix tread all wall/gran {MODEL} mesh n_meshes 1 meshes wheel",
            f"fix wrench all ave/time {SAMPLE} 1 {SAMPLE} {wrench} file {WRENCHES}",
            f"fix lower all move/mesh mesh wheel linear 0 0 {-wheel.lowering_speed:.17g}",
            f"run {steps}",
            "unfix lower",
            *([] if wheel.lying else _rolling(wheel, x, y, z - wheel.lowering_speed * steps * STEP)),
            "",
        ]
    )


def _rolling(wheel: Wheel, x: float, y: float, z: float) -> list[str]:
    # The second motion is in the frame that the first one moves: the wheel turns about its travelling axle.
    return [
        f"fix roll all move/mesh mesh wheel linear {wheel.speed:.17g} 0 0",
        f"fix turn all move/mesh mesh wheel rotate origin {x:.17g} {y:.17g} {z:.17g} axis 0 1 0 period {2.0 * math.pi / wheel.rate:.17g}",
    ]


def _write_final() -> str:
    return f'write_dump all custom {FINAL} {COLUMNS} modify sort id format "%d{" %.17g" * 9}"\n'
