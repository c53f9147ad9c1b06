"""The soil below a BCM wheel: untouched, or pressed before and so elastic down to its floor and up to its yield pressure."""

from __future__ import annotations

import math
from typing import NamedTuple

from ..slave.kernel import kernel
from ..terrain.patch import pressed_before, sinkage_at
from ..terramechanics import bekker
from ..unloading import Unloading, pressure, tested_depth, unloading_stiffness

#: Places of the rim at which it is looked for where it meets a floor that was pressed before.
_PROBES = 12


class Soil(NamedTuple):
    """The soil below a wheel."""

    modulus: float  # k of Bekker's law [N/m^(n+2)]
    n: float  # its exponent
    unloading: Unloading
    tested: float  # least depth that the yield pressure of a patch is of [m]
    r: float  # radius [m]
    x_0: tuple  # world x [m] of the wheel's centre, and of its axes x, a and r
    y_0: tuple  # the same of y


@kernel
def pressure_at(soil, patch, z, sin, cos, xi):
    """Pressure [Pa] and its slope [Pa/m] that the soil bears at a depth z [m] below its level, 0 above it, and its pressure if it yields.

    Args:
        patch: What pressed the soil before, None where nothing did: then it bears Bekker's pressure.
        sin, cos, xi: Where on the rim: of the angle from nadir, and place along the axle [m].
    """
    if z <= 0.0:
        return 0.0, 0.0, 0.0
    sigma = bekker(soil.modulus, z, soil.n)
    if patch is None:
        return sigma, soil.n * sigma / z, sigma
    inside, floor, yields = pressed_at(soil, patch, sin, cos, xi)
    if not inside:
        return sigma, soil.n * sigma / z, sigma
    if z <= floor:
        return 0.0, 0.0, 0.0
    tested = tested_depth(soil.unloading, soil.modulus, soil.n, floor, soil.tested)
    plastic = sigma * min(yields / bekker(soil.modulus, tested, soil.n), 1.0)
    sigma, rise = pressure(unloading_stiffness(soil.unloading, z, sigma, floor), soil.n, z - floor, z, plastic)
    return sigma, rise, plastic


@kernel(inline=True)
def _below(soil, sin, cos, xi):
    """World x and y [m] of a place of the rim: of the angle from nadir, and place along the axle [m]."""
    x, y, forward, down = soil.x_0, soil.y_0, soil.r * sin, -soil.r * cos
    return x[0] + forward * x[1] + xi * x[2] + down * x[3], y[0] + forward * y[1] + xi * y[2] + down * y[3]


@kernel
def pressed_at(soil, patch, sin, cos, xi):
    """``pressed_before`` below a place of the rim."""
    x, y = _below(soil, sin, cos, xi)
    return pressed_before(patch, x, y)


@kernel
def bearing_arc(soil, patch, cos_g, cos_1, trail, lead, xi):
    """Part of the arc from trail to lead [rad] where the rim is below the floor that was pressed before: all quadrature is within it.

    Returns:
        found (False if none is), where it begins and ends, whether it begins at the trailing end.
    """
    found, begins, begin, end = False, False, trail, lead
    theta, gap = trail, _below_floor(soil, patch, cos_g, cos_1, trail, xi)
    for k in range(_PROBES + 1):
        # The lowest point is one of the probes.
        share = 2.0 * k / _PROBES - 1.0
        a, gap_a = theta, gap
        theta = -share * trail if share < 0.0 else share * lead
        gap = _below_floor(soil, patch, cos_g, cos_1, theta, xi)
        if gap > 0.0:
            end = theta
            if not found:
                found, begin, begins = True, theta, k == 0
                if k > 0:
                    begin = _edge(soil, patch, cos_g, cos_1, theta, gap, a, gap_a, xi)
        elif gap_a > 0.0:
            end = _edge(soil, patch, cos_g, cos_1, a, gap_a, theta, gap, xi)
    return found, begin, end, begins


@kernel
def _below_floor(soil, patch, cos_g, cos_1, theta, xi):
    """Depth [m] of a place of the rim below the floor."""
    sin, cos = math.sin(theta), math.cos(theta)
    x, y = _below(soil, sin, cos, xi)
    return soil.r * cos_g * (cos - cos_1) - sinkage_at(patch, x, y)


@kernel
def _edge(soil, patch, cos_g, cos_1, low, gap_low, high, gap_high, xi):
    """Angle [rad] between one where the rim is below the floor and one where it is above, at which it meets it (false position)."""
    for _ in range(2):
        theta = low + (high - low) * gap_low / (gap_low - gap_high)
        gap = _below_floor(soil, patch, cos_g, cos_1, theta, xi)
        if gap > 0.0:
            low, gap_low = theta, gap
        else:
            high, gap_high = theta, gap
    return low + (high - low) * gap_low / (gap_low - gap_high)
