"""Materials of particles and of what touches them: their declaration, the law's numbers, and the longest stable time step."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ..slave.model import ModelError
from ..slave.records import Choice, Real, Record
from .law import DAMPING, HERTZ, LINEAR, MASS, STIFFNESS, law_of
from .shape import LARGEST_ASPECT, MOST_CORNERS, Shape

#: Share of the Rayleigh time that a time step lasts, at most (Thornton 2015), and share of the longest step that is chosen by default.
LARGEST_SHARE, SHARE = 0.2, 0.65
#: Overlap over diameter up to which a time step is stable.
_OVERLAP = 0.01


@dataclass(frozen=True)
class Material:
    """One material and its contacts with itself.

    Attributes:
        E: Young's modulus [Pa]; far below that of real grains, which changes little as long as overlaps are below 1 % of the diameter.
        nu: Poisson's ratio.
        e: Coefficient of restitution.
        mu: Coefficient of friction.
        mu_r: Coefficient of rolling friction.
        cohesion: Pull of a contact over the square of the diameter of equal particles [Pa].
        density: Density of the grains [kg/m3].
        linear: Linear contacts in place of Hertz'.
        shape: How particles of this material roll, beside ``mu_r``; None: as spheres. That of a tool's material means nothing.

    Raises:
        ModelError: A value that no material has.
    """

    E: float = 1e7
    nu: float = 0.3
    e: float = 0.5
    mu: float = 0.5
    mu_r: float = 0.1
    cohesion: float = 0.0
    density: float = 2600.0
    linear: bool = False
    shape: Shape | None = None

    def __post_init__(self):
        for name, impossible, needed in (
            ("E", not 0.0 < self.E < math.inf, "above 0 Pa"),
            ("nu", not 0.0 <= self.nu < 0.5, "from 0 to below 0.5"),
            ("e", not 0.0 < self.e <= 1.0, "above 0 and at most 1"),
            ("mu", not 0.0 <= self.mu < math.inf, "at least 0"),
            ("mu_r", not 0.0 <= self.mu_r < math.inf, "at least 0"),
            ("cohesion", not 0.0 <= self.cohesion < math.inf, "at least 0 Pa"),
            ("density", not 0.0 < self.density < math.inf, "above 0 kg/m3"),
        ):
            if impossible:
                raise ModelError(f"{name} = {getattr(self, name):g}: it must be {needed}, and finite")

    def law(self, dt: float) -> np.ndarray:
        """The law's numbers for substeps of dt [s]."""
        returned = self.shape.returned if self.shape else 1.0
        return law_of(self.E, self.nu, self.e, self.mu, self.mu_r, self.cohesion, self.density, dt, self.linear, returned)

    def largest_time_step(self, radius: float) -> float:
        """Longest stable substep [s] for the smallest radius [m]."""
        shear_modulus = self.E / (2.0 * (1.0 + self.nu))
        rayleigh_time = math.pi * radius * math.sqrt(self.density / shear_modulus) / (0.163 * self.nu + 0.8766)
        # Own choice, and what beds do: the fastest motion is that of particles that spin against their six neighbours, with
        # w^2 = 20 k/m and 2 D w = 51 beta sqrt(k/m); leapfrog with the damping of the last step is stable for w^2 dt^2 + 2 D w dt < 4.
        law = self.law(1.0)
        stiffness = law[STIFFNESS] * radius * (law[HERTZ] * math.sqrt(_OVERLAP) + law[LINEAR] * 0.5)  # R* = r / 2
        damping = 25.5 * 0.5 * law[DAMPING]
        step = (math.sqrt(damping * damping + 80.0) - damping) / 20.0 * math.sqrt(law[MASS] * radius**3 / stiffness)
        return min(LARGEST_SHARE * rayleigh_time, step)

    def check_step(self, dt: float, radius: float) -> None:
        """Raise ModelError for a substep dt [s] that is not stable for the smallest radius [m]."""
        largest = self.largest_time_step(radius)
        if dt > largest:
            raise ModelError(
                f"dt = {dt:g} s: above the stability limit of particles of {2e3 * radius:.3g} mm and E = {self.E:g} Pa; "
                f"use at most {largest:.3g} s, or 0 for {self.time_step(radius):.3g} s"
            )

    def time_step(self, radius: float) -> float:
        """Substep [s] that is chosen for the smallest radius [m]."""
        return SHARE * self.largest_time_step(radius)


_DEFAULT = Material()

#: Grains and their contacts.
GRAIN = Record(
    E=Real(_DEFAULT.E, "Pa", "Young's modulus of grains, softer than real ones: overlaps stay below 1 % of d", min=1e4, max=1e12),
    nu=Real(_DEFAULT.nu, "1", "Poisson's ratio", min=0.0, max=0.49),
    e=Real(_DEFAULT.e, "1", "Coefficient of restitution", min=0.01, max=1.0),
    mu=Real(_DEFAULT.mu, "1", "Coefficient of friction", min=0.0, max=5.0),
    mu_r=Real(_DEFAULT.mu_r, "1", "Coefficient of rolling friction", min=0.0, max=5.0),
    cohesion=Real(_DEFAULT.cohesion, "Pa", "Pull of a contact over the square of the diameter", min=0.0, max=1e6),
    density=Real(_DEFAULT.density, "kg/m3", "Density of the grains", min=100.0, max=2e4),
    rotation=Choice(
        "Rotation geometry, by which grains roll, beside mu_r (section 8.3.18)",
        sphere="as spheres",
        ellipse="ellipses about each axis",
        polygon="regular polygons about each axis",
    ),
    aspect=Real(1.2, "1", "Long over short axis of the ellipses", min=1.001, max=LARGEST_ASPECT),
    corners=Real(6.0, "1", "Number of corners of the polygons, even", min=4.0, max=float(MOST_CORNERS)),
    returned=Real(0.25, "1", "Share of what a grain climbs on these that it gets back", min=0.0, max=1.0),
)
#: What is different where particles touch wheels and bodies.
SURFACE = Record(
    **{name: GRAIN.fields[name] for name in ("e", "mu", "mu_r")},
    # R* is the particle's radius there, twice that of two equal particles.
    cohesion=replace(GRAIN.fields["cohesion"], description="Pull of a contact over 4 times the square of the diameter"),
)

#: Which of a grain's numbers are of its rotation geometry.
SHAPE_FIELDS = ("aspect", "corners", "returned")


def material_of(grain, linear: bool) -> Material:
    """The material that the values of ``GRAIN`` declare."""
    numbers = {name: float(grain[name]) for name in GRAIN.fields if name not in ("rotation", *SHAPE_FIELDS)}
    rotation, returned = list(GRAIN.fields["rotation"].options)[int(grain["rotation"]) - 1], float(grain["returned"])
    shapes = {
        "ellipse": Shape(aspect=float(grain["aspect"]), returned=returned),
        "polygon": Shape(corners=int(grain["corners"]), returned=returned),
    }
    return Material(**numbers, linear=linear, shape=shapes.get(rotation))
