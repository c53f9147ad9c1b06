"""What SCM refuses, what it says, and that it can go on from the state before."""

import math

import numpy as np
import pytest
from soil import LOAD, Carriage, on_soil, scm

from cdl_fmu.scm import SCM
from cdl_fmu.slave.model import Instance, ModelError

OFF_MAP = r"wheel 1, at \([-\d.]+, [-\d.]+\) m, leaves the map: keep it, .* within map_min, map_max \("


@pytest.mark.parametrize(
    ("parameters", "text"),
    [
        (dict(cell=0.05), r"cell = 0.05 m: larger than a third of the wheel's width b_w = 0.125 m; use at most 0.0417 m"),
        (dict(cell=math.nan), r"cell = nan m: it must be finite"),
        (dict(repose=-0.1), r"repose = -0.1 rad: it must be at least 0 rad \(Angle of repose, below 90 deg; 0 = phi"),
        (dict(repose=1.6), r"repose = 1.6 rad: it must be at most 1.55 rad \(Angle of repose, below 90 deg; 0 = phi"),
        (dict(plasticity=1.1), r"plasticity = 1.1: it must be at most 1 "),
        (dict(unloading_ratio=0), r"unloading_ratio = 0: it must be at least 1 "),
        (dict(rho=1.6), r"rho = 1.6 kg/m3: lighter than any soil; use at least 100 kg/m3 \(1 g/cm3 is 1000 kg/m3\), or 0"),
        (dict(layer_depth=0), r"layer_depth = 0 m: it must be at least 0.001 m"),
        (dict(max_tiles=0), r"max_tiles = 0: it must be at least 1 "),
        (dict(n_g=2.5), r"n_g = 2.5: the number of grousers must be whole"),
        (dict(erosion_sweeps=2.5), r"erosion_sweeps = 2.5: it must be a whole number"),
        (dict(n_g=500), r"n_g = 500: grousers of t_g = 0.002 m fill more than the 0.848 m around their tips; use fewer or thinner"),
        (dict(map_min=(0, 2), map_max=(1, 1)), r"map_min = 2 m along y: it must be less than map_max, which is 1 m"),
        (dict(threads=1.5), r"threads = 1.5: it must be a whole number, on this machine at most \d+; .* NUMBA_NUM_THREADS"),
        (dict(threads=200), r"threads = 200: it must be a whole number, on this machine at most \d+; .* NUMBA_NUM_THREADS"),
        (dict(pressure_model="wong"), r"pressure_model = 'wong': choose one of bekker, reece"),
        (
            dict(b_w=0.01, cell=0.003),
            r"k_c = -2.86e\+06 N/m\^3.49: k_c/b \+ k_phi < 0 for wheel width b = 0.01 m; use a wheel wider than 0.0116 m or another soil",
        ),
    ],
)
def test_parameters_that_are_refused(parameters, text):
    with pytest.raises(ModelError, match=text):
        scm(**parameters)


@pytest.mark.parametrize(
    ("parameters", "start", "velocities", "text"),
    [
        (dict(map_max=(0.2, 1.0)), {}, dict(forward=0.2), OFF_MAP + r"-1e\+06 to 0.2 m in x"),
        (
            dict(map_min=(-1.0, -0.2)),
            {},
            dict(sideways=-0.1),
            OFF_MAP + r"-1 to 1e\+06 m in x, -0.2 to 1e\+06 m in y\) and the base raster",
        ),
        (
            dict(layer_depth=0.02),
            dict(depth=0.01),
            dict(up=-0.05),
            "wheel 1 is pressed through the soil's layer, layer_depth = 0.02 m: raise layer_depth, lighten the wheel or take a stronger",
        ),
        (
            dict(max_tiles=12),
            {},
            dict(forward=0.2),
            "the soil's pool is full, max_tiles = 12 of 16 x 16 cells of 0.01 m: raise max_tiles, coarsen",
        ),
        (
            {},
            dict(depth=0.3),
            {},
            r"wheel 1 is buried: its centre, at \(0, 0, -0.175\) m, is more than its radius of 0.125 m .*ground_z",
        ),
        ({}, {}, dict(forward=math.nan), r"wheel\[1\].v_0\[1\] = nan m/s: it must be finite"),
        (
            {},
            dict(camber=0.5 * math.pi),
            {},
            r"wheel 1 lies on its side: its axle, wheel\[1\].T\[2,1:3\] = \(.*, .*, 1.000\), is more than 80 deg",
        ),
    ],
)
def test_a_refused_step_says_why_and_can_be_taken_back(parameters, start, velocities, text):
    carriage = Carriage(scm(**parameters), **start)
    instance = carriage.instance
    with pytest.raises(ModelError, match=text + r".*t = [\d.]+ s"):
        for k in range(3000):
            saved = instance.save()
            carriage.set_inputs(**velocities)
            inputs = instance.block[instance.slices["u"]].copy()
            instance.step(k * 1e-3, 1e-3)
            carriage.move_on(1e-3)
    assert np.array_equal(instance.block[instance.slices["u"]], inputs, equal_nan=True)
    assert np.array_equal(instance.x, saved.block[instance.slices["x"]].view(instance.x.dtype)[0])
    instance.restore(saved)
    assert np.array_equal(instance.block, saved.block)
    instance.step(0.0, 1e-3)
    assert np.isfinite(instance.block).all()


@pytest.mark.parametrize("h", [math.nan, math.inf, -1e-3])
def test_a_step_of_no_sensible_length(h):
    instance = on_soil().instance
    before = instance.save()
    with pytest.raises(ModelError, match=r"scm: step length h = .* s at t = 0 s: it must be finite and not negative"):
        instance.step(0.0, h)
    assert np.array_equal(instance.block, before.block)


def test_a_refused_step_leaves_the_soil_as_it_was():
    carriage = on_soil(layer_depth=0.03)
    instance = carriage.instance
    carriage.set_inputs()
    before = instance.save()
    carriage.r[2] -= 0.02
    carriage.set_inputs(forward=0.1, rate=1.0)
    with pytest.raises(ModelError, match="pressed through"):
        instance.step(0.0, 1e-3)
    after = instance.save()
    assert np.array_equal(before.block[instance.slices["x"]], after.block[instance.slices["x"]])
    assert instance.pool.to_bytes(before.pool) == instance.pool.to_bytes(after.pool)


def test_a_trailing_wheel_whose_patch_reaches_beyond_the_map():
    instance = Instance(SCM(1, 1), "scm", map_max=(1.0, 1.0))
    instance.u.wheel[0].r_0[:] = 0.0, 0.0, 0.12
    instance.initialise()
    instance.u.trailing[0].r_0[:] = 0.9, 0.0, 0.12
    text = r"scm: patch\[1\] reaches beyond the map: keep trailing\[1\].r_0, now \(0.9, 0\) m, half a patch .* \(-1e.06 to 1 m"
    with pytest.raises(ModelError, match=text):
        instance.step(0.0, 1e-3)
    instance.u.trailing[0].r_0[0] = 0.5
    instance.step(0.0, 1e-3)
    assert instance.y.patch[0].spacing == 0.03


def test_a_wheel_without_a_pose_is_an_error_after_two_steps():
    instance = Instance(SCM(), "scm")
    instance.initialise()
    for k in range(2):
        instance.step(k * 1e-3, 1e-3)
    assert len(instance.warnings) == 1 and "wheel 1 has no pose yet" in instance.warnings[0]
    with pytest.raises(ModelError, match=r"wheel\[1\] still has no pose after 2 steps: connect wheel\[1\].r_0, T, v_0, w_0"):
        instance.step(2e-3, 1e-3)


def test_a_wheel_that_is_off_is_not_looked_at():
    carriage = Carriage(scm(map_max=(0.5, 0.5)), at=(3.0, 0.0), load=LOAD)
    carriage.instance.u.wheel[0].active = 0.0
    carriage.move(0.01)
    assert not carriage.reading()[:6].any()


def test_a_patch_that_is_shorter_than_the_contact():
    text = r"patch_spacing = 0.01 m: a patch of 13 x 9 nodes does not reach .* r_w = 0.125 m; use at least 0.0268 m"
    with pytest.raises(ModelError, match=text):
        Instance(SCM(1, 1), "scm", patch_spacing=0.01).initialise()
