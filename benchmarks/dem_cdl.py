"""The case of `dem_case` in this package's DEM, with the interface of its peers."""

from __future__ import annotations

import time
from dataclasses import replace
from importlib.metadata import version as version_of

import numpy as np
from dem_case import DENSITY, FRICTION, POISSON, RESTITUTION, ROLLING_FRICTION, SAMPLE, STEP, YOUNG, Bed, Wheel, measures
from dem_launch import BLOCKS

from cdl_fmu.dem.material import Material
from cdl_fmu.dem.particles import V_X, W_X, X
from cdl_fmu.dem.simulation import Simulation, Tool
from cdl_fmu.frames import axis_rotation
from cdl_fmu.mesh.surface import Surface

_LYING = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # T of a plate: its axle is upright
MATERIAL = Material(E=YOUNG, nu=POISSON, e=RESTITUTION, mu=FRICTION, mu_r=ROLLING_FRICTION, density=DENSITY)


def version() -> str:
    """Name and version."""
    return f"cdl-fmu {version_of('cdl-fmu')}"


def run(bed: Bed, steps: int, processes: int = 1, wheel: Wheel | None = None, precision=np.float64, surface: Surface | None = None) -> dict:
    """As the peers' `run`.

    `processes` is the number of threads, `precision` that of contacts, `surface` the wheel's or plate's as it stands at the start, in place
    of an exact cylinder.
    """
    tools = walls(bed)
    if wheel is not None:
        shape = dict(surface=surface) if surface else dict(wheel=(wheel.radius, wheel.width, 0.0, 0.0, 0.0))
        turned = wheel.lying and surface is None
        tools.append(Tool(MATERIAL, **shape, r_0=wheel.start(bed), T=_LYING if turned else np.eye(3)))
    simulation = Simulation(bed.positions, bed.radii, MATERIAL, tools, dt=STEP, threads=processes, precision=precision)
    simulation.bodies[:, V_X : V_X + 3] = bed.velocities
    motion = _Motion(simulation, bed, wheel) if wheel is not None else None
    if motion:
        motion.lower()
    rates, samples = [], steps // BLOCKS // SAMPLE
    for _ in range(BLOCKS):
        began = time.perf_counter()
        for _ in range(samples):
            if motion:
                motion.roll()
            simulation.step(SAMPLE * STEP)
            if motion:
                motion.feel()
        rates.append(samples * SAMPLE * len(bed.radii) / (time.perf_counter() - began))
    final, spins = _final(simulation, bed)
    found = {"wall_s": steps * len(bed.radii) / float(np.mean(rates)), "particle_steps_per_s": np.array(rates)}
    found |= {"positions": final.positions, "velocities": final.velocities, **measures(final, spins)}
    return found | (motion.felt() if motion else {})


def walls(bed: Bed) -> list[Tool]:
    """Floor and four sides."""
    (x_0, x_1), (y_0, y_1), (z_0, _) = bed.box
    turned = np.eye(3)[[1, 2, 0]]  # z along the world's x
    sides = [((x_0, 0, 0), turned), ((0, y_0, 0), np.eye(3)[[2, 0, 1]]), ((0, 0, z_0), np.eye(3))]
    opposite = np.diag([1.0, -1.0, -1.0])
    sides += [((x_1, 0, 0), opposite @ turned), ((0, y_1, 0), opposite @ np.eye(3)[[2, 0, 1]])]
    return [Tool(MATERIAL, r_0=np.array(place, float), T=T) for place, T in sides]


class _Motion:
    """The wheel's prescribed motion, and what it feels of it every SAMPLE steps, at the sample's end as the peers tell it."""

    def __init__(self, simulation: Simulation, bed: Bed, wheel: Wheel):
        self.simulation, self.wheel, self.tool = simulation, wheel, simulation.tools[-1]
        self.steps, self.angle = wheel.lowering_steps(bed), 0.0
        self.wrenches: list[np.ndarray] = []

    def lower(self) -> None:
        for _ in range(self.steps // SAMPLE):
            self.tool.r_0 = self.tool.r_0 - [0.0, 0.0, self.wheel.lowering_speed * SAMPLE * STEP]
            self.simulation.step(SAMPLE * STEP)
            self.feel()

    def roll(self) -> None:
        if self.wheel.lying:
            return
        self.tool.r_0 = self.tool.r_0 + np.array([self.wheel.speed * SAMPLE * STEP, 0.0, 0.0])
        self.angle += self.wheel.rate * SAMPLE * STEP
        self.tool.T = axis_rotation(2, self.angle)

    def feel(self) -> None:
        self.wrenches.append(np.array([*self.tool.f_0, *self.tool.t_0]))

    def felt(self) -> dict:
        wrenches = np.array(self.wrenches)
        time = SAMPLE * STEP * np.arange(1, len(wrenches) + 1)
        return {"time": time, "force": wrenches[:, :3], "torque": wrenches[:, 3:], "rolls_from": self.steps * STEP}


def _final(simulation: Simulation, bed: Bed) -> tuple[Bed, np.ndarray]:
    order = np.argsort(simulation.ident)
    bodies = simulation.bodies[order]
    return replace(bed, positions=bodies[:, X : X + 3], velocities=bodies[:, V_X : V_X + 3]), bodies[:, W_X : W_X + 3]
