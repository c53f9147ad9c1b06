"""The worked example of CONTRIBUTING.md: a contact model in one file."""

import math

import numpy as np
import pytest
from linear_spring import LinearSpring

from cdl_fmu.frames import axis_rotation
from cdl_fmu.slave.model import Instance, ModelError

K, D, MU, V_S, R = 1e6, 2e3, 0.5, 0.02, 0.125


def spring(n_wheels=1):
    instance = Instance(LinearSpring(n_wheels=n_wheels), k=K, d=D, mu=MU, v_s=V_S, r_w=R)
    instance.initialise()
    return instance


def place(wheel, z, v=(0.0, 0.0, 0.0), w=(0.0, 0.0, 0.0), T=None):
    wheel.r_0[:] = 0.3, -0.2, z
    wheel.v_0[:], wheel.w_0[:] = v, w
    wheel["T"][:] = np.eye(3) if T is None else T


def test_wheel_at_rest_sinks_by_weight_over_stiffness():
    instance, mass, g, h = spring(), 20.0, 9.81, 1e-4
    z, v = R, 0.0
    for step in range(4000):
        place(instance.u.wheel[0], z, (0, 0, v))
        instance.step(step * h, h)
        v += h * (instance.y.wheel[0].f_0[2] / mass - g)
        z += h * v
    assert R - z == pytest.approx(mass * g / K, rel=1e-6)


def test_force_is_spring_damper_and_smooth_coulomb_friction_in_the_heading_frame():
    instance, yaw, depth = spring(), 0.7, 1e-3
    c, s = math.cos(yaw), math.sin(yaw)
    slide_x, slide_y, v_n = 0.03, -0.01, 0.05
    place(instance.u.wheel[0], R - depth, (c * slide_x - s * slide_y, s * slide_x + c * slide_y, v_n), T=axis_rotation(3, yaw))
    instance.step(0.0, 1e-3)

    F_n = K * depth - D * v_n
    friction = MU * F_n / math.hypot(slide_x, slide_y, V_S)
    contact, wheel = instance.y.contact[0], instance.y.wheel[0]
    np.testing.assert_allclose(contact.F, [-friction * slide_x, -friction * slide_y, F_n], rtol=1e-12)
    assert wheel.f_0 == pytest.approx(contact.axes.T @ contact.F, rel=1e-12)
    assert wheel.t_0 == pytest.approx(np.cross(contact.point_0 - instance.u.wheel[0].r_0, wheel.f_0), rel=1e-12)


def test_rolling_wheel_has_no_friction_and_a_spinning_one_is_driven_forward():
    instance = spring()
    place(instance.u.wheel[0], R - 1e-3, v=(1.0 * R, 0, 0), w=(0, 1.0, 0))
    instance.step(0.0, 1e-3)
    assert instance.y.contact[0].F[:2] == pytest.approx([0, 0], abs=1e-12)
    place(instance.u.wheel[0], R - 1e-3, w=(0, 1.0, 0))
    instance.step(0.0, 1e-3)
    assert instance.y.wheel[0].f_0[0] > 0 > instance.y.wheel[0].t_0[1]


def test_jacobian_is_tangent_along_the_normal_and_secant_along_friction():
    instance, depth, v = spring(), 1e-3, np.array([0.03, 0.01, -0.02])

    def force(depth, v):
        place(instance.u.wheel[0], R - depth, v)
        instance.step(0.0, 1e-3)
        return instance.y.contact[0].F.copy()

    dz, dv = 1e-7, np.array([0, 0, 1e-5])
    K_n = (force(depth + dz, v) - force(depth - dz, v))[2] / (2 * dz)
    D_n = -(force(depth, v + dv) - force(depth, v - dv))[2] / (2 * dv[2])
    F = force(depth, v)
    contact = instance.y.contact[0]
    np.testing.assert_allclose(contact.K, [0, 0, K_n], rtol=1e-6)
    np.testing.assert_allclose(contact.D, [-F[0] / v[0], -F[1] / v[1], D_n], rtol=1e-6)
    for name in ("r_0", "T", "v_0", "w_0"):
        np.testing.assert_array_equal(contact.anchor[name], instance.u.wheel[0][name])


def test_wheel_in_the_air_or_pulling_away_feels_nothing():
    instance = spring()
    place(instance.u.wheel[0], R + 1e-6)
    instance.step(0.0, 1e-3)
    assert instance.y.contact[0].in_contact == 0 and not instance.y.wheel[0].f_0.any()
    place(instance.u.wheel[0], R - 1e-3, v=(0, 0, 10.0))
    instance.step(0.0, 1e-3)
    assert not instance.y.wheel[0].f_0.any()


def test_missing_pose_warns_once_then_is_an_error_that_names_the_wheel():
    instance = spring(n_wheels=2)
    place(instance.u.wheel[0], R - 1e-3)
    instance.u.wheel[1]["T"][:] = 0.0
    instance.step(0.0, 1e-3)
    instance.step(1e-3, 1e-3)
    assert instance.warnings == [
        "cdl_spring_w2: wheel[2].T is no rotation: no pose was set yet, and the wheel feels no ground (t = 0 s)",
    ]
    assert instance.y.wheel[0].f_0[2] == pytest.approx(K * 1e-3) and not instance.y.wheel[1].f_0.any()
    with pytest.raises(ModelError, match=r"wheel\[2\].T is still no rotation after 2 steps: connect wheel\[2\].T"):
        instance.step(2e-3, 1e-3)


def test_wheel_on_its_side_is_refused():
    instance = spring()
    place(instance.u.wheel[0], R - 1e-3, T=axis_rotation(1, math.pi / 2))
    with pytest.raises(ModelError, match=r"wheel\[1\].T: the axle is vertical, so the wheel has no heading"):
        instance.step(0.0, 1e-3)


def test_bound_is_named():
    instance = Instance(LinearSpring(), k=-1.0)
    with pytest.raises(ModelError, match=r"parameter k = -1 N/m: it must be at least 0 N/m \(Stiffness of the ground\)"):
        instance.initialise()
