"""Wheel geometry: a cylinder with radial grousers over its full width."""

from __future__ import annotations

import math

from .slave.kernel import kernel
from .slave.model import Rule
from .slave.records import Real, Record

#: The wheel of Table 8.2; r_w is the radius of the rim, without grousers.
WHEEL = Record(
    r_w=Real(0.125, "m", "Wheel radius without grousers", min=1e-3, max=10.0),
    b_w=Real(0.125, "m", "Wheel width", min=1e-3, max=10.0),
    n_g=Real(12.0, "1", "Number of grousers; 0 = smooth wheel", min=0.0, max=1000.0),
    h_g=Real(0.010, "m", "Grouser height", min=0.0, max=1.0),
    t_g=Real(0.002, "m", "Thickness of a grouser's tip (assumption: 0.2 of the height; Table 8.2 leaves it out)", min=0.0, max=1.0),
)


#: Of wheels that can be built.
WHEEL_RULES = (
    Rule("n_g = {p.n_g:g}: the number of grousers must be whole", lambda p: p.n_g != math.floor(p.n_g)),
    Rule(
        "n_g = {p.n_g:g}: grousers of t_g = {p.t_g:g} m fill more than the {around:.3g} m around their tips; use fewer or thinner",
        lambda p: p.n_g * p.t_g > 2.0 * math.pi * (p.r_w + p.h_g),
        dict(around=lambda p: 2.0 * math.pi * (p.r_w + p.h_g)),
    ),
)


@kernel
def tip_radius(p):
    """Radius [m] up to the tips of the grousers, on which a wheel stands on hard ground."""
    return p.r_w + p.h_g if p.n_g > 0.0 else p.r_w
