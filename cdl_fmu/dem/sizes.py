"""Distributions of the sizes of particles."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..slave.model import ModelError

_WIDEST = 5.0  # own choice: largest over smallest diameter; cells of neighbours are as large as the largest particle


@dataclass(frozen=True)
class Uniform:
    """Diameters between ``d_min`` and ``d_max`` [m], each as often, by number."""

    d_min: float
    d_max: float

    def __post_init__(self):
        if not 0.0 < self.d_min <= self.d_max < math.inf:
            raise ModelError(f"d_min = {self.d_min:g} m, d_max = {self.d_max:g} m: 0 < d_min <= d_max is needed (diameters of particles)")
        _check_width(self.d_min, self.d_max)

    @property
    def mean(self) -> float:
        """Mean diameter [m]."""
        return 0.5 * (self.d_min + self.d_max)

    @property
    def mean_volume(self) -> float:
        """Mean volume of a particle [m3]: pi/6 times the mean of d^3."""
        return math.pi / 24.0 * (self.d_min + self.d_max) * (self.d_min**2 + self.d_max**2)

    def draw(self, n: int, rng: np.random.Generator) -> np.ndarray:
        """Diameters [m] of n particles, one from each of n equal parts of the range, in random order."""
        return self.d_min + (self.d_max - self.d_min) * (rng.permutation(n) + rng.random(n)) / n


@dataclass(frozen=True)
class Shares:
    """Some diameters [m], each with its share of the mass, as sieves give them."""

    shares: tuple[tuple[float, float], ...]

    def __post_init__(self):
        for d, share in self.shares:
            if not (0.0 < d < math.inf and share > 0.0):
                raise ModelError(f"diameter {d:g} m with the mass share {share:g}: both must be above 0 (sizes of particles)")
        total = sum(share for _, share in self.shares)
        if abs(total - 1.0) > 1e-6:
            raise ModelError(f"the mass shares of the diameters sum to {total:g}: they must sum to 1; divide each by {total:g}")
        _check_width(self.d_min, self.d_max)

    @property
    def d_min(self) -> float:
        """Least diameter [m]."""
        return min(d for d, _ in self.shares)

    @property
    def d_max(self) -> float:
        """Largest diameter [m]."""
        return max(d for d, _ in self.shares)

    @property
    def mean(self) -> float:
        """Mean diameter by mass [m]."""
        return sum(share * d for d, share in self.shares)

    @property
    def mean_volume(self) -> float:
        """Mean volume of a particle [m3]."""
        return math.pi / 6.0 / sum(share / d**3 for d, share in self.shares)

    def draw(self, n: int, rng: np.random.Generator) -> np.ndarray:
        """Diameters [m] of n particles, as many of each as its share asks, in random order."""
        numbers = np.cumsum([share / d**3 for d, share in self.shares])
        which = np.searchsorted(numbers / numbers[-1], (rng.permutation(n) + 0.5) / n)
        return np.array([d for d, _ in self.shares])[which]


def _check_width(d_min: float, d_max: float) -> None:
    if d_max > _WIDEST * d_min:
        raise ModelError(
            f"diameters from {d_min:g} m to {d_max:g} m: the largest is {d_max / d_min:.3g} times the smallest, at most "
            f"{_WIDEST:g} times is possible; leave out the finest, and give their mass to the next"
        )
