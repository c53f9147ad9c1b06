"""Coarse grains: the rules by which fewer, larger particles stand for a soil, and the checks of their limits.

A coarse-grain factor multiplies all diameters and keeps density, stiffness, restitution, both frictions and cohesion, which is a stress: at
equal stress, forces grow with d^2 and overlaps with d, so that strains and strength stay as they were, as long as what touches the soil is
large against a particle. Each limit is checked where what it needs is known: overlaps under its own weight by ``settle``; features of
tools, the box and overlaps under load by whoever puts a tool on a bed, with the functions here.
"""

from __future__ import annotations

import math
import warnings

from ..slave.model import ModelError
from .material import Material

#: Least size of a tool's feature, in mean diameters: refused below the first, warned of below the second.
LEAST_FEATURE, GOOD_FEATURE = 2.0, 5.0
#: Least width of the box in widths of a tool, and depth in its radii, without effect of the boundary to speak of.
LEAST_WIDTH, LEAST_DEPTH = 2.0, 1.2
#: Largest overlap over diameter that leaves the soil's kinematics as those of stiff grains.
LARGEST_OVERLAP = 0.01
_CONTACTS, _SOLID = 4.5, 0.6  # of a packing, for an estimate of the overlap: coordination number, and solid share of the volume


def check_feature(name: str, size: float, diameter: float) -> None:
    """Refuse a feature of a tool (height of grousers, width of a plate) that is small against particles, or warn of it.

    Args:
        name: What it is, for messages.
        size: Its size [m].
        diameter: Mean diameter of the particles there [m].

    Raises:
        ModelError: It is below 2 diameters. Below 5 it is warned of.
    """
    ratio = size / diameter
    text = f"{name} = {size:g} m is {ratio:.3g} mean diameters of the particles ({diameter:g} m)"
    if ratio < LEAST_FEATURE:
        raise ModelError(f"{text}, at least {LEAST_FEATURE:g} are needed: take particles below {size / LEAST_FEATURE:.3g} m")
    if ratio < GOOD_FEATURE:
        warnings.warn(
            f"{text}, below {GOOD_FEATURE:g} its forces depend on single particles: {size / GOOD_FEATURE:.3g} m would do", stacklevel=2
        )


def check_box(width: float, depth: float, tool_width: float, tool_radius: float) -> None:
    """Raise ModelError if a box of particles of this width and depth [m] is too small for a tool of this width and radius [m]."""
    for name, have, least, of, size in (
        ("box_width", width, LEAST_WIDTH, "widths", tool_width),
        ("depth", depth, LEAST_DEPTH, "radii", tool_radius),
    ):
        if have < least * size:
            raise ModelError(
                f"{name} = {have:g} m: for this tool it must be at least {least * size:g} m ({least:g} {of} of {size:g} m); make the "
                "box larger, or the tool smaller"
            )


def overlap_under(material: Material, pressure: float) -> float:
    """Mean overlap over diameter of equal particles in a packing under a pressure [Pa]; it does not depend on the diameter."""
    force = math.pi * pressure / (_SOLID * _CONTACTS)  # Rumpf 1970, over d^2
    effective = 0.5 * material.E / (1.0 - material.nu**2)
    if material.linear:
        return force / (2.0 * effective * 0.25)  # F = 2 E* R* d, R* = diameter / 4
    return (force / (4.0 / 3.0 * effective * math.sqrt(0.25))) ** (2.0 / 3.0)  # F = 4/3 E* sqrt(R*) d^1.5


def check_overlap(material: Material, pressure: float) -> None:
    """Warn if particles under this pressure [Pa] overlap by more than 1 % of their diameter, naming the least stiffness."""
    overlap = overlap_under(material, pressure)
    if overlap > LARGEST_OVERLAP:
        least = material.E * (overlap / LARGEST_OVERLAP) ** (1.0 if material.linear else 1.5)
        warnings.warn(
            f"E = {material.E:g} Pa: under {pressure:.3g} Pa particles overlap by {100.0 * overlap:.2g} % of their diameter, above "
            f"{100.0 * LARGEST_OVERLAP:g} % they act softer than soil; take E >= {least:.2g} Pa",
            stacklevel=2,
        )
