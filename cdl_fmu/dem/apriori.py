"""A-priori parameters: grains that make a soil of given strength, density and porosity, without calibration of that soil.

What is strong in a bed of spheres is known from one grid of virtual shear tests over friction, rolling friction and porosity, of no soil
(``benchmarks/dem_apriori.py``, table beside it). Strength grows along a line through both frictions: with mu alone, then with mu_r at the
friction of minerals, then with both. phi is the peak strength of the bed at its porosity, as ``cdl identify`` takes it from shear tests; of
loose sand, peak and residual strength are alike, and so is its angle of repose. What dense sand has more, it has from its porosity.
"""

from __future__ import annotations

import math

import numpy as np

from ..slave.model import ModelError
from .material import Material
from .scaling import LARGEST_OVERLAP, overlap_under

#: Pressure under wheels [Pa] below which overlaps stay below 1 % of the diameter.
WHEEL_PRESSURE = 1e4
#: Porosities that the training set has.
POROSITIES = 0.4, 0.46
#: The line: mu, mu_r, T = tan(phi) at the porosity ``_MIDDLE``, and the loosest porosity that settles; the last ones settle above 0.46.
_LINE = np.array(
    [
        (0.3, 0.0, 0.375, 0.403),
        (0.5, 0.0, 0.421, 0.416),
        (0.5, 0.1, 0.517, 0.438),
        (0.5, 0.25, 0.592, 0.462),
        (0.5, 0.6, 0.718, 0.48),
        (0.8, 0.6, 0.756, 0.48),
        (0.8, 1.2, 0.801, 0.48),
    ]
)
#: tan(phi) = T + B max(T - T_0, 0) (0.43 - porosity): rough grains flow at looser porosities than others, so that at one porosity they are
#: the denser, by which strength grows (Bolton 1986). Least squares: tests are off by 1.4 deg (root mean square), most of it their scatter.
_MIDDLE, _B, _T_0 = 0.43, 10.8, 0.485
_COORDINATION = 4.5  # contacts of a grain, as beds have them


def grains_of(phi: float, c: float, rho: float, porosity: float, linear: bool = False) -> Material:
    """Grains of a soil, to be settled to this porosity.

    Args:
        phi: Angle of internal friction, peak strength [rad].
        c: Cohesion [Pa].
        rho: Bulk density [kg/m3].
        porosity: Of the bed. Where it is not the soil's, as spheres cannot be that loose or dense, the bed still has the soil's density.
        linear: Linear contacts in place of Hertz'.

    Raises:
        ModelError: No bed of spheres has this porosity, or this strength at it; or c or rho is out of bounds.
    """
    low, high = POROSITIES
    if not low <= porosity <= high:
        raise ModelError(
            f"porosity = {porosity:g}: beds of grains are known between {low:g} and {high:g}; take the nearest, which keeps rho: the "
            "density of the grains follows"
        )
    if not 0.0 <= c < math.inf:
        raise ModelError(f"c = {c:g} Pa: cohesion must be at least 0 Pa and finite")
    if not 0.0 < rho < math.inf:
        raise ModelError(f"rho = {rho:g} kg/m3: the soil's bulk density must be above 0 kg/m3 and finite")
    least, largest = reachable_phi(porosity)
    if not least <= phi <= largest:
        remedy = "a denser bed, as far as the soil is" if phi > largest else "a denser bed, which weaker grains settle to"
        raise ModelError(
            f"phi = {phi:g} rad ({math.degrees(phi):.3g} deg): beds of porosity {porosity:g} have {least:.3g} to {largest:.3g} rad "
            f"({math.degrees(least):.3g} to {math.degrees(largest):.3g} deg); take {remedy}"
        )
    mu, mu_r, strength, _ = _LINE.T
    tangent, denser = math.tan(phi), _B * (_MIDDLE - porosity)
    wanted = tangent if tangent <= _T_0 else (tangent + _T_0 * denser) / (1.0 + denser)
    # Rumpf 1970: sigma_t = (1 - n) k F / (pi d^2) with k contacts of a grain; c = sigma_t tan(phi).
    pull = math.pi * c / tangent / ((1.0 - porosity) * _COORDINATION)
    soft = Material(linear=linear)
    ratio = overlap_under(soft, WHEEL_PRESSURE) / LARGEST_OVERLAP
    return Material(
        E=soft.E * ratio ** (1.0 if linear else 1.5),  # overlap ~ E^-1, E^-2/3
        mu=float(np.interp(wanted, strength, mu)),
        mu_r=float(np.interp(wanted, strength, mu_r)),
        cohesion=pull,
        density=rho / (1.0 - porosity),
        linear=linear,
    )


def reachable_phi(porosity: float) -> tuple[float, float]:
    """Least and largest peak strength phi [rad] of beds with this porosity: weaker grains do not settle that loosely."""
    _, _, strength, loosest = _LINE.T
    settles = np.interp(porosity, loosest[:4], strength[:4])
    return tuple(math.atan(t + _B * max(t - _T_0, 0.0) * (_MIDDLE - porosity)) for t in (settles, strength[-1]))
