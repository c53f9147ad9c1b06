"""A rigid chassis on driven wheels in process, on any contact tier: what tiers are compared with.

The contact's interface Jacobian makes its step implicit, as the rover's is; a tier of rigid contacts is told the chassis' inverse inertia.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np

from cdl_fmu.frames import axis_rotation
from cdl_fmu.slave.interface import triangle
from cdl_fmu.slave.model import Instance

G = 9.81
RADIUS, TIP = 0.125, 0.135  # of the wheel of Table 8.2 without and with its grousers [m]
MASS = 27.0  # on each wheel [kg], as in the two-wheel drive
_SPACING, _TRACK, _ABOVE = 0.4, 0.8, 0.2  # of axles, between the sides, of the centre of mass above the axles [m]
_GUIDED = 1e3  # inertia that rigid contacts are told of a motion that is given, in masses: they slide on it and do not stop it
_ALL = ("x", "y", "z", "roll", "pitch", "yaw")


def rows_of_wheels(n: int) -> np.ndarray:
    """Centres of the wheels against the centre of mass [m], shape [n, 3]: in one track below 4 wheels, from there on in two."""
    tracks = 1 if n < 4 else 2
    axles = n // tracks
    x = _SPACING * (np.arange(axles) - 0.5 * (axles - 1))
    y = [0.0] if tracks == 1 else [-0.5 * _TRACK, 0.5 * _TRACK]
    return np.array([(a, b, -_ABOVE) for a in x for b in y])


def freedom(n: int) -> tuple[str, ...]:
    """What a chassis on n wheels is free to do: what its wheels hold."""
    return ("x", "z") if n == 1 else ("x", "z", "pitch") if n < 4 else _ALL


class Vehicle:
    """Wheels at a given rate on a rigid chassis, whose motion is given where it is not free.

    Args:
        instance: The contact tier, not initialised yet; all its wheels are the vehicle's, its bodies stay where they are.
        free: Names of the chassis' free motions.
        clearance: Of the wheels' lowest points above z = 0 at the start [m].
        radius: Of the wheels, with grousers [m].
        slope: Of the ground, in which x points downhill [rad].
        ground: Height of the ground [m] at x, y, for tiers that take patches.
    """

    def __init__(
        self,
        instance: Instance,
        free: tuple[str, ...],
        *,
        clearance: float = 0.0,
        radius: float = TIP,
        mass: float = MASS,
        slope: float = 0.0,
        ground: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None,
    ):
        self.instance, self.ground, self.radius = instance, ground, radius
        n = instance.model.sizes["n_wheels"]
        self.offsets = rows_of_wheels(n)
        self.r, self.T, self.q = np.array([0.0, 0.0, clearance + radius + _ABOVE]), np.eye(3), np.zeros(6)
        self.mass = mass * n
        self.free = [_ALL.index(name) for name in free]
        self.gravity = G * np.array([math.sin(slope), 0.0, -math.cos(slope)])
        self.rate = self.spin = self.t = 0.0
        self.damper = 0.0  # against z, to put wheels down gently [N.s/m]
        self.times: list[float] = []  # wall time of each step of the tier [s]
        self.contacts: list[int] = []  # of rigid and visco-elastic points in each step
        self._place()
        instance.initialise()

    @property
    def lowest(self) -> float:
        """Height of the first wheel's lowest point while the wheel is upright [m]."""
        return float((self.r + self.T.T @ self.offsets[0])[2] - self.radius)

    def force(self, wheel: int = 0) -> np.ndarray:
        """Contact force on a wheel, resolved in world [N]."""
        return self.instance.y.wheel[wheel].f_0.copy()

    def step(self, h: float) -> None:
        """One step of the tier, timed, and one of the chassis."""
        self._place()
        self._send_mobility(h)
        start = time.perf_counter()
        self.instance.step(self.t, h)
        self.times.append(time.perf_counter() - start)
        M, Q = self._inertia(h), self._own_force()
        C, K = np.zeros((6, 6)), np.zeros(6)
        for wheel, (arm, _) in zip(self.instance.y.wheel, self._arms):
            Q[:3] += wheel.f_0
            Q[3:] += wheel.t_0 + np.cross(arm, wheel.f_0)
        n = 0
        for i, contact in self._jacobians():
            J = contact.axes @ np.hstack([np.eye(3), -_cross_matrix(contact.point_0 - self.r)])
            arm, axle = self._arms[i]
            moves = J @ self.q + contact.axes @ np.cross(self.rate * axle, contact.point_0 - self.r - arm)
            C += J.T @ np.diag(contact.D + h * contact.K) @ J
            K += J.T @ (contact.K * moves)
            n += 1
        self.contacts.append(int(self.instance.y.n_contacts) if "n_contacts" in self.instance.model.outputs.fields else n)
        free = np.ix_(self.free, self.free)
        if self.free:
            self.q[self.free] += np.linalg.solve((M + h * C)[free], h * (Q - h * K)[self.free])
        self.r = self.r + h * self.q[:3]
        angle = float(np.linalg.norm(self.q[3:])) * h
        if angle > 0.0:
            axis = _cross_matrix(self.q[3:] * h / angle)
            self.T = self.T @ (np.eye(3) + math.sin(angle) * axis + (1.0 - math.cos(angle)) * axis @ axis).T
        self.spin += h * self.rate
        self.t += h

    def run(self, seconds: float, h: float = 1e-3, record: Callable[[Vehicle], object] = lambda vehicle: None) -> np.ndarray:
        """What ``record`` returns after each step."""
        out = []
        for _ in range(round(seconds / h)):
            self.step(h)
            out.append(record(self))
        return np.array(out)

    def put_down(self, seconds: float = 1.0) -> None:
        """Lower the standing wheels against a damper, so slowly that they do not sink deeper than they will rest."""
        self.rate, self.q[:], self.damper = 0.0, 0.0, 150.0 * self.mass
        self.run(seconds, 2e-3)
        self.damper = 0.0

    def _place(self) -> None:
        u, axle = self.instance.u, self.T[1]
        turned = axis_rotation(2, self.spin) @ self.T
        self._arms = [(self.T.T @ offset, axle) for offset in self.offsets]
        for wheel, (arm, _) in zip(u.wheel, self._arms):
            wheel.r_0[:], wheel["T"][:] = self.r + arm, turned
            wheel.v_0[:] = self.q[:3] + np.cross(self.q[3:], arm)
            wheel.w_0[:] = self.q[3:] + self.rate * axle
        if self.ground is not None:
            for patch, (arm, _) in zip(u.patch, self._arms):
                patch.spacing = 0.03
                corner = np.round((self.r + arm)[:2] / patch.spacing) - (6, 4)
                patch.origin[:] = corner * patch.spacing
                x, y = np.meshgrid(*((c + np.arange(m)) * patch.spacing for c, m in zip(corner, patch.z.shape)), indexing="ij")
                patch.z[:] = self.ground(x, y)

    def _inertia(self, h: float) -> np.ndarray:
        x, y, z = 0.3 + np.abs(self.offsets).max(axis=0)  # a box around the wheels
        moments = np.array([y * y + z * z, x * x + z * z, x * x + y * y]) / 3.0
        M = np.zeros((6, 6))
        M[:3, :3], M[3:, 3:] = self.mass * np.eye(3), self.T.T @ np.diag(self.mass * moments) @ self.T
        M[2, 2] += h * self.damper
        return M

    def _own_force(self) -> np.ndarray:
        """Weight and damper, without contacts [N, N.m]."""
        Q = np.zeros(6)
        Q[:3] = self.mass * self.gravity
        Q[2] -= self.damper * self.q[2]
        return Q

    def _send_mobility(self, h: float) -> None:
        u = self.instance.u
        if "inverse_inertia" not in self.instance.model.inputs.fields:
            return
        M, Q, given = self._inertia(h), self._own_force(), [k for k in range(6) if k not in self.free]
        Q[given] = 0.0
        M[given, :], M[:, given] = 0.0, 0.0
        M[given, given] = _GUIDED * self.mass
        mobility = np.linalg.inv(M)
        q = self.q + h * mobility @ Q
        S = np.vstack([np.block([[np.eye(3), -_cross_matrix(arm)], [np.zeros((3, 3)), np.eye(3)]]) for arm, _ in self._arms])
        n = len(S)
        u.inverse_inertia[: triangle(n)] = (S @ mobility @ S.T)[np.tril_indices(n)]
        u.free_twist[:n] = S @ q
        for i, (_, axle) in enumerate(self._arms):
            u.free_twist[6 * i + 3 : 6 * i + 6] += self.rate * axle

    def _jacobians(self):
        """Wheel and interface Jacobian of each contact; those of rigid ones are in the impulses already."""
        y = self.instance.y
        if "contact" in self.instance.model.outputs.fields:
            yield from ((i, contact) for i, contact in enumerate(y.contact) if contact.in_contact > 0.0)
        elif "pair" in self.instance.model.outputs.fields:
            yield from ((int(pair.on) - 1, pair) for pair in y.pair if 0.0 < pair.on <= len(self.offsets))


def _cross_matrix(a) -> np.ndarray:
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])
