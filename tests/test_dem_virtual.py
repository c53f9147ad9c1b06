"""Virtual tests of beds of particles: direct shear, angle of repose, plates."""

import math
from dataclasses import replace

import numpy as np
import pytest

from cdl_fmu.dem.apriori import WHEEL_PRESSURE, grains_of, reachable_phi
from cdl_fmu.dem.bed import BedKey
from cdl_fmu.dem.material import Material
from cdl_fmu.dem.scaling import overlap_under
from cdl_fmu.dem.settle import settle
from cdl_fmu.dem.sizes import Uniform
from cdl_fmu.dem.virtual.plate import plates
from cdl_fmu.dem.virtual.repose import repose
from cdl_fmu.dem.virtual.shear import shear
from cdl_fmu.slave.model import ModelError
from cdl_fmu.soil.identify import identify
from cdl_fmu.soil.measurements import read_plates, read_shear

SIZES = Uniform(4.5e-3, 5.5e-3)
MIDDLE = Material(E=1e7, mu=0.5, mu_r=0.1)
QUICK = dict(strain=0.24, rows=40, inertial_number=5e-3)


@pytest.fixture(scope="module")
def bed():
    return settle(BedKey(MIDDLE, SIZES, 0.43, 0.05, (0.066, 0.044)))


def with_grains(bed, **changes):
    """The same particles of another material."""
    return replace(bed, key=replace(bed.key, material=replace(bed.key.material, **changes)))


@pytest.fixture(scope="module")
def sheared(bed):
    return shear(bed, [5e3, 2e4], **QUICK)


def test_strength_grows_with_both_frictions(bed, sheared):
    weak, rough = (shear(with_grains(bed, mu=mu, mu_r=mu_r), [2e4], **QUICK).runs[0] for mu, mu_r in ((0.2, 0.0), (0.5, 0.5)))
    middle = sheared.runs[1]
    assert 0.2 < weak.residual < 0.9 * middle.residual < 0.9 * 0.95 * rough.residual < 0.7


def test_strength_without_cohesion_is_in_proportion_to_the_load_which_is_kept(sheared):
    low, high = sheared.runs
    assert low.residual == pytest.approx(high.residual, rel=0.15)  # of few grains
    for run in sheared.runs:
        assert run.sigma.mean() == pytest.approx(run.p, rel=0.05)
        assert run.j[-1] == pytest.approx(0.24 * 0.05, rel=0.2)
    assert sheared.strength.c < 0.1 * 5e3


def test_the_whole_sample_is_sheared_between_plates_that_grip(sheared):
    for run in sheared.runs:
        assert run.profile[0] < 0.3 and run.profile[-1] > 0.7
        assert np.diff(run.profile).max() < 0.5  # no slip of the whole sample in one place
        assert run.porosity[-1] == pytest.approx(run.porosity[len(run.j) // 2], abs=0.01)


def test_a_pull_of_contacts_is_cohesion(bed):
    """By Rumpf 1970 with as many contacts as the bed has."""
    sticky = with_grains(bed, cohesion=2e3)
    low, high = shear(sticky, [5e3, 2e4], **QUICK).runs
    (tau_low, p_low), (tau_high, p_high) = ((run.tau[20:].mean(), run.sigma[20:].mean()) for run in (low, high))
    slope = (tau_high - tau_low) / (p_high - p_low)
    sigma_t = (1.0 - bed.porosity) * bed.coordination / math.pi * 2e3
    assert tau_low - p_low * slope == pytest.approx(sigma_t * slope, rel=0.5)


def test_progress_reaches_the_end_once(bed):
    shares = []
    shear(bed, [2e4], strain=0.01, rows=5, inertial_number=5e-3, progress=shares.append)
    assert shares == sorted(shares) and shares[-1] == 1.0


def test_the_slope_that_a_wall_leaves_is_steeper_for_rougher_grains():
    bed = settle(BedKey(MIDDLE, SIZES, 0.43, 0.04, (0.066, 0.044)))
    rough, smooth = (repose(with_grains(bed, mu=mu, mu_r=mu_r), wall_speed=0.3) for mu, mu_r in ((0.5, 0.5), (0.2, 0.0)))
    assert math.radians(10.0) < smooth.angle < math.radians(22.0)
    assert max(math.radians(20.0), smooth.angle + math.radians(2.0)) < rough.angle < math.radians(38.0)
    # What ran out is what is missing above.
    assert np.trapezoid(rough.z, rough.x) == pytest.approx(np.trapezoid(smooth.z, smooth.x), rel=0.1)


def test_a_block_too_short_for_a_slope_is_refused(bed):
    with pytest.raises(
        ModelError, match=r"bed is 0.066 m long and 0.05 m deep: for an angle of repose it must be at least 1.5 depths long, 0.075"
    ):
        repose(bed)


@pytest.fixture(scope="module")
def pressed(bed):
    return plates(bed, [0.025, 0.035], sinkage=0.012, speed=0.15, rows=24)


def test_pressure_of_a_plate_grows_with_its_sinkage(pressed):
    for run in pressed.runs:
        assert run.z[0] < 1e-3 and run.p[run.z > 0.0].min() > 0.0
        assert run.z[-1] > 0.01
        assert 0.0 < run.pressure(0.003) < run.pressure(0.01) < 1e5


def test_files_are_read_by_identify(pressed, sheared, tmp_path):
    pressed.write(tmp_path / "plates.csv")
    sheared.write(tmp_path / "shear.csv")
    tests, _ = read_plates(tmp_path / "plates.csv")
    assert [test.b for test in tests] == pytest.approx([0.0125, 0.0175])
    assert tests[1].p == pytest.approx(pressed.runs[1].test.p, rel=1e-5)
    tests, _ = read_shear(tmp_path / "shear.csv")
    assert [test.p for test in tests] == pytest.approx([5e3, 2e4], rel=0.05)
    found = identify(tmp_path / "plates.csv", tmp_path / "shear.csv")
    assert found.values["phi"].value == pytest.approx(sheared.strength.phi, rel=1e-4)
    assert found.values["n"].value == pytest.approx(pressed.sinkage.n, rel=1e-3)


def test_bad_tests_are_refused(bed):
    with pytest.raises(ModelError, match="normal pressure = -5 Pa of a shear test: it must be above 0 Pa"):
        shear(bed, [-5.0])
    with pytest.raises(ModelError, match=r"bed is 0.05 m deep: for a plate of 0.06 m pressed in by 0.025 m it must be at least 0.085 m"):
        plates(bed, [0.06])


def test_grains_of_a_soil_have_its_density_and_are_stiff_enough():
    for linear in (False, True):
        grains = grains_of(phi=0.55, c=100.0, rho=1500.0, porosity=0.44, linear=linear)
        assert grains.linear == linear
        assert grains.density * (1.0 - 0.44) == pytest.approx(1500.0)
        assert overlap_under(grains, WHEEL_PRESSURE) == pytest.approx(0.01, rel=1e-6)


def test_grains_are_rougher_for_stronger_soils_and_for_looser_beds():
    strengths = [grains_of(phi, 0.0, 1500.0, 0.43) for phi in np.radians([27.0, 30.0, 33.0, 36.0])]
    porosities = [grains_of(0.55, 0.0, 1500.0, porosity) for porosity in (0.4, 0.43, 0.46)]
    for grains in (strengths, porosities):
        assert np.all(np.diff([one.mu + one.mu_r for one in grains]) > 0.0)
    assert strengths[0].cohesion == 0.0


def test_pull_of_contacts_is_from_cohesion_by_rumpf():
    one, two = (grains_of(0.55, c, 1500.0, 0.43) for c in (100.0, 200.0))
    assert two.cohesion == pytest.approx(2.0 * one.cohesion)
    assert one.cohesion * 0.57 * 4.5 / math.pi * math.tan(0.55) == pytest.approx(100.0)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        (dict(porosity=0.285), "porosity = 0.285: beds of grains are known between 0.4 and 0.46; take the nearest, which keeps rho"),
        (dict(phi=0.9), r"phi = 0.9 rad \(51.6 deg\): beds of porosity 0.43 have .* take a denser bed"),
        (dict(phi=0.2), r"phi = 0.2 rad \(11.5 deg\): beds of porosity 0.43 have .* take a denser bed"),
        (dict(c=-1.0), "c = -1 Pa: cohesion must be at least 0 Pa"),
        (dict(rho=0.0), "rho = 0 kg/m3: the soil's bulk density must be above 0 kg/m3"),
    ],
)
def test_soils_that_grains_cannot_be_are_refused(changes, text):
    with pytest.raises(ModelError, match=text):
        grains_of(**dict(phi=0.55, c=0.0, rho=1500.0, porosity=0.43) | changes)


def test_what_is_in_reach_is_made():
    for porosity in (0.4, 0.43, 0.46):
        for phi in reachable_phi(porosity):
            grains_of(phi, 0.0, 1500.0, porosity)


@pytest.mark.slow
def test_grains_of_dry_sand_have_its_strength_and_its_slope():
    """Within the scatter of samples of so few grains."""
    grains = grains_of(phi=math.radians(29.0), c=0.0, rho=1330.0, porosity=0.46)
    sample = settle(BedKey(grains, SIZES, 0.46, 0.06, (0.066, 0.066)))
    tests = shear(sample, [4e3, 1e4, 2e4], strain=0.3, inertial_number=2e-3)
    assert math.degrees(tests.strength_without_cohesion.phi) == pytest.approx(29.0, abs=2.0)
    block = settle(BedKey(grains, SIZES, 0.46, 0.08, (0.132, 0.022)))
    assert math.degrees(repose(block, wall_speed=0.2).angle) == pytest.approx(29.0, abs=3.0)
