"""Slip of a wheel on a carriage, as testbeds measure it: of the rim's speed r omega against the carriage's, whatever the slip angle."""

from __future__ import annotations

import math


def slip_of(speed: float, wheel_rate: float, r_w: float) -> float:
    """Slip of a wheel of radius r_w [m] that turns with wheel_rate [rad/s] on a carriage of this speed [m/s] >= 0; at rest 0.

    1 - V/(r omega) where the rim is at least as fast as the carriage, r omega/V - 1 where it is slower.
    """
    rim = r_w * wheel_rate
    if rim >= speed:
        return 1.0 - speed / rim if rim > 0.0 else 0.0
    return rim / speed - 1.0 if speed > 0.0 else -1.0


def wheel_rate_of(slip: float, speed: float, r_w: float) -> float:
    """Rate [rad/s] at which a wheel of radius r_w [m] has this slip, at most 1, on a carriage of this speed [m/s]; infinite at slip 1."""
    if slip < 0.0:
        return (1.0 + slip) * speed / r_w
    if speed == 0.0:
        return 0.0
    return speed / (r_w * (1.0 - slip)) if slip < 1.0 else math.inf
