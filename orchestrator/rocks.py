"""Rocks of an experiment: their keys, their meshes, what they weigh, and where they lie."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cdl_fmu.frames import axis_rotation
from cdl_fmu.mesh.rocks import MOST_ROUGH
from cdl_fmu.mesh.rocks import rock as generated
from cdl_fmu.mesh.surface import Surface, load_surface
from cdl_fmu.slave.kernel import cache_folder
from cdl_fmu.slave.model import Instance, ModelError
from cdl_fmu.slave.records import Real, Record
from fmus import ROCK_TIERS
from mbs.rover import Rover

from .settle import Wires

#: Name of the part that is the contact of wheels and rocks.
ROCKS = "rocks"

#: What a hard contact model may ask of each body.
_HARD = {name: field for kind in ROCK_TIERS.values() for name, field in kind(1, 1).parameters.fields["body"].record.fields.items()}
#: Keys of a [[rock]].
ROCK = Record(
    x=Real(0.0, "m", "Position of the rock's frame", (), -1e6, 1e6),
    y=Real(0.0, "m", "Position of the rock's frame", (), -1e6, 1e6),
    yaw=Real(0.0, "rad", "Rotation about z, then about the new y and x by pitch and roll", (), -10.0, 10.0),
    pitch=Real(0.0, "rad", "Pitch", (), -1.5708, 1.5708),
    roll=Real(0.0, "rad", "Roll", (), -10.0, 10.0),
    buried=Real(0.5, "1", "Share of the rock's height that lies below the ground, at rest", min=-10.0, max=1.0),
    density=Real(2700.0, "kg/m3", "Density of the rock (granite)", min=1.0, max=3e4),
    size=Real((0.2, 0.16, 0.12), "m", "Extents of a generated rock along its axes", (3,), 0.01, 3.0),
    roughness=Real(0.2, "1", "Depth of a generated rock's cuts and lumps over its radius", min=0.0, max=MOST_ROUGH),
    seed=Real(1.0, "1", "Number of a generated rock's random shape", min=0.0, max=2.0**31),
    **{name: field for name, field in _HARD.items() if name != "mass"},
)
_MASS, _CENTER = (Rover(2, 1).parameters.fields["rock"].record.fields[name] for name in ("mass", "center"))
#: Its file.
MESH = {"mesh": "Closed mesh of the rock (.stl, .obj or .ply, in metres); none = a generated one"}


@dataclass(frozen=True)
class Rock:
    """A rock of an experiment.

    Attributes:
        values: By key of ``ROCK``, as they are stored.
        path: Of its mesh.
        surface: That mesh.
    """

    values: Mapping[str, float]
    path: Path
    surface: Surface

    @property
    def mass(self) -> float:
        """[kg]"""
        return self.surface.volume * self.values["density"]

    def rover_values(self, j: int, z: float) -> dict[str, float]:
        """Start values of the rover for its rock j, counted from 1, whose frame is at height z [m]."""
        inertia = self.surface.inertia * self.values["density"]
        pairs = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]
        own = {"mass": self.mass, "z": z} | {key: self.values[key] for key in ("x", "y", "yaw", "pitch", "roll", "fixed")}
        own |= {f"center[{k + 1}]": float(self.surface.centre[k]) for k in range(3)}
        own |= {f"inertia[{k + 1}]": float(inertia[pair]) for k, pair in enumerate(pairs)}
        return {f"rock[{j}].{name}": value for name, value in own.items()}

    def hard_values(self, j: int, wanted: Record) -> dict[str, float]:
        """Start values of a hard contact model that declares ``wanted`` of each body, for its body j, counted from 1."""
        return {f"body[{j}].{name}": self.mass if name == "mass" else self.values[name] for name in wanted.fields}

    def height(self, ground: float) -> float:
        """Height of the frame [m] at which the share ``buried`` of the rock is below the ground."""
        yaw, pitch, roll = (self.values[key] for key in ("yaw", "pitch", "roll"))
        T = axis_rotation(1, roll) @ axis_rotation(2, pitch) @ axis_rotation(3, yaw)
        z = self.surface.arrays.vertices[:, :3] @ T[:, 2]
        return ground - float(z.min()) - self.values["buried"] * float(np.ptp(z))


def make_rock(values: Mapping[str, float], mesh: str) -> Rock:
    """A rock by the keys that are given, and the path of its mesh, "" for a generated one.

    Raises:
        ModelError: The mesh cannot be used.
    """
    values = {s.name: s.start for s in ROCK.scalars()} | dict(values)
    if values["seed"] != np.floor(values["seed"]):
        raise ModelError(f"seed = {values['seed']:g}: it must be a whole number")
    path = Path(mesh) if mesh else _generate(values)
    try:
        rock = Rock(values, path, load_surface(path))
    except ModelError as error:
        raise ModelError(f"mesh = {error}") from None
    what = f"mesh = {path.name}" if mesh else "size"
    if not _MASS.min <= rock.mass <= _MASS.max:
        across = float(np.ptp(rock.surface.arrays.vertices[:, :3], axis=0).max())
        raise ModelError(
            f"{what}: the rock is {across:.3g} m across and weighs {rock.mass:.3g} kg at density = {values['density']:g} kg/m3; it must "
            f"weigh {_MASS.min:g} to {_MASS.max:g} kg: is the mesh in millimetres? scale it by 0.001"
        )
    if np.abs(rock.surface.centre).max() > _CENTER.max:
        raise ModelError(f"{what}: its centre of mass is more than {_CENTER.max:g} m from its origin; move the mesh to the origin")
    return rock


def hard_keys() -> list[str]:
    """Keys of a rock that hard contact models ask for, each its own."""
    return [name for name in _HARD if name not in ("mass", "fixed")]


def _generate(values: Mapping[str, float]) -> Path:
    """Path of a generated rock's mesh in the cache."""
    arguments = int(values["seed"]), tuple(values[f"size[{k}]"] for k in (1, 2, 3)), values["roughness"]
    stone = generated(*arguments)
    key = hashlib.sha256(stone.vertices.tobytes()).hexdigest()[:16]
    path = cache_folder("rocks") / f"rock_{key}.ply"
    if not path.exists():
        part = path.with_suffix(".part.ply")
        stone.export(part)
        part.replace(path)
    return path


def place(rocks: Sequence[Rock], rover: Instance, ground: np.ndarray) -> None:
    """Set the rover's rocks on ground of these heights [m] at their places."""
    for j, (rock, z) in enumerate(zip(rocks, ground), 1):
        rover.set_starts(rock.rover_values(j, rock.height(float(z))))


_DEEPEST = 0.2  # [m] by which a rock has pressed the soil below it, at most
_HALVINGS = 20


def bed(rocks: Sequence[Rock], name: str, soil: Instance, wires: Wires, gravity: float) -> None:
    """Set how far each rock has pressed the soil below it before, so that the soil bears its weight where it lies; fixed rocks have not.

    Soil that is too weak to bear a rock there gives way when the run begins.

    Args:
        name, soil: Instance of SCM whose bodies are the rocks, initialised with their poses.
        wires: Connections of all parts.
        gravity: Along the ground's normal [m/s2].
    """
    fixed = ROCK.fields["fixed"].value("on")
    if all(rock.values["fixed"] == fixed for rock in rocks):
        return
    loads = np.array([0.0 if rock.values["fixed"] == fixed else rock.mass * gravity for rock in rocks])

    def set_settled(depths: np.ndarray) -> None:
        soil.set_starts({f"body[{j}].settled": float(depth) for j, depth in enumerate(depths, 1)})
        wires.feed(name)
        soil.initialise()

    low, high = np.zeros(len(rocks)), np.full(len(rocks), _DEEPEST)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        set_settled(middle)
        bears = np.array(soil.y["body"]["f_0"][:, 2]) >= loads
        low, high = np.where(bears, low, middle), np.where(bears, middle, high)
    set_settled(np.where(loads > 0.0, high, 0.0))
