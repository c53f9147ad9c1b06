"""SCM on undisturbed ground from a raster: its heights, wheels at rest on slopes, and where it ends."""

import math

import numpy as np
import pytest
from soil import LOAD, Carriage, R, scm, surface, volume_error

from cdl_fmu.scm import SCM
from cdl_fmu.slave.model import Instance, ModelError

H = 1e-3


@pytest.fixture
def raster(tmp_path):
    """Writes ground that rises by these slopes from its middle, 2 m x 2 m in size; its node [0, 0] is the first corner."""

    def write(slope_x=0.0, slope_y=0.0, height=1.0, middle=(0.0, 0.0)):
        s = np.linspace(-1.0, 1.0, 41)
        z = height + slope_x * s[:, None] + slope_y * s[None, :]
        np.savez(tmp_path / "base.npz", z=z, origin=np.array(middle) - 1.0, spacing=0.05)
        return tmp_path / "base.npz"

    return write


def settle(instance, x, y, z, seconds=1.5):
    """Put down a wheel that cannot roll, free to move as a body of its load; force [N] and position [m] at the end."""
    wheel = instance.u.wheel[0]
    wheel.active = 1.0
    wheel["T"][:] = np.eye(3)
    mass, r, v = LOAD / 9.81, np.array([x, y, z]), np.zeros(3)
    for k in range(round(seconds / H)):
        wheel.r_0[:], wheel.v_0[:] = r, v
        instance.step(k * H, H)
        K, D = np.array(instance.y.contact[0].K), np.array(instance.y.contact[0].D)
        v += H * (instance.y.wheel[0].f_0 - [0.0, 0.0, LOAD] - H * K * v) / (mass + H * D + H * H * K)
        r = r + H * v
    return instance.y.wheel[0].f_0, r


@pytest.mark.parametrize(("along", "across"), [(0, 0), (10, 0), (0, 10), (-12, 12), (20, 0)])
def test_a_wheel_rests_on_a_slope_with_its_force_along_gravity(raster, along, across):
    slopes = [math.tan(math.radians(angle)) for angle in (along, across)]
    instance = scm(base=raster(*slopes))
    steepest = math.hypot(*slopes)
    force, r = settle(instance, 0.013, 0.007, 1.0 + R * math.hypot(1.0, steepest))
    assert force == pytest.approx([0.0, 0.0, LOAD], abs=0.01 * LOAD)
    assert np.hypot(*(r[:2] - [0.013, 0.007])) < 0.02  # it stays
    assert volume_error(instance) == 0.0
    sunk = 1.0 + slopes[0] * r[0] + slopes[1] * r[1] - (r[2] - R)
    assert instance.y.diagnostics[0].sinkage == pytest.approx(sunk, abs=1e-9)


def test_level_ground_from_a_raster_is_that_of_ground_z(raster):
    from_raster, flat = scm(base=raster(height=0.3), ground_z=7.0), scm(ground_z=0.3)
    for instance in from_raster, flat:
        carriage = Carriage(instance, depth=0.02)
        carriage.r[2] += 0.3
        carriage.move(0.05, forward=0.1, rate=1.0)
    assert from_raster.y.tobytes() == flat.y.tobytes()


def test_touched_soil_has_the_rasters_heights(raster):
    instance = scm(base=raster(0.2, -0.1))
    carriage = Carriage(instance, at=(0.2, 0.1))
    carriage.r[2] += 1.03 + 0.02
    carriage.move(H)
    ground = surface(instance)
    x, y = (o + ground.spacing * np.arange(n) for o, n in zip(ground.origin, ground.z.shape))
    inside = (np.abs(x)[:, None] <= 1.0) & (np.abs(y)[None, :] <= 1.0) & np.isfinite(ground.z)
    assert inside.sum() > 1000
    assert ground.z[inside] == pytest.approx((1.0 + 0.2 * x[:, None] - 0.1 * y[None, :])[inside], abs=1e-12)


def test_a_wheel_that_leaves_the_raster_is_refused(raster):
    carriage = Carriage(scm(base=raster(height=0.0)), at=(0.8, 0.0), depth=0.01)
    with pytest.raises(
        ModelError, match=r"wheel 1, at .* m, leaves the map: keep it, half a wheel's length inside, .* and the base raster"
    ):
        carriage.move(1.0, forward=0.5, rate=4.0)
    assert carriage.r[0] == pytest.approx(1.0 - R - 0.01, abs=1e-3)


def test_a_patch_beyond_the_raster_is_refused(raster):
    instance = Instance(SCM(1, 1), "scm", base=raster(height=0.0))
    instance.u.wheel["active"] = 0.0
    instance.initialise()
    instance.u.trailing[0].r_0[:] = 0.7, 0.0, 0.1
    instance.step(0.0, H)
    assert instance.y.patch[0].spacing == 0.03
    instance.u.trailing[0].r_0[0] = 0.9
    with pytest.raises(ModelError, match=r"patch\[1\] reaches beyond the map: keep trailing\[1\].r_0, now .* and the base raster"):
        instance.step(H, H)


def test_wheels_without_a_pose_are_waited_for_even_if_the_raster_does_not_hold_the_origin(raster):
    """Some masters send zeros before the first step."""
    instance = Instance(SCM(1, 1), "scm", base=raster(middle=(50.0, 20.0)))
    instance.u.wheel["active"] = 1.0
    instance.initialise()
    instance.step(0.0, H)
    assert not instance.y.wheel[0].f_0.any() and instance.y.patch[0].spacing == 0.0
    assert instance.warnings == ["scm: wheel 1 has no pose yet (T is no rotation or nothing was ever set): no force (t = 0 s)"]


def test_what_is_wrong_with_a_raster_is_said_with_its_parameter(tmp_path):
    np.savez(tmp_path / "base.npz", z=np.full((5, 5), np.nan), origin=np.zeros(2), spacing=0.1)
    with pytest.raises(ModelError, match=r"^base = base.npz: 25 of 25 nodes have no height \(NODATA, NaN or infinite\); fill them"):
        scm(base=tmp_path / "base.npz")
