"""Records between rover, driver and drives: what is commanded and what the joints report; and what every mover asks of a contact."""

from __future__ import annotations

from cdl_fmu.slave.kernel import kernel
from cdl_fmu.slave.records import Real, Record


def commands(n: int) -> Record:
    """Rates commanded to the drives of ``n`` wheels; a wheel that does not steer ignores its steering rate."""
    return Record(
        command=Record(
            wheel_rate=Real(0.0, "rad/s", "Commanded rate of each wheel about its axle, positive drives forward", (n,), -1e3, 1e3),
            steer_rate=Real(0.0, "rad/s", "Commanded steering rate of each wheel, positive to the left", (n,), -1e3, 1e3),
        )
    )


def joints(n: int) -> Record:
    """Angles and rates of the drives of ``n`` wheels; a wheel that does not steer keeps the angle 0."""
    return Record(
        joint=Record(
            steer_angle=Real(0.0, "rad", "Steering angle of each wheel, positive to the left", (n,)),
            wheel_angle=Real(0.0, "rad", "Angle of each wheel about its axle", (n,)),
            wheel_rate=Real(0.0, "rad/s", "Rate of each wheel about its axle, relative to the rover's body", (n,)),
        )
    )


@kernel
def is_sent(T):
    """True if a contact's anchor, of which this is the rotation, was sent."""
    for k in range(3):
        for j in range(3):
            if T[k, j] != 0.0:
                return True
    return False
