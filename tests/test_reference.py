"""The reference drive: its equations of motion against MuJoCo's, its convergence, and the co-simulated rover against it."""

import math

import mujoco
import numpy as np
import pytest
from linear_spring import LinearSpring

from cdl_fmu.bcm import BCM
from cdl_fmu.slave.model import Instance, ModelError
from mbs.driver import Driver
from mbs.rover import Rover
from validation.reference import accelerate, place_wheels, simulate_reference

WEIGHT = 54 * 9.81
STIFFNESS = 3e4


def parts(**driver):
    contact = Instance(LinearSpring(n_wheels=2), k=STIFFNESS, d=1500.0, mu=0.6, v_s=0.05, r_w=0.125)
    return contact, Instance(Rover(), **{"start.z": 0.125 - WEIGHT / 2 / STIFFNESS}), Instance(Driver(), **driver)


def test_equations_of_motion_agree_with_mujoco():
    rng = np.random.default_rng(1)
    contact, rover, _ = parts()
    rover.initialise()
    m, d = rover.pool.m, rover.pool.d
    _, U, _, Y = contact.arrays
    mass, acceleration, work = np.zeros((m.nv, m.nv)), np.zeros(5), np.zeros((2, 12, 12))
    for _ in range(20):
        s = np.concatenate([rng.uniform(-1, 1, 5), rng.uniform(-2, 2, 5), rng.uniform(-1, 1, 2)])
        phi_dot, delta_dot, phi_ddot, delta_ddot = rng.uniform(-3, 3, 4)
        d.qpos[:] = [*s[:5], s[10], s[11], s[10]]  # spin of the front wheel; steering, spin of the rear wheel
        d.qvel[:] = [*s[5:10], phi_dot, delta_dot, phi_dot]
        given = np.array([phi_ddot, delta_ddot, phi_ddot])
        for i in range(2):
            wrench = rng.uniform(-100, 100, 6)
            Y["wheel"][0, i]["f_0"], Y["wheel"][0, i]["t_0"] = wrench[:3], wrench[3:]
            d.xfrc_applied[m.body(f"wheel{i}").id] = wrench
        mujoco.mj_forward(m, d)
        mujoco.mj_fullM(m, d, mass)
        force = np.zeros(m.nv)
        for i in range(2):
            body, w = m.body(f"wheel{i}").id, d.xfrc_applied[m.body(f"wheel{i}").id].copy()
            mujoco.mj_applyFT(m, d, w[:3], w[3:], d.xipos[body], body, force)
        expected = np.linalg.solve(mass[:5, :5], (force - d.qfrc_bias)[:5] - mass[:5, 5:] @ given)

        place_wheels(rover.arrays[0][0], s, phi_dot, delta_dot, U[0])
        accelerate(rover.arrays[0][0], s, phi_dot, phi_ddot, delta_dot, delta_ddot, U[0], Y[0], acceleration, work[0], work[1])
        np.testing.assert_allclose(acceleration, expected, rtol=1e-9, atol=1e-7)
        for i in range(2):
            body = m.body(f"wheel{i}").id
            np.testing.assert_allclose(U["wheel"][0, i]["r_0"], d.xpos[body], atol=1e-14)
            np.testing.assert_allclose(U["wheel"][0, i]["T"], d.xmat[body].reshape(3, 3).T, atol=1e-14)
            np.testing.assert_allclose(U["wheel"][0, i]["w_0"], d.cvel[body][:3], atol=1e-12)


def test_steps_converge_through_a_steering_motion():
    contact, rover, driver = parts(steer_at=[0.02, 0.05])
    coarse, fine = (simulate_reference(contact, rover, driver, stop_time=1.5, dt=dt) for dt in (1e-4, 5e-5))
    assert fine["steer_angle"][-1] < -0.1
    assert coarse["r_0"] == pytest.approx(fine["r_0"], abs=1e-5)
    rms = np.sqrt(np.mean((coarse["f"] - fine["f"]) ** 2, axis=0)) / (WEIGHT / 2)
    assert rms.max() < 1e-3
    assert fine["f"][..., 2].sum(axis=1).mean() == pytest.approx(WEIGHT, rel=1e-3)


def test_rover_at_1_ms_follows_the_reference():
    """Gauss-Seidel order with the interface Jacobian, in process; forces are those that the rover applied."""
    h, n = 1e-3, 3000
    contact, rover, driver = parts(steer_at=[0.05, 0.1])
    expected = simulate_reference(contact, rover, driver, stop_time=n * h)
    for instance in (contact, rover, driver):
        instance.initialise()
    force = np.zeros((n + 1, 2, 3))
    for k in range(n):
        driver.u.joint.steer_angle[:] = rover.y.joint.steer_angle
        for i in range(2):
            driver.u.wheel[i].r_0[:] = rover.y.wheel[i].r_0
            for name in ("r_0", "T", "v_0", "w_0"):
                contact.u.wheel[i][name] = rover.y.wheel[i][name]
        driver.step(k * h, h)
        contact.step(k * h, h)
        rover.u.command = driver.y.command
        rover.u.contact = contact.y.contact
        for i in range(2):
            rover.u.wheel[i].f_0[:], rover.u.wheel[i].t_0[:] = contact.y.wheel[i].f_0, contact.y.wheel[i].t_0
        rover.step(k * h, h)
        for i in range(2):
            axle, (x, y, z) = rover.y.wheel[i]["T"][1], rover.y.applied[i].f_0
            level = math.hypot(axle[0], axle[1])
            force[k + 1, i] = (x * axle[1] - y * axle[0]) / level, (x * axle[0] + y * axle[1]) / level, z
    assert expected["steer_angle"][-1] < -0.2
    steering = np.abs(np.diff(expected["steer_angle"], 2, append=[0, 0])) > 1e-6  # starts and ends of the steering motions
    apart = np.convolve(steering, np.ones(41), "same") == 0
    apart[:300] = False
    assert apart[300:].mean() > 0.9
    error = np.sqrt(np.mean((force - expected["f"])[apart] ** 2, axis=0)) / (WEIGHT / 2)
    assert error.max() < 1e-3
    assert rover.y.wheel[1].r_0 == pytest.approx(expected["r_0"][-1, 1], abs=1e-3)


def test_a_start_with_a_jump_is_refused():
    with pytest.raises(ValueError, match="start_ramp = 0 s: the reference needs a wheel rate without jumps"):
        simulate_reference(*parts(start_ramp=0.0), stop_time=1.0)


def test_a_refused_pose_gives_the_contact_models_message():
    contact = Instance(BCM(n_wheels=2))
    _, rover, driver = parts()
    rover.set_parameter("start.z", -0.2)
    with pytest.raises(ModelError, match="wheel 1 is buried"):
        simulate_reference(contact, rover, driver, stop_time=0.01)
