"""Where made-up signals are found to be stationary."""

import numpy as np
import pytest

from orchestrator.stationary import Signal, stationary_part

PATH = np.linspace(0.0, 0.5, 2001)
SETTLING = 10.0 + 5.0 * np.exp(-PATH / 0.03)  # within 0.2 of its end from 0.1 m on


def found(*values, ripple=0.0, tolerance=0.2):
    return stationary_part(PATH, [Signal(v, tolerance) for v in values], ripple)


def noise(deviation, seed=1):
    return np.random.default_rng(seed).normal(0.0, deviation, PATH.size)


def test_a_constant_is_stationary_from_the_start():
    part = found(0.0 * PATH + 7.0)
    assert part == (type(part))(part.first, True, (0.0,)) and PATH[part.first] < 0.01


def test_a_signal_that_settles_is_stationary_once_it_is_in_the_band():
    part = found(SETTLING)
    assert part.stationary
    assert PATH[part.first] == pytest.approx(0.03 * np.log(5.0 / 0.2), abs=0.005)


@pytest.mark.parametrize("deviation", [0.1, 1.0])
def test_noise_neither_hides_the_part_nor_makes_it_up(deviation):
    part = found(SETTLING + noise(deviation))
    assert part.stationary
    assert 0.03 < PATH[part.first] < 0.2
    assert (SETTLING + noise(deviation))[part.first :].mean() == pytest.approx(10.0, abs=0.1)


def test_the_signal_that_settles_last_counts():
    late = 10.0 - 5.0 * np.exp(-PATH / 0.08)
    assert found(SETTLING, late).first == found(late).first > found(SETTLING).first


def test_a_ripple_of_the_grousers_is_no_drift_however_large_it_is():
    ripple = 0.026
    sawtooth = 5.0 * (PATH / ripple % 1.0)
    part = found(SETTLING + sawtooth, ripple=ripple)
    assert part.stationary
    assert 0.05 < PATH[part.first] < 0.2


def test_a_long_ripple_is_cut_to_a_sixteenth_of_the_path():
    assert found(10.0 + 0.0 * PATH, ripple=10.0).stationary


def test_a_drift_is_told_per_metre_and_the_last_quarter_is_given():
    part = found(10.0 + 2.0 * PATH)
    assert not part.stationary
    assert PATH[part.first] == pytest.approx(0.375, abs=0.005)
    assert part.drifts == pytest.approx((2.0,), rel=0.02)
    assert found(10.0 - 2.0 * PATH).drifts == pytest.approx((-2.0,), rel=0.02)


def test_a_drift_that_would_not_cross_the_band_over_the_whole_path_is_none():
    assert found(10.0 + 0.7 * PATH).stationary


def test_what_rises_and_falls_again_is_not_stationary():
    hump = 0.6 * np.sin(np.pi * np.clip((PATH - 0.2) / 0.3, 0.0, 1.0))
    assert not found(10.0 + hump).stationary


def test_a_signal_that_settles_only_at_the_end_is_not_stationary():
    assert not found(10.0 + 5.0 * np.exp(-PATH / 0.3)).stationary


def test_a_tolerance_may_be_relative_to_the_mean():
    drifting = [Signal(factor * (10.0 + 1.0 * PATH), 0.0, relative=0.03) for factor in (1.0, 100.0)]
    assert all(stationary_part(PATH, [signal]).stationary for signal in drifting)
    assert not stationary_part(PATH, [Signal(drifting[0].values, 0.0, relative=0.02)]).stationary


@pytest.mark.parametrize("n", [0, 1, 2, 20])
def test_too_few_rows_are_not_stationary(n):
    part = stationary_part(PATH[:n], [Signal(SETTLING[:n], 0.2)])
    assert not part.stationary and part.drifts == (0.0,)
    assert part.first == max(n - max(n // 4, 1), 0)


def test_a_path_on_which_nothing_moves_is_not_stationary():
    assert not stationary_part(np.zeros(100), [Signal(np.ones(100), 0.1)]).stationary
