"""The chapter's experiment with BCM on both wheels (BxB): what section 8.5.1 says of it, on the shipped experiment as it is."""

import numpy as np
import pytest

import orchestrator
from orchestrator.report import wheels_of

WEIGHT = (50.0 + 2 * 2.0) * 9.81


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    outcome = orchestrator.simulate("two_wheel", tmp_path_factory.mktemp("two_wheel"))
    assert outcome.warnings == []
    result = orchestrator.open_result(outcome.result)
    front, rear = wheels_of(result)
    x = rear.centre("x")
    forces = {
        f"{axis}_{wheel.name}": wheel.diagnostic(name)
        for wheel in (front, rear)
        for axis, name in (("F_x", "drawbar_pull"), ("F_y", "lateral_force"), ("F_z", "normal_load"))
    }
    return {"x": x, "t": result.time.values, "z_front": front.centre("z"), "z_rear": rear.centre("z"), **forces}


def between(drive, low, high):
    return (drive["x"] >= low) & (drive["x"] < high) & (drive["t"] > 0.0)


def test_it_starts_at_rest_in_equilibrium(drive):
    first = slice(1, 3)  # the row at t = 0 comes before the contacts' first step
    assert drive["F_z_front"][first] + drive["F_z_rear"][first] == pytest.approx(WEIGHT, rel=1e-3)
    assert drive["z_front"][0] == pytest.approx(drive["z_rear"][0], abs=1e-9)


def test_a_positive_peak_of_both_tractive_forces_at_the_start(drive):
    start = between(drive, 0.0, 0.1)
    assert drive["F_x_front"][start].max() > 5.0 and drive["F_x_rear"][start].max() > 5.0


def test_stationary_by_0_1_m_with_tractive_forces_that_cancel(drive):
    straight = between(drive, 0.1, 0.89)
    for name in ("F_x_front", "F_x_rear"):
        assert np.ptp(drive[name][straight]) < 0.01 * WEIGHT / 2
    assert np.abs(drive["F_x_front"] + drive["F_x_rear"])[straight].max() < 0.01 * WEIGHT / 2
    assert np.abs(drive["F_y_rear"])[straight].max() < 1e-6


def test_nothing_changes_where_the_front_wheels_rut_would_be(drive):
    before, inside = between(drive, 0.15, 0.35), between(drive, 0.35, 0.89)
    for name in ("F_x_front", "F_x_rear", "F_z_front", "F_z_rear"):
        assert drive[name][inside].mean() == pytest.approx(drive[name][before].mean(), abs=0.002 * WEIGHT / 2)
    assert drive["z_rear"][inside].mean() == pytest.approx(drive["z_rear"][before].mean(), abs=5e-5)


def test_steering_first_pushes_against_the_turn_then_the_front_wheel_pulls(drive):
    onset, turned = between(drive, 0.9, 0.93), between(drive, 1.05, 1.15)
    assert drive["F_y_rear"][onset].min() < -1.0 < 20.0 < drive["F_y_rear"][turned].mean()
    assert drive["F_x_front"][turned].mean() > 20.0
    assert drive["F_x_rear"][turned].mean() < -20.0


def test_both_tractive_forces_are_near_zero_where_the_wheels_are_aligned_again(drive):
    around, peak = between(drive, 1.25, 1.4), drive["F_x_front"][between(drive, 1.0, 1.2)].max()
    for name in ("F_x_front", "F_x_rear"):
        nearest = np.abs(drive[name][around]).argmin()
        assert np.abs(drive[name][around][nearest]) < 0.05 * peak
        assert drive["x"][around][nearest] == pytest.approx(1.3, abs=0.04)


def test_stationary_again_after_1_6_m(drive):
    end = between(drive, 1.6, 9.0)
    for name in ("F_x_front", "F_x_rear", "F_y_front", "F_y_rear"):
        assert np.ptp(drive[name][end]) < 0.02 * WEIGHT / 2
    assert drive["F_x_front"][end].mean() > 20.0
