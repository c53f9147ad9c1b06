"""Rigid bodies that move freely on SCM's soil, integrated implicitly with the interface Jacobian that it sends."""

import math
from pathlib import Path

import numpy as np
import trimesh

from cdl_fmu.frames import axis_rotation
from cdl_fmu.scm import SCM
from cdl_fmu.slave.model import Instance

G = 9.81


class FreeBody:
    """A body of a mesh whose origin is its centre of mass, beside a wheel that is not there yet.

    Args:
        path: The mesh.
        mass: [kg]
        z: Height of the centre of mass at the start [m].
        roll, pitch, yaw: Attitude at the start [deg].
        at: x and y at the start [m].
    """

    def __init__(self, path: Path, mass: float, z: float, roll=0.0, pitch=0.0, yaw=0.0, at=(0.0, 0.0), **parameters):
        solid = trimesh.load_mesh(path)
        self.mass, self.inertia = mass, np.array(solid.moment_inertia) * (mass / solid.volume)
        self.instance = Instance(SCM(1, 0, 1), "scm", **{"body[1].mesh": path}, **parameters)
        self.instance.u.wheel["active"] = 0.0
        body = self.body
        body.r_0[:] = *at, z
        body["T"][:] = axis_rotation(1, math.radians(roll)) @ axis_rotation(2, math.radians(pitch)) @ axis_rotation(3, math.radians(yaw))
        self.instance.initialise()

    @property
    def body(self):
        return self.instance.u.body[0]

    def step(self, h: float, push=(0.0, 0.0, 0.0)) -> None:
        """One step of the soil, then one of the body under its weight and a force at its centre of mass [N], implicit in the Jacobian."""
        body, y, support = self.body, self.instance.y.body[0], self.instance.y.support[0]
        self.instance.step(0.0, h)
        T = body["T"].copy()
        inertia = T.T @ self.inertia @ T
        v, w = body.v_0.copy(), body.w_0.copy()
        # Motion of the material at point_0: v + w x r.
        to_point, mass = np.eye(6), self.mass * np.eye(6)
        to_point[:3, 3:], mass[3:, 3:] = -_cross_matrix(support.point_0 - body.r_0), inertia
        K, D = np.diag([*support.K, *support.K_r]), np.diag([*support.D, *support.D_r])
        force = np.concatenate([y.f_0 + push - [0.0, 0.0, self.mass * G], y.t_0 - np.cross(w, inertia @ w)])
        K, D = to_point.T @ K @ to_point, to_point.T @ D @ to_point
        change = np.linalg.solve(mass + h * D + h * h * K, h * (force - h * K @ np.concatenate([v, w])))
        body.v_0[:], body.w_0[:] = v + change[:3], w + change[3:]
        body.r_0 += h * body.v_0
        body["T"][:] = T @ turn(-h * body.w_0)

    @property
    def energy(self) -> float:
        """Kinetic and potential energy [J]."""
        body, T = self.body, self.body["T"]
        spin = T @ body.w_0
        return float(0.5 * self.mass * body.v_0 @ body.v_0 + 0.5 * spin @ self.inertia @ spin + self.mass * G * body.r_0[2])

    def run(self, seconds: float, h=1e-3, push=(0.0, 0.0, 0.0)) -> np.ndarray:
        """Position, velocity, angular velocity, force and energy [m, m/s, rad/s, N, J] after each step, [n, 13]."""
        rows = []
        for _ in range(round(seconds / h)):
            self.step(h, push)
            body = self.body
            rows.append([*body.r_0, *body.v_0, *body.w_0, *self.instance.y.body[0].f_0, self.energy])
        return np.array(rows)


def turn(rotation: np.ndarray) -> np.ndarray:
    """Matrix that turns vectors by a rotation vector [rad] (Rodrigues)."""
    angle = np.linalg.norm(rotation)
    axis = _cross_matrix(rotation / max(angle, 1e-30))
    return np.eye(3) + math.sin(angle) * axis + (1.0 - math.cos(angle)) * axis @ axis


def _cross_matrix(a: np.ndarray) -> np.ndarray:
    """Matrix of the vector product with a."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])
