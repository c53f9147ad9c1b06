"""Models in which each wheel stands on one plane: of flat ground, or fitted as in Fig. 8.4 in a patch of its own or in a mesh.

A model gives ``bear(p, wheel, patch, n_x, n_y, n_z, d, wrench, contact, shown)``, what acts on a wheel whose centre is d [m] above the
plane with that normal; ``patch`` says what pressed the ground before, None where nothing did.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from ..contact import NO_DATA, WHEEL_EVENTS, has_pose, refusal, release, sees
from ..mesh.ray import MeshGround, highest, mesh_ground
from ..mesh.surface import Meshes, load_surface, nothing
from ..slave.interface import body_pose
from ..slave.kernel import kernel
from ..slave.model import STATUS_SPAN, Event, ModelError
from ..slave.pool import ConstantPool
from ..slave.records import Array, Real, Record
from ..wheel import tip_radius
from .follow import PLANE, follow_plane
from .patch import surface

_OUTSIDE, _OFF, NO_GROUND = 5, 6, 7
#: Meaning of the status numbers of all steps here.
STAND_EVENTS = WHEEL_EVENTS | {
    _OUTSIDE: Event(
        "wheel {i}, at ({wheel.r_0[0]:.4g}, {wheel.r_0[1]:.4g}) m, is outside patch[{i}]: "
        "send the heights around the wheel's centre (origin, spacing, z)"
    ),
    _OFF: Event(
        "wheel {i}, at ({wheel.r_0[0]:.4g}, {wheel.r_0[1]:.4g}, {wheel.r_0[2]:.4g}) m, has no ground below its top: keep it on the mesh "
        "that ground names, and start it above"
    ),
    NO_GROUND: Event("ground names no file: give the path of the ground's mesh (.stl, .obj or .ply, in metres, z up)"),
}
#: Files of a model on a mesh.
GROUND = {"ground": "Mesh of the ground in world (.stl, .obj or .ply, in metres, z up), open or closed"}


def check_grounds(n_wheels: int, n_patches: int, n_grounds: int) -> None:
    """Raise ValueError for numbers that do not fit: a patch for each wheel, or one mesh for all, or neither."""
    if n_patches not in (0, n_wheels):
        raise ValueError(f"n_patches = {n_patches}: choose 0 (flat ground) or {n_wheels} (a patch for each wheel)")
    if n_grounds not in (0, 1) or (n_grounds and n_patches):
        raise ValueError(f"n_grounds = {n_grounds}: choose 0, or without patches 1 (a mesh for all wheels)")


def stand_state(n_wheels: int, n_patches: int, n_grounds: int) -> Record:
    """What such models remember."""
    return Record(
        wheel=Array(n_wheels, Record(silent=Real(0.0, "1", "Steps without a pose"))),
        plane=Array(n_wheels if n_grounds else n_patches, PLANE),
    )


def ground_pool(files: dict[str, Path]) -> ConstantPool:
    """The mesh of the ground.

    Raises:
        ModelError: The file does not hold a mesh in metres.
    """
    try:
        meshes = load_surface(files["ground"], ground=True).arrays if "ground" in files else nothing()
    except ModelError as error:
        raise ModelError(f"ground = {error}") from None
    poses = np.zeros(1, body_pose(1).fields["body"].record.dtype)
    poses["T"] = np.eye(3)
    ground = mesh_ground(meshes, poses)
    return ConstantPool((*ground.meshes, ground.poses, ground.stack))


@kernel
def initialise_flat(t, p, x, y):
    for i in range(len(y.wheel)):
        x.wheel[i].silent = 0.0
        release(y.wheel[i], y.contact[i], y.diagnostics[i])


@kernel
def initialise_planes(t, p, x, y, *arrays):
    for i in range(len(y.wheel)):
        x.wheel[i].silent = 0.0
        x.plane[i].known = 0.0
        release(y.wheel[i], y.contact[i], y.diagnostics[i])


@cache
def step_on_flat(bear):
    """The step of a model on flat ground at ``ground_z``."""

    @kernel
    def step(t, h, p, u, x, y):
        # Refuse before anything changes, so that the state of a refused step is the old one.
        for i in range(len(u.wheel)):
            refused = refusal(p, u.wheel[i], x.wheel[i].silent, p.ground_z)
            if refused:
                return refused + STATUS_SPAN * i
        status = 0
        for i in range(len(u.wheel)):
            wheel = u.wheel[i]
            if sees(wheel, x.wheel[i], y.wheel[i], y.contact[i], y.diagnostics[i]):
                bear(p, wheel, None, 0.0, 0.0, 1.0, wheel.r_0[2] - p.ground_z, y.wheel[i], y.contact[i], y.diagnostics[i])
            elif x.wheel[i].silent > 0.0:
                status = NO_DATA + STATUS_SPAN * i
        return status

    return step


@cache
def step_on_patches(bear, compaction: bool = False, further: float = 0.0):
    """The step of a model on patches, with compaction in them or without; flat ground where there is no patch yet.

    ``further`` [m] is as in ``follow_plane``.
    """

    @kernel
    def stand(p, wheel, patch, h, plane, wrench, contact, shown):
        n_x, n_y, n_z, d = 0.0, 0.0, 1.0, wheel.r_0[2] - p.ground_z
        if compaction:
            if patch.spacing > 0.0:
                n_x, n_y, n_z, d = follow_plane(p, wheel, patch, patch.sinkage, None, further, h, plane)
            bear(p, wheel, patch, n_x, n_y, n_z, d, wrench, contact, shown)
        else:
            if patch.spacing > 0.0:
                n_x, n_y, n_z, d = follow_plane(p, wheel, patch, None, None, further, h, plane)
            bear(p, wheel, None, n_x, n_y, n_z, d, wrench, contact, shown)

    @kernel
    def step(t, h, p, u, x, y):
        for i in range(len(u.wheel)):
            wheel, z = u.wheel[i], p.ground_z
            if wheel.active > 0.0 and u.patch[i].spacing > 0.0 and has_pose(wheel):
                inside, z, _, _ = surface(u.patch[i], wheel.r_0[0], wheel.r_0[1])
                if not inside:
                    return _OUTSIDE + STATUS_SPAN * i
            refused = refusal(p, wheel, x.wheel[i].silent, z)
            if refused:
                return refused + STATUS_SPAN * i
        status = 0
        for i in range(len(u.wheel)):
            wheel = u.wheel[i]
            if sees(wheel, x.wheel[i], y.wheel[i], y.contact[i], y.diagnostics[i]):
                stand(p, wheel, u.patch[i], h, x.plane[i], y.wheel[i], y.contact[i], y.diagnostics[i])
            else:
                x.plane[i].known = 0.0
                if x.wheel[i].silent > 0.0:
                    status = NO_DATA + STATUS_SPAN * i
        return status

    return step


@cache
def step_on_mesh(bear, further: float = 0.0):
    """The step of a model on a mesh; ``further`` [m] is as in ``follow_plane``."""

    @kernel
    def step(t, h, p, u, x, y, *arrays):
        ground = MeshGround(Meshes(*arrays[:-2]), arrays[-2], arrays[-1])
        if len(ground.meshes.nodes) == 0:
            return NO_GROUND
        for i in range(len(u.wheel)):
            wheel = u.wheel[i]
            if wheel.active > 0.0 and has_pose(wheel):
                hit, z, _, _, _ = highest(ground, wheel.r_0[0], wheel.r_0[1], wheel.r_0[2] + tip_radius(p))
                if not hit:
                    return _OFF + STATUS_SPAN * i
                refused = refusal(p, wheel, x.wheel[i].silent, z)
            else:
                refused = refusal(p, wheel, x.wheel[i].silent, 0.0)
            if refused:
                return refused + STATUS_SPAN * i
        status = 0
        for i in range(len(u.wheel)):
            wheel = u.wheel[i]
            if sees(wheel, x.wheel[i], y.wheel[i], y.contact[i], y.diagnostics[i]):
                n_x, n_y, n_z, d = follow_plane(p, wheel, None, None, ground, further, h, x.plane[i])
                bear(p, wheel, None, n_x, n_y, n_z, d, y.wheel[i], y.contact[i], y.diagnostics[i])
            else:
                x.plane[i].known = 0.0
                if x.wheel[i].silent > 0.0:
                    status = NO_DATA + STATUS_SPAN * i
        return status

    return step
