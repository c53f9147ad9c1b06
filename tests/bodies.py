"""Meshes of bodies, and bodies that are moved over SCM's soil in process."""

import math
from pathlib import Path

import numpy as np
import trimesh

from cdl_fmu.frames import axis_rotation
from cdl_fmu.scm import SCM
from cdl_fmu.slave.model import Instance

N_BODIES = 2


def plate(path: Path, diameter: float, thickness=0.02) -> Path:
    """A round plate, its origin in the middle of its lower face."""
    return _write(path, trimesh.creation.cylinder(0.5 * diameter, thickness, sections=128), 0.5 * thickness)


def box(path: Path, *size: float) -> Path:
    """A box, its origin in the middle of its lower face."""
    return _write(path, trimesh.creation.box(size), 0.5 * size[2])


def ball(path: Path, radius: float) -> Path:
    """A ball about the origin."""
    return _write(path, trimesh.creation.icosphere(4, radius), 0.0)


def _write(path: Path, mesh: trimesh.Trimesh, up: float) -> Path:
    mesh.apply_translation([0.0, 0.0, up])
    mesh.export(path)
    return path


class Bodies:
    """An SCM with bodies whose motion is prescribed; those without a mesh of their own have the first one's and hang high in the air."""

    def __init__(self, *meshes: Path, **parameters):
        files = {f"body[{i + 1}].mesh": meshes[min(i, len(meshes) - 1)] for i in range(N_BODIES)}
        self.instance = Instance(SCM(1, 0, N_BODIES), "scm", **files, **parameters)
        self.instance.u.wheel["active"] = 0.0
        for i in range(N_BODIES):
            self.place(i, 0.0, 0.0, 5.0 + i)
        self.instance.initialise()
        self.instance.step(0.0, 0.0)  # a body that has been in the air is put on the soil, not laid into it

    def place(self, i, x, y, z, pitch=0.0, roll=0.0, yaw=0.0):
        """Put a body somewhere, at rest; angles [deg]."""
        body = self.instance.u.body[i]
        body.r_0[:] = x, y, z
        body["T"][:] = axis_rotation(1, math.radians(roll)) @ axis_rotation(2, math.radians(pitch)) @ axis_rotation(3, math.radians(yaw))
        body.v_0[:] = body.w_0[:] = 0.0

    def move(self, seconds: float, *velocities, h=1e-3) -> np.ndarray:
        """Move the first bodies at these velocities [m/s]; wrenches on the first one [n, 6] by step."""
        wrenches = []
        for k in range(max(1, round(seconds / h))):
            for body, v in zip(self.instance.u.body, velocities):
                body.r_0 += h * np.array(v)
                body.v_0[:] = v
            self.instance.step(k * h, h)
            wrenches.append(self.wrench(0))
        return np.array(wrenches)

    def wrench(self, i) -> np.ndarray:
        """Force [N] and torque [N.m] on a body."""
        return np.concatenate([self.instance.y.body[i].f_0, self.instance.y.body[i].t_0])
