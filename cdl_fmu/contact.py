"""What every contact model on wheels does alike: knows whether a wheel has a pose, clears outputs, and shows what an engineer plots."""

from __future__ import annotations

import math

from .frames import is_rotation
from .slave.kernel import kernel
from .slave.model import Event

LEAST_CAMBER_COSINE = 0.17  # the axle at most 80 degrees from the horizontal
SLIP_FLOOR = 1e-3  # [m/s] slower wheels have a slip and slip angle near 0 rather than noise
#: Steps that a wheel or body may be without a pose.
PATIENCE = 2

#: Status numbers of a step; a model's own start at 5.
NO_DATA, STILL_NO_DATA, BURIED, ON_ITS_SIDE = 1, 2, 3, 4
WHEEL_EVENTS = {
    NO_DATA: Event("wheel {i} has no pose yet (T is no rotation or nothing was ever set): no force", is_error=False),
    STILL_NO_DATA: Event("wheel[{i}] still has no pose after 2 steps: connect wheel[{i}].r_0, T, v_0, w_0 to the rover"),
    BURIED: Event(
        "wheel {i} is buried: its centre, at ({wheel.r_0[0]:.4g}, {wheel.r_0[1]:.4g}, {wheel.r_0[2]:.4g}) m, is more than its radius of "
        "{p.r_w:g} m below the ground; start it on the ground or check ground_z"
    ),
    ON_ITS_SIDE: Event(
        "wheel {i} lies on its side: its axle, wheel[{i}].T[2,1:3] = ({wheel[T][1][0]:.3f}, {wheel[T][1][1]:.3f}, {wheel[T][1][2]:.3f}), "
        "is more than 80 deg from the horizontal; the model knows rolling wheels only"
    ),
}


@kernel
def sees(wheel, memory, wrench, contact, shown):
    """Clear the outputs; True if the wheel is active and has a pose, else count the steps without one."""
    release(wrench, contact, shown)
    if wheel.active == 0.0:
        memory.silent = 0.0
        return False
    if has_pose(wheel):
        memory.silent = 0.0
        return True
    memory.silent += 1.0
    return False


@kernel
def has_pose(wheel):
    """False for a T that is no rotation and for a wheel that was never set: T exactly the identity and all else exactly 0."""
    if not is_rotation(wheel.T):
        return False
    for i in range(3):
        if wheel.r_0[i] != 0.0 or wheel.v_0[i] != 0.0 or wheel.w_0[i] != 0.0:
            return True
        for j in range(3):
            if wheel.T[i, j] != (1.0 if i == j else 0.0):
                return True
    return False


@kernel
def is_set(r_0):
    """False for a position that was never sent: exactly 0. Some masters send zeros before the first step."""
    return r_0[0] != 0.0 or r_0[1] != 0.0 or r_0[2] != 0.0


@kernel
def refusal(p, wheel, silent, surface):
    """Number of the error that this wheel is in, or 0; ``surface`` is the ground's height under its centre [m]."""
    if wheel.active == 0.0:
        return 0
    if not has_pose(wheel):
        return STILL_NO_DATA if silent >= PATIENCE else 0
    if wheel.T[1, 0] ** 2 + wheel.T[1, 1] ** 2 < LEAST_CAMBER_COSINE**2:
        return ON_ITS_SIDE
    if wheel.r_0[2] < surface - p.r_w:
        return BURIED
    return 0


@kernel
def release(wrench, contact, shown):
    """No contact: nothing acts."""
    for i in range(3):
        wrench.f_0[i] = 0.0
        wrench.t_0[i] = 0.0
        contact.F[i] = 0.0
        contact.K[i] = 0.0
        contact.D[i] = 0.0
    contact.in_contact = 0.0
    shown.sinkage = 0.0
    shown.slip = 0.0
    shown.slip_angle = 0.0
    shown.theta_entry = 0.0
    shown.theta_exit = 0.0
    shown.drawbar_pull = 0.0
    shown.lateral_force = 0.0
    shown.normal_load = 0.0
    shown.drive_torque = 0.0


@kernel
def anchor_here(wheel, contact):
    """Say that the force holds at the wheel's present pose and twist."""
    for i in range(3):
        contact.anchor.r_0[i] = wheel.r_0[i]
        contact.anchor.v_0[i] = wheel.v_0[i]
        contact.anchor.w_0[i] = wheel.w_0[i]
        for j in range(3):
            contact.anchor.T[i, j] = wheel.T[i, j]


@kernel
def lowest_point(p, wheel):
    """Height [m] of the rim's lowest point."""
    a_x, a_y, a_z = wheel.T[1, 0], wheel.T[1, 1], wheel.T[1, 2]
    return wheel.r_0[2] - p.r_w * math.sqrt(a_x * a_x + a_y * a_y) - 0.5 * p.b_w * abs(a_z)


@kernel
def show(wheel, sinkage, slip, theta_entry, theta_exit, f, drive_torque, shown):
    """Diagnostics, forces in the heading frame."""
    v, a_x, a_y = wheel.v_0, wheel.T[1, 0], wheel.T[1, 1]
    level = max(math.sqrt(a_x * a_x + a_y * a_y), 1e-9)  # a wheel on its side, which hard contacts know, has no heading
    h_x, h_y = a_y / level, -a_x / level  # heading, horizontal
    forward, sideward = v[0] * h_x + v[1] * h_y, v[1] * h_x - v[0] * h_y
    shown.sinkage = sinkage
    shown.slip = slip
    shown.slip_angle = math.atan2(sideward, max(abs(forward), SLIP_FLOOR))
    shown.theta_entry = theta_entry
    shown.theta_exit = theta_exit
    shown.drawbar_pull = f[0] * h_x + f[1] * h_y
    shown.lateral_force = f[1] * h_x - f[0] * h_y
    shown.normal_load = f[2]
    shown.drive_torque = drive_torque
