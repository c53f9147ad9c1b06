"""What BCM refuses, and what it says."""

import numpy as np
import pytest

from cdl_fmu import BCM, Instance
from cdl_fmu.frames import axis_rotation
from cdl_fmu.slave.model import ModelError


def refusal(instance, match):
    with pytest.raises(ModelError, match=match):
        instance.step(0.5, 1e-3)


def placed(model=None, z=0.1) -> Instance:
    instance = Instance(model or BCM(2), "cdl_bcm")
    for wheel in instance.u.wheel:
        wheel.r_0[2] = z
    instance.initialise()
    return instance


def test_soil_that_bears_nothing_under_a_narrow_wheel():
    text = r"k_c = -2.86e\+06 N/m\^3.49: k_c/b \+ k_phi < 0 for wheel width b = 0.01 m; use a wheel wider than 0.0116 m or another soil"
    with pytest.raises(ModelError, match=text):
        Instance(BCM(), b_w=0.01).initialise()


def test_half_a_grouser():
    with pytest.raises(ModelError, match=r"n_g = 2.5: the number of grousers must be whole"):
        Instance(BCM(), n_g=2.5).initialise()


def test_more_grousers_than_room():
    with pytest.raises(ModelError, match=r"n_g = 500: grousers of t_g = 0.002 m fill more than the 0.848 m around their tips; use fewer"):
        Instance(BCM(), n_g=500).initialise()


def test_parameter_out_of_bounds():
    with pytest.raises(ModelError, match=r"eta = 2: it must be at most 1 \(Least ratio of exit to entry angle"):
        Instance(BCM(), eta=2).initialise()


def test_patches_for_some_wheels_only():
    with pytest.raises(ValueError, match=r"n_patches = 1: choose 0 \(flat ground\) or 3"):
        BCM(3, 1)


@pytest.mark.parametrize("zeros", [False, True])
def test_no_pose_is_zero_force_one_warning_and_an_error_after_two_steps(zeros):
    instance = Instance(BCM(), "cdl_bcm")
    instance.initialise()
    if zeros:
        instance.u.wheel[0]["T"][:] = 0.0
    for _ in range(2):
        instance.step(0.0, 1e-3)
        assert not instance.y.wheel[0].f_0.any()
    assert len(instance.warnings) == 1 and "wheel 1 has no pose yet" in instance.warnings[0]
    refusal(instance, r"cdl_bcm: wheel\[1\] still has no pose after 2 steps: connect wheel\[1\].r_0, T, v_0, w_0 to the rover")
    instance.u.wheel[0]["T"][:] = np.eye(3)
    instance.u.wheel[0].r_0[2] = 0.1
    instance.step(0.0, 1e-3)
    assert instance.y.wheel[0].f_0[2] > 0


def test_a_wheel_at_rest_at_the_origin_of_its_ground_has_a_pose():
    instance = Instance(BCM(), ground_z=-0.1)
    instance.initialise()
    instance.u.wheel[0].w_0[1] = 1e-9
    instance.step(0.0, 1e-3)
    assert instance.y.wheel[0].f_0[2] > 0 and not instance.warnings


def test_buried_wheel():
    instance = placed()
    instance.u.wheel[1].r_0[2] = -0.126
    before = instance.block.copy()
    refusal(
        instance,
        r"cdl_bcm: wheel 2 is buried: its centre, at \(0, 0, .*\) m, is more than its radius of 0.125 m below the ground; .* \(t = 0.5 s\)",
    )
    assert (instance.block == before).all()


def test_wheel_just_above_burial_is_loaded_by_finite_forces():
    instance = placed(z=-0.124)
    instance.step(0.0, 1e-3)
    assert np.isfinite(instance.block).all()
    assert instance.y.wheel[0].f_0[2] > 1000


def test_wheel_on_its_side():
    instance = placed()
    instance.u.wheel[0]["T"][:] = axis_rotation(1, np.pi / 2)
    refusal(instance, "wheel 1 lies on its side")


def test_wheel_outside_its_patch():
    instance = placed(BCM(1, 1))
    instance.step(0.0, 1e-3)  # no patch yet: flat ground
    assert instance.y.wheel[0].f_0[2] > 0
    instance.u.patch[0].spacing = 0.03
    instance.u.patch[0].origin[:] = (1.0, 0.0)
    refusal(instance, r"wheel 1, at \(0, 0\) m, is outside patch\[1\]: send the heights around the wheel's centre")
