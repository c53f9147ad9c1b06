"""Wheel geometry: a cylinder with radial grousers over its full width."""

from .slave.records import Real, Record

#: The wheel of Table 8.2; r_w is the radius of the rim, without grousers.
WHEEL = Record(
    r_w=Real(0.125, "m", "Wheel radius without grousers", min=1e-3, max=10.0),
    b_w=Real(0.125, "m", "Wheel width", min=1e-3, max=10.0),
    n_g=Real(12.0, "1", "Number of grousers; 0 = smooth wheel", min=0.0, max=1000.0),
    h_g=Real(0.010, "m", "Grouser height", min=0.0, max=1.0),
    t_g=Real(0.002, "m", "Thickness of a grouser's tip (assumption: 0.2 of the height; Table 8.2 leaves it out)", min=0.0, max=1.0),
)
