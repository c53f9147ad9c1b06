"""BCM on soil that loses strength as it is sheared and pushed along."""

import numpy as np
import pytest

from cdl_fmu.bcm import BCM
from cdl_fmu.slave.model import Instance
from cdl_fmu.soil import load_soil

R, V, LOAD = 0.058, 0.01, 24.0
SETTINGS = dict(r_w=R, b_w=0.05, n_g=0, eta=0.0, V_theta=1e-3, V_j_mode="mapped", c_d=0.0)


def at_rest_in_height(slip, **parameters):
    """Sinkage [m] and pull [N] of the wheel that the soil just carries at a slip."""
    instance = Instance(BCM(1), "bcm", **load_soil("cmu_sand"), **SETTINGS, **parameters)
    instance.initialise()
    wheel = instance.u.wheel[0]
    wheel.active, wheel["T"][:] = 1.0, np.eye(3)
    rim = V / (1.0 - slip) if slip >= 0.0 else V * (1.0 + slip)
    wheel.v_0[:], wheel.w_0[:] = (V, 0.0, 0.0), (0.0, rim / R, 0.0)
    low, high = 0.0, 0.1
    for _ in range(50):
        z = 0.5 * (low + high)
        wheel.r_0[:] = 0.0, 0.0, R - z
        instance.step(0.0, 1e-3)
        low, high = (z, high) if instance.y.wheel[0].f_0[2] < LOAD else (low, z)
    return z, float(instance.y.wheel[0].f_0[0])


def test_a_wheel_sinks_by_its_slip_and_more_by_skid():
    still, slipping, skidding = (at_rest_in_height(slip, strength="critical_state")[0] for slip in (0.0, 0.5, -0.5))
    assert slipping > 1.3 * still and skidding > slipping
    plates = [at_rest_in_height(slip)[0] for slip in (0.0, 0.5, -0.5)]
    assert max(plates) < 1.1 * min(plates)


def test_soil_that_is_not_sheared_bears_what_plates_measured():
    """At a slip of 0 little is sheared; with neither softening nor tilt nor push, the law is Bekker's."""
    assert at_rest_in_height(0.0, strength="critical_state")[0] == pytest.approx(at_rest_in_height(0.0)[0], rel=0.1)


def test_stiffness_is_at_least_the_slope_of_the_force():
    """Soil that is sheared grows stronger more slowly with depth than the stiffness says, which holds a rover the better."""
    instance = Instance(BCM(1), "bcm", **load_soil("cmu_sand"), **SETTINGS, strength="critical_state")
    instance.initialise()
    wheel = instance.u.wheel[0]
    wheel.active, wheel["T"][:] = 1.0, np.eye(3)
    wheel.v_0[:], wheel.w_0[:] = (V, 0.0, 0.0), (0.0, 2.0 * V / R, 0.0)
    forces = []
    for z in (0.0195, 0.0205, 0.02):
        wheel.r_0[:] = 0.0, 0.0, R - z
        instance.step(0.0, 1e-3)
        forces.append(float(instance.y.wheel[0].f_0[2]))
    slope = (forces[1] - forces[0]) / 1e-3
    assert 1.0 < instance.y.contact[0].K[2] / slope < 1.7
