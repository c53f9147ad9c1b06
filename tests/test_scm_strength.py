"""What soil bears that is sheared, pushed along or heaped up."""

import math

import numpy as np
import pytest
from soil import BARE, Carriage, scm

from cdl_fmu.strength import (
    angle,
    critical_pressure,
    escape,
    exponential,
    left_by_push,
    log_of_friction,
    log_of_push,
    softened,
    strength_of,
    yield_pressure,
)

#: Sand and smooth wheel of the CMU single-wheel tests; 5 mm cells.
SAND = dict(k_c=-2.335e5, k_phi=1.219e7, n=1.373, c=0.0, phi=math.radians(29.0), rho=1330.0, K=0.021)
WHEEL = dict(r_w=0.058, b_w=0.05, n_g=0, cell=0.005, tau_r=0.0)
WEIGHT = 24.0


def strength(width=0.05, length=0.05, depth=0.02, speed=1.0, **parameters):
    p = scm(**SAND | WHEEL | parameters).p
    return strength_of(p, True, p.phi, width, length, depth, speed)


def test_friction_that_pushes_soil_to_where_it_escapes_takes_its_strength():
    tan_phi = math.tan(math.radians(29.0))
    assert log_of_friction(tan_phi, 0.0) == pytest.approx(0.0, abs=1e-12)
    # Prandtl's N_q with all friction on the base, by hand: (1 + sin) exp((pi/2 - phi) tan) over (1 + sin)/(1 - sin) exp(pi tan).
    phi = math.atan(tan_phi)
    full = math.log(1.0 - math.sin(phi)) - (math.pi / 2 + phi) * tan_phi
    assert log_of_friction(tan_phi, tan_phi) == pytest.approx(full, rel=1e-9)
    assert log_of_friction(tan_phi, -tan_phi) == pytest.approx(math.log(1.0 - math.sin(phi)) + (math.pi / 2 + phi) * tan_phi, rel=1e-9)
    table = scm(**SAND | WHEEL).x.pushes
    for share in np.linspace(-0.98, 0.98, 41):
        assert log_of_push(table, share) == pytest.approx(log_of_friction(tan_phi, share * tan_phi), abs=0.01)


def test_sheared_soil_bears_what_vesic_says_of_a_footing():
    """By hand for 29 deg: N_q 16.44, N_gamma 19.34, d_q factor 2 tan(phi) (1 - sin(phi))^2 = 0.2943."""
    gamma = 1330.0 * 9.81
    square = strength()
    by_hand = gamma * 0.02 * 16.443 * (1.0 + 0.55431) * (1.0 + 0.2943 * 0.4) + 0.5 * gamma * 0.05 * 19.338 * 0.6
    assert critical_pressure(square, 0.02) == pytest.approx(by_hand, rel=1e-3)
    assert strength(rho=2660.0).weight == pytest.approx(2.0 * square.weight)
    # A path of 0.7 K takes 63 %.
    assert softened(square, 0.7 * 0.021) == pytest.approx(1.0 - math.exp(-1.0))


def test_loose_soil_bears_as_sheared_soil_does_and_dense_soil_more():
    s, dense = strength(), 35e3
    sheared = critical_pressure(s, 0.02)
    assert sheared < dense
    assert yield_pressure(s, dense, 0.02, 0.0, 0.0, 1.0) == dense
    assert yield_pressure(s, dense, 0.02, 0.02, 0.0, 1.0) == sheared == yield_pressure(s, dense, 0.02, 0.0, 1.0, 1.0)
    assert yield_pressure(s, dense, 0.02, -0.01, 0.5, 0.4) == pytest.approx(0.4 * 0.5 * (dense + sheared))


def pushed(ahead, behind, beside=0.0):
    return left_by_push(strength(), ahead, behind, beside)


@pytest.mark.parametrize("x", [-5.0, -1.0, -1e-6, 0.0, 1.0, 3.0])
def test_the_exponential_function_is_near_enough(x):
    assert exponential(x) == pytest.approx(math.exp(x), rel=abs(x) ** 5 / 1e8 + 1e-14)
    assert 0.0 < exponential(-1e300) < 1e-8


def test_soil_escapes_where_it_is_pushed_and_to_where_the_base_faces():
    s, none = strength(), (1.0, 1.0, 1.0)
    assert escape(s, 0.0, 0.0, *none) == 1.0
    assert escape(s, 0.5, math.sin(0.5), *none) == pytest.approx(escape(strength(speed=0.0), -0.5, -math.sin(0.5), *none), rel=0.2)
    assert escape(s, 0.5, math.sin(0.5), *pushed(-1.0, 0.5)) < escape(s, 0.0, 0.0, *pushed(-1.0, 0.5)) < 1.0
    # A driving wheel pushes soil back, below its front, which is held there.
    assert escape(s, 0.5, math.sin(0.5), *pushed(0.5, -1.0)) > escape(s, 0.5, math.sin(0.5), *pushed(-1.0, 0.5))
    assert escape(s, 0.0, 0.0, *pushed(0.5, -1.0)) < 1.0
    assert escape(s, 0.0, 0.0, *pushed(0.0, 0.0, -1.0)) < 1.0
    for theta in (-1.5, -0.3, 0.0, 0.7, 1.5):
        assert angle(math.sin(theta), math.cos(theta)) == pytest.approx(theta, abs=2e-4)


def test_plates_find_no_other_soil():
    """What is pressed straight down, by a level base, is not weakened by anything."""
    pressed = {}
    for law in ("critical_state", "plates"):
        carriage = Carriage(scm(**SAND | WHEEL | BARE | dict(strength=law, fan=0.0, plasticity=0, erosion_sweeps=0)))
        pressed[law] = carriage.move(1.0, up=-0.02)[-1, 2]
    assert pressed["critical_state"] == pytest.approx(pressed["plates"], rel=0.03)


def rolling(slip, sideways=0.0, travel=0.25, **parameters):
    """Sinkage [m], pull and side force [N] of the wheel under its load after some travel at 0.1 m/s."""
    instance = scm(**SAND | WHEEL | parameters)
    carriage = Carriage(instance, load=WEIGHT)
    carriage.r[2] = WHEEL["r_w"]
    carriage.put_down()
    rim = 0.1 / (1.0 - slip) if slip >= 0.0 else 0.1 * (1.0 + slip)
    readings = carriage.move(travel / 0.1, forward=0.1, sideways=sideways, rate=rim / WHEEL["r_w"])
    return np.array([WHEEL["r_w"] - carriage.r[2], *readings[-200:, :2].mean(axis=0)])


def test_a_wheel_sinks_by_its_slip_and_more_by_skid():
    still, slipping, skidding = (rolling(slip)[0] for slip in (0.0, 0.5, -0.5))
    assert slipping > 1.3 * still and skidding > 1.3 * still
    assert rolling(0.5, strength="plates")[0] < 1.15 * rolling(0.0, strength="plates")[0]


def test_a_skidding_wheel_pushes_more_than_friction():
    """A wheel that is nearly locked ploughs: it is held back by more than tan(phi) of its load."""
    assert -rolling(-0.9)[1] > 1.2 * WEIGHT * math.tan(SAND["phi"])


def test_a_wheel_at_an_angle_of_slip_sinks_deeper_and_is_pushed_back():
    straight, aslant = rolling(0.0), rolling(0.0, sideways=0.058)
    assert aslant[0] > 1.05 * straight[0]
    assert aslant[2] < -0.2 * WEIGHT


def test_soil_that_springs_back_carries_the_back_of_the_wheel():
    assert rolling(0.0, unloading_ratio=5)[1] > rolling(0.0, unloading_ratio=40)[1] + 0.02 * WEIGHT
