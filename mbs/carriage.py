"""Carriage of a single-wheel testbed: one wheel at a given speed, rate and slip angle, free to sink under its load."""

from __future__ import annotations

import math

from cdl_fmu.slave.interface import ENVIRONMENT, contact_jacobian, wheel_pose, wheel_wrench
from cdl_fmu.slave.kernel import kernel
from cdl_fmu.slave.model import KernelModel, Rule
from cdl_fmu.slave.records import Real, Record

from .interface import is_sent

_LIMIT = 1e6  # [m]

#: Speed [m/s] at which the damper alone bears the load while the wheel is lowered. Own choice: a wheel that rests 20 mm deep then lags
#: behind its load by less than 0.1 s.
LOWERING_SPEED = 0.1


class Carriage(KernelModel):
    """Moves the wheel of a single-wheel testbed: speed, wheel rate and slip angle are given, and so is the load under which it sinks.

    First the wheel is lowered. It stands, and its load grows smoothly within the first half of ``lowering_time``; it sinks without inertia
    against a damper, never deeper than it will rest, as soil remembers how deep it was pressed. Then speed and wheel rate rise together,
    so that the slip is the same throughout.

    On a slope the load is what presses the wheel on the ground, along z, and the carriage bears the weight's other component: the slope
    acts on the soil alone.

    Step: the contact force along z is F = F0 - K (z - z_a) - D (v - v_a), implicit in the velocity at the step's end; a contact that would
    pull is left out. Without the contact's Jacobian the force acts as it is. What moves is the mass load / (gravity cos(slope)).
    """

    feedthrough = False
    identifier = "cdl_carriage_w1"

    parameters = ENVIRONMENT | Record(
        load=Real(100.0, "N", "Load on the wheel along the ground's normal, its own weight included", min=1e-3, max=1e6),
        speed=Real(0.05, "m/s", "Speed of the carriage", min=0.0, max=100.0),
        slip_angle=Real(
            0.0, "rad", "Angle from the wheel's heading to the carriage's velocity, positive to the left", (), -math.pi / 2, math.pi / 2
        ),
        wheel_rate=Real(0.4, "rad/s", "Rate of the wheel about its axle, positive drives forward", min=-1e3, max=1e3),
        heading=Real(0.0, "rad", "Heading of the wheel from the x axis, positive to the left", min=-10.0, max=10.0),
        lowering_time=Real(1.0, "s", "Time in which the standing wheel takes on its load; 0 = at once, with its impact", min=0.0, max=1e4),
        start_ramp=Real(0.5, "s", "Time in which speed and wheel rate then rise", min=0.0, max=1e4),
        start=Record(
            x=Real(0.0, "m", "Start position of the wheel's centre", (), -_LIMIT, _LIMIT),
            y=Real(0.0, "m", "Start position of the wheel's centre", (), -_LIMIT, _LIMIT),
            z=Real(0.135, "m", "Start height of the wheel's centre; 0.135 puts the wheel of Table 8.2 on ground at 0", (), -_LIMIT, _LIMIT),
        ),
    )
    rules = (Rule("gravity = 0 m/s2: the wheel's inertia is load / gravity; use a gravity above 0", lambda p: p.gravity == 0.0),)
    inputs = wheel_wrench(1) | contact_jacobian(1)
    state = Record(
        z=Real(0.0, "m", "Height of the wheel's centre"),
        v_z=Real(0.0, "m/s", "Its rate"),
    )
    outputs = wheel_pose(1) | Record(
        travel=Real(0.0, "m", "Travel of the carriage since it started"),
        applied_load=Real(0.0, "N", "Load on the wheel; grows while the wheel is lowered"),
    )

    def __init__(self, n_wheels: int = 1):
        super().__init__(n_wheels=n_wheels)
        if n_wheels != 1:
            raise ValueError(f"n_wheels = {n_wheels}: a carriage moves 1 wheel")
        self.initialise_kernel = _initialise
        self.step_kernel = _step


@kernel
def smooth_step(s):
    """Rise from 0 to 1 over s from 0 to 1 that begins and ends level."""
    s = min(max(s, 0.0), 1.0)
    return s * s * (3.0 - 2.0 * s)


@kernel
def applied_load(t, p):
    """Load on the wheel [N] at time t [s]."""
    return p.load * smooth_step(2.0 * t / p.lowering_time) if t < 0.5 * p.lowering_time else p.load


@kernel
def progress(t, p):
    """Share of full speed at time t [s], and the time at full speed [s] that the motion so far would have taken."""
    since = max(t - p.lowering_time, 0.0)
    if since >= p.start_ramp:
        return 1.0, since - 0.5 * p.start_ramp
    s = since / p.start_ramp
    return smooth_step(s), p.start_ramp * s * s * s * (1.0 - 0.5 * s)


@kernel
def _initialise(t, p, x, y):
    x.z, x.v_z = p.start.z, 0.0
    _move(t, p, x, y)


@kernel
def _step(t, h, p, u, x, y):
    x.v_z = _vertical_speed(t, h, p, u.wheel[0], u.contact[0], x.z, x.v_z)
    x.z += h * x.v_z
    _move(t + h, p, x, y)
    return 0


@kernel
def _vertical_speed(t, h, p, wheel, contact, z, v):
    """Vertical speed [m/s] at the end of a step from height z [m] and speed v [m/s]."""
    load = applied_load(t + h, p)
    if t + 0.5 * h < p.lowering_time:
        mass, damping = 0.0, p.load / LOWERING_SPEED
    else:
        mass, damping = p.load / (p.gravity * math.cos(p.slope)), 0.0
    force, K, D = wheel.f_0[2], 0.0, 0.0
    if contact.in_contact > 0.5:
        for k in range(3):
            share = contact.axes[k, 2] ** 2  # of a vertical motion's force along this axis
            K += share * contact.K[k]
            D += share * contact.D[k]
        if is_sent(contact.anchor.T):
            force -= K * (z - contact.anchor.r_0[2]) + D * (v - contact.anchor.v_0[2])
    end = (mass * v + h * (force + D * v - load)) / (mass + h * (damping + D + h * K))
    if contact.in_contact > 0.5 and force - D * (end - v) - h * K * end < 0.0:
        return (mass * v - h * load) / (mass + h * damping)
    return end


@kernel
def _move(t, p, x, y):
    """Outputs at time t: all but the height is given."""
    share, time = progress(t, p)
    course, speed, rate, angle = p.heading + p.slip_angle, share * p.speed, share * p.wheel_rate, time * p.wheel_rate
    h_x, h_y, cos, sin = math.cos(p.heading), math.sin(p.heading), math.cos(angle), math.sin(angle)
    y.travel, y.applied_load = time * p.speed, applied_load(t, p)
    wheel = y.wheel[0]
    wheel.r_0[0], wheel.r_0[1], wheel.r_0[2] = p.start.x + y.travel * math.cos(course), p.start.y + y.travel * math.sin(course), x.z
    wheel.v_0[0], wheel.v_0[1], wheel.v_0[2] = speed * math.cos(course), speed * math.sin(course), x.v_z
    wheel.w_0[0], wheel.w_0[1], wheel.w_0[2] = -rate * h_y, rate * h_x, 0.0
    wheel.T[0, 0], wheel.T[0, 1], wheel.T[0, 2] = cos * h_x, cos * h_y, -sin
    wheel.T[1, 0], wheel.T[1, 1], wheel.T[1, 2] = -h_y, h_x, 0.0
    wheel.T[2, 0], wheel.T[2, 1], wheel.T[2, 2] = sin * h_x, sin * h_y, cos
