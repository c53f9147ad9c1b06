"""What a contact tier considers, each effect a small measurement of one smooth wheel in process: ``measured(tier)``."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import trimesh
from dem_tier import CLEARANCE, GROUSERS, SOIL, D, across, moved, places
from vehicle import MASS, RADIUS, TIP, G, Vehicle

from cdl_fmu.bcm import BCM
from cdl_fmu.dem.model import DEM
from cdl_fmu.dem.pool import GrainPool
from cdl_fmu.rbc import RBC
from cdl_fmu.scm import SCM
from cdl_fmu.scm.pool import SoilPool
from cdl_fmu.slave.model import Instance
from cdl_fmu.vem import VEM
from orchestrator.validate.sand import surface

LOAD = MASS * G
SPEED, PATH, H = 0.1, 0.7, 2e-3  # of the wheels [m/s], how far they roll [m], and the step [s]
STEP = 0.04  # height of what they climb [m]
BALL = 0.05  # radius of a stone [m]


@dataclass(frozen=True)
class Tier:
    """A tier as its wheels are put on ground.

    Attributes:
        name: Of the tier.
        ground: Makes wheels on level ground, as soft as the tier can be: ``ground(n_wheels, **parameters)``.
        heights: Makes wheels on given heights [m], ``heights(n_wheels, height(x, y), **parameters)``; None where ``stones`` serve,
            or where heights cannot be given.
        stones: Makes wheels on fixed bodies: ``stones(n_wheels, [(mesh, position), ...], **parameters)``; None where it has none.
        stones_on_soil: Makes a smooth wheel on soil that meets such bodies, while the wheel does not; None where it meets none.
        settings: Parameters of a body that set how an impact rebounds, with what they are called, the least rebound first.
        tilts: Parameters that tell the tier of a slope [rad] that falls along x.
        path: How far wheels roll [m]; shorter where that is not affordable.
        clearance: Height [m] above z = 0 from which on nothing is in a wheel's way.
        grousers: Parameters of ground that is fine enough for grousers.
    """

    name: str
    ground: Callable[..., Instance]
    heights: Callable[..., Instance] | None
    stones: Callable[..., Instance] | None
    stones_on_soil: Callable[[list], Instance] | None = None
    settings: tuple[tuple[dict[str, float], str], ...] = ()
    tilts: Callable[[float], dict[str, float]] = lambda slope: {}
    path: float = PATH
    clearance: float = 0.0
    grousers: dict[str, float] = field(default_factory=dict)


def tiers(folder: Path) -> list[Tier]:
    """RBC, VEM, BCM, SCM and DEM; meshes go into the folder."""
    floor = export(folder, "floor", trimesh.creation.box((8.0, 4.0, 0.2)))
    slab = (floor, (0.0, 0.0, -0.1))

    sand = dict(strength="critical_state")  # BCM and SCM can: soil loses strength as it is sheared

    def rbc(n_wheels, bodies, **parameters):
        return with_bodies(RBC(n_wheels, len(bodies)), bodies, **parameters)

    def vem(n_wheels, bodies, **parameters):
        return with_bodies(VEM(n_wheels, 0, len(bodies)), bodies, **parameters)

    def patches(n_wheels, height, **parameters):
        return Instance(BCM(n_wheels, n_wheels), **sand, **parameters)

    def based(n_wheels, height, **parameters):
        x, y = np.meshgrid(np.arange(-2.0, 2.0, 0.01), np.arange(-0.5, 0.5, 0.01), indexing="ij")
        np.savez(folder / "base.npz", z=height(x, y), origin=(-2.0, -0.5), spacing=0.01)
        return Instance(SCM(n_wheels), base=folder / "base.npz", map_min=(-1.9, -0.45), map_max=(1.9, 0.45), **parameters)

    rebounds = tuple(({"body[1].restitution": e}, f"restitution {e:g}") for e in (0.0, 0.5, 1.0))
    damped = tuple(({"body[1].damping_ratio": d}, f"damping {d:g}") for d in (1.0, 0.2, 0.0))

    def downhill(slope):
        return dict(slope=slope, uphill=math.pi)

    def in_sand(bodies):
        return with_bodies(SCM(1, 0, len(bodies)), bodies, n_g=0)

    def in_grains(bodies):
        return with_bodies(DEM(1, 0, len(bodies)), bodies, n_g=0, **SOIL)

    shorter = dict(path=0.36 * PATH, clearance=CLEARANCE, grousers=GROUSERS)
    return [
        Tier("RBC", lambda n, **p: rbc(n, [slab], **p), None, rbc, settings=rebounds),
        Tier("VEM", lambda n, **p: Instance(VEM(n), normal_model="bekker", **p), None, vem, settings=damped),
        Tier("BCM", lambda n, **p: Instance(BCM(n), **sand, **p), patches, None, tilts=downhill),
        Tier("SCM", lambda n, **p: Instance(SCM(n), **sand, **p), based, None, in_sand, tilts=downhill),
        Tier("DEM", lambda n, **p: Instance(DEM(n), **(SOIL | p)), None, None, in_grains, tilts=downhill, **shorter),
    ]


def export(folder: Path, name: str, mesh: trimesh.Trimesh) -> Path:
    """Write a mesh and give its path."""
    mesh.export(folder / f"{name}.stl")
    return folder / f"{name}.stl"


def with_bodies(model, bodies, **parameters) -> Instance:
    """A model with bodies (mesh, position) that stay where they are."""
    for j, (mesh, _) in enumerate(bodies, 1):
        parameters |= {f"body[{j}].mesh": mesh}
        if "body" in model.parameters.fields and "fixed" in model.parameters.fields["body"].record.fields:
            parameters |= {f"body[{j}].fixed": "on"}
    instance = Instance(model, **parameters)
    for body, (_, position) in zip(instance.u.body, bodies):
        body.r_0[:] = position
    return instance


def wheel_on(instance: Instance, free=("z",), **options) -> Vehicle:
    """A smooth wheel that was put down gently."""
    vehicle = Vehicle(instance, free, **({"radius": RADIUS} | options))
    vehicle.put_down()
    return vehicle


def rolled(vehicle: Vehicle, slip=0.0, angle=0.0, path=PATH) -> np.ndarray:
    """Force over load, sinkage [m], and energy lost a metre over the load, of a wheel that rolls on with its heading along x, [n, 5].

    Args:
        vehicle: The wheel.
        slip: Of the rim without grousers.
        angle: Slip angle [rad].
        path: How far it rolls [m].
    """
    vehicle.q[:2] = SPEED * math.cos(angle), SPEED * math.sin(angle)
    vehicle.rate = vehicle.q[0] / (RADIUS * (1.0 - slip))

    def reading(v):
        force, torque = v.force(), -v.instance.y.wheel[0].t_0[1]
        return (*(force / LOAD), -v.lowest, (torque * v.rate / v.q[0] - force[0]) / LOAD)

    return vehicle.run(path / SPEED, H, reading)


def steady(tier: Tier, slip=0.0, angle=0.0, radius=RADIUS, share=1.0, **parameters) -> np.ndarray:
    """Mean of that over the last third of the path, or of a share of it."""
    vehicle = wheel_on(tier.ground(1, **({"n_g": 0} | parameters)), radius=radius, clearance=tier.clearance)
    rows = rolled(vehicle, slip, angle, share * tier.path)
    return rows[2 * len(rows) // 3 :].mean(axis=0)


def rest(vehicle: Vehicle, x: float, y: float, mass: float, seconds: float) -> float:
    """Height of the lowest point [m] at which the wheel with this mass comes to rest there, let down from 30 mm above z = 0."""
    vehicle.rate, vehicle.q[:] = 0.0, 0.0
    vehicle.r[2] += 0.2
    vehicle.step(H)  # off the ground
    vehicle.r[:] = x, y, vehicle.r[2] - vehicle.lowest + 0.03
    own, vehicle.mass, vehicle.q[:] = vehicle.mass, mass, 0.0
    vehicle.put_down(seconds)
    vehicle.mass = own
    return vehicle.lowest


def _sinkage(tier: Tier) -> dict[str, float]:
    """Sinkage from z = 0, or from where 0.2 kg rest on particles, which reach above their mean surface."""

    def lowest(mass):
        return wheel_on(tier.ground(1, n_g=0), mass=mass, clearance=tier.clearance).lowest

    level = lowest(0.2) if tier.clearance else 0.0
    sunk = [level - lowest(mass) for mass in (MASS, 2.0 * MASS, 1.02 * MASS)]
    more = sunk[2] - sunk[0]
    return {"sinkage": sunk[0], "sinkage_of_twice_the_load": sunk[1], "stiffness": 0.02 * LOAD / more if more > 1e-9 else math.inf}


def _rolling(tier: Tier) -> dict[str, float]:
    level, slow, fast, spinning = (steady(tier, slip) for slip in (0.0, 0.1, 0.3, 0.6))
    smooth = steady(tier, 0.3, share=0.7, **tier.grousers) if tier.grousers else fast
    grousers = steady(tier, 0.3, radius=TIP, share=0.7 if tier.grousers else 1.0, n_g=12, **tier.grousers)
    return {
        "pull_00": level[0],
        "loss": level[4],
        "pull_01": slow[0],
        "pull_03": fast[0],
        "pull_06": spinning[0],
        "slip_sinkage": spinning[3] - level[3],
        "grousers": grousers[0] - smooth[0],
        "lateral": abs(steady(tier, 0.1, math.radians(15.0))[1]),
    }


def _passes(tier: Tier) -> dict[str, float]:
    """A wheel goes twice over the same ground; with 0.2 kg on it, it feels what the first pass left where no soil can be looked at."""
    vehicle = wheel_on(tier.ground(1, n_g=0), clearance=tier.clearance)
    instance, last = vehicle.instance, round(1.0 / H)
    if isinstance(instance.pool, GrainPool):
        first, answers = _first_pass_over_particles(tier, vehicle)
    else:
        before = rest(vehicle, -0.8, 0.0, 0.2, 1.5)
        rest(vehicle, 0.0, 0.0, MASS, 1.5)
        first = rolled(vehicle, 0.2)[-last:, 0].mean()
        answers = {"rut": before - rest(vehicle, 0.4, 0.0, 0.2, 1.5), "berm": rest(vehicle, 0.45, 0.14, 0.2, 1.5) - before}
    if isinstance(instance.pool, SoilPool):
        soil = surface(instance)
        across_it = soil.z[round((0.4 - soil.origin[0]) / soil.spacing)]
        answers |= {"rut": -float(np.nanmin(across_it)), "berm": float(np.nanmax(across_it))}  # a wheel lies on the rut's walls
    rest(vehicle, 0.0, 0.0, MASS, 1.5)
    second = rolled(vehicle, 0.2, path=tier.path)[-last:, 0].mean()
    return answers | {"second_pull": second - first}


def _first_pass_over_particles(tier: Tier, vehicle: Vehicle) -> tuple[float, dict[str, float]]:
    """Pull over load of the first pass, and how far it moved the surface, and the particles one to two diameters below the rut."""
    instance, x = vehicle.instance, 4.0 / 7.0 * tier.path
    level, at_first = across(instance, x), places(instance)
    first = rolled(vehicle, 0.2, path=tier.path)[-round(1.0 / H) :, 0].mean()
    rise = across(instance, x) - level
    rut = -float(rise.min())
    return first, {"rut": rut, "berm": float(rise.max()), "below": moved(at_first, places(instance), x, -rut - D)}


def _creep(tier: Tier) -> dict[str, float]:
    """Speed at which a locked wheel creeps down 10 deg, after 2 s."""
    slope = math.radians(10.0)
    vehicle = wheel_on(tier.ground(1, n_g=0, **tier.tilts(slope)), slope=slope, clearance=tier.clearance)
    vehicle.free = [0, 2]
    x = vehicle.run(3.0, 1e-3, lambda v: v.r[0])
    return {"creep": abs(x[-1] - x[1999])}


def _rebound(instance: Instance, clearance: float = 0.0) -> float:
    """Rebound speed over impact speed of a wheel that meets the ground at 1 m/s."""
    vehicle = Vehicle(instance, ("z",), radius=RADIUS, clearance=clearance + 1e-6)
    vehicle.q[2] = -math.sqrt(1.0 - 2.0 * G * clearance)
    speeds = vehicle.run(0.15, 1e-4, lambda v: v.q[2])
    return max(0.0, float(speeds.max()))


def _impact(tier: Tier, folder: Path) -> dict[str, object]:
    if tier.stones is None:
        return {"rebounds": [("soil", _rebound(tier.ground(1, n_g=0), tier.clearance))]}
    slab = [(folder / "floor.stl", (0.0, 0.0, -0.1))]
    return {"rebounds": [(name, _rebound(tier.stones(1, slab, n_g=0, **given))) for given, name in tier.settings]}


def _stones(tier: Tier, folder: Path) -> dict[str, float]:
    """Shares of the load that stones carry: one below a wheel, and each of two between which it lies."""
    ball = export(folder, "ball", trimesh.creation.icosphere(4, BALL))
    high = 2.0 * BALL + 1e-3 + tier.clearance

    def on(*positions):
        bodies = [(ball, (*p, BALL + tier.clearance)) for p in positions]
        instance = tier.stones(1, bodies, n_g=0) if tier.stones else tier.stones_on_soil(bodies)
        vehicle = Vehicle(instance, ("z",), radius=RADIUS, clearance=high)
        vehicle.put_down(2.0)
        return vehicle

    if tier.stones is None and tier.stones_on_soil is None:
        return {}
    one = on((0.0, 0.0))
    shares = {"on_a_stone": (one.lowest - tier.clearance) / (2.0 * BALL)}
    if tier.stones:
        two = on((-0.08, 0.0), (0.08, 0.0))
        shares["least_of_two"] = min(-body.f_0[2] for body in two.instance.y.body) / LOAD
    return shares


def _climb(tier: Tier, folder: Path) -> dict[str, float]:
    """How high a wheel comes on a step of 40 mm, over the step's height."""

    def height(x, y):
        return np.where(x > 0.3, STEP, 0.0)

    if tier.stones:
        box = export(folder, "step", trimesh.creation.box((0.8, 0.4, STEP)))
        bodies = [(folder / "floor.stl", (0.0, 0.0, -0.1)), (box, (0.7, 0.0, 0.5 * STEP))]
        vehicle = wheel_on(tier.stones(1, bodies, n_g=0))
    elif tier.heights is None:
        return {}
    else:
        instance = tier.heights(1, height, n_g=0)
        vehicle = wheel_on(instance, ground=height if instance.model.sizes["n_patches"] else None)
    start = vehicle.lowest
    rolled(vehicle)
    return {"climbed": (vehicle.lowest - start) / STEP}


def measured(tier: Tier, folder: Path) -> dict[str, object]:
    """All effects of a tier: lengths in m, forces over the wheel's load, stiffness in N/m, creep in m/s; what it cannot do is left out."""
    answers = _sinkage(tier) | _rolling(tier) | _passes(tier) | _creep(tier)
    return answers | _impact(tier, folder) | _stones(tier, folder) | _climb(tier, folder)
