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
        arm = _cross_matrix(support.point_0 - body.r_0)
        to_point = np.block([[np.eye(3), -arm], [np.zeros((3, 3)), np.eye(3)]])
        K, D = np.diag([*support.K, *support.K_r]), np.diag([*support.D, *support.D_r])
        mass = np.block([[self.mass * np.eye(3), np.zeros((3, 3))], [np.zeros((3, 3)), inertia]])
        force = np.concatenate([y.f_0 + push - [0.0, 0.0, self.mass * G], y.t_0 - np.cross(w, inertia @ w)])
        twist = np.concatenate([v, w])
        implicit = to_point.T @ (D + h * K) @ to_point
        change = np.linalg.solve(mass + h * implicit, h * (force - h * (to_point.T @ K @ to_point) @ twist))
        body.v_0[:], body.w_0[:] = v + change[:3], w + change[3:]
        body.r_0 += h * body.v_0
        angle = np.linalg.norm(body.w_0) * h
        turn = np.eye(3)
        if angle > 0.0:
            axis = _cross_matrix(body.w_0 * h / angle)
            turn += math.sin(angle) * axis + (1.0 - math.cos(angle)) * axis @ axis
        u, _, v_t = np.linalg.svd(T @ turn.T)
        body["T"][:] = u @ v_t

    @property
    def energy(self) -> float:
        """Kinetic and potential energy [J]."""
        body, T = self.body, self.body["T"]
        spin = T @ body.w_0
        return float(0.5 * self.mass * body.v_0 @ body.v_0 + 0.5 * spin @ self.inertia @ spin + self.mass * G * body.r_0[2])

    def run(self, seconds: float, h=1e-3, push=(0.0, 0.0, 0.0)) -> np.ndarray:
        """Rows of position, velocity, angular velocity, force and energy after each step, [n, 13]."""
        rows = []
        for _ in range(round(seconds / h)):
            self.step(h, push)
            body = self.body
            rows.append([*body.r_0, *body.v_0, *body.w_0, *self.instance.y.body[0].f_0, self.energy])
        return np.array(rows)


def _cross_matrix(a):
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])
