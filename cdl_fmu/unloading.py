"""Soil that was pressed before: elastic up to the pressure at which it yields again, as stiff as Wong (1980) has it."""

from __future__ import annotations

from typing import NamedTuple

from .slave.kernel import kernel
from .slave.records import Real, Record

#: How stiff soil is that is unloaded and loaded again.
UNLOADING = Record(
    unloading_ratio=Real(
        8.0,
        "1",
        "Stiffness of soil that is unloaded and loaded again over the slope of its law of pressure, at least 2 / n; used where k_0 and A_u "
        "are 0",
        min=1.0,
        max=1e6,
    ),
    k_0=Real(
        0.0,
        "Pa/m",
        "Stiffness of soil that is unloaded and loaded again, at the surface (Wong); at least the slope of its law of pressure counts",
        min=0.0,
        max=1e12,
    ),
    A_u=Real(0.0, "Pa/m2", "Its increase with the depth to which it was pressed (Wong)", min=0.0, max=1e13),
)


class Unloading(NamedTuple):
    """How stiff soil is that is unloaded and loaded again: k_u = k_0 + A_u z_u (Wong 1980), or in ratio to the law of pressure."""

    k_0: float  # [Pa/m]
    A_u: float  # [Pa/m2]
    ratio: float  # of k_u to the secant pressure / depth [1]; 0 where k_0 and A_u are given
    rest: float  # share of a depth that is left when the load goes [1]
    exponent: float  # of the slope of the law of pressure over depth [1]


@kernel
def unloading_of(p):
    """The law of unloading that a model's parameters give."""
    if p.k_0 + p.A_u > 0.0:
        return Unloading(p.k_0, p.A_u, 0.0, 1.0, p.n - 1.0)
    ratio = max(p.unloading_ratio * p.n, 2.0)  # soil springs back by 1 / ratio of its depth, half of it at most
    return Unloading(0.0, 0.0, ratio, 1.0 - 1.0 / ratio, p.n - 1.0)


@kernel(inline=True)
def unloading_stiffness(law, depth, dense, floor):
    """Stiffness k_u [Pa/m] of soil that is unloaded or loaded again.

    It is that of the depth z_u from which the soil is unloaded: the floor and what sprang back, or the tool's depth where that is more.

    Args:
        law: See ``unloading_of``.
        depth: Depth of the tool [m], where dense soil bears the pressure ``dense`` [Pa].
        floor: Depth of the floor that was pressed before [m].
    """
    if law.ratio == 0.0:
        # Soil that is unloaded is not softer than soil that is pressed for the first time.
        k_u = max(law.k_0 + law.A_u * depth, (1.0 + law.exponent) * dense / depth)
        return k_u + law.A_u * max(0.0, floor + dense / k_u - depth)
    per_depth = 1.0 / depth
    more = min(max(0.0, floor * (1.0 / law.rest) * per_depth - 1.0), 1.0)  # z_u / depth - 1
    return law.ratio * dense * per_depth * (1.0 + law.exponent * more)  # slope at z_u, to first order


@kernel(inline=True)
def pressure(k_u, n, elastic, depth, plastic):
    """Elastic-plastic pressure [Pa] and its slope [Pa/m] of soil pressed ``elastic`` > 0 [m] below its floor, at a depth [m].

    Elastic predictor k_u elastic, limited by the plastic pressure; the floor that is left lies pressure / k_u above the tool.
    """
    trial = k_u * elastic
    yields = trial >= plastic
    return plastic if yields else trial, n * plastic * (1.0 / depth) if yields else k_u


@kernel
def tested_depth(law, modulus, n, floor, least):
    """Depth [m] that the yield pressure of a patch is of: that to which the soil was pressed, ``least`` [m] where that is less.

    Args:
        law: See ``unloading_of``.
        modulus, n: Of the law of pressure k z^n [N/m^(n+2)], [1].
        floor: Plastic sinkage [m].
    """
    if floor <= 0.0:
        return least
    dense = modulus * floor**n
    return max(floor + dense / unloading_stiffness(law, floor, dense, floor), least)
