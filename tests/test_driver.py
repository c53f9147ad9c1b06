"""The driver: ramp, thresholds, steering servo."""

import math

import numpy as np
import pytest

from cdl_fmu.slave.model import Instance, ModelError
from mbs.driver import Driver

H = 1e-3


def driver(**parameters):
    d = Instance(Driver(), **parameters)
    d.initialise()
    return d


def test_wheels_ramp_up_together():
    d = driver(start_time=0.1, start_ramp=0.2, wheel_rate=1.5)
    rates = []
    for k in range(500):
        d.step(k * H, H)
        rates.append(d.y.command.wheel_rate.copy())
    t = H * np.arange(1, 501)
    assert np.array(rates)[:, 0] == pytest.approx(1.5 * np.clip((t - 0.1) / 0.2, 0, 1), abs=1e-12)
    assert np.array_equal(rates[-1], [1.5, 1.5])


def test_without_ramp_the_rate_steps():
    d = driver(start_ramp=0.0)
    assert d.y.command.wheel_rate[0] == 1.0
    d.step(0.0, H)
    assert d.y.command.wheel_rate[0] == 1.0


def test_manoeuvre_of_section_8_5_1():
    d = driver()
    angle, angles, rates, x = 0.0, [], [], np.arange(0, 1.8, 0.125 * H)
    for k, position in enumerate(x):
        d.u.wheel[1].r_0[0] = position
        d.u.joint.steer_angle[1] = angle
        d.step(k * H, H)
        angle += H * d.y.command.steer_rate[1]
        angles.append(angle)
        rates.append(d.y.command.steer_rate[1])
    angles, rates = np.array(angles), np.array(rates)
    assert np.all(angles[x < 0.9] == 0)
    assert np.all(np.abs(rates) <= 0.8)
    assert rates[np.searchsorted(x, 0.9001)] == 0.8
    assert angles[np.searchsorted(x, 0.9001) + 500] == pytest.approx(0.4, rel=1e-2)
    assert angles[(x > 1.05) & (x < 1.2)] == pytest.approx(math.pi / 4, abs=1e-4)
    # 90 deg back at 0.8 rad/s and 0.125 m/s take 0.245 m; the last angle is held.
    assert angles[(x > 1.48)] == pytest.approx(-math.pi / 4, abs=1e-4)
    assert np.all(d.y.command.steer_rate[:1] == 0)


def test_a_threshold_once_passed_stays_passed_and_restores():
    d = driver()
    d.u.wheel[1].r_0[0] = 0.95
    d.step(0.0, H)
    saved = d.block.copy()
    d.u.wheel[1].r_0[0] = 0.85
    d.step(H, H)
    assert d.y.command.steer_rate[1] == 0.8
    d.u.wheel[1].r_0[0] = 1.3
    d.step(2 * H, H)
    assert d.y.command.steer_rate[1] == -0.8
    d.block[:] = saved
    d.step(H, H)
    assert d.y.command.steer_rate[1] == 0.8


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"steer_at": [1.2, 0.9]}, r"steer_at\[2\] = 0.9 m: it must be at least steer_at\[1\] = 1.2 m"),
        ({"servo_time": 0.0}, "servo_time = 0 s: it must be at least 1e-06 s"),
        ({"steer_to": [3.0, 0.0]}, r"steer_to\[1\] = 3 rad: it must be at most 1.5708 rad"),
    ],
)
def test_bad_parameters_are_refused(values, text):
    with pytest.raises(ModelError, match=text):
        driver(**values)
