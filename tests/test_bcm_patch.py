"""BCM on a height patch: the contact plane takes the place of flat ground."""

import numpy as np
import pytest

from cdl_fmu import BCM, Instance, load_soil, unloading
from cdl_fmu.frames import axis_rotation
from cdl_fmu.slave.interface import TESTED
from cdl_fmu.slave.model import ModelError

SOIL = load_soil("mss_d")
R, SPACING = 0.125, 0.03


def on_patch(height, **parameters) -> Instance:
    """BCM on a patch with heights ``height(x, y)``, centred at the origin."""
    instance = Instance(BCM(1, 1), **(SOIL | parameters))
    patch = instance.u.patch[0]
    patch.spacing, patch.origin[:] = SPACING, (-6 * SPACING, -4 * SPACING)
    x, y = patch.origin[0] + SPACING * np.arange(13), patch.origin[1] + SPACING * np.arange(9)
    patch.z[:] = height(x[:, None], y[None, :])
    instance.initialise()
    return instance


def set_pose(instance, r, T, v, w):
    wheel = instance.u.wheel[0]
    wheel.r_0[:], wheel.v_0[:], wheel.w_0[:] = r, v, w
    wheel["T"][:] = T
    instance.step(0.0, 1e-3)
    return instance.y.wheel[0]


def random_motion(rng):
    T = axis_rotation(2, rng.uniform(-3, 3)) @ axis_rotation(1, rng.uniform(-0.2, 0.2)) @ axis_rotation(3, rng.uniform(-3, 3))
    return T, rng.normal(0, 0.1, 3), rng.normal(0, 1, 3)


def test_a_flat_patch_is_flat_ground():
    flat = Instance(BCM(), **SOIL, ground_z=0.05)
    flat.initialise()
    patched = on_patch(lambda x, y: 0.05 + 0 * x * y, ground_z=0.05)
    rng = np.random.default_rng(0)
    for _ in range(50):
        T, v, w = random_motion(rng)
        pose = ((0.01, -0.01, 0.05 + R - rng.uniform(0.005, 0.03)), T, v, w)
        set_pose(flat, *pose), set_pose(patched, *pose)
        assert patched.block[patched.slices["y"]] == pytest.approx(flat.block[flat.slices["y"]], rel=1e-9, abs=1e-9)


def test_on_a_slope_the_wrench_turns_with_the_ground():
    """A tilted plane under an equally tilted wheel: the flat ground's wrench, tilted. Tilt about the axle, so the rays do not change."""
    T, v, w = axis_rotation(2, 0.4), np.array((0.1, 0.02, -0.01)), np.array((0.0, 1.0, 0.1))
    flat = set_pose(on_patch(lambda x, y: 0 * x * y), (0, 0, R - 0.025), T, v, w)
    for slope in (-0.4, -0.1, 0.3):
        Q = axis_rotation(2, slope).T
        inclined = on_patch(lambda x, y: -np.tan(slope) * x + 0 * y)  # noqa: B023
        tilted = set_pose(inclined, Q @ (0, 0, R - 0.025), T @ Q.T, Q @ v, Q @ w)
        assert tilted.f_0 == pytest.approx(Q @ flat.f_0, abs=1e-8)
        assert tilted.t_0 == pytest.approx(Q @ flat.t_0, abs=1e-8)
        assert inclined.y.contact[0].axes[2] == pytest.approx(Q @ (0, 0, 1), abs=1e-12)


def test_a_slope_is_followed_without_lag_and_a_step_in_the_plane_is_smoothed():
    instance = on_patch(lambda x, y: 0.2 * x + 0 * y)
    T = np.eye(3)
    loads = [set_pose(instance, (x, 0, R - 0.02 + 0.2 * x), T, (0, 0, 0), (0, 0, 0)).f_0.copy() for x in np.linspace(0, 0.02, 20)]
    assert np.ptp(loads, axis=0) == pytest.approx(np.zeros(3), abs=1e-9)
    before = loads[-1][2]
    instance.u.patch[0].z += 0.005
    force = [set_pose(instance, (0.02, 0, R - 0.016), T, (0, 0, 0), (0, 0, 0)).f_0[2] for _ in range(200)]
    assert before < force[0] < before + 0.1 * (force[-1] - before)
    assert force[20] - before == pytest.approx((1 - np.exp(-21 / 20)) * (force[-1] - before), rel=0.1)
    assert force[-1] == pytest.approx(
        set_pose(on_patch(lambda x, y: 0.2 * x + 0.005), (0.02, 0, R - 0.016), T, (0, 0, 0), (0, 0, 0)).f_0[2], rel=1e-3
    )


def test_a_wall_pushes_the_wheel_back_into_its_rut():
    rut = on_patch(lambda x, y: np.clip((np.abs(y) - 0.05) * 0.7, 0, 0.03) + 0 * x)
    centre = set_pose(rut, (0, 0, R - 0.02), np.eye(3), (0, 0, 0), (0, 0, 0)).f_0.copy()
    assert centre[1] == pytest.approx(0.0, abs=1e-9)
    rut.initialise()
    beside = set_pose(rut, (0, 0.03, R - 0.02), np.eye(3), (0, 0, 0), (0, 0, 0)).f_0
    assert beside[1] < -5.0


def test_the_plane_turns_gently_when_a_wheel_meets_a_wall():
    """Crossing into a wall of 35 degrees at 0.125 m/s: at most 0.4 degrees per millisecond."""
    instance = on_patch(lambda x, y: np.clip((y - 0.03) * 0.7, 0, 0.03) + 0 * x)
    normals = []
    for y in np.arange(-0.05, 0.05, 0.125e-3):
        set_pose(instance, (0, y, R - 0.02), np.eye(3), (0, 0.125, 0), (0, 0, 0))
        normals.append(instance.y.contact[0].axes[2].copy())
    assert np.ptp(np.array(normals)[:, 1]) > 0.2
    assert np.degrees(np.linalg.norm(np.diff(normals, axis=0), axis=1)).max() < 0.4


def test_a_wheel_above_its_patch_is_free():
    instance = on_patch(lambda x, y: 0 * x * y)
    wrench = set_pose(instance, (0, 0, R + 0.011), np.eye(3), (0.1, 0, 0), (0, 1, 0))
    assert not wrench.f_0.any() and instance.y.contact[0].in_contact == 0.0
    assert instance.y.diagnostics[0].sinkage == pytest.approx(-0.011)


def test_touchdown_on_a_patch_is_continuous():
    instance = on_patch(lambda x, y: 0.1 * x + 0.05 * y)
    forces = [set_pose(instance, (0, 0, z), np.eye(3), (0.1, 0, 0), (0, 1, 0)).f_0.copy() for z in np.linspace(R + 0.02, R - 0.005, 2000)]
    assert np.abs(np.diff(forces, axis=0)).max() < 0.1


# -- compaction


def on_pressed_soil(height, sinkage, share=1.0, **parameters) -> Instance:
    """BCM on a patch of soil with this plastic sinkage [m] of all nodes, which bears a share of what plates measured."""
    instance = Instance(BCM(1, 1, 1), **(SOIL | parameters))
    patch, p = instance.u.patch[0], instance.p
    patch.spacing, patch.origin[:], patch.z[:], patch.sinkage[:] = SPACING, (-6 * SPACING, -4 * SPACING), height, sinkage
    modulus = SOIL["k_c"] / p.b_w + SOIL["k_phi"]
    depth = unloading.tested_depth(unloading.unloading_of(p), modulus, p.n, sinkage, TESTED * p.b_w)
    patch.yield_pressure[:] = share * modulus * depth**p.n
    instance.initialise()
    return instance


STRAIGHT = np.eye(3), np.array((0.12, 0.0, 0.0)), np.array((0.0, 1.0, 0.0))


def test_untouched_soil_with_compaction_is_as_without():
    plain, pressed = on_patch(lambda x, y: 0.01 + 0 * x * y), on_pressed_soil(0.01, 0.0)
    rng = np.random.default_rng(0)
    for _ in range(20):
        T, v, w = random_motion(rng)
        pose = ((0.01, -0.01, 0.01 + R - rng.uniform(0.005, 0.03)), T, v, w)
        expected, found = set_pose(plain, *pose), set_pose(pressed, *pose)
        load = np.linalg.norm(expected.f_0)
        assert found.f_0 == pytest.approx(expected.f_0, abs=1e-3 * load)
        assert found.t_0 == pytest.approx(expected.t_0, abs=1e-3 * load * R)


def load_on_floor(instance, floor, below) -> float:
    """Load [N] of a wheel whose lowest point is ``below`` a floor, both in m, by a fine integral of the law over the rim."""
    p, law = instance.p, unloading.unloading_of(instance.p)
    modulus, n = SOIL["k_c"] / p.b_w + SOIL["k_phi"], float(p.n)
    theta = np.linspace(-0.4, 0.4, 4001)
    z = floor + below - R * (1 - np.cos(theta))
    theta, z = theta[z > floor], z[z > floor]
    dense = modulus * z**n
    k_u = np.array([unloading.unloading_stiffness(law, *values, floor) for values in zip(z, dense)])
    return float(np.trapezoid(np.minimum(k_u * (z - floor), dense) * np.cos(theta) * R * p.b_w, theta))


def test_a_wheel_on_a_rut_does_not_sink_twice():
    """On the floor of a rut of 25 mm the soil bears at once, elastically and then as much as it bore; above it the wheel is free."""
    smooth, floor = dict(n_g=0, c_d=0.0), 0.025
    still = np.eye(3), np.zeros(3), np.zeros(3)
    assert set_pose(on_patch(lambda x, y: -floor + 0 * x * y, **smooth), (0, 0, R - 0.027), *still).f_0[2] < 10.0
    rut = on_pressed_soil(-floor, floor, **smooth)
    assert set_pose(rut, (0, 0, R - floor + 1e-4), *still).f_0[2] == 0.0 == rut.y.contact[0].in_contact
    for below in (3e-4, 1e-3, 2e-3, 3e-3, 5e-3):
        deeper = set_pose(rut, (0, 0, R - floor - below - 1e-5), *still).f_0[2]
        load = set_pose(rut, (0, 0, R - floor - below), *still).f_0[2]
        assert load == pytest.approx(load_on_floor(rut, floor, below), rel=0.015)
        assert rut.y.contact[0].K[2] == pytest.approx((deeper - load) / 1e-5, rel=0.2)
        assert rut.y.diagnostics[0].theta_entry == pytest.approx(np.arccos(1 - below / R), rel=0.03)


def test_a_rut_without_friction_pushes_nobody():
    rut = on_pressed_soil(-0.025, 0.025, n_g=0, c_d=0.0, phi=0.0, c=0.0, eta=1.0, rho=0.0)
    for below in (1e-3, 2e-3, 5e-3):
        wrench = set_pose(rut, (0, 0, R - 0.025 - below), *STRAIGHT)
        assert abs(wrench.f_0[0]) < 1e-3 * wrench.f_0[2]


def test_a_pressed_plain_has_no_walls():
    sideways = np.eye(3), np.array((0.0, 0.05, 0.0)), np.zeros(3)
    wide, narrow = (on_pressed_soil(-0.025, 0.025, n_g=0, c_d=0.0, phi=0.0, c=0.0) for _ in range(2))
    narrow.u.patch[0].sinkage[:, [0, 1, -2, -1]] = 0.0  # a rut: the soil beside it was not pressed
    plain, rut = (-set_pose(instance, (0, 0, R - 0.026), *sideways).f_0[1] for instance in (wide, narrow))
    assert 0.0 <= plain < 0.05 * rut


def test_a_wheel_on_stress_of_two_parts_does_not_feel_compaction():
    with pytest.raises(ModelError, match="normal_model = wong_reece: with compaction the stress is that of the local depth; use bekker"):
        on_pressed_soil(0.0, 0.0, normal_model="wong_reece")


def test_weak_soil_bears_the_share_that_its_yield_pressure_says():
    loads = [set_pose(on_pressed_soil(0.0, 0.0, share, c_d=0.0), (0, 0, R - 0.027), *STRAIGHT).f_0[2] for share in (1.0, 0.5)]
    assert loads[1] == pytest.approx(0.5 * loads[0], rel=0.02)


def test_a_wheel_drives_into_a_rut_without_a_push():
    """The plane is that of the level from which sinkage counts: level at the end of a rut, where heights alone fall by its depth."""

    def step_down(instance):
        patch = instance.u.patch[0]
        patch.z[7:] = -0.025
        return set_pose(instance, (0, 0, R - 0.027), *STRAIGHT).f_0[0]

    rut = on_pressed_soil(0.0, 0.0)
    rut.u.patch[0].sinkage[7:] = 0.025
    modulus, p = SOIL["k_c"] / rut.p.b_w + SOIL["k_phi"], rut.p
    rut.u.patch[0].yield_pressure[7:] = modulus * unloading.tested_depth(unloading.unloading_of(p), modulus, p.n, 0.025, 0.0) ** p.n
    step_down(rut)
    assert rut.y.contact[0].axes[2] == pytest.approx((0, 0, 1), abs=1e-9)
    plain = on_patch(lambda x, y: 0 * x * y)
    assert step_down(plain) > 10.0 and plain.y.contact[0].axes[2, 0] > 0.1


def test_without_a_patch_yet_the_ground_is_flat():
    instance = Instance(BCM(1, 1, 1), **SOIL)
    instance.initialise()
    assert set_pose(instance, (0, 0, R - 0.027), *STRAIGHT).f_0[2] > 100.0
