"""Ground that is a slope: the rover rests and drives on it, soil slides by the true vertical, and level ground is what it was."""

import math

import numpy as np
import pytest
from soil import fields, heap, on_soil, scm, volume_error, wait_for_rest
from test_cli import cdl

from cdl_fmu.frames import vertical
from cdl_fmu.scm.erosion import DTYPE, _flow, _is_steep, _Tilt, _tilt
from cdl_fmu.scm.tiles import FILL, SLIDING
from cdl_fmu.slave.model import Instance, ModelError
from cdl_fmu.terramechanics import unit_weight
from mbs.carriage import Carriage
from mbs.rover import Rover
from orchestrator import open_result
from orchestrator.assemble import assemble
from orchestrator.experiment import ExperimentError, load_experiment
from orchestrator.validate import slopes
from orchestrator.validate.sand import inclinations

WEIGHT = 54 * 9.81
AHEAD, LEFT, BEHIND, RIGHT = 0.0, math.pi / 2, math.pi, -math.pi / 2


def parts_on(tier, slope, uphill, **overrides):
    """The parts of the shipped experiment, where the rover rests on a slope."""
    values = {"environment.slope": slope, "environment.uphill": uphill, **overrides}
    return assemble(load_experiment("two_wheel", tiers=[tier, tier], overrides=values)).instances


# -- gravity


def test_gravity_points_down_the_slope():
    rover = Instance(Rover(), slope=0.2, uphill=0.5)
    rover.initialise()
    for k in range(100):
        rover.step(k * 1e-3, 1e-3)
    assert rover.y.body.v_0 == pytest.approx(-0.981 * np.array(vertical(0.2, 0.5)), rel=1e-9)


def test_soil_weighs_less_along_the_normal_of_a_slope():
    assert unit_weight(1600.0, 9.81, 0.0) == 1600.0 * 9.81
    assert unit_weight(1600.0, 3.71, 0.3) == pytest.approx(1600.0 * 3.71 * math.cos(0.3))
    level, steep = (on_soil(slope=slope, repose=0.5, kappa_q=0.0).sinkage for slope in (0.0, 0.45))
    assert level < steep < 1.05 * level  # what is below the rim bears less


# -- the rover


@pytest.mark.parametrize("tier", ["BCM", "SCM"])
@pytest.mark.parametrize(("uphill", "towards_rear"), [(AHEAD, 1.0), (LEFT, 0.0), (BEHIND, -1.0), (RIGHT, 0.0)])
def test_the_rover_rests_on_a_slope_with_its_weight_on_the_lower_wheel(tier, uphill, towards_rear):
    slope = 0.2
    parts = parts_on(tier, slope, uphill)
    front, rear = (d.normal_load for d in parts[tier.lower()].y.diagnostics)
    assert front + rear == pytest.approx(WEIGHT * math.cos(slope), rel=1e-5)
    moment = (50 * 0.1 + 54 * 0.125) * 9.81 * math.sin(slope)  # of the weight along the slope about the contacts
    assert (rear - front) * 0.3 == pytest.approx(towards_rear * moment, rel=0.02, abs=1e-3)
    assert parts["rover"].p.start.pitch == pytest.approx(-towards_rear * 0.0045, abs=5e-4)


def test_a_rover_that_tips_over_is_not_placed():
    with pytest.raises((ExperimentError, ModelError), match=r"rover .*rest.*check mass.*slope"):
        parts_on("BCM", 0.6, AHEAD, **{"rover.mass_height": 2.0})


@pytest.mark.parametrize("tier", ["BCM", "SCM"])
def test_what_the_wheels_push_is_the_weight_along_the_slope(tier, monkeypatch):
    monkeypatch.setattr(slopes, "_SECONDS", 2.0)
    monkeypatch.setattr(slopes, "_STEADY", 1.0)
    found = {uphill: slopes.drive(tier, 10.0, uphill) for uphill in (AHEAD, LEFT, BEHIND, RIGHT)}
    along, normal = WEIGHT * math.sin(math.radians(10.0)), WEIGHT * math.cos(math.radians(10.0))
    for uphill, one in found.items():
        assert one.pull == pytest.approx(math.cos(uphill) * along, abs=0.01 * WEIGHT)
        assert one.lateral == pytest.approx(math.sin(uphill) * along, abs=0.01 * WEIGHT)
        assert one.load == pytest.approx(normal, rel=0.01)
    assert min(found[AHEAD].slip) > 0.05 > -0.05 > max(found[BEHIND].slip)
    # Across it slides downhill, to the left where the hill is on the right: a mirror image.
    assert max(found[LEFT].slip_angle) < -0.002 and found[LEFT].drift < -0.002
    assert found[RIGHT].path == pytest.approx(found[LEFT].path * (1.0, -1.0), abs=1e-7)
    assert found[RIGHT].slip_angle == pytest.approx([-angle for angle in found[LEFT].slip_angle], abs=1e-6)


def test_the_command_shows_the_drift(tmp_path):
    slope = ["--set", "environment.slope=0.15", "--set", "environment.uphill=1.57"]
    done = cdl("run", "two_wheel", *slope, "--stop-time", "1", "--out", tmp_path)
    assert done.exit_code == 0 and "slip angle [deg]" in done.stdout
    result = open_result(tmp_path)
    assert result.cdl["bcm.diagnostics[1].slip_angle"][-1] < -0.05
    assert "x and y lie in a slope of 0.15 rad, which rises towards 1.57 rad from x to y" in cdl("info", tmp_path).stdout


def test_a_testbed_on_a_slope_presses_its_wheel_along_the_normal():
    carriage = Instance(Carriage(), load=100.0, slope=0.5, lowering_time=0.0, gravity=1.62)
    carriage.initialise()
    carriage.step(0.0, 1e-3)
    assert carriage.x.v_z == pytest.approx(-1e-3 * 1.62 * math.cos(0.5))  # in the air; the carriage holds it along the slope


# -- landslides


@pytest.mark.parametrize(
    ("repose", "slope", "uphill"), [(36.7, 5, 0), (36.7, 20, 0), (36.7, 20, 30), (36.7, 20, 225), (29, 15, 120), (29, 20, -45)]
)
def test_a_heap_on_a_slope_rests_at_the_angle_of_repose_against_the_true_horizontal(repose, slope, uphill):
    angles = {key: math.radians(value) for key, value in (("repose", repose), ("slope", slope), ("uphill", uphill))}
    instance = heap(lambda x, y: np.maximum(0.0, 0.45 - 4.5 * np.hypot(x, y)), 0.5, **angles)
    mass = fields(instance, FILL).sum()
    wait_for_rest(instance)
    assert fields(instance, FILL).sum() == mass and volume_error(instance) == mass
    assert np.degrees(inclinations(instance)) == pytest.approx(repose, abs=1.0)


def test_mirrored_slopes_slide_to_mirrored_heaps():
    def rest(uphill):
        instance = heap(lambda x, y: np.maximum(0.0, 0.2 - 2.0 * np.hypot(x, y)), 0.4, slope=0.3, uphill=uphill)
        wait_for_rest(instance)
        return inclinations(instance)

    left, right = rest(LEFT), rest(RIGHT)
    assert right[np.r_[0, 7:0:-1]] == pytest.approx(left, abs=1e-6)


def test_a_slope_just_below_the_angle_of_repose_is_at_rest_and_a_rut_in_it_comes_to_rest():
    carriage = on_soil(repose=0.5, slope=0.499)
    carriage.move(0.3, forward=0.1, rate=1.0)
    flat = heap(lambda x, y: 0.0 * x, 0.3, repose=0.5, slope=0.499)
    wait_for_rest(flat, 0.05)
    assert not fields(flat, FILL).any()
    carriage.load = None
    carriage.move(0.02, up=10.0)
    wait_for_rest(carriage.instance, 30.0)
    assert carriage.instance.pool.head[SLIDING] == 0 and volume_error(carriage.instance) == 0.0


@pytest.mark.parametrize("uphill", [0.0, 0.7, -2.0])
def test_a_face_is_steep_by_the_exact_angle_between_its_normal_and_the_vertical(uphill):
    p = scm(slope=0.4, uphill=uphill).p
    tan, e = math.tan(p.phi), np.array(vertical(0.4, uphill))
    tilt = _tilt(p, tan)
    for x, y in np.random.default_rng(1).uniform(-2.0, 2.0, (200, 2)):
        angle = math.acos(np.array([-x, -y, 1.0]) @ e / math.hypot(1.0, x, y))
        assert _is_steep(p, tan, tilt, x * p.cell, y * p.cell) == (angle > math.atan(tan + 0.004))


@pytest.mark.parametrize("uphill", [0.0, 0.7, -2.0])
def test_the_steepest_drops_across_corners_are_lines_at_the_angle_of_repose(uphill):
    p, e = scm(slope=0.4, uphill=uphill).p, np.array(vertical(0.4, uphill))
    tilt, half = _tilt(p, math.tan(p.phi)), math.sqrt(0.5)
    for drop, x, y in ((tilt.ahead, half, half), (tilt.behind, -half, -half), (tilt.left, -half, half), (tilt.right, half, -half)):
        assert math.asin(np.array([x, y, -drop]) @ -e / math.hypot(1.0, drop)) == pytest.approx(p.phi)


def test_soil_slides_down_the_line_of_steepest_descent():
    p = scm(slope=0.4, uphill=0.7).p
    tan, e = math.tan(p.phi), np.array(vertical(0.4, 0.7))
    tilt = _tilt(p, tan)
    for direction in np.linspace(0.0, 6.0, 7):
        # The gradient in this direction at the angle of repose, and a little beyond it.
        r = np.linspace(0.0, 5.0, 50001)
        x, y = r * math.cos(direction), r * math.sin(direction)
        steepest = np.argmax((e[2] - x * e[0] - y * e[1]) / np.sqrt(1.0 + r * r) < math.cos(math.atan(tan)))
        x, y = 1.001 * x[steepest], 1.001 * y[steepest]
        normal = np.array([-x, -y, 1.0])
        descent = -(e - normal * (normal @ e) / (normal @ normal))[:2]
        flow = np.array(_flow(p, tan, tilt, x * p.cell, y * p.cell))
        assert flow / np.linalg.norm(flow) == pytest.approx(descent / np.linalg.norm(descent), abs=5e-3)


def test_level_ground_is_the_limit_of_a_slope_and_uphill_then_means_nothing():
    def rest(**slope):
        instance = heap(lambda x, y: np.maximum(0.0, 0.15 - 1.5 * np.hypot(x, y)), 0.3, **slope)
        wait_for_rest(instance)
        return fields(instance, FILL).copy()

    assert np.array_equal(rest(), rest(uphill=1.0))
    assert rest(slope=1e-9) == pytest.approx(rest(), abs=1e-6)
    p, none = scm().p, _Tilt(0.0, 0.0, math.tan(0.6), math.tan(0.6), math.tan(0.6), math.tan(0.6))
    for x, y in np.random.default_rng(2).uniform(-0.03, 0.03, (50, 2)):
        assert _flow(p, math.tan(0.6), none, x, y) == _flow(p, math.tan(0.6), None, x, y)  # to the last bit
    assert DTYPE.names == ("z", "held", "moved", "steep")


# -- refusals


def test_a_slope_above_the_angle_of_repose_is_refused():
    text = r"slope = 0.65 rad: steeper than the soil's angle of repose, 0.6405 rad, it slides down by itself; use at most 0.6405 rad, or"
    with pytest.raises(ModelError, match=text):
        scm(slope=0.65)
    with pytest.raises(ExperimentError, match=r"--set environment.slope: environment.slope = 0.65 rad: steeper than"):
        load_experiment("two_wheel", tiers=["SCM", "BCM"], overrides={"environment.slope": 0.65}).instances()
    scm(slope=0.65, repose=0.66)
    text = r"slope = 0.65 rad: steeper than the soil's friction holds, phi = 0.6405 rad; use at most 0.6405 rad"
    with pytest.raises(ExperimentError, match=text):
        load_experiment("two_wheel", overrides={"environment.slope": 0.65}).instances()
    with pytest.raises(ExperimentError, match=r"environment.slope = -0.1 rad: it must be at least 0 rad"):
        load_experiment("two_wheel", overrides={"environment.slope": -0.1})
    with pytest.raises(ExperimentError, match=r"environment.uphill = 90 rad: it must be at most 6.28319 rad"):
        load_experiment("two_wheel", overrides={"environment.uphill": 90})
