"""Reference of the two-wheel drive: no co-simulation, no MuJoCo, no interface Jacobian.

Classical Runge-Kutta (RK4) with small steps; the contact model's own kernel is called at every stage with the pose of that stage.
Wheel angle and steering angle follow the driver's law exactly (prescribed motion), so that 5 coordinates of the body are integrated:
position of the middle between the wheels, yaw psi and pitch theta. The equations of motion are written out here by Kane's method.
"""

from __future__ import annotations

import math

import numpy as np

from cdl_fmu.frames import cross, dot
from cdl_fmu.slave.kernel import kernel
from cdl_fmu.slave.model import Instance, ModelError
from mbs.driver import passed, steer_rate, wheel_rate

_N = 2
_FREE = 5  # x, y, z, psi, theta
_PHI, _DELTA = 2 * _FREE, 2 * _FREE + 1  # in the state vector: q, q_dot, wheel angle, steering angle of the rear wheel


def simulate_reference(
    contact: Instance, rover: Instance, driver: Instance, *, stop_time: float, dt: float = 5e-5, record_interval: float = 1e-3
) -> dict[str, np.ndarray]:
    """Drive the two-wheel rover on a contact model.

    Args:
        contact: Contact model of both wheels, without state that its forces depend on (BCM on flat ground).
        rover, driver: :class:`mbs.rover.Rover` and :class:`mbs.driver.Driver`, for their parameters.
        stop_time: End [s]. dt: Step [s]. record_interval: Interval of the results [s], a multiple of dt.

    Returns:
        ``t`` [s], shape [k]; ``r_0`` wheel centres [m] and ``f`` contact forces in the heading frame (forward, left, up) [N], shape
        [k, wheel, 3]; ``yaw``, ``pitch``, ``steer_angle`` [rad], shape [k].

    Raises:
        ModelError: The contact model refuses a pose.
        ValueError: The wheels would start with a jump, or the times do not fit together.
    """
    if driver.p.start_ramp <= 0.0:
        raise ValueError("start_ramp = 0 s: the reference needs a wheel rate without jumps; use a short ramp, such as 1e-3 s")
    every, n = round(record_interval / dt), round(stop_time / dt)
    if not math.isclose(every * dt, record_interval) or n % every:
        raise ValueError(
            f"stop_time = {stop_time:g} s and record_interval = {record_interval:g} s: they must be multiples of dt = {dt:g} s"
        )
    for instance in (contact, rover, driver):
        instance.initialise()
    state = np.zeros(2 * _FREE + 2)
    start = rover.p.start
    state[:_FREE] = start.x, start.y, start.z, start.yaw, start.pitch
    records = np.zeros((n // every + 1, _N * 6 + 4))
    rover_p, driver_p = rover.arrays[0], driver.arrays[0]
    memory = np.zeros((2, state.size, state.size)), np.zeros((4, state.size)), np.zeros(state.size)
    status, step = _integrate(contact.model.step_kernel, *contact.arrays, rover_p, driver_p, state, dt, n, every, records, *memory)
    if status:
        contact.step(step * dt, dt)  # again, to raise its message
        raise ModelError(f"{contact.name}: stopped at t = {step * dt:g} s: {'; '.join(contact.warnings)}")
    wheels = records[:, 1:-3].reshape(-1, _N, 6)
    t, (yaw, pitch, steer_angle) = records[:, 0], records[:, -3:].T
    return {"t": t, "r_0": wheels[..., :3], "f": wheels[..., 3:], "yaw": yaw, "pitch": pitch, "steer_angle": steer_angle}


@kernel
def _integrate(contact_step, P, U, X, Y, ROVER, DRIVER, s, dt, n, every, records, work, k, stage):
    """RK4 from s over n steps, in the memory of work, k and stage; returns (status of the contact model, step)."""
    driver = DRIVER[0]
    n_passed = 0.0
    for step in range(n + 1):
        t = step * dt
        now = passed(driver, n_passed, s[0] - 0.5 * ROVER[0].wheel_base * math.cos(s[3]) * math.cos(s[4]))
        if now != n_passed:
            _jump(contact_step, t, dt, P, U, X, Y, ROVER, driver, n_passed, now, s, k, work)
            n_passed = now
        for i in range(4):
            part = 0.0 if i == 0 else dt if i == 3 else 0.5 * dt
            for j in range(s.size):
                stage[j] = s[j] + part * k[i - 1, j]
            status = _slope(contact_step, t + part, dt, P, U, X, Y, ROVER, driver, n_passed, 0.0, stage, k[i], work)
            if status != 0:
                return status, step
            if i == 0 and step % every == 0:
                _record(t, s, U, Y, records[step // every])
        for j in range(s.size):
            s[j] += dt / 6.0 * (k[0, j] + 2.0 * k[1, j] + 2.0 * k[2, j] + k[3, j])
    return 0, n


@kernel
def _jump(contact_step, t, dt, P, U, X, Y, ROVER, driver, before, now, s, k, work):
    """The steering rate jumps where a threshold is passed: the body takes up the wheel's angular momentum."""
    rise = steer_rate(driver, now, s[_DELTA]) - steer_rate(driver, before, s[_DELTA])
    _slope(contact_step, t, dt, P, U, X, Y, ROVER, driver, before, rise, s, k[1], work)
    _slope(contact_step, t, dt, P, U, X, Y, ROVER, driver, before, 0.0, s, k[0], work)
    for i in range(_FREE):
        s[_FREE + i] += k[1, _FREE + i] - k[0, _FREE + i]


@kernel
def _slope(contact_step, t, dt, P, U, X, Y, ROVER, driver, n_passed, impulse, s, slope, work):
    """Derivative of the state; ``impulse`` adds to the steering acceleration. Returns the contact model's status."""
    delta_dot = steer_rate(driver, n_passed, s[_DELTA])
    # Within its limit the servo is a first-order lag.
    delta_ddot = -delta_dot / driver.servo_time if abs(delta_dot) < driver.steer_rate else 0.0
    ramp = driver.start_time <= t < driver.start_time + driver.start_ramp
    phi_dot, phi_ddot = wheel_rate(t, driver), driver.wheel_rate / driver.start_ramp if ramp else 0.0
    place_wheels(ROVER[0], s, phi_dot, delta_dot, U[0])
    status = contact_step(t, dt, P[0], U[0], X[0], Y[0])
    accelerate(ROVER[0], s, phi_dot, phi_ddot, delta_dot, delta_ddot + impulse, U[0], Y[0], slope[_FREE : 2 * _FREE], work[0], work[1])
    for i in range(_FREE):
        slope[i] = s[_FREE + i]
    slope[_PHI] = phi_dot
    slope[_DELTA] = delta_dot
    return status


@kernel
def _axes(psi, theta):
    """Body axes x, y, z in world."""
    c, s, ct, st = math.cos(psi), math.sin(psi), math.cos(theta), math.sin(theta)
    return (c * ct, s * ct, -st), (-s, c, 0.0), (c * st, s * st, ct)


@kernel
def place_wheels(p, s, phi_dot, delta_dot, u):
    """Pose and twist of both wheels for the state s, as the contact model's inputs u."""
    e_x, e_y, e_z = _axes(s[3], s[4])
    w_x, w_y, w_z = s[9] * e_y[0], s[9] * e_y[1], s[8]
    for i in range(_N):
        wheel = u.wheel[i]
        delta, rate, side = (0.0, 0.0, 0.5) if i == 0 else (s[_DELTA], delta_dot, -0.5)
        arm = side * p.wheel_base
        v_x, v_y, v_z = cross(w_x, w_y, w_z, arm * e_x[0], arm * e_x[1], arm * e_x[2])
        wheel.v_0[0], wheel.v_0[1], wheel.v_0[2] = s[5] + v_x, s[6] + v_y, s[7] + v_z
        w = (w_x, w_y, w_z)
        cd, sd, cp, sp = math.cos(delta), math.sin(delta), math.cos(s[_PHI]), math.sin(s[_PHI])
        for j in range(3):
            ahead, axle = cd * e_x[j] + sd * e_y[j], cd * e_y[j] - sd * e_x[j]
            wheel.r_0[j] = s[j] + arm * e_x[j]
            wheel.T[0, j] = cp * ahead - sp * e_z[j]
            wheel.T[1, j] = axle
            wheel.T[2, j] = sp * ahead + cp * e_z[j]
            wheel.w_0[j] = w[j] + rate * e_z[j] + phi_dot * axle


@kernel
def accelerate(p, s, phi_dot, phi_ddot, delta_dot, delta_ddot, u, y, acceleration, M, J):
    """Accelerations of x, y, z, psi, theta under gravity, contact wrenches and the prescribed motion of the wheels.

    Kane: sum over bodies of J_v' (f - m a) + J_w' (t - d(I w)/dt) = 0, with the partial velocities J of each body; the rest of
    its acceleration, which does not depend on the unknowns, is the bias. M and J are work space.
    """
    e_x, e_y, e_z = _axes(s[3], s[4])
    psi_dot, theta_dot = s[8], s[9]
    w = (theta_dot * e_y[0], theta_dot * e_y[1], psi_dot)  # body: psi_dot about world z, theta_dot about body y
    b = cross(0.0, 0.0, psi_dot, theta_dot * e_y[0], theta_dot * e_y[1], 0.0)  # bias of its angular acceleration
    for i in range(_FREE):
        acceleration[i] = 0.0
        for j in range(_FREE):
            M[i, j] = 0.0
            J[i, j] = 0.0
    _add_mass(p.mass, p.gravity, p.mass_height, e_z, e_y, w, b, 0.0, 0.0, 0.0, acceleration, M, J)
    for i in range(_N):
        wrench = y.wheel[i]
        f, tau = wrench.f_0, wrench.t_0
        arm = (0.5 if i == 0 else -0.5) * p.wheel_base
        _add_mass(p.wheel_mass, p.gravity, arm, e_x, e_y, w, b, f[0], f[1], f[2], acceleration, M, J)
        # Rotation: I = I_d 1 + (I_a - I_d) a a' with the axle a; w_wheel = w + delta_dot e_z + phi_dot a.
        a = (u.wheel[i].T[1, 0], u.wheel[i].T[1, 1], u.wheel[i].T[1, 2])
        rate, rise = (0.0, 0.0) if i == 0 else (delta_dot, delta_ddot)
        fork = (w[0] + rate * e_z[0], w[1] + rate * e_z[1], w[2] + rate * e_z[2])
        turn_z, turn_a = cross(*w, *e_z), cross(*fork, *a)
        I_d, extra = p.wheel_inertia_diameter, p.wheel_inertia_axle - p.wheel_inertia_diameter
        spin = dot(*fork, *a) + phi_dot
        bias = (
            b[0] + rise * e_z[0] + rate * turn_z[0] + phi_ddot * a[0] + phi_dot * turn_a[0],
            b[1] + rise * e_z[1] + rate * turn_z[1] + phi_ddot * a[1] + phi_dot * turn_a[1],
            b[2] + rise * e_z[2] + rate * turn_z[2] + phi_ddot * a[2] + phi_dot * turn_a[2],
        )
        # d(I w)/dt = I_d w_dot + extra d((w.a) a)/dt, where d(w.a)/dt = w_dot.a + w.a_dot and w.a_dot = fork.(fork x a) = 0.
        change = extra * dot(*bias, *a)
        t_x = tau[0] - I_d * bias[0] - change * a[0] - extra * spin * turn_a[0]
        t_y = tau[1] - I_d * bias[1] - change * a[1] - extra * spin * turn_a[1]
        t_z = tau[2] - I_d * bias[2] - change * a[2] - extra * spin * turn_a[2]
        acceleration[3] += t_z
        acceleration[4] += dot(t_x, t_y, t_z, *e_y)
        along = dot(*e_y, *a)
        M[3, 3] += I_d + extra * a[2] * a[2]
        M[4, 4] += I_d + extra * along * along
        M[3, 4] += extra * a[2] * along
        M[4, 3] += extra * a[2] * along
    _solve(M, acceleration)


@kernel
def _add_mass(m, gravity, arm, axis, e_y, w, b, f_x, f_y, f_z, rhs, M, J):
    """Add a mass at arm * axis from the body's origin, with the force f on it."""
    r = (arm * axis[0], arm * axis[1], arm * axis[2])
    swing, lift = cross(*w, *cross(*w, *r)), cross(*b, *r)
    push = (f_x - m * (swing[0] + lift[0]), f_y - m * (swing[1] + lift[1]), f_z - m * (swing[2] + lift[2] + gravity))
    yaw, pitch = cross(0.0, 0.0, 1.0, *r), cross(*e_y, *r)
    for k in range(3):
        J[k, k] = 1.0
        J[3, k] = yaw[k]
        J[4, k] = pitch[k]
    for i in range(_FREE):
        rhs[i] += J[i, 0] * push[0] + J[i, 1] * push[1] + J[i, 2] * push[2]
        for j in range(_FREE):
            M[i, j] += m * (J[i, 0] * J[j, 0] + J[i, 1] * J[j, 1] + J[i, 2] * J[j, 2])


@kernel
def _solve(M, b):
    """Solve M x = b in place for a symmetric positive definite M (Gauss, no pivoting)."""
    for i in range(_FREE):
        for j in range(i + 1, _FREE):
            ratio = M[j, i] / M[i, i]
            for k in range(i, _FREE):
                M[j, k] -= ratio * M[i, k]
            b[j] -= ratio * b[i]
    for i in range(_FREE - 1, -1, -1):
        for k in range(i + 1, _FREE):
            b[i] -= M[i, k] * b[k]
        b[i] /= M[i, i]


@kernel
def _record(t, s, U, Y, record):
    record[0] = t
    for i in range(_N):
        wheel, f = U[0].wheel[i], Y[0].wheel[i].f_0
        level = math.hypot(wheel.T[1, 0], wheel.T[1, 1])
        h_x, h_y = wheel.T[1, 1] / level, -wheel.T[1, 0] / level  # heading: horizontal, ahead of the axle
        for j in range(3):
            record[1 + 6 * i + j] = wheel.r_0[j]
        record[4 + 6 * i] = f[0] * h_x + f[1] * h_y
        record[5 + 6 * i] = f[1] * h_x - f[0] * h_y
        record[6 + 6 * i] = f[2]
    record[13] = s[3]
    record[14] = s[4]
    record[15] = s[_DELTA]
