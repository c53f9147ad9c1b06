"""RBC and VEM on hard ground against closed forms, and against MuJoCo's own contacts."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from cdl_fmu.rbc import RBC
from cdl_fmu.vem import VEM

from . import mujoco_bodies
from .bench import Bench
from .coupled import Coupled
from .mujoco_bodies import Scene
from .rows import Findings, Row, relative

# Bars: of what is exact but for rounding, of a ball at this step, of springs and friction's secant, and of runs beside MuJoCo's.
_EXACT, _BALL, _SOFT, _CLIMB = 1e-4, 0.01, 0.01, 3e-3

_G = 9.81
_SLOPE, _MU, _SLIDING = 0.5, 0.3, 0.3  # rad, 1, s
_SIDE, _RADIUS, _DROP, _E = 0.2, 0.1, 0.3, 0.5  # m, m, m, 1
_FINE = 1e-4  # step of the ball [s]
_HIGH, _STEP_AT, _LONG = 0.04, 0.9, 0.6  # step: height, place and length [m]
_RATE, _RAMP, _SERVO, _DRIVEN = 2.0, 0.3, 100.0, 3.0  # rad/s, s, N.m.s/rad, s
_R, _SPRING = 0.125, 1e7  # wheel's radius [m]; stiffness of the ball [N/m], so that one vertex of it touches
_FAR = {"start.x": 500.0}  # where bodies are alone the rover falls elsewhere
_SMOOTH = {"n_g": 0.0, "h_g": 0.0}


def check(bench: Bench) -> Findings:
    """Hard ground: RBC and VEM against closed forms and MuJoCo"""
    with tempfile.TemporaryDirectory() as folder:
        meshes = _meshes(Path(folder))
        rows = [*_slide(meshes), *_stack(meshes), *_bounce(meshes), *_climb(meshes)]
    return Findings(
        rows,
        note="Bodies of 2700 kg/m3 on a fixed floor, coupled with the rover's multibody system at 1 ms (the ball at 0.1 ms). MuJoCo has an "
        "elliptic friction cone and soft contacts, at 0.1 ms; its rows beside closed forms are not judged. RBC has hard contacts and a "
        "polyhedral cone of 8 directions, along one of which the box slides. VEM's friction is implicit by its secant, which adds a share "
        "of a h / v. A rebound comes from damping in VEM and MuJoCo: its closed form is that of a spring and damper that do not pull.",
    )


def _meshes(folder: Path) -> dict[str, Path]:
    import trimesh  # takes most of a second

    floor, step = trimesh.creation.box((8.0, 2.0, 0.2)), trimesh.creation.box((_LONG, 2.0, 2.0 * _HIGH))
    floor.apply_translation((0.0, 0.0, -0.1))
    step.apply_translation((_STEP_AT + 0.5 * _LONG, 0.0, 0.0))
    ball = trimesh.creation.icosphere(2, _RADIUS)
    lowest = ball.vertices[np.argmin(ball.vertices[:, 2])]
    ball.apply_transform(trimesh.geometry.align_vectors(lowest, [0.0, 0.0, -1.0]))
    meshes = {"floor": floor, "step": step, "ball": ball, "box": trimesh.creation.box((_SIDE,) * 3)}
    for name, mesh in meshes.items():
        mesh.export(folder / f"{name}.stl")
    return {name: folder / f"{name}.stl" for name in meshes}


def _system(tier: str, meshes: Mapping[str, Path], bodies: Sequence[tuple[str, Mapping]], rover: Mapping, **options) -> Coupled:
    """The rover and bodies (mesh, start) on a fixed floor; ``values`` are of the contact, ``each`` of each body."""
    n, values, each = len(bodies) + 1, options.pop("values", {}), options.pop("each", {})
    contact, own = (RBC(2, n), {"tolerance": 1e-9}) if tier == "RBC" else (VEM(2, 0, n), {"effective_mass": 5.0})
    given = own | values | {f"body[{j}].{name}": value for j in range(1, n + 1) for name, value in each.items()}
    return Coupled(
        contact, [(meshes["floor"], {"fixed": "on"}), *((meshes[name], start) for name, start in bodies)], rover, given, **options
    )


def _slide(meshes: Mapping[str, Path]) -> list[Row]:
    """Acceleration of a box down a slope, once its springs are pressed."""
    expected = _G * (math.sin(_SLOPE) - _MU * math.cos(_SLOPE))
    name, quantity = "Coulomb's law", f"acceleration of a box on a slope of {_SLOPE:g} rad, friction {_MU:g}"

    def acceleration(speeds: np.ndarray) -> float:
        return float(speeds[len(speeds) // 3] - speeds[-1]) / (_SLIDING - _SLIDING / 3.0 - 1e-3)

    rows = []
    for tier, bar in (("RBC", _EXACT), ("VEM", _SOFT)):
        system = _system(tier, meshes, [("box", {"z": 0.5 * _SIDE})], _FAR | {"slope": _SLOPE}, each={"mu": _MU})
        found = acceleration(system.run(_SLIDING, lambda s: float(s.rover.y.rock[1].v_0[0])))
        rows.append(relative(tier, name, quantity, expected, found, "m/s2", bar))
    scene = Scene(mujoco_bodies.box(_SIDE, _mass(system), 0.5 * _SIDE), _MU, _SLOPE, h=_FINE)
    found = acceleration(scene.run(_SLIDING, lambda s: float(s.data.qvel[0])))
    return [*rows, relative("MuJoCo", name, quantity, expected, found, "m/s2")]


def _stack(meshes: Mapping[str, Path]) -> list[Row]:
    """Load of three boxes on the floor."""
    quantity, rows = "load of three boxes on each other on the floor, over their weight", []
    for tier in ("RBC", "VEM"):
        system = _system(tier, meshes, [("box", {"z": (0.5 + k) * _SIDE}) for k in range(3)], _FAR)
        loads = -system.run(0.5, lambda s: float(s.hard.y.body[0].f_0[2]))
        rows.append(relative(tier, "weight", quantity, 1.0, float(loads[-100:].mean() / (3.0 * _mass(system) * _G)), "1", _EXACT))
    scene = Scene("".join(mujoco_bodies.box(_SIDE, _mass(system), (0.5 + k) * _SIDE) for k in range(3)), 0.6)
    loads = scene.run(0.5, Scene.floor_load)
    return [*rows, relative("MuJoCo", "weight", quantity, 1.0, float(loads[-100:].mean() / (3.0 * _mass(system) * _G)), "1")]


def _bounce(meshes: Mapping[str, Path]) -> list[Row]:
    """Speed of a ball after an impact over that before it, by the height to which it comes."""
    rigid = _rebound(_system("RBC", meshes, [_ball()], _FAR, each={"restitution": _E}, h=_FINE))
    rows = [relative("RBC", "Newton", f"restitution of a ball, {_E:g} given", _E, rigid, "1", _BALL)]
    for ratio in (0.1, 0.3):
        law = {"k": _SPRING, "damping_ratio": ratio}
        expected, quantity = _spring_rebound(ratio), f"restitution of a ball on a damper of Lehr's ratio {ratio:g}"
        name = "Schwager & Poeschel 2007"
        system = _system("VEM", meshes, [_ball()], _FAR, each=law, h=_FINE)
        rows.append(relative("VEM", name, quantity, expected, _rebound(system), "1", _BALL))
        frequency = math.sqrt(_SPRING / _mass(system))
        scene = Scene(
            mujoco_bodies.ball(_RADIUS, _mass(system), _RADIUS + _DROP), 0.0, 0.0, (-(frequency**2), -2.0 * ratio * frequency), h=_FINE
        )
        heights = scene.run(0.5, lambda s: float(s.data.qpos[2]) - _RADIUS)
        rows.append(relative("MuJoCo", name, quantity, expected, _of_heights(heights), "1"))
    return rows


def _ball() -> tuple[str, Mapping]:
    return "ball", {"z": _RADIUS + _DROP}


def _rebound(system: Coupled) -> float:
    return _of_heights(system.run(0.5, lambda s: float(s.rover.y.rock[1].r_0[2]) - _RADIUS))


def _of_heights(heights: np.ndarray) -> float:
    first = heights[: round(0.3 / _FINE)].argmin()
    return math.sqrt(heights[first:].max() / _DROP)


def _spring_rebound(ratio: float) -> float:
    """Restitution of an impact on a spring and damper that do not pull, of Lehr's ratio below 1: Schwager & Poeschel 2007, eq. (20)."""
    root = math.sqrt(1.0 - ratio**2)
    return math.exp(-ratio / root * (math.pi - math.atan2(2.0 * ratio * root, 1.0 - 2.0 * ratio**2)))


def _climb(meshes: Mapping[str, Path]) -> list[Row]:
    """Where a driven rover is that has climbed a step with its front wheel."""

    def rate(t: float) -> float:
        return _RATE * min(1.0, t / _RAMP)

    systems = {
        tier: _system(tier, meshes, [("step", {"fixed": "on"})], {"start.z": _R, "wheel_servo_gain": _SERVO}, values=_SMOOTH)
        for tier in ("RBC", "VEM")
    }
    p = systems["RBC"].rover.p
    scene = Scene(mujoco_bodies.rover(p, _R) + mujoco_bodies.step(_HIGH, _STEP_AT, _LONG), 0.6, servo=_SERVO, h=_FINE)
    start = 0.5 * p.wheel_base
    place, pitch = scene.run(_DRIVEN, lambda s: (float(s.data.qpos[0]) + start, float(s.data.qpos[4])), rate)[-1]
    rows = []
    for tier, system in systems.items():
        for _ in range(round(_DRIVEN / system.h)):
            system.rover.u.command.wheel_rate[:] = rate(system.t)
            system.step()
        quantity = f"of a rover with one wheel up a step of {1e3 * _HIGH:g} mm"
        body = system.rover.y.body
        rows.append(relative(tier, "MuJoCo", f"place {quantity}, {_DRIVEN:g} s", place, float(body.r_0[0]), "m", _CLIMB))
        rows.append(relative(tier, "MuJoCo", f"pitch {quantity}", pitch, float(body.pitch), "rad", _SOFT))
    return rows


def _mass(system: Coupled) -> float:
    return float(system.rover.p.rock[1].mass)
