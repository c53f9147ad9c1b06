"""What moves the wheels of an experiment: the rover with its driver, or the carriage of a single-wheel testbed; and where they start."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from cdl_fmu.dem import DEM
from cdl_fmu.mesh.ray import highest, mesh_ground
from cdl_fmu.mesh.surface import load_surface
from cdl_fmu.scm import SCM
from cdl_fmu.slave.interface import ENVIRONMENT, body_pose
from cdl_fmu.slave.model import Instance, Model, ModelError
from cdl_fmu.slave.records import Real, Record
from cdl_fmu.terrain.raster import load_raster
from cdl_fmu.wheel import WHEEL
from mbs.carriage import Carriage
from mbs.driver import Driver
from mbs.rover import Rover

from .settle import Wires, settle
from .slip import wheel_rate_of

Contacts = Mapping[str, tuple[Instance, list[int]]]


@dataclass(frozen=True)
class Rig:
    """A kind of experiment: what its wheels are and what moves them.

    Attributes:
        mover: The part that has the wheels' poses.
        tiers: Its wheels, in the order of its ports -> where the tier of each is given.
        parts: Part -> class of its model.
        keys: What is set at the experiment's top level, above all sections.
        given: Parameter of the mover that a key of the top level sets -> that key.
        start: Parameters of the mover that place the wheels; if one of them is given, they are not put on the ground.
    """

    mover: str
    tiers: Mapping[str, str]
    parts: Mapping[str, type[Model]]
    keys: Record
    given: Mapping[str, str]
    start: frozenset[str]

    def mover_values(self, keys: Mapping[str, float], r_w: float) -> dict[str, float]:
        """Parameters of the mover by the values of the top level, ``keys`` holding those that are given; r_w is the wheel's radius [m].

        Raises ModelError for values that do not fit together.
        """
        return {}

    def run_values(self, keys: Mapping[str, float], mover: Instance, r_w: float) -> dict[str, float | None]:
        """What this kind of experiment knows better than the record of [run]: ``stop_time`` (None: nothing ends it) and ``step`` [s]."""
        return {}

    def put_on_ground(self, mover: Instance, contacts: Contacts, wires: Wires, ground: np.ndarray) -> None:
        """Set the mover's start on ground of these heights [m] below its wheels."""
        raise NotImplementedError


class _RoverRig(Rig):
    def put_on_ground(self, mover: Instance, contacts: Contacts, wires: Wires, ground: np.ndarray) -> None:
        centres = np.array(mover.y["wheel"]["r_0"])
        (front, rear), apart = ground, float(np.linalg.norm((centres[0] - centres[1])[:2]))
        mover.set_starts({"start.z": float(np.mean(ground)) + tip_radius(contacts), "start.pitch": math.atan2(rear - front, apart)})
        mover.set_starts(settle(mover, *_cells_in_place_of_particles(contacts, wires)))
        _lift_from_particles(mover, contacts)


#: Travel [m] of a testbed's carriage at least, and in radii of its wheel: sinkage and forces are stationary well before.
LEAST_TRAVEL, TRAVEL_IN_RADII = 0.5, 8.0
#: Travel of rim or hub in one step [m], and the longest step [s]: soil in cells of 5 mm then answers as in shorter steps.
STEP_TRAVEL, LONGEST_STEP = 1e-4, 0.01
_HIGH = 1e4  # [m] above all meshes
_SMALL = 1e-6  # [m], [rad] by which derivatives are taken
_STOPS_PER_SECOND = 10.0  # tenths of a second are multiples of the usual steps


class _Testbed(Rig):
    def mover_values(self, keys: Mapping[str, float], r_w: float) -> dict[str, float]:
        values = {own: keys[key] for own, key in self.given.items() if key in keys}
        if "wheel_rate" not in keys:
            speed = keys.get("carriage_speed", _TESTBED_KEYS["carriage_speed"].start)
            slip = keys.get("slip", _TESTBED_KEYS["slip"].start)
            rate, most = wheel_rate_of(slip, speed, r_w), _CARRIAGE["wheel_rate"].max
            if rate > most:
                needs = "an infinite wheel rate" if rate == math.inf else f"a wheel rate of {rate:.4g} rad/s, above {most:g} rad/s,"
                remedy = "use a smaller slip, or carriage_speed = 0 with a wheel_rate"
                raise ModelError(f"slip = {slip:g}: it needs {needs} at a carriage_speed of {speed:g} m/s; {remedy}")
            values["wheel_rate"] = rate
        return values

    def run_values(self, keys: Mapping[str, float], mover: Instance, r_w: float) -> dict[str, float | None]:
        p = mover.p
        fastest = max(float(p.speed), r_w * abs(float(p.wheel_rate)))
        step = _round_down(min(STEP_TRAVEL / fastest, LONGEST_STEP) if fastest > 0.0 else LONGEST_STEP)
        if p.speed == 0.0:
            return {"step": step, "stop_time": None}
        travel = keys.get("travel", max(LEAST_TRAVEL, TRAVEL_IN_RADII * r_w))
        end = float(p.lowering_time + 0.5 * p.start_ramp) + travel / float(p.speed)
        return {"step": step, "stop_time": math.ceil(end * _STOPS_PER_SECOND - 1e-6) / _STOPS_PER_SECOND}

    def put_on_ground(self, mover: Instance, contacts: Contacts, wires: Wires, ground: np.ndarray) -> None:
        particles = [contact.pool.highest for contact, _ in contacts.values() if isinstance(contact.model, DEM)]
        mover.set_starts({"start.z": max([float(ground[0]), *particles]) + tip_radius(contacts)})


ROVER = _RoverRig(
    "rover",
    {"front": "tiers.front", "rear": "tiers.rear"},
    {"rover": Rover, "driver": Driver},
    Record(),
    {},
    frozenset({"start.z", "start.pitch"}),
)

_CARRIAGE = Carriage.parameters.fields
_TESTBED_KEYS = {
    "load_N": _CARRIAGE["load"],
    "carriage_speed": _CARRIAGE["speed"],
    "slip": Real(
        0.0, "1", "Slip of the rim's speed r omega: 1 - V/(r omega) driving, r omega/V - 1 in skid; V is the carriage's", min=-1.0, max=1.0
    ),
    "slip_angle": _CARRIAGE["slip_angle"],
    "wheel_rate": _CARRIAGE["wheel_rate"],
    "travel": Real(LEAST_TRAVEL, "m", "Travel at full speed; by default 8 wheel radii, at least 0.5 m", min=1e-3, max=1e4),
}
TESTBED = _Testbed(
    "carriage",
    {"wheel": "tier"},
    {"carriage": Carriage},
    Record(**_TESTBED_KEYS),
    {"load": "load_N", "speed": "carriage_speed", "slip_angle": "slip_angle", "wheel_rate": "wheel_rate"},
    frozenset({"start.z"}),
)


def rig_of(tables: Mapping) -> Rig:
    """The kind of an experiment, by the sections of its file: one with a [carriage] is a testbed."""
    return TESTBED if "carriage" in tables else ROVER


def tip_radius(contacts: Contacts) -> float:
    """Radius [m] of the wheels up to the tips of their grousers."""
    p = next(iter(contacts.values()))[0].p
    return float(p.r_w + (p.h_g if p.n_g > 0.0 else 0.0))


def start(rig: Rig, mover: Instance, contacts: Contacts, wires: Wires, is_given: bool) -> None:
    """Set the mover's start pose on the ground, unless the user gives one, and the contacts' start inputs to match.

    Raises ModelError if there is no such pose, or the user's is far from the ground.
    """
    mover.initialise()
    for contact, _ in contacts.values():
        if isinstance(contact.model, DEM):
            contact.initialise()  # its bed
    centres = np.array(mover.y["wheel"]["r_0"])
    ground = ground_under(contacts, centres)
    if is_given:
        r_w = float(next(iter(contacts.values()))[0].p.r_w)
        for name, z, low in zip(rig.tiers, centres[:, 2], ground):
            where = f"{rig.mover}.start.z = {float(mover.p.start.z):g} m puts the axle of wheel {name} {abs(z - low):.4g} m"
            remedy = f"use a start.z between {low:g} and {low + 2 * r_w:g} m, or leave it out to start on the ground"
            if z < low:
                raise ModelError(f"{where} below the surface: {remedy}")
            if z > low + 2 * r_w:
                raise ModelError(f"{where} above the surface, its rim more than the wheel's radius above it: {remedy}")
    else:
        rig.put_on_ground(mover, contacts, wires, ground)
        mover.initialise()
    for name, (contact, _) in contacts.items():
        wires.feed(name)
        contact.initialise()


def _cells_in_place_of_particles(contacts: Contacts, wires: Wires) -> tuple[Contacts, Wires]:
    """Contacts for a rover that is to be at rest: SCM's soil in place of particles, which take their time to bear."""
    cells = {}
    for name, (contact, wheels) in contacts.items():
        if isinstance(contact.model, DEM):
            sizes = contact.model.sizes
            p = {key: float(contact.p[key]) for key in (*WHEEL.fields, *ENVIRONMENT.fields, "ground_z", "phi", "c", "rho")}
            cells[name] = Instance(SCM(sizes["n_wheels"], sizes["n_patches"]), name, **p), wheels
    if not cells:
        return contacts, wires
    instances = {**wires.instances, **{name: instance for name, (instance, _) in cells.items()}}
    return {**contacts, **cells}, Wires(instances, wires.connections)


def _lift_from_particles(mover: Instance, contacts: Contacts) -> None:
    """Lift the wheels on particles out of them, so that they sink in as the run begins; the others stay where they are."""
    wanted = {j: contact.pool.highest for contact, wheels in contacts.values() if isinstance(contact.model, DEM) for j in wheels}
    if not wanted:
        return
    at = {name: float(getattr(mover.p.start, name)) for name in ("z", "pitch")}

    def heights(**moved: float) -> np.ndarray:
        mover.set_starts({f"start.{name}": value + moved.get(name, 0.0) for name, value in at.items()})
        mover.initialise()
        return np.array(mover.y["wheel"]["r_0"][:, 2])

    now = heights()
    slopes = np.column_stack([(heights(**{name: _SMALL}) - now) / _SMALL for name in at])
    lift = np.array([wanted[j] + tip_radius(contacts) - z if j in wanted else 0.0 for j, z in enumerate(now)])
    heights(**dict(zip(at, np.linalg.lstsq(slopes, lift)[0])))


def ground_under(contacts: Contacts, points: np.ndarray) -> np.ndarray:
    """Heights [m] of the undisturbed ground at points [n, 2 or more]."""
    (first, p), *rest = ((name, contact.p) for name, (contact, _) in contacts.items())
    for name, other in rest:
        if other.ground_z != p.ground_z:
            both = f"{name}.ground_z = {other.ground_z:g} m, but {first}.ground_z = {p.ground_z:g} m"
            raise ModelError(f"{both}: the wheels stand on one ground; set both alike")
    base = next((contact.files["base"] for contact, _ in contacts.values() if contact.files.get("base")), None)
    mesh = next((contact.files["ground"] for contact, _ in contacts.values() if contact.files.get("ground")), None)
    if mesh is not None:
        return _on_mesh(Path(mesh), points)
    if base is None:
        return np.full(len(points), float(p.ground_z))
    raster = load_raster(base)
    axes = [first + raster.spacing * np.arange(n) for first, n in zip(raster.origin, raster.z.shape)]
    # Beyond the raster the last slope goes on: the contact that stands there refuses by name.
    return RegularGridInterpolator(axes, raster.z, bounds_error=False, fill_value=None)(points[:, :2])


def _on_mesh(path: Path, points: np.ndarray) -> np.ndarray:
    pose = np.zeros(1, body_pose(1).fields["body"].record.dtype)
    pose["T"] = np.eye(3)
    ground = mesh_ground(load_surface(path, ground=True).arrays, pose)
    heights = []
    for x, y, *_ in points:
        hit, z, *_ = highest(ground, x, y, _HIGH)
        if not hit:
            raise ModelError(
                f"ground = {path.name}: it does not reach below ({x:.4g}, {y:.4g}) m, where a wheel or rock starts; move it there"
            )
        heights.append(z)
    return np.array(heights)


def _round_down(value: float) -> float:
    """The largest 1, 2 or 5 times a power of ten that is not above a positive value."""
    power = 10.0 ** math.floor(math.log10(value) + 1e-9)
    return max(share * power for share in (1.0, 2.0, 5.0) if share * power <= value * (1.0 + 1e-9))
