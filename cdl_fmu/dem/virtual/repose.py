"""Angle of repose: a block of a bed, periodic along y, one side of which is let go as a wall draws back slowly.

What stays is a slope that grains have rolled down ever since the wall began to move: its angle is that at which they stop, the drained
angle of repose, which is below the one at which a slope at rest begins to slide.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ...slave.model import ModelError
from ..bed import Bed, replicate
from ..particles import FREE, M, R, X
from ..simulation import Simulation, Tool
from ..surface import NOTHING, fill_heights

#: Speed of the wall over sqrt(g d): grains roll away from it faster by far, and the slope keeps its angle behind it.
WALL_SPEED = 0.1
#: Between which shares of the block's height the angle is fitted.
MIDDLE = (0.25, 0.75)
#: Least length of a block, in its heights: its far side keeps its height at angles above 22 deg.
LEAST_LENGTH = 1.5

_RUN_OUT = 2.0  # heights that the wall goes at most: a slope of 15 deg is free of it then
_HELD = 1.0  # own choice, in diameters: thickness of the layer at the bottom that is held, as a rough floor
_AT_REST = 1e-3  # own choice: kinetic energy over m g d of the particles
_LONGEST = 100.0  # in sqrt(height / g): after that time a slope that is not at rest never will be


@dataclass(frozen=True, eq=False)
class Heap:
    """A slope at rest.

    Attributes:
        angle: Of repose [rad].
        x, z: Its surface: distance along x, and mean height above the floor [m].
        middle: Which of its points the angle is fitted to.
    """

    angle: float
    x: np.ndarray
    z: np.ndarray
    middle: np.ndarray


def repose(bed: Bed, *, wall_speed: float = WALL_SPEED, threads: int = 1, progress: Callable[[float], None] = lambda share: None) -> Heap:
    """Let a block, the whole tile, go at one side, and fit the slope that stays.

    Args:
        bed: The tile; gravity is its, without tilt.
        wall_speed: Over sqrt(g d).
        threads: Number of threads.
        progress: Called with the share done.

    Raises:
        ModelError: The tile is too short for its depth, or the slope does not come to rest.
    """
    depth, g, d, material = bed.key.depth, math.hypot(*bed.key.gravity), bed.key.diameter, bed.key.material
    length = bed.periods[0]
    if length < LEAST_LENGTH * depth:
        raise ModelError(
            f"the bed is {length:g} m long and {depth:g} m deep: for an angle of repose it must be at least {LEAST_LENGTH:g} depths long, "
            f"{LEAST_LENGTH * depth:g} m"
        )
    block = replicate(bed, math.ceil(1.0 + _RUN_OUT * depth / length), 1)
    held = block.positions[:, 2] < bed.floor + _HELD * d
    kept = held | (block.positions[:, 0] < length)
    positions = block.positions[kept] - [0.0, 0.0, bed.floor]
    floor, smooth = Tool(material), replace(material, cohesion=0.0)  # no grain sticks to a wall that draws back
    left = Tool(smooth, r_0=np.array([-0.5 * d, 0.0, 0.0]), T=np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]))
    right = Tool(smooth, r_0=np.array([length + 0.5 * d, 0.0, 0.0]), T=np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]]))
    simulation = Simulation(
        positions, block.radii[kept], material, [floor, left, right], gravity=(0.0, 0.0, -g), periods=(0.0, bed.periods[1]), threads=threads
    )
    simulation.bodies[:, FREE] = ~held[kept]
    speed, h = wall_speed * math.sqrt(g * d), 0.1 * d / (wall_speed * math.sqrt(g * d))
    travel, longest = 0.0, _LONGEST * math.sqrt(depth / g)
    while True:
        if travel < _RUN_OUT * depth:
            travel += speed * h
            right.r_0 = np.array([length + 0.5 * d + travel, 0.0, 0.0])
        simulation.step(h)
        free = simulation.bodies[:, FREE] > 0.0
        mass = simulation.bodies[free, M].sum()
        free_of_wall = travel >= _RUN_OUT * depth or (travel > depth and right.contacts == 0.0)
        if free_of_wall and simulation.kinetic_energy < _AT_REST * mass * g * d:
            break
        progress(min(travel / (_RUN_OUT * depth), 1.0))
        if simulation.time > _RUN_OUT * depth / speed + longest:
            raise ModelError(f"the slope is not at rest after {simulation.time:.3g} s: its grains roll on; raise mu_r = {material.mu_r:g}")
    progress(1.0)
    return _fitted(simulation.bodies, bed.periods[1], depth, 0.5 * d)


def _fitted(bodies: np.ndarray, breadth: float, height: float, spacing: float) -> Heap:
    """The slope of particles, with its mean surface on a grid."""
    n = math.ceil((bodies[:, X].max() + bodies[:, R].max()) / spacing)
    heights = np.zeros((n, max(round(breadth / spacing), 1)))
    fill_heights(bodies, len(bodies), np.full(2, 0.5 * spacing), spacing, heights)
    # Mean of what is not bare: a bare node is a gap between grains of the floor, or an edge of the period.
    seen = heights > NOTHING
    x, z = (np.arange(n) + 0.5) * spacing, np.where(seen, heights, 0.0).sum(axis=1) / np.maximum(seen.sum(axis=1), 1)
    middle = (z > MIDDLE[0] * height) & (z < MIDDLE[1] * height)
    slope = np.polyfit(x[middle], z[middle], 1)[0]
    return Heap(math.atan(-slope), x, z, middle)
