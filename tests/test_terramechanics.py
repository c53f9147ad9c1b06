"""One equation, one function: closed values of Table 8.2's soil."""

import math

import pytest

from cdl_fmu import terramechanics as tm
from cdl_fmu.soil import load_soil

SOIL = load_soil("mss_d")
N_PHI = tm.flow_value(SOIL["phi"])


@pytest.mark.parametrize(
    ("diameter", "pressures"), [(0.100, (1987, 11165, 30643)), (0.150, (2187, 12287, 33721))], ids=["100 mm plate", "150 mm plate"]
)
def test_bekker_plates(diameter, pressures):
    k_eq = tm.bekker_modulus(SOIL["k_c"], SOIL["k_phi"], diameter / 2)
    for z, p in zip((0.01, 0.02, 0.03), pressures):
        assert tm.bekker(k_eq, z, SOIL["n"]) == pytest.approx(p, rel=3e-4)
    assert tm.bekker(k_eq, -0.01, SOIL["n"]) == 0.0


def test_bekker_modulus_changes_no_sign_under_a_narrow_patch():
    assert tm.bekker_modulus(-2.86e6, 2.47e8, 0.125) == pytest.approx(2.2412e8)
    assert tm.bekker_modulus(-2.86e6, 2.47e8, 0.01) == tm.LEAST_MODULUS_SHARE * 2.47e8


def test_mohr_coulomb():
    assert tm.mohr_coulomb(66.5, 1e4, math.tan(SOIL["phi"])) == pytest.approx(66.5 + 7453.8, rel=1e-4)


def test_shear_velocity_law_is_smooth_at_rest_and_saturates():
    assert tm.janosi_velocity(0.0, 0.05) == 1 / 0.05
    for v in (1e-12, 4.99e-5, 5.01e-5, 1e-3, 0.05, 10.0):
        assert tm.janosi_velocity(v, 0.05) * v == pytest.approx(-math.expm1(-v / 0.05), rel=1e-12)
    assert tm.janosi_displacement(0.02, 0.02) == pytest.approx(1 - math.exp(-1))


def test_mapped_shear_velocity_mobilises_as_the_displacement_does():
    v, omega, arc, K = 0.03, 1.3, 0.4, 0.02
    V_j = tm.mapped_shear_velocity(K, omega, arc)
    assert tm.janosi_velocity(v, V_j) * v == pytest.approx(tm.janosi_displacement(v * arc / omega, K))


def test_exit_share_falls_from_1_to_eta():
    assert tm.exit_share(0.3, 0.0, 0.01) == tm.exit_share(0.3, -1.0, 0.01) == 1.0
    assert tm.exit_share(0.3, 0.01, 0.01) == pytest.approx(0.3 + 0.7 / math.e)
    assert tm.exit_share(0.3, 1.0, 0.01) == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("v_x", "rim", "travel"), [(0.1, 0.125, 0.125), (0.1, 0, 0.1), (0, 0.2, 0.2), (-0.1, -0.2, -0.2), (0.1, -0.1, 0), (-0.2, 0.05, -0.15)]
)
def test_travel_speed(v_x, rim, travel):
    assert tm.travel_speed(v_x, rim) == pytest.approx(travel)


@pytest.mark.parametrize(
    ("v_x", "rim", "slip"), [(0.08, 0.1, 0.2), (0.1, 0.08, -0.2), (-0.08, -0.1, 0.2), (0.1, 0.0, -1.0), (0.0, 0.1, 1.0), (0.0, 0.0, 0.0)]
)
def test_slip_ratio(v_x, rim, slip):
    assert tm.slip_ratio(v_x, rim, 1e-3) == pytest.approx(slip)


def test_wong_reece_mirror_maps_the_exit_to_the_entry():
    assert tm.wong_reece_mirror(-0.2, 0.7, -0.2, 0.3) == pytest.approx(0.7)
    assert tm.wong_reece_mirror(0.3, 0.7, -0.2, 0.3) == pytest.approx(0.3)


def test_rankine_flow_value_and_wall():
    assert pytest.approx(3.970, abs=5e-4) == N_PHI
    assert tm.rankine_wall(SOIL["rho"] * 9.81, 0.03, 0.0, 0.0, SOIL["c"], N_PHI) == pytest.approx(41.18, abs=0.05)
    # A wall below another bears what one wall of both heights bears.
    deep = tm.rankine_wall(1.8e4, 0.01, 0.0, 100.0, 50.0, 4.0) + tm.rankine_wall(1.8e4, 0.02, 0.01, 100.0, 50.0, 4.0)
    assert deep == pytest.approx(tm.rankine_wall(1.8e4, 0.03, 0.0, 100.0, 50.0, 4.0))
