"""How much the soil below a tool bears: dense soil as plates measured it, sheared soil at its critical state, pushed aside and along.

A plate presses soil straight down, and what it measures is the strength of soil at rest (Bekker's law). A tool that slips shears the soil:
along a path of some millimetres it falls to its critical state, whose strength is that of a footing of the size of the contact, by Vesic
(1975), with the friction of the angle of repose, at which loose soil is. That is why a slipping wheel sinks.

A footing that pushes soil along bears less than one that presses straight down, and one whose base faces its push less still: the fan of
slip lines from its edge to the free surface is shorter (Prandtl 1920, Sokolovskii 1965). A wheel in skid pushes soil ahead, up its
front, and so sinks deeper than one that slips as much when it drives, which pushes soil below itself to the back.

Soil that lies above its undisturbed level is loose: it is at the critical state from the start.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from .contact import SLIP_FLOOR
from .slave.kernel import kernel
from .slave.records import Choice, Real, Record
from .terramechanics import flow_value, unit_weight

#: Constants of the law. All were chosen on the CMU tests of a smooth wheel (see validation/), within what the theory says.
STRENGTH = Record(
    softening=Real(
        0.7, "1", "Path of slip over which dense soil falls to its critical state, over K; 0 = it stays dense", min=0.0, max=1e3
    ),
    preshear=Real(0.5, "1", "Share of the passive wedge's length ahead along which pushed soil is sheared", min=0.0, max=10.0),
    fan=Real(0.6, "1", "Share of the loss of strength by a tilted base that counts: the rest escapes to the sides", min=0.0, max=1.0),
    behind=Real(0.43, "1", "Share of the loss of strength by push that counts towards the rut behind", min=0.0, max=1.0),
)


#: Which strength soil has that is sheared, pushed along or heaped up.
STRENGTHS = Choice(
    "Strength of soil that is sheared, pushed along or heaped up",
    plates="what plates measured, everywhere",
    critical_state="falls from what plates measured to its critical state: slip sinkage",
)
CRITICAL_STATE = STRENGTHS.value("critical_state")


class Strength(NamedTuple):
    """What the strength below a tool depends on, constant in a step."""

    per_K_s: float  # 1 / path of slip that softens [1/m]; 0 = no softening
    loose: float  # 1 where soil above its undisturbed level is loose, 0 where it bears as dense soil does
    surcharge: float  # pressure per depth that soil beside the tool adds [Pa/m]
    deepening: float  # its increase by depth over width [1]
    width: float  # the smaller side of the contact [m]
    depth: float  # of the contact [m]
    weight: float  # pressure that the weight of the soil below adds [Pa]
    along: float  # exponents of the loss by push along the tool's heading and across it [1]
    across: float
    flank: float  # by how much more a steep base bears, whose wedge is wider than it is [1]
    tilt: float  # loss by the tilt of the base, per rad
    behind: float  # share of the loss that counts where soil is pushed to the rut behind [1]
    wall: float  # passive pressure of soil beside a steep face, over Rankine's on a smooth long one [1]
    wall_modulus: float  # displacement that mobilises 63 % of it [m]


#: Displacement that mobilises 63 % of a wall's passive pressure, over its height: a third of the 4 % that mobilise all (Clough & Duncan
#: 1991, loose sand).
_WALL_MODULUS = 0.013

_LEAST = 1e-3  # [m] length of a contact


@kernel
def strength_of(p, critical, phi_cs, width, length, depth, speed):
    """Strength below a tool.

    Args:
        critical: False if soil bears everywhere what plates measured.
        phi_cs: Angle of repose [rad], at which soil at its critical state is.
        width, length, depth: Of the contact, across and along the tool's heading, and down [m].
        speed: Along the heading [m/s]; a tool at rest leaves no rut behind.
    """
    if not critical:
        return Strength(0.0, 0.0, 0.0, 0.0, _LEAST, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, p.K)
    b = max(min(width, length), _LEAST)
    ratio = b / max(width, length, _LEAST)
    tan_phi, tan_cs, sin_cs = math.tan(p.phi), math.tan(phi_cs), math.sin(phi_cs)
    N_q = flow_value(phi_cs) * math.exp(math.pi * tan_cs)  # Prandtl 1920, Reissner 1924
    N_gamma = 2.0 * (N_q + 1.0) * tan_cs  # Vesic 1975
    gamma_s, N_phi = unit_weight(p.rho, p.gravity, p.slope), flow_value(p.phi)
    shape = max(length, _LEAST) / width
    return Strength(
        1.0 / (p.softening * p.K) if p.softening > 0.0 else 0.0,
        1.0,
        gamma_s * N_q * (1.0 + ratio * tan_cs),  # with the shape factor s_q
        2.0 * tan_cs * (1.0 - sin_cs) ** 2,  # Hansen 1970, d_q up to a depth of the width
        b,
        depth,
        0.5 * gamma_s * b * N_gamma * (1.0 - 0.4 * ratio),  # with the shape factor s_gamma
        # Vesic 1975: m = (2 + l/b) / (1 + l/b) along the contact, in units of the 2 of a long footing pushed across.
        0.5 * (2.0 + shape) / (1.0 + shape),
        0.5 * (2.0 * shape + 1.0) / (1.0 + shape),
        2.0 / 3.0 * math.sqrt(N_phi) * depth / width,
        2.0 * p.fan * tan_phi,  # of the 2 tan(phi) of a plane fan
        p.behind + (1.0 - p.behind) * math.exp(-abs(speed) / SLIP_FLOOR),
        # Soil rises against the face, whose friction adds to its pressure, and fails in a wedge that is wider than the face by as much as
        # two thirds of its own length.
        math.exp(log_of_friction(tan_phi, -tan_phi)) * (1.0 + 2.0 / 3.0 * math.sqrt(N_phi) * depth / max(length, _LEAST)),
        min(p.K, max(_WALL_MODULUS * depth, 1e-6)),
    )


@kernel
def log_of_friction(tan_phi, push):
    """Logarithm of the share of its strength that is left to soil pushed along by friction; above 0 if it is pushed against its escape.

    Args:
        tan_phi: Tangent of the soil's angle of friction.
        push: Tangent of the angle of friction that acts, positive towards the side to which the soil escapes.
    """
    phi, delta = math.atan(tan_phi), -math.atan(push)
    sin_phi = math.sin(phi)
    turn = math.asin(max(-1.0, min(1.0, math.sin(delta) / max(sin_phi, 1e-9)))) + delta
    # Sokolovskii 1965: the ratio of Prandtl's N_q under an inclined load to that under none.
    return math.log((1.0 + sin_phi * math.cos(turn)) / (1.0 + sin_phi)) + turn * tan_phi


@kernel
def tabulate_pushes(phi, table):
    """Fill ``table`` with ``log_of_friction`` at mobilised shares of friction from -1 to 1: computed, it would cost more than all else."""
    for k in range(len(table)):
        table[k] = log_of_friction(math.tan(phi), math.tan(phi) * (2.0 * k / (len(table) - 1.0) - 1.0))


@kernel(inline=True)
def log_of_push(table, share):
    """``log_of_friction`` of a mobilised share from -1 to 1, from its table."""
    at = (share + 1.0) * (0.5 * (len(table) - 1.0))
    k = min(max(int(at), 0), len(table) - 2)
    return table[k] + (at - k) * (table[k + 1] - table[k])


@kernel(inline=True)
def angle(sin, cos):
    """Angle [rad] between -pi/2 and pi/2, from its half's tangent; off by 1e-4 at most, in a form that compilers turn into vectors."""
    t = sin / (1.0 + cos)
    q = t * t
    # Abramowitz & Stegun 1964, 4.4.49, for the arc tangent.
    return 2.0 * t * (0.9998660 + q * (-0.3302995 + q * (0.1801410 + q * (-0.0851330 + q * 0.0208351))))


@kernel(inline=True)
def exponential(x):
    """e^x for x from -20 to 20, with a relative error of |x|^5 / 1e8, in a form that compilers turn into vectors."""
    t = min(max(x, -20.0), 20.0) / 32.0
    e = 1.0 + t * (1.0 + t * (1.0 / 2.0 + t * (1.0 / 6.0 + t * (1.0 / 24.0))))
    e *= e
    e *= e
    e *= e
    e *= e
    return e * e


@kernel(inline=True)
def left_by_push(s, ahead, behind, beside):
    """Shares of the strength that the push leaves to soil that escapes ahead of the tool, behind it and beside it.

    Args:
        s: Strength.
        ahead, behind, beside: ``log_of_friction`` of the push towards that side.
    """
    return exponential(s.along * ahead), exponential(s.along * s.behind * behind), exponential(s.across * beside)


@kernel(inline=True)
def escape(s, theta, sin, ahead, behind, beside):
    """Share of the strength that is left where soil escapes most easily: ahead, behind or beside the tool.

    Args:
        s: Strength.
        theta, sin: Angle [rad] by which the base faces ahead, and its sine.
        ahead, behind, beside: Shares ``left_by_push`` towards that side.
    """
    tilt, up, down = exponential(s.along * s.tilt * theta), max(sin, 0.0), min(sin, 0.0)
    front = ahead * (1.0 / tilt) * (1.0 + s.flank * up * up)
    back = min(behind * tilt, beside) * (1.0 + s.flank * down * down)
    return min(1.0, front, back)


@kernel(inline=True)
def softened(s, path):
    """Share of the soil's way to its critical state after a path of slip [m]."""
    return 1.0 - exponential(-path * s.per_K_s)


@kernel(inline=True)
def critical_pressure(s, depth):
    """Pressure [Pa] that soil at its critical state bears at a depth [m]."""
    relative = depth * (1.0 / s.width)
    return s.surcharge * depth * (1.0 + s.deepening * min(relative, 1.0)) + s.weight


@kernel(inline=True)
def yield_pressure(s, dense, depth, fill, soft, share):
    """Pressure [Pa] at which soil yields.

    Args:
        dense: Pressure that dense soil bears there at rest [Pa].
        depth: Depth below the surface [m]; ``fill`` [m] of it, if positive, is loose.
        soft: Share of the way to the critical state.
        share: Of the strength that is left, see ``escape``.
    """
    soft = max(soft, s.loose * min(fill * (1.0 / depth), 1.0))
    return share * ((1.0 - soft) * dense + soft * min(dense, critical_pressure(s, depth)))
