"""The case that particle codes are compared on: a bed of spheres in a box with an open top, and a wheel that is driven through it.

A bed is an .npz file: `positions` [n, 3] m, `radii` [n] m, `velocities` [n, 3] m/s, `box` [3, 2] m, lower and upper walls in x, y and z,
of which the upper one in z is open.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

DENSITY = 2600.0  # kg/m3
YOUNG = 1e7  # Pa
POISSON = 0.3
RESTITUTION = 0.5
FRICTION = 0.5  # between particles, and of particles on walls and wheel
ROLLING_FRICTION = 0.1
GRAVITY = 9.81  # m/s2
STEP = 5e-5  # s: 13 % of the Rayleigh time of the smallest particle
SKIN = 1e-3  # m
SAMPLE = 20  # steps between two samples of the wheel's wrench: 1 ms
HEADROOM = 0.35  # m above the bed: a wheel that stands on it has to be inside of a peer's domain
MARGIN = 0.02  # m: the same beside the walls


@dataclass
class Bed:
    """Spheres in a box: positions [m], [n, 3]; radii [m], [n]; velocities [m/s], [n, 3]; box [m], [3, 2]."""

    positions: np.ndarray
    radii: np.ndarray
    velocities: np.ndarray
    box: np.ndarray

    @property
    def masses(self) -> np.ndarray:
        """Masses of the particles [kg], [n]."""
        return DENSITY * 4.0 / 3.0 * math.pi * self.radii**3

    @property
    def domain(self) -> np.ndarray:
        """What a peer's simulation box has to enclose [m], [3, 2]: the walls, all particles and a wheel on them."""
        low, high = self.box[:, 0] - MARGIN, self.box[:, 1] + MARGIN
        high[2] = (self.positions[:, 2] + self.radii).max() + HEADROOM
        return np.column_stack([low, high])

    def surface(self) -> float:
        """Height of the bed [m]: the median, over cells as wide as two of the largest particles, of the highest point in each."""
        cell = np.floor((self.positions[:, :2] - self.box[:2, 0]) / (4.0 * self.radii.max())).astype(int)
        tops: dict[tuple[int, int], float] = {}
        for key, top in zip(map(tuple, cell.tolist()), (self.positions[:, 2] + self.radii).tolist()):
            tops[key] = max(top, tops.get(key, top))
        return float(np.median(list(tops.values())))

    def save(self, path: Path) -> None:
        """Write the .npz file."""
        np.savez_compressed(path, positions=self.positions, radii=self.radii, velocities=self.velocities, box=self.box)


def load(path: Path) -> Bed:
    """The bed of an .npz file; without `velocities` it is at rest, without `box` it is as wide as its particles."""
    with np.load(path) as data:
        positions, radii = data["positions"], data["radii"]
        velocities = data.get("velocities", np.zeros_like(positions))
        around = np.column_stack([(positions - radii[:, None]).min(0), (positions + radii[:, None]).max(0)])
        return Bed(positions, radii, velocities, data.get("box", around))


@dataclass(frozen=True)
class Wheel:
    """A smooth cylinder with caps and its motion: lowered into the bed, then rolling along x at constant speed, slip and height.

    Its axle is along y, in the middle between the side walls. A plate is such a cylinder that lies flat in the middle of the bed, and is
    held once it was pressed in.
    """

    radius: float = 0.125  # m
    width: float = 0.125  # m
    depth: float = 0.02  # m below the bed's surface
    lowering_speed: float = 0.1  # m/s
    speed: float = 0.1  # m/s
    slip: float = 0.2  # 1 - speed / (rate * radius)
    lying: bool = False  # a plate

    @property
    def half_height(self) -> float:
        """From its centre to its lowest point [m]."""
        return self.width / 2.0 if self.lying else self.radius

    @property
    def rate(self) -> float:
        """Angular velocity about y while rolling [rad/s]."""
        return self.speed / (self.radius * (1.0 - self.slip))

    def start(self, bed: Bed) -> np.ndarray:
        """Centre [m], [3], of a wheel on the highest particle below it, near the wall at low x, or of a plate, in the middle."""
        if self.lying:
            x, y = bed.box[:2].mean(1)
            below = np.hypot(bed.positions[:, 0] - x, bed.positions[:, 1] - y) < self.radius + bed.radii
            return np.array([x, y, (bed.positions[below, 2] + bed.radii[below]).max() + self.half_height])
        x = bed.box[0, 0] + self.radius + MARGIN
        y = bed.box[1].mean()
        aside = np.maximum(np.abs(bed.positions[:, 1] - y) - self.width / 2.0, 0.0)
        # Sphere against the cylinder's rim: centres apart in the x-z plane by both radii, less what lies beside the rim.
        reach = self.radius + np.sqrt(np.maximum(bed.radii**2 - aside**2, 0.0))
        height2 = reach**2 - (bed.positions[:, 0] - x) ** 2
        below = (height2 > 0.0) & (aside < bed.radii)
        z = (bed.positions[below, 2] + np.sqrt(height2[below])).max()
        return np.array([x, y, z])

    def lowering_steps(self, bed: Bed) -> int:
        """Steps until the wheel has its depth, in whole samples."""
        way = self.start(bed)[2] - self.half_height - bed.surface() + self.depth
        return SAMPLE * max(1, round(way / (self.lowering_speed * STEP * SAMPLE)))


def loose(n: int, length: float, width: float, seed: int) -> Bed:
    """`n` spheres of 4.5 to 5.5 mm radius, evenly distributed, thrown about at random above a floor of `length` by `width` [m].

    They start apart from each other: in cells of a lattice, each somewhere in its cell, with 0.5 m/s in random directions.
    """
    random = np.random.default_rng(seed)
    radii = random.uniform(4.5e-3, 5.5e-3, n)
    counts = np.array([int(length / 0.0125), int(width / 0.0125)])
    cell = np.array([*(np.array([length, width]) / counts), 0.0125])
    number = np.arange(n)
    corner = np.column_stack([number % counts[0], number // counts[0] % counts[1], number // (counts[0] * counts[1])])
    play = cell - 2.0 * radii[:, None]
    positions = corner * cell + radii[:, None] + play * random.random((n, 3))
    direction = random.normal(size=(n, 3))
    velocities = 0.5 * direction / np.linalg.norm(direction, axis=1, keepdims=True)
    box = np.array([[0.0, length], [0.0, width], [0.0, positions[:, 2].max() + 0.0125]])
    return Bed(positions, radii, velocities, box)


def measures(bed: Bed, spins: np.ndarray) -> dict[str, float]:
    """What tells whether two beds are alike; `spins` are the particles' angular velocities [rad/s], [n, 3].

    `coordination`: contacts of a particle, mean over all; `packing`: share of solid volume in a box 30 mm off walls and floor, up to 30 mm
    below the surface; `kinetic_energy` [J] of translation and rotation.
    """
    pairs = cKDTree(bed.positions).query_pairs(2.0 * bed.radii.max(), output_type="ndarray")
    apart = np.linalg.norm(bed.positions[pairs[:, 0]] - bed.positions[pairs[:, 1]], axis=1)
    contacts = int((apart < bed.radii[pairs].sum(1)).sum())
    low, high = bed.box[:, 0] + 0.03, bed.box[:, 1] - 0.03
    high[2] = bed.surface() - 0.03
    inside = ((bed.positions > low) & (bed.positions < high)).all(1)
    solid = (bed.masses[inside] / DENSITY).sum()
    inertia = 0.4 * bed.masses * bed.radii**2
    energy = 0.5 * (bed.masses * (bed.velocities**2).sum(1) + inertia * (spins**2).sum(1)).sum()
    return {
        "coordination": 2.0 * contacts / len(bed.radii),
        "packing": float(solid / np.prod(high - low)),
        "kinetic_energy": float(energy),
    }
