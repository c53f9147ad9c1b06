"""Wheels driven over SCM's soil in process, and what the soil looks like afterwards."""

import math

import numpy as np
from scipy.ndimage import binary_dilation

from cdl_fmu.frames import axis_rotation
from cdl_fmu.scm.erosion import repose_of
from cdl_fmu.scm.tiles import STAMP, TILE, TILE_I, TILE_J
from cdl_fmu.slave.model import Instance
from orchestrator.validate.sand import fields, heap, scm, slopes, surface, volume_error, wait_for_rest  # noqa: F401 - some are for tests

R = B = 0.125
LOAD = 27 * 9.81
ALONG_X, ALONG_Y = (1.0, 0.0), (0.0, 1.0)
#: A smooth wheel without damping, on soil that bears what plates measured.
BARE = dict(n_g=0, c_d=0, tau_r=0, strength="plates", k_0=2e8)
#: Soil that is pressed and nothing else: all of it compacted, none dragged along, no landslides.
STILL = dict(plasticity=0, transport_depth=0, erosion_sweeps=0)


def towards(degrees: float) -> tuple[float, float]:
    return math.cos(math.radians(degrees)), math.sin(math.radians(degrees))


class Carriage:
    """Moves a wheel as told, with its height prescribed, or free under a load.

    Args:
        at: x and y of its centre [m].
        heading: Unit vector, horizontal.
        depth: Sinkage of its lowest point below z = 0 at the start [m]; below 0 it hangs in the air.
        load: Weight on the wheel [N]; None: its height is prescribed.
    """

    def __init__(self, instance: Instance, i=0, *, at=(0.0, 0.0), heading=ALONG_X, depth=0.0, load=None, camber=0.0):
        self.instance, self.i, self.heading, self.load, self.camber = instance, i, heading, load, camber
        self.r = np.array([*at, R - depth])
        self.v_z = self.spin = 0.0
        instance.u.wheel[i].active = 1.0

    @property
    def sinkage(self) -> float:
        return R - self.r[2]

    def set_inputs(self, forward=0.0, sideways=0.0, up=0.0, rate=0.0):
        x, y = self.heading
        upright = axis_rotation(1, self.camber) @ np.array([[x, y, 0.0], [-y, x, 0.0], [0.0, 0.0, 1.0]])
        self.v = np.array([forward * x - sideways * y, forward * y + sideways * x, up if self.load is None else self.v_z])
        wheel = self.instance.u.wheel[self.i]
        wheel.r_0[:], wheel.v_0[:] = self.r, self.v
        wheel["T"][:] = axis_rotation(2, self.spin) @ upright
        wheel.w_0[:] = rate * upright[1]
        self.rate = rate

    def move_on(self, h):
        """Move by the velocities that were set, after the soil's step."""
        if self.load is not None and h:
            contact = self.instance.y.contact[self.i]
            mass, K, D = self.load / 9.81, contact.K[2], contact.D[2]
            self.v_z = (mass * self.v_z + h * (contact.F[2] - self.load + D * self.v_z)) / (mass + h * D + h * h * K)
            self.v[2] = self.v_z
        self.r = self.r + h * self.v
        self.spin += h * self.rate

    def reading(self) -> np.ndarray:
        """Force and torque in the heading frame [N, N.m], sinkage [m]."""
        x, y = self.heading
        to_heading = np.array([[x, y, 0.0], [-y, x, 0.0], [0.0, 0.0, 1.0]])
        wrench = self.instance.y.wheel[self.i]
        return np.array([*(to_heading @ wrench.f_0), *(to_heading @ wrench.t_0), self.sinkage])

    def put_down(self, h=0.01):
        """Lower the wheel until the soil carries its load, without overshoot: what it lacks pulls it against a strong damper."""
        damper = 1e4
        for k in range(400):
            self.set_inputs(up=self.v_z)
            self.instance.step(k * h, h)
            contact = self.instance.y.contact[self.i]
            self.v_z = (contact.F[2] - self.load) / (damper + h * contact.K[2])
            self.r[2] += h * self.v_z
        self.v_z = 0.0

    def move(self, seconds, h=1e-3, **velocities) -> np.ndarray:
        """Readings [n, 7] of steps of h with these velocities: forward, sideways, up [m/s], rate of the wheel [rad/s]."""
        readings = []
        for k in range(max(1, round(seconds / h))):
            self.set_inputs(**velocities)
            self.instance.step(k * h, h)
            readings.append(self.reading())
            self.move_on(h)
        return np.array(readings)


def on_soil(heading=ALONG_X, at=(0.0, 0.0), load=LOAD, camber=0.0, **parameters) -> Carriage:
    """A loaded wheel that was put down gently."""
    carriage = Carriage(scm(**parameters), at=at, heading=heading, load=load, camber=camber)
    carriage.put_down()
    return carriage


def stamps(instance: Instance) -> np.ndarray:
    """Number of the last step in which a tool worked on each cell, on the nodes of ``surface``."""
    n = int(instance.pool.head[0])
    corners = instance.pool.marks[:n, [TILE_I, TILE_J]] * TILE
    first = corners.min(axis=0)
    out = np.full(tuple(corners.max(axis=0) - first + TILE), -1.0)
    for tile, (i, j) in zip(fields(instance, STAMP), corners - first):
        out[i : i + TILE, j : j + TILE] = tile
    return out


def excess(instance: Instance, waited=0, away=0.0) -> tuple[float, float]:
    """Largest excess over the angle of repose, in cells, along rows and columns, and along diagonals.

    Cells that a tool worked on in the last ``waited`` steps, their neighbours, and what lies less than ``away`` [m] from them do not count.
    """
    z, cell = surface(instance).z, float(instance.p.cell)
    left = ~binary_dilation(stamps(instance) > instance.x.stamp - waited, iterations=max(1, round(away / cell)))
    z = np.where(left, z, np.nan)

    def steepest(pairs, distance):
        return max(np.nanmax(np.abs(a - b)) for a, b in pairs) / cell - distance * math.tan(repose_of(instance.p))

    straight = steepest([(z[1:], z[:-1]), (z[:, 1:], z[:, :-1])], 1.0)
    diagonal = steepest([(z[1:, 1:], z[:-1, :-1]), (z[1:, :-1], z[:-1, 1:])], math.sqrt(2.0))
    return straight, diagonal
