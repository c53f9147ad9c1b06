"""A contact model in one file: a wheel on flat ground at z = 0 that is a linear spring and damper with Coulomb friction.

Run it: a wheel of 20 kg sinks in by its weight over the stiffness.
"""

import math

from cdl_fmu.frames import is_rotation
from cdl_fmu.slave.interface import contact_jacobian, wheel_pose, wheel_wrench
from cdl_fmu.slave.kernel import kernel
from cdl_fmu.slave.model import STATUS_SPAN, Event, Instance, KernelModel
from cdl_fmu.slave.records import Real, Record

NO_POSE, POSE_MISSING, ON_ITS_SIDE = 1, 2, 3


class LinearSpring(KernelModel):
    """Normal force k depth - d v_n, never below zero; friction mu F_n, smoothed at sliding speeds near v_s. No soil, no camber."""

    events = {
        NO_POSE: Event("wheel[{i}].T is no rotation: no pose was set yet, and the wheel feels no ground", is_error=False),
        POSE_MISSING: Event("wheel[{i}].T is still no rotation after 2 steps: connect wheel[{i}].T to the wheel's rotation matrix"),
        ON_ITS_SIDE: Event("wheel[{i}].T: the axle is vertical, so the wheel has no heading: use a contact model that rolls on its side"),
    }

    def __init__(self, n_wheels: int = 1):
        super().__init__(n_wheels=n_wheels)
        self.identifier = f"cdl_spring_w{n_wheels}"
        self.parameters = Record(
            r_w=Real(0.125, "m", "Wheel radius", min=1e-3, max=10.0),
            k=Real(1e6, "N/m", "Stiffness of the ground", min=0.0, max=1e9),
            d=Real(1e3, "N.s/m", "Damping of the ground", min=0.0, max=1e7),
            mu=Real(0.6, "1", "Coefficient of friction", min=0.0, max=10.0),
            v_s=Real(0.01, "m/s", "Sliding speed at which friction reaches 71 % of mu F_n", min=1e-6, max=1.0),
        )
        self.inputs = wheel_pose(n_wheels)
        self.state = Record(missing=Real(0.0, "1", "Steps that each wheel has been without a pose", (n_wheels,)))
        self.outputs = wheel_wrench(n_wheels) | contact_jacobian(n_wheels)

    @staticmethod
    @kernel
    def initialise_kernel(t, p, x, y):
        for i in range(len(x.missing)):
            x.missing[i] = 0.0

    @staticmethod
    @kernel
    def step_kernel(t, h, p, u, x, y):
        for i in range(len(u.wheel)):
            error = refusal(u.wheel[i], x.missing[i])
            if error:
                return error + STATUS_SPAN * i  # before anything has changed
        status = 0
        for i in range(len(u.wheel)):
            release(y.wheel[i], y.contact[i])
            if is_rotation(u.wheel[i].T):
                x.missing[i] = 0.0
                touch(p, u.wheel[i], y.wheel[i], y.contact[i])
            else:
                x.missing[i] += 1.0
                status = NO_POSE + STATUS_SPAN * i
        return status


@kernel
def refusal(wheel, missing):
    """Number of the error that this wheel is in, or 0."""
    if not is_rotation(wheel.T):
        return POSE_MISSING if missing >= 2.0 else 0
    return ON_ITS_SIDE if math.hypot(wheel.T[1, 0], wheel.T[1, 1]) < 0.1 else 0


@kernel
def release(wrench, contact):
    """No contact: nothing acts."""
    for j in range(3):
        wrench.f_0[j] = wrench.t_0[j] = contact.F[j] = contact.K[j] = contact.D[j] = 0.0
    contact.in_contact = 0.0


@kernel
def touch(p, wheel, wrench, contact):
    """Wrench and interface Jacobian of one wheel, if it touches the ground."""
    depth = p.r_w - wheel.r_0[2]
    if depth <= 0.0:
        return

    # Axes: the axle is row 2 of T; longitudinal = axle x vertical, lateral = vertical x longitudinal.
    axle_x, axle_y = wheel.T[1, 0], wheel.T[1, 1]
    horizontal = math.hypot(axle_x, axle_y)
    c, s = axle_y / horizontal, -axle_x / horizontal  # heading: cosine and sine

    # Velocity of the wheel's material at the contact point, r_w below its centre.
    v_0 = wheel.v_0[0] - wheel.w_0[1] * p.r_w
    v_1 = wheel.v_0[1] + wheel.w_0[0] * p.r_w
    v_x, v_y, v_n = c * v_0 + s * v_1, c * v_1 - s * v_0, wheel.v_0[2]

    F_n = max(0.0, p.k * depth - p.d * v_n)
    secant = p.mu * F_n / math.sqrt(v_x * v_x + v_y * v_y + p.v_s * p.v_s)  # friction as a damping [N.s/m]
    F_x, F_y = -secant * v_x, -secant * v_y

    wrench.f_0[0], wrench.f_0[1], wrench.f_0[2] = c * F_x - s * F_y, s * F_x + c * F_y, F_n
    wrench.t_0[0], wrench.t_0[1] = p.r_w * wrench.f_0[1], -p.r_w * wrench.f_0[0]

    contact.in_contact = 1.0
    contact.point_0[0], contact.point_0[1], contact.point_0[2] = wheel.r_0[0], wheel.r_0[1], wheel.r_0[2] - p.r_w
    contact.axes[0, 0], contact.axes[0, 1], contact.axes[0, 2] = c, s, 0.0
    contact.axes[1, 0], contact.axes[1, 1], contact.axes[1, 2] = -s, c, 0.0
    contact.axes[2, 0], contact.axes[2, 1], contact.axes[2, 2] = 0.0, 0.0, 1.0
    contact.F[0], contact.F[1], contact.F[2] = F_x, F_y, F_n
    contact.K[2] = p.k  # friction has no stiffness, the normal force its tangent
    contact.D[0], contact.D[1], contact.D[2] = secant, secant, p.d
    anchor = contact.anchor
    for j in range(3):
        anchor.r_0[j], anchor.v_0[j], anchor.w_0[j] = wheel.r_0[j], wheel.v_0[j], wheel.w_0[j]
        for k in range(3):
            anchor.T[j, k] = wheel.T[j, k]


if __name__ == "__main__":
    spring = Instance(LinearSpring(), k=1e5)
    spring.initialise()
    z, v, h, mass = 0.125, 0.0, 1e-3, 20.0
    for step in range(2000):
        spring.u.wheel[0].r_0[2], spring.u.wheel[0].v_0[2] = z, v
        spring.step(step * h, h)
        v += h * (spring.y.wheel[0].f_0[2] / mass - 9.81)
        z += h * v
    print(f"sinkage {1e3 * (0.125 - z):.4f} mm; weight / stiffness {1e3 * mass * 9.81 / 1e5:.4f} mm")
