"""The rover's state in MuJoCo: parameters and coordinates are brought there, and what MuJoCo makes of them is observed and shown."""

from __future__ import annotations

import math

from cdl_fmu.frames import vertical
from cdl_fmu.slave.kernel import kernel

from .mujoco_library import MUJOCO

mj_setConst, mj_kinematics, mj_comPos, mj_comVel = map(MUJOCO.function, ("mj_setConst", "mj_kinematics", "mj_comPos", "mj_comVel"))
mj_makeM, mj_fullM, mj_rne, mju_eig3 = map(MUJOCO.function, ("mj_makeM", "mj_fullM", "mj_rne", "mju_eig3"))

#: What a choice between off and on holds for the latter.
ON = 2.0


@kernel
def set_up(p, rocks, work, constants, held):
    """Bring the parameters into MuJoCo's model, and what else the step needs of them into memory."""
    bodies, n_wheels = constants.bodies, constants.spins.size
    x, y, z = vertical(p.slope, p.uphill)
    held.gravity[0], held.gravity[1], held.gravity[2] = -p.gravity * x, -p.gravity * y, -p.gravity * z
    held.body_mass[bodies[0]], held.body_ipos[bodies[0], 2] = p.mass, p.mass_height
    for d in range(work.gains.size):
        work.gains[d] = 0.0
    for i in range(n_wheels):
        body = bodies[1 + i]
        held.body_pos[body, 0] = (0.5 - i) * p.wheel_base
        held.body_mass[body] = p.wheel_mass
        held.body_inertia[body, 0] = held.body_inertia[body, 2] = p.wheel_inertia_diameter
        held.body_inertia[body, 1] = p.wheel_inertia_axle
        work.gains[constants.spins[i]] = p.wheel_servo_gain
        if constants.steers[i] >= 0:
            work.gains[constants.steers[i]] = p.steer_servo_gain
        work.masses[i] = p.mass / n_wheels + p.wheel_mass
    for j in range(len(rocks)):
        body = bodies[1 + n_wheels + j]
        held.body_mass[body] = work.masses[n_wheels + j] = rocks[j].mass
        for k in range(3):
            held.body_ipos[body, k] = rocks[j].center[k]
        _set_inertia(rocks[j].inertia, held.body_inertia[body], held.body_iquat[body], work.eigen)
    for i in range(len(work.moves)):
        fixed = i >= n_wheels and rocks[i - n_wheels].fixed == ON
        for d in range(work.gains.size):
            work.moves[i, d] = 0.0 if fixed else constants.follows[i, d]
    mj_setConst(held.addresses[0], held.addresses[1])
    work.is_set[0] = 1


@kernel
def _set_inertia(inertia, principal, quaternion, eigen):
    """Principal inertias and the rotation of their axes from xx, yy, zz, xy, xz, yz."""
    matrix = eigen[0]
    matrix[0], matrix[4], matrix[8] = inertia[0], inertia[1], inertia[2]
    matrix[1] = matrix[3] = inertia[3]
    matrix[2] = matrix[6] = inertia[4]
    matrix[5] = matrix[7] = inertia[5]
    mju_eig3(principal.ctypes.data, eigen[1].ctypes.data, quaternion.ctypes.data, matrix.ctypes.data)


@kernel
def start(p, rocks, x_q, x_q_dot):
    """State at the start."""
    for k in range(x_q_dot.size):
        x_q_dot[k] = 0.0
    for k in range(x_q.size - 7 * len(rocks)):
        x_q[k] = 0.0
    x_q[0], x_q[1], x_q[2], x_q[3], x_q[4] = p.start.x, p.start.y, p.start.z, p.start.yaw, p.start.pitch
    for j in range(len(rocks)):
        rock, at = rocks[j], x_q.size - 7 * (len(rocks) - j)
        x_q[at], x_q[at + 1], x_q[at + 2] = rock.x, rock.y, rock.z
        a, b = math.cos(0.5 * rock.yaw), math.sin(0.5 * rock.yaw)
        c, d = math.cos(0.5 * rock.pitch), math.sin(0.5 * rock.pitch)
        e, f = math.cos(0.5 * rock.roll), math.sin(0.5 * rock.roll)
        x_q[at + 3], x_q[at + 4] = a * c * e + b * d * f, a * c * f - b * d * e
        x_q[at + 5], x_q[at + 6] = a * d * e + b * c * f, b * c * e - a * d * f


@kernel
def is_at(x_q, x_q_dot, work, held):
    """True if MuJoCo's data hold the state."""
    same = work.is_set[0] == 1
    for k in range(x_q.size):
        same &= x_q[k] == held.qpos[k]
    for k in range(x_q_dot.size):
        same &= x_q_dot[k] == held.qvel[k]
    return same


@kernel
def load(p, rocks, x_q, x_q_dot, work, constants, held):
    """Bring the state into MuJoCo's data, after the parameters where those are not there yet."""
    if work.is_set[0] == 0:
        set_up(p, rocks, work, constants, held)
    for k in range(x_q.size):
        held.qpos[k] = x_q[k]
    for k in range(x_q_dot.size):
        held.qvel[k] = x_q_dot[k]
    update(work, constants, held)


@kernel
def update(work, constants, held):
    """Bring all that depends on positions and rates up to date."""
    model, data = held.addresses[0], held.addresses[1]
    mj_kinematics(model, data)
    mj_comPos(model, data)
    mj_comVel(model, data)
    mj_makeM(model, data)
    mj_fullM(model, data, work.mass.ctypes.data)
    mj_rne(model, data, 0, work.bias.ctypes.data)
    for i in range(len(work.R)):
        body = constants.bodies[1 + i]
        # MuJoCo's twists are angular, then linear at the centre of mass of all that hangs on the same root.
        c, r = held.subtree_com[constants.roots[1 + i]], held.xpos[body]
        s_x, s_y, s_z = r[0] - c[0], r[1] - c[1], r[2] - c[2]
        for k in range(3):
            work.R[i, k] = r[k]
            for j in range(3):
                work.T[i, j, k] = held.xmat[body, 3 * k + j]
        _at_origin(held.cvel[body], s_x, s_y, s_z, work.twists[i])
        for d in range(len(held.cdof)):
            if work.moves[i, d] > 0.0:
                _at_origin(held.cdof[d], s_x, s_y, s_z, work.J[i, :, d])


@kernel
def _at_origin(twist, s_x, s_y, s_z, out):
    w_x, w_y, w_z = twist[0], twist[1], twist[2]
    out[0], out[1], out[2] = twist[3] + w_y * s_z - w_z * s_y, twist[4] + w_z * s_x - w_x * s_z, twist[5] + w_x * s_y - w_y * s_x
    out[3], out[4], out[5] = w_x, w_y, w_z


@kernel
def remember(work):
    """Keep poses and twists as the step begins."""
    for i in range(len(work.R)):
        for k in range(3):
            work.R_before[i, k] = work.R[i, k]
            for j in range(3):
                work.T_before[i, k, j] = work.T[i, k, j]
        for k in range(6):
            work.twists_before[i, k] = work.twists[i, k]


@kernel
def show(x, y, work, constants, held, wheels, rocks, shown):
    """State and outputs from MuJoCo's data and the frames."""
    q, q_dot = held.qpos, held.qvel
    for k in range(q.size):
        x.q[k] = q[k]
    for k in range(q_dot.size):
        x.q_dot[k] = q_dot[k]
    for i in range(len(wheels)):
        _show_frame(work.R[i], work.T[i], work.twists[i], wheels[i])
        for k in range(3):
            shown[i].f_0[k] = work.applied[i, k]
        # The rover's coordinates come first, and each of them has one number in q.
        spin, steer = constants.spins[i], constants.steers[i]
        y.joint.wheel_angle[i], y.joint.wheel_rate[i] = q[spin], q_dot[spin]
        if steer >= 0:
            y.joint.steer_angle[i] = q[steer]
    for j in range(len(rocks)):
        i = len(wheels) + j
        _show_frame(work.R[i], work.T[i], work.twists[i], rocks[j])
    body = y.body
    for k in range(3):
        body.r_0[k] = q[k]
        body.w_0[k] = held.cvel[constants.bodies[0], k]
        body.v_0[k] = q_dot[k]
    body.yaw = q[3]
    body.pitch = q[4]


@kernel
def _show_frame(r, T, twist, out):
    for k in range(3):
        out.r_0[k], out.v_0[k], out.w_0[k] = r[k], twist[k], twist[3 + k]
        for j in range(3):
            out.T[k, j] = T[k, j]
