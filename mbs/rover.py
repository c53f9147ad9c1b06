"""Rover: the multibody system of the chapter's experiment (Table 8.2), two wheels on a rigid link, integrated by MuJoCo.

The contact forces come from other slaves; their interface Jacobian lets one implicit step of MuJoCo carry stiff contacts at 1 ms.
"""

from __future__ import annotations

from functools import partial

import mujoco
import numpy as np

from cdl_fmu.frames import cross, dot, resolve2
from cdl_fmu.slave.interface import ENVIRONMENT, contact_jacobian, wheel_pose, wheel_wrench
from cdl_fmu.slave.kernel import compiled, kernel
from cdl_fmu.slave.model import Event, Instance, Model, ModelError
from cdl_fmu.slave.records import Array, Choice, Real, Record

from .interface import commands, is_sent, joints
from .rover_mjcf import STEERED, two_wheel

_LIMIT = 1e6  # [m], [rad], [m/s], [rad/s]: a state beyond it is no rover's
_LOST, _REDO = 1, 2  # status of a step: an event, and to be done again without the contacts that pulled

_RADIUS, _WIDTH, _MASS = 0.125, 0.125, 2.0  # wheel of Table 8.2, for the inertia it leaves out


class Rover(Model):
    """Two-wheel rover of Table 8.2: wheels on a rigid massless link, a point mass above its middle, free in all but roll.

    The body frame lies in the middle between the wheel centres, x forward, y to the left, z up; wheel 1 is the front wheel,
    wheel 2 the rear wheel, which steers about the body's z axis. Positive pitch lowers the nose.

    Step: the contact force on each axis is F = F0 - K (x - x_a) - D (v - v_a), implicit in the velocity at the step's end; where
    ``contact[i].in_contact`` is 0, ``wheel[i].f_0, t_0`` act as they are. If a normal force comes out negative the step is redone
    with that contact off. The torque that the contact's point does not explain acts on the wheel as it is.
    """

    feedthrough = False
    events = {
        _LOST: Event(
            "the rover's motion left all bounds (a position or rate is not finite or beyond 1e6): check the contact forces that it gets, "
            "shorten the communication step, or send the contacts' stiffness and damping (contact[i].K, D)"
        )
    }

    parameters = ENVIRONMENT | Record(
        wheel_base=Real(0.6, "m", "Distance of the wheel centres (Table 8.2)", min=1e-3, max=100.0),
        mass=Real(50.0, "kg", "Point mass in the middle between the wheels (Table 8.2)", min=1e-3, max=1e5),
        mass_height=Real(0.1, "m", "Height of the point mass above the wheel centres (Table 8.2)", min=-10.0, max=10.0),
        wheel_mass=Real(_MASS, "kg", "Mass of one wheel (Table 8.2)", min=1e-3, max=1e4),
        wheel_inertia_axle=Real(
            _MASS * _RADIUS**2 / 2, "kg.m2", "Inertia of a wheel about its axle (assumption: solid cylinder)", min=1e-6, max=1e4
        ),
        wheel_inertia_diameter=Real(
            _MASS * (3 * _RADIUS**2 + _WIDTH**2) / 12,
            "kg.m2",
            "Inertia of a wheel about a diameter (assumption: solid cylinder)",
            min=1e-6,
            max=1e4,
        ),
        wheel_servo_gain=Real(1e5, "N.m.s/rad", "Gain of the wheel rate servo (assumption: stiff)", min=0.0, max=1e7),
        steer_servo_gain=Real(1e5, "N.m.s/rad", "Gain of the steering rate servo (assumption: stiff)", min=0.0, max=1e7),
        start=Record(
            x=Real(0.3, "m", "Start position of the middle between the wheel centres; 0.3 puts the rear wheel at 0", (), -_LIMIT, _LIMIT),
            y=Real(0.0, "m", "Start position of the middle between the wheel centres", (), -_LIMIT, _LIMIT),
            z=Real(_RADIUS, "m", "Start height of the middle between the wheel centres", (), -_LIMIT, _LIMIT),
            yaw=Real(0.0, "rad", "Start heading from the x axis, positive to the left", (), -10.0, 10.0),
            pitch=Real(0.0, "rad", "Start pitch, positive nose down", (), -1.5, 1.5),
        ),
        with_inverse_inertia=Choice(
            "Output of the inverse inertia at the contacts, for a master's stability guard", off="none", on="each step"
        ),
    )

    def __init__(self, n_wheels: int = 2):
        super().__init__(n_wheels=n_wheels)
        if n_wheels != len(STEERED):
            raise ModelError(f"n_wheels = {n_wheels}: the rover of Table 8.2 has {len(STEERED)} wheels")
        n, n_joints = n_wheels, 5 + n_wheels + sum(STEERED)
        self.identifier = f"cdl_rover_w{n}"
        self.inputs = wheel_wrench(n) | contact_jacobian(n) | commands(n)
        self.state = Record(
            q=Real(0.0, "1", "x, y, z, yaw, pitch, then per wheel steering angle (where it steers) and wheel angle [m, rad]", (n_joints,)),
            q_dot=Real(0.0, "1", "Rates of q [m/s, rad/s]", (n_joints,)),
        )
        self.outputs = (
            wheel_pose(n)
            | joints(n)
            | Record(
                body=Record(
                    r_0=Real(0.0, "m", "Middle between the wheel centres, resolved in world", (3,)),
                    yaw=Real(0.0, "rad", "Heading of the body from the x axis, positive to the left"),
                    pitch=Real(0.0, "rad", "Pitch of the body, positive nose down"),
                    v_0=Real(0.0, "m/s", "Velocity of r_0, resolved in world", (3,)),
                    w_0=Real(0.0, "rad/s", "Angular velocity of the body, resolved in world", (3,)),
                ),
                applied=Array(
                    n, Record(f_0=Real(0.0, "N", "Contact force that acted on the wheel in the last step, resolved in world", (3,)))
                ),
                inverse_inertia=Real(
                    0.0,
                    "1/kg",
                    "J (M + H kv)^-1 J': velocity of the contact points (wheel centres, off contact) per impulse on them, in world axes",
                    (3 * n, 3 * n),
                ),
            )
        )

    def check(self, p) -> None:
        axle, diameter = float(p.wheel_inertia_axle), float(p.wheel_inertia_diameter)
        if axle > 2 * diameter:
            raise ModelError(
                f"wheel_inertia_axle = {axle:g} kg.m2: it must be at most twice wheel_inertia_diameter = {diameter:g} kg.m2, "
                "as no body has more; lower it or raise wheel_inertia_diameter"
            )

    def bind(self, instance: Instance):
        # MuJoCo would write its warnings to MUJOCO_LOG.TXT in the working directory; a lost state is caught by _settle instead.
        mujoco.set_mju_user_warning(lambda text: None)
        simulation = None

        def initialise(t: float) -> None:
            nonlocal simulation
            simulation = _Simulation(instance)
            simulation.initialise()

        return initialise, lambda t, h: simulation.step(h)


class _Simulation:
    """MuJoCo's model and data of one instance, with views of their memory bound once.

    The records x are the state; MuJoCo's data are loaded from them whenever they differ, that is after a restore.
    """

    def __init__(self, instance: Instance):
        self.instance = instance
        m = self.m = two_wheel(instance.p)
        d = self.d = mujoco.MjData(m)
        n = instance.model.sizes["n_wheels"]
        self.h = np.zeros(1)
        fields = instance.model.parameters.fields
        self.with_inverse_inertia = instance.p.with_inverse_inertia == fields["with_inverse_inertia"].value("on")
        self.q, self.q_dot = d.qpos, d.qvel
        self.bodies = np.array([m.body(name).id for name in ("body", *(f"wheel{i}" for i in range(n)))])
        self.spins = np.array([m.joint(f"spin{i}").dofadr[0] for i in range(n)])
        self.steers = np.array([m.joint(f"steer{i}").dofadr[0] if STEERED[i] else -1 for i in range(n)])
        self.servos = np.concatenate([self.spins, self.steers[self.steers >= 0]])
        self.lifted = np.zeros(n)
        self.applied = np.zeros((n, 3))
        _, U, X, Y = instance.arrays
        mass = float(instance.p.mass / n + instance.p.wheel_mass)  # what a wheel carries
        contacts = (U, Y, self.lifted, self.bodies, self.steers)
        actuators = (m.actuator_gear, m.actuator_biasprm, d.xfrc_applied, d.ctrl)
        moments = (d.actuator_force, d.actuator_moment, d.moment_rownnz, d.moment_rowadr, d.moment_colind)
        joints = (self.q, self.q_dot, self.bodies, self.spins, self.steers)
        frames = (d.xpos, d.xmat, d.cvel, d.subtree_com[self.bodies[0]])
        self.is_at_state = _bound(_same, X, self.q, self.q_dot)
        self.command = _bound(_command, self.h, mass, *contacts, *actuators)
        self.settle = _bound(_settle, U, X, self.lifted, self.applied, self.q, self.q_dot, m.actuator_biasprm, *moments)
        self.output = _bound(_output, X, Y, self.applied, *joints, *frames)

    def initialise(self) -> None:
        start = self.instance.p.start
        self.q[:5] = start.x, start.y, start.z, start.yaw, start.pitch
        self.write_outputs()

    def step(self, h: float) -> int:
        m, d = self.m, self.d
        if h != self.h[0]:
            self.h[0] = m.opt.timestep = h
        if not self.is_at_state():
            self.load()
            self.write_outputs()
        self.lifted[:] = 0.0
        while True:
            self.command()
            mujoco.mj_step(m, d)
            status = self.settle()
            if status == 0:
                self.write_outputs()
                return 0
            if status == _LOST:
                return _LOST
            self.load()

    def load(self) -> None:
        self.q[:] = self.instance.x.q
        self.q_dot[:] = self.instance.x.q_dot

    def write_outputs(self) -> None:
        m, d = self.m, self.d
        # After mj_step MuJoCo's positions and velocities lag by one step.
        mujoco.mj_kinematics(m, d)
        mujoco.mj_comPos(m, d)
        mujoco.mj_comVel(m, d)
        self.output()
        if self.with_inverse_inertia:
            self.instance.y.inverse_inertia[:] = self.inverse_inertia()

    def inverse_inertia(self) -> np.ndarray:
        m, d, u = self.m, self.d, self.instance.u
        mass = np.zeros((m.nv, m.nv))
        mujoco.mj_makeM(m, d)
        mujoco.mj_fullM(m, d, mass)
        # The servos stiffen what an impulse within one implicit step meets: that step's own matrix, not the plain mass matrix.
        mass[self.servos, self.servos] += m.opt.timestep * m.actuator_gainprm[-len(self.servos) :, 0]
        jacobian = np.zeros((3 * len(self.spins), m.nv))
        for i, body in enumerate(self.bodies[1:]):
            contact = u.contact[i]
            point = contact.point_0 if contact.in_contact > 0.5 else d.xpos[body]
            mujoco.mj_jac(m, d, jacobian[3 * i : 3 * i + 3], None, point, body)
        return jacobian @ np.linalg.solve(mass, jacobian.T)


def _bound(function, *arguments):
    """A kernel as a call without arguments, on these."""
    return partial(compiled(function, *arguments), *arguments)


@kernel
def _same(X, q, q_dot):
    """True if MuJoCo's data hold the state x."""
    x = X[0]
    same = True
    for k in range(q.size):
        same &= x.q[k] == q[k] and x.q_dot[k] == q_dot[k]
    return same


@kernel
def _command(h, mass, U, Y, lifted, bodies, steers, gear, biasprm, xfrc, ctrl):
    """Set MuJoCo's actuators and external forces from the inputs and the wheel poses in y."""
    u, y = U[0], Y[0]
    n = lifted.size
    steer = 4 * n
    for i in range(n):
        ctrl[3 * n + i] = u.command.wheel_rate[i]
        if steers[i] >= 0:
            ctrl[steer] = u.command.steer_rate[i]
            steer += 1
        external = xfrc[bodies[1 + i]]
        for k in range(6):
            external[k] = 0.0
        for k in range(3):
            for j in range(3):
                biasprm[3 * i + k, j] = 0.0
        if lifted[i] > 0.0:
            continue
        wheel, contact, pose = u.wheel[i], u.contact[i], y.wheel[i]
        for k in range(3):
            external[k] = wheel.f_0[k]
            external[3 + k] = wheel.t_0[k]
        if contact.in_contact > 0.5:
            anchored = is_sent(contact.anchor.T)
            for k in range(3):
                _command_axis(h[0], mass, contact, pose, anchored, k, gear[3 * i + k], biasprm[3 * i + k], external)


@kernel
def _command_axis(h, mass, contact, pose, anchored, k, gear, biasprm, external):
    """Actuator on axis k of one contact: a force on the wheel along the axis a, at the contact point.

    It acts at the hub with the point's lever arm s in its gear, both in the wheel frame, where MuJoCo wants them.
    """
    anchor = contact.anchor if anchored else pose
    ax, ay, az = contact.axes[k, 0], contact.axes[k, 1], contact.axes[k, 2]
    sx, sy, sz = contact.point_0[0] - anchor.r_0[0], contact.point_0[1] - anchor.r_0[1], contact.point_0[2] - anchor.r_0[2]
    mx, my, mz = cross(sx, sy, sz, ax, ay, az)
    gear[0], gear[1], gear[2] = resolve2(pose.T, ax, ay, az)
    gear[3], gear[4], gear[5] = resolve2(pose.T, mx, my, mz)

    v = _along(ax, ay, az, pose.v_0) + _along(mx, my, mz, pose.w_0)
    v_anchor = _along(ax, ay, az, anchor.v_0) + _along(mx, my, mz, anchor.w_0)
    # Displacement since the anchor of the wheel's material at the contact point, to first order in the rotation since then:
    # spin alone moves nothing along the normal.
    x = _along(ax, ay, az, pose.r_0) - _along(ax, ay, az, anchor.r_0)
    x += mx * _turn(pose.T, anchor.T, 2, 1) + my * _turn(pose.T, anchor.T, 0, 2) + mz * _turn(pose.T, anchor.T, 1, 0)

    # own choice: F = F0 - K (x0 - x_a) - D (v1 - v_a) - H K (v1 - v0 / (1 + W^2)) with the velocities v0 and v1 at the step's ends
    # and W = (omega H)^2 = H^2 K / m of the mass that a wheel carries. For soft contacts this is anchored in velocity: no numerical
    # damping, and no bias where v0 is not 0 though nothing is compressed, as on a rolling wheel. For stiff ones it is backward Euler,
    # where the other form returns an impact with up to 1.1 of its speed and undoes the contact's own damping. Rebound speed over
    # impact speed at 1 ms, mean over the phase of the impact, for omega H = 0.19, 0.47, 2.2 (2 kg) and 7 (2 kg) without damping:
    # 1.00, 0.97, 0.85, 0.42; backward Euler throughout 0.75, 0.54, 0.32, 0.47; anchored in velocity throughout 1.00, 1.00, 1.01, 1.00
    # (0.89 instead of 0.45 for a damping ratio of 0.3 at omega H = 7).
    F, K, D = contact.F[k], contact.K[k], contact.D[k]
    W = h * h * K / mass
    biasprm[0] = F - K * x + D * v_anchor + h * K * v / (1.0 + W * W)
    biasprm[2] = -(D + h * K)

    # What F at its point explains of the wrench about the hub; the rest acts as it is.
    external[0] -= ax * F
    external[1] -= ay * F
    external[2] -= az * F
    external[3] -= mx * F
    external[4] -= my * F
    external[5] -= mz * F


@kernel
def _along(ax, ay, az, v):
    return dot(ax, ay, az, v[0], v[1], v[2])


@kernel
def _turn(T, T_anchor, i, j):
    """Half of element (i, j) less (j, i) of T' T_anchor: with (2, 1), (0, 2), (1, 0) the rotation vector from the anchor, in world."""
    turn = 0.0
    for k in range(3):
        turn += T[k, i] * T_anchor[k, j] - T[k, j] * T_anchor[k, i]
    return 0.5 * turn


@kernel
def _settle(U, X, lifted, applied, q, q_dot, biasprm, force, moment, n_row, row, column):
    """Find the force that acted in the step just done: 0, _LOST, or REDO after marking the contacts that pulled."""
    u, x = U[0], X[0]
    for k in range(q.size):
        if not (abs(q[k]) <= _LIMIT and abs(q_dot[k]) <= _LIMIT):
            return _LOST
    status = 0
    for i in range(lifted.size):
        for j in range(3):
            applied[i, j] = 0.0 if lifted[i] > 0.0 else u.wheel[i].f_0[j]
        if lifted[i] > 0.0 or u.contact[i].in_contact < 0.5:
            continue
        for k in range(3):
            actuator = 3 * i + k
            f = force[actuator]
            # Implicit part: the change of velocity times the damping that MuJoCo integrated.
            for c in range(row[actuator], row[actuator] + n_row[actuator]):
                f += biasprm[actuator, 2] * moment[c] * (q_dot[column[c]] - x.q_dot[column[c]])
            for j in range(3):
                applied[i, j] += (f - u.contact[i].F[k]) * u.contact[i].axes[k, j]
            if k == 2 and f < 0.0:
                lifted[i] = 1.0
                status = _REDO
    return status


@kernel
def _output(X, Y, applied, q, q_dot, bodies, spins, steers, xpos, xmat, cvel, com):
    x, y = X[0], Y[0]
    for k in range(q.size):
        x.q[k] = q[k]
        x.q_dot[k] = q_dot[k]
    for i in range(spins.size):
        wheel, b = y.wheel[i], bodies[1 + i]
        for j in range(3):
            wheel.r_0[j] = xpos[b, j]
            wheel.w_0[j] = cvel[b, j]
            y.applied[i].f_0[j] = applied[i, j]
            for k in range(3):
                wheel.T[j, k] = xmat[b, 3 * k + j]
        # MuJoCo's twist is angular, then linear at the system's centre of mass.
        vx, vy, vz = cross(cvel[b, 0], cvel[b, 1], cvel[b, 2], xpos[b, 0] - com[0], xpos[b, 1] - com[1], xpos[b, 2] - com[2])
        wheel.v_0[0] = cvel[b, 3] + vx
        wheel.v_0[1] = cvel[b, 4] + vy
        wheel.v_0[2] = cvel[b, 5] + vz
        y.joint.wheel_angle[i] = q[spins[i]]
        y.joint.wheel_rate[i] = q_dot[spins[i]]
        if steers[i] >= 0:
            y.joint.steer_angle[i] = q[steers[i]]
    for j in range(3):
        y.body.r_0[j] = q[j]
        y.body.w_0[j] = cvel[bodies[0], j]
        y.body.v_0[j] = q_dot[j]
    y.body.yaw = q[3]
    y.body.pitch = q[4]
