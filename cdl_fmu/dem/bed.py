"""What a bed is: a periodic tile of particles at rest on a floor, with their contacts, and all that it was made from."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..slave.model import ModelError
from .contacts import Contacts, put_contacts
from .material import Material
from .simulation import Simulation, Tool
from .sizes import Shares, Uniform
from .surface import mean_height

#: Side of a column: so many diameters of the largest particle, but at least so much [m]. Own choice: columns are loaded and deleted whole.
COLUMN_DIAMETERS, LEAST_COLUMN = 4.0, 0.02
#: Largest ratio of diameters across an interface of refinement: a sphere passes between three that touch if theirs is 6.5 times its own
#: diameter, and between loose ones below that; most steps of it; least thickness of a layer in its mean diameters. Own choices.
LARGEST_RATIO, MOST_STEPS, LEAST_LAYER = 2.0, 2, 4.0
#: Diameters of the largest particle there that floor and surface disturb, where porosity is not measured. Own choice, after profiles.
DISTURBED = 2.0


@dataclass(frozen=True)
class Layer:
    """A layer of particles: bottom and top [m], 0 at the bed's surface, and what the diameters of ``BedKey.sizes`` are multiplied by."""

    bottom: float
    top: float
    factor: float


@dataclass(frozen=True)
class BedKey:
    """Everything that a bed is made from.

    Attributes:
        material: Of the particles and of the floor.
        sizes: Distribution of the diameters of the soil's grains.
        porosity: Volume of pores over volume, to be reached in the bulk.
        depth: From the floor to the mean surface [m].
        size: Least lengths along x and y [m]; the bed's are whole numbers of columns.
        gravity: Acceleration of gravity [m/s2]; one that is tilted makes a slope of the bed.
        refinement: Where diameters change: (depth [m], ratio of the diameters below it to those above), from the top to the bottom.
        scale: Coarse-grain factor: particles are so many times larger than the grains, see ``scaling``.
        seed: Of the random numbers.

    Raises:
        ModelError: A value is out of its bounds.
    """

    material: Material
    sizes: Uniform | Shares
    porosity: float
    depth: float
    size: tuple[float, float]
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
    refinement: tuple[tuple[float, float], ...] = ()
    scale: float = 1.0
    seed: int = 0

    def __post_init__(self):
        if not 0.0 < self.porosity < 1.0:
            raise ModelError(f"porosity = {self.porosity:g}: it must be within 0 and 1; spheres settle to about 0.36 to 0.45")
        if not 1.0 <= self.scale < math.inf:
            raise ModelError(f"scale = {self.scale:g}: a coarse-grain factor must be at least 1; for finer grains give smaller diameters")
        for axis, length in zip("xy", self.size):
            if not 0.0 < length < math.inf:
                raise ModelError(f"size along {axis} = {length:g} m: it must be above 0 m and finite")
        if not (all(map(math.isfinite, self.gravity)) and self.gravity[2] < 0.0):
            raise ModelError(f"gravity = {self.gravity} m/s2: its z must be below 0 m/s2 so that a bed settles on its floor")
        if len(self.refinement) > MOST_STEPS:
            raise ModelError(f"refinement has {len(self.refinement)} steps: at most {MOST_STEPS} are possible; leave out the deepest")
        for depth, ratio in self.refinement:
            if not 1.0 < ratio <= LARGEST_RATIO:
                raise ModelError(
                    f"refinement at {depth:g} m by the ratio {ratio:g}: it must be above 1 and at most {LARGEST_RATIO:g}, so that fine "
                    "particles do not trickle into the coarse; take two steps"
                )
        for layer in self.layers:
            diameter = layer.factor * self.sizes.mean
            least = LEAST_LAYER * diameter
            if not layer.top - layer.bottom >= least:
                raise ModelError(
                    f"the layer from {-layer.top:g} m to {-layer.bottom:g} m of depth holds particles of {diameter:g} m: it "
                    f"must be at least {least:g} m thick ({LEAST_LAYER:g} diameters); make it thicker, or take finer particles"
                )
        bottom, top = self.bulk(-self.depth, 0.0)
        if top - bottom < self.largest:
            raise ModelError(
                f"depth = {self.depth:g} m: too shallow to measure a porosity for particles of up to {self.largest:g} m at the floor; "
                f"make it at least {self.depth + self.largest - (top - bottom):g} m, or take finer particles"
            )

    @property
    def layers(self) -> tuple[Layer, ...]:
        """Layers of equal sizes, from the top to the bottom."""
        factors = np.cumprod([self.scale, *(ratio for _, ratio in self.refinement)])
        edges = [0.0, *(depth for depth, _ in self.refinement), self.depth]
        return tuple(Layer(-below, -above, float(factor)) for above, below, factor in zip(edges, edges[1:], factors))

    @property
    def diameter(self) -> float:
        """Mean diameter of the particles at the top [m]."""
        return self.scale * self.sizes.mean

    @property
    def largest(self) -> float:
        """Largest diameter of all particles [m]."""
        return self.layers[-1].factor * self.sizes.d_max

    @property
    def column(self) -> float:
        """Side of a column [m]."""
        return max(COLUMN_DIAMETERS * self.largest, LEAST_COLUMN)

    @property
    def counts(self) -> tuple[int, int]:
        """Numbers of columns along x and y."""
        return tuple(math.ceil(length / self.column - 1e-9) for length in self.size)

    def bulk(self, floor: float, surface: float) -> tuple[float, float]:
        """Bottom and top [m] of the bulk of a bed between these heights [m]: what neither floor nor surface disturbs."""
        return floor + DISTURBED * self.largest, surface - DISTURBED * self.scale * self.sizes.d_max


@dataclass(frozen=True)
class Bed:
    """A periodic tile of n particles at rest. Heights are above its mean surface: the highest particles reach above z = 0.

    Attributes:
        key: What it was made from.
        positions: Centres [m], [n, 3].
        radii: [m], [n].
        periods: Lengths after which it repeats itself along x and y [m].
        counts: Numbers of columns along x and y, by which it can be cut.
        floor: Height of its floor [m], below 0.
        contacts: Contacts of the particles, with their history.
        orientations: Quaternions from the particles' frames to the world, [n, 4]; of spheres [0, 4].
    """

    key: BedKey
    positions: np.ndarray
    radii: np.ndarray
    periods: tuple[float, float]
    counts: tuple[int, int]
    floor: float
    contacts: Contacts
    orientations: np.ndarray

    @property
    def column(self) -> float:
        """Side of a column [m]."""
        return self.periods[0] / self.counts[0]

    @property
    def porosity(self) -> float:
        """Volume of pores over volume, in the bulk."""
        bottom, top = self.key.bulk(self.floor, 0.0)
        return porosity_between(self.positions[:, 2], self.radii, self.periods, np.array([bottom, top]))[0]

    @property
    def coordination(self) -> float:
        """Contacts of a particle in the bulk, mean number."""
        bottom, top = self.key.bulk(self.floor, 0.0)
        inside = (self.positions[:, 2] > bottom) & (self.positions[:, 2] < top)
        return np.bincount(self.contacts.pairs.ravel(), minlength=len(inside))[inside].mean()

    @property
    def surface(self) -> float:
        """Mean height of the surface [m]: 0, but for what is felt of rounding and of moving since."""
        return surface_of(self.key, self.positions, self.radii, self.periods, self.column)

    def simulation(self, tools: Sequence[Tool] = (), **options) -> Simulation:
        """The bed in a simulation with its contacts; the floor is the first tool, before these. Options as of ``Simulation``."""
        floor = Tool(self.key.material, r_0=np.array([0.0, 0.0, self.floor]))
        options = dict(gravity=self.key.gravity, periods=self.periods) | options
        simulation = Simulation(self.positions, self.radii, self.key.material, [floor, *tools], **options)
        put_contacts(simulation, self.contacts)
        if len(self.orientations):
            simulation.particles.orientation[0] = self.orientations
        return simulation


def porosity_between(z: np.ndarray, radii: np.ndarray, periods: tuple[float, float], heights: np.ndarray) -> np.ndarray:
    """Porosity between each two neighbours of ascending heights [m], [m - 1]: particles are cut there.

    Args:
        z, radii: Heights of the centres and radii of the particles [m], [n].
        periods: Lengths of the tile [m].
        heights: [m].
    """
    h = np.clip(heights[:, None] - z, -radii, radii)
    below = np.pi * (2.0 / 3.0 * radii**3 + radii**2 * h - h**3 / 3.0).sum(axis=1)  # spheres cut by a plane
    return 1.0 - np.diff(below) / (periods[0] * periods[1] * np.diff(heights))


def surface_of(key: BedKey, positions: np.ndarray, radii: np.ndarray, periods: tuple[float, float], column: float) -> float:
    """Mean height [m] of the surface of particles within the periods, on cells about half a diameter wide."""
    return mean_height(positions, radii, periods, column / math.ceil(2.0 * column / key.diameter))


def replicate(bed: Bed, n_x: int, n_y: int) -> Bed:
    """The bed so many times side by side along x and y, with all contacts, also those from copy to copy.

    Raises ModelError if a number is below 1.
    """
    if n_x < 1 or n_y < 1:
        raise ModelError(f"a bed replicated {n_x} by {n_y} times: both numbers must be at least 1")
    copies = np.array([(a, b) for a in range(n_x) for b in range(n_y)])
    n, (l_x, l_y), c = len(bed.radii), bed.periods, bed.contacts
    steps = copies * bed.periods
    positions = (bed.positions + np.pad(steps, ((0, 0), (0, 1)))[:, None]).reshape(-1, 3)
    # The image that the first particle touches lies in another copy, or in an image of one.
    target = copies[:, None] + c.images  # [copies, m, 2]
    images, target = np.divmod(target, [n_x, n_y])
    second = c.pairs[:, 1] + n * (target[..., 0] * n_y + target[..., 1])
    first = c.pairs[:, 0] + n * np.arange(len(copies))[:, None]

    def repeated(vectors):
        return np.tile(vectors, (len(copies), 1))

    contacts = Contacts(
        pairs=np.stack([first, second], axis=-1).reshape(-1, 2).astype(np.int32),
        images=images.reshape(-1, 2).astype(np.int8),
        shear=repeated(c.shear),
        roll=repeated(c.roll),
        on_floor=(c.on_floor + n * np.arange(len(copies))[:, None]).ravel().astype(np.int32),
        floor_shear=repeated(c.floor_shear),
        floor_roll=repeated(c.floor_roll),
    )
    return replace(
        bed,
        positions=positions,
        radii=np.tile(bed.radii, len(copies)),
        orientations=np.tile(bed.orientations, (len(copies), 1)),
        periods=(n_x * l_x, n_y * l_y),
        counts=(n_x * bed.counts[0], n_y * bed.counts[1]),
        contacts=contacts,
    )
