"""Soil that gets denser, and so stronger, where it is compacted again: an extension of the chapter, where both stay as they are.

A cell knows how much height the column below it lost by compaction. It is spread over the depth to which a wheel reaches, and is taken from
the voids: the void ratio falls in proportion, and friction rises as Caquot & Kerisel (1948) have it, e tan(phi) = constant.

Plates and shear tests compact the soil while they measure it: what they find at some sinkage holds for soil as dense as that sinkage makes
it, so a first pressing is as without this law. Soil that is denser is stronger than measured. It gets so where loose soil slides or is
dragged back into a rut and is pressed again: sinkage starts anew, the compaction of the column stays.

What is left out: two layers in a column; the column's compaction goes with what fills it up, or lies on it. Soil that dilates where it is
sheared. Compaction beside tools. A shorter way to mobilise dense soil's friction (K). Patches do not tell wheels of other tiers of it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ..slave.kernel import kernel
from ..slave.model import Rule
from ..slave.records import Choice, Real, Record
from ..strength import exponential
from .tiles import QUANTUM

COMPRESSIBLE = Record(
    compressible=Choice(
        "Density and strength of soil that is compacted",
        off="stay as they are, as in the chapter",
        on="rise with compaction: void ratio times tan(phi) stays (Caquot & Kerisel 1948)",
    ),
    rho_s=Real(2650.0, "kg/m3", "Density of the grains, as of quartz; used if compressible", min=1.0, max=1e5),
    e_min=Real(
        0.2,
        "1",
        "Least void ratio, at which soil flows out and is not compacted: 0.2 in well graded, 0.3 in silty, 0.4 in uniform sand (Lambe & "
        "Whitman 1969); used if compressible",
        min=0.01,
        max=10.0,
    ),
)


#: Compressible soil that is not as dense as can be from the start.
DENSITY_RULE = Rule(
    "e_min = {p.e_min:g}: not below the void ratio rho_s/rho - 1 = {voids:.4g} of undisturbed soil, rho = {p.rho:g} kg/m3; use at most "
    "{most:.4g} kg/m3 for rho, a smaller e_min, or as rho_s, {p.rho_s:g} kg/m3, the density of the grains that this soil has",
    lambda p: p.compressible == 2.0 and (1.0 + p.e_min) * p.rho >= p.rho_s,
    dict(voids=lambda p: p.rho_s / p.rho - 1.0, most=lambda p: p.rho_s / (1.0 + p.e_min)),
)


class Density(NamedTuple):
    """How a column of soil gets denser and stronger, constant during a run."""

    per_depth: float  # 1 / its height before [1/m]; 0 = it stays as it is
    per_void: float  # 1 / height of its voids before [1/m]; 0 likewise
    most: float  # height that it can lose [m], a multiple of QUANTUM
    measured: float  # share of a test's sinkage by which it compacts the soil that it measures [1]
    tan_phi: float  # friction measured [1]


#: Depth over which compaction is spread, in widths of the wheel: there the stress below a square footing has fallen to a tenth
#: (Boussinesq 1885).
_REACH = 2.0


@kernel
def density_of(p):
    """The law that a model's parameters give."""
    if p.compressible == 1.0:
        return Density(0.0, 0.0, math.inf, 1.0 - p.plasticity, math.tan(p.phi))
    depth = min(_REACH * p.b_w, p.layer_depth)
    grains = depth * p.rho / p.rho_s
    voids = depth - grains
    most = math.floor((voids - p.e_min * grains) / QUANTUM) * QUANTUM
    return Density(1.0 / depth, 1.0 / voids, most, 1.0 - p.plasticity, math.tan(p.phi))


@kernel(inline=True)
def densification(law, compacted):
    """Density of a column that was compacted by a height [m] over that of undisturbed soil."""
    return 1.0 / (1.0 - compacted * law.per_depth)


@kernel(inline=True)
def friction(law, compacted, sinkage):
    """tan(phi) of a column that was compacted by a height [m], where tests compact it by their share of the sinkage [m]."""
    tested = min(law.measured * sinkage, compacted)
    return law.tan_phi * ((1.0 - tested * law.per_void) / (1.0 - compacted * law.per_void))  # Caquot & Kerisel 1948


@kernel(inline=True)
def passive_gain(law, tan_phi):
    """Rankine's passive flow value at a friction over that at the measured one."""
    ratio = _root(tan_phi) / _root(law.tan_phi)
    return ratio * ratio


@kernel(inline=True)
def bearing_gain(law, tan_phi):
    """Pressure that soil of a friction bears over what plates measured: the ratio of Prandtl's (1920) factors N_q."""
    return passive_gain(law, tan_phi) * exponential(math.pi * (tan_phi - law.tan_phi))


@kernel(inline=True)
def _root(tan_phi):
    """tan(pi/4 + phi/2), whose square is the flow value."""
    return tan_phi + math.sqrt(1.0 + tan_phi * tan_phi)
