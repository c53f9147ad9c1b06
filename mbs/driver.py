"""Driver: the manoeuvre of the chapter's experiment as rates for the rover's drives (sections 8.4.2 and 8.5.1)."""

from __future__ import annotations

import math

from cdl_fmu.slave.interface import wheel_pose
from cdl_fmu.slave.kernel import kernel
from cdl_fmu.slave.model import KernelModel, Rule
from cdl_fmu.slave.records import Array, Real, Record

from .interface import commands, joints

_TARGETS = 2


class Driver(KernelModel):
    """Drives all wheels at one rate and steers the last wheel to a target angle at each position that it passes.

    The wheel rate rises linearly from 0 within ``start_ramp``. The steering rate closes the angle's distance to its target with the
    time constant ``servo_time``, limited to ``steer_rate``. A threshold once passed stays passed.
    """

    parameters = Record(
        wheel_rate=Real(1.0, "rad/s", "Rate of all wheels (Table 8.2)", min=-100.0, max=100.0),
        start_time=Real(0.0, "s", "Time at which the wheels start to turn", min=0.0, max=1e6),
        start_ramp=Real(0.3, "s", "Time in which the wheel rate rises linearly (assumption)", min=0.0, max=1e3),
        steer_rate=Real(0.8, "rad/s", "Largest steering rate (Table 8.2)", min=0.0, max=100.0),
        steer_at=Real(
            (0.9, 1.2), "m", "Positions of the steered wheel along x from which on it steers (section 8.5.1)", (_TARGETS,), -1e6, 1e6
        ),
        steer_to=Real(
            (math.pi / 4, -math.pi / 4),
            "rad",
            "Target angles, positive to the left; the last is held (section 8.5.1)",
            (_TARGETS,),
            -math.pi / 2,
            math.pi / 2,
        ),
        servo_time=Real(0.02, "s", "Time constant of the steering servo (assumption)", min=1e-6, max=100.0),
    )
    rules = (
        Rule(
            "steer_at[2] = {p.steer_at[1]:g} m: it must be at least steer_at[1] = {p.steer_at[0]:g} m (passed in order)",
            lambda p: p.steer_at[0] > p.steer_at[1],
        ),
    )
    state = Record(passed=Real(0.0, "1", "Number of thresholds passed"))

    def __init__(self, n_wheels: int = 2):
        super().__init__(n_wheels=n_wheels)
        self.identifier = f"cdl_driver_w{n_wheels}"
        position = wheel_pose(n_wheels).fields["wheel"].record.fields["r_0"]
        angle = joints(n_wheels).fields["joint"].fields["steer_angle"]
        self.inputs = Record(wheel=Array(n_wheels, Record(r_0=position)), joint=Record(steer_angle=angle))
        self.outputs = commands(n_wheels)
        self.initialise_kernel = _initialise
        self.step_kernel = _step


@kernel
def wheel_rate(t, p):
    """Commanded wheel rate [rad/s] at time t [s]."""
    since = t - p.start_time
    if since >= p.start_ramp:
        return p.wheel_rate
    return p.wheel_rate * max(since, 0.0) / p.start_ramp


@kernel
def passed(p, before, position):
    """Number of steering thresholds passed at ``position`` [m], ``before`` of them earlier."""
    n = before
    while n < p.steer_at.size and position >= p.steer_at[int(n)]:
        n += 1.0
    return n


@kernel
def steer_rate(p, n_passed, angle):
    """Commanded steering rate [rad/s] at a steering angle [rad] after ``n_passed`` thresholds."""
    if n_passed == 0.0:
        return 0.0
    rate = (p.steer_to[int(n_passed) - 1] - angle) / p.servo_time
    return min(max(rate, -p.steer_rate), p.steer_rate)


@kernel
def _initialise(t, p, x, y):
    x.passed = 0.0
    for i in range(y.command.wheel_rate.size):
        y.command.wheel_rate[i] = wheel_rate(t, p)
        y.command.steer_rate[i] = 0.0


@kernel
def _step(t, h, p, u, x, y):
    steered = y.command.wheel_rate.size - 1
    x.passed = passed(p, x.passed, u.wheel[steered].r_0[0])
    for i in range(steered + 1):
        y.command.wheel_rate[i] = wheel_rate(t + h, p)
    y.command.steer_rate[steered] = steer_rate(p, x.passed, u.joint.steer_angle[steered])
    return 0
