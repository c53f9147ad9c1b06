"""One particle, or two, against closed forms: restitution, rolling, friction on slopes, cohesion; and what is refused."""

import math
from dataclasses import replace

import numpy as np
import pytest
from grains import box, effective, facing, hold, in_order, velocities
from test_dem_law import LAWS, NO_GRAVITY, SOFT, single

from cdl_fmu.dem.material import Material
from cdl_fmu.dem.particles import V_X, V_Z, W_Y, M, X, Z
from cdl_fmu.dem.simulation import Simulation, Tool
from cdl_fmu.slave.model import ModelError

G, RADIUS = 9.81, 5e-3


def slope(angle):
    """Gravity on a plane z = 0 that falls along x."""
    return np.array([G * math.sin(angle), 0.0, -G * math.cos(angle)])


def settled(material, angle, *, seconds=0.3):
    """A sphere at rest on a plane that is then tilted."""
    s = single((0.0, 0.0, RADIUS), material, [Tool(material)], dt=2e-5)
    s.step(seconds)
    s.gravity = slope(angle)
    return s


@pytest.mark.parametrize("linear", LAWS)
@pytest.mark.parametrize("e", [0.2, 0.5, 0.9, 1.0])
@pytest.mark.parametrize("speed", [0.1, 1.0])
def test_a_sphere_bounces_by_its_coefficient_of_restitution(linear, e, speed):
    m = Material(linear=linear, e=e)
    s = single((0.0, 0.0, RADIUS), m, [Tool(m)], velocity=(0.0, 0.0, -speed), dt=5e-7, gravity=NO_GRAVITY)
    s.step(4e-3 * (0.1 / speed) ** 0.2)
    assert s.bodies[0, Z] > RADIUS
    assert s.bodies[0, V_Z] == pytest.approx(e * speed, abs=1e-3 * speed)


@pytest.mark.parametrize("linear", LAWS)
def test_unequal_spheres_bounce_by_the_coefficient_of_restitution_and_keep_their_momentum(linear):
    radii = np.array([5e-3, 2e-3])
    s = Simulation(np.array([[0.0, 0.0, 0.0], [0.007, 0.0, 0.0]]), radii, Material(e=0.4, linear=linear), dt=1e-7, gravity=NO_GRAVITY)
    s.bodies[:, V_X] = 0.3, -0.9
    momentum = s.bodies[:, M] @ s.bodies[:, V_X]
    s.step(1e-3)
    b = in_order(s)
    assert b[1, X] - b[0, X] > radii.sum()
    assert b[1, V_X] - b[0, V_X] == pytest.approx(0.4 * 1.2, abs=1e-3)
    assert b[:, M] @ b[:, V_X] == pytest.approx(momentum, rel=1e-13)


@pytest.mark.parametrize("linear", LAWS)
def test_the_longest_overlap_and_the_time_of_an_impact_are_those_of_the_law(linear):
    m, v, dt = Material(e=1.0, linear=linear), 0.5, 2e-7
    s = single((0.0, 0.0, RADIUS), m, [Tool(m)], velocity=(0.0, 0.0, -v), dt=dt, gravity=NO_GRAVITY)
    mass, e_modulus = s.bodies[0, M], effective(m)[0]
    heights = []
    while s.bodies[0, Z] <= RADIUS:
        s.step(dt)
        heights.append(s.bodies[0, Z])
    if linear:
        k = 2.0 * e_modulus * RADIUS
        overlap, time = v * math.sqrt(mass / k), math.pi * math.sqrt(mass / k)
    else:  # Johnson 1985, Contact Mechanics, Eq. (11.21)
        overlap = (15.0 * mass * v**2 / (16.0 * math.sqrt(RADIUS) * e_modulus)) ** 0.4
        time = 2.9432675 * overlap / v
    assert RADIUS - min(heights) == pytest.approx(overlap, rel=1e-3)
    assert len(heights) * dt == pytest.approx(time, rel=1e-3)


@pytest.mark.parametrize("linear", LAWS)
def test_a_sphere_that_slides_ends_up_rolling_at_five_sevenths_of_its_speed(linear):
    s = settled(Material(mu=0.3, mu_r=0.0, linear=linear), 0.0)
    s.bodies[0, V_X] = 1.0
    s.step(0.05)
    assert s.bodies[0, V_X] == pytest.approx(1.0 - 0.3 * G * 0.05, rel=2e-3)  # Coulomb
    s.step(0.35)  # it rolls from 2 / 7 v / (mu g) = 0.097 s on
    assert s.bodies[0, V_X] == pytest.approx(5.0 / 7.0, rel=2e-3)
    assert s.bodies[0, W_Y] * RADIUS == pytest.approx(s.bodies[0, V_X], rel=2e-3)


@pytest.mark.parametrize("e, mu", [(0.2, 0.1), (0.5, 0.1), (0.5, 0.5), (0.9, 0.3)])
def test_friction_of_an_impact_that_slides_is_mu_times_its_normal_force_at_any_damping(e, mu):
    m, dt = Material(e=e, mu=mu, mu_r=0.0), 1e-6
    s = single((0.0, 0.0, RADIUS), m, [Tool(m)], velocity=(1.5, 0.0, -0.1), dt=dt, gravity=NO_GRAVITY)
    normal = tangential = 0.0
    for _ in range(6000):
        s.step(dt)
        f_x, _, f_z = -s.tools[0].f_0
        assert abs(f_x) <= mu * max(f_z, 0.0) * (1.0 + 1e-12)
        normal, tangential = normal + max(f_z, 0.0), tangential + f_x
    assert s.bodies[0, Z] > RADIUS
    assert tangential == pytest.approx(-mu * normal, rel=1e-6)


@pytest.mark.parametrize("linear", LAWS)
def test_a_sphere_on_a_slope_stays_below_rolling_friction_and_rolls_beyond(linear):
    m = Material(mu=0.8, mu_r=0.2, linear=linear)
    s = settled(m, math.atan(0.19))
    s.step(0.5)
    at = s.bodies[0, X]
    s.step(1.0)
    assert s.bodies[0, X] == pytest.approx(at, abs=1e-5)
    angle = math.atan(0.3)
    s = settled(m, angle)
    s.step(0.1)
    before = s.bodies[0, V_X]
    s.step(0.3)
    expected = 5.0 / 7.0 * G * (math.sin(angle) - 0.2 * math.cos(angle))  # 2/5 m a = F - mu_r N and m a = m g sin - F
    assert (s.bodies[0, V_X] - before) / 0.3 == pytest.approx(expected, rel=0.01)
    assert s.bodies[0, W_Y] * RADIUS == pytest.approx(s.bodies[0, V_X], rel=2e-3)


@pytest.mark.parametrize("linear", LAWS)
def test_a_body_that_cannot_roll_sticks_on_a_slope_below_mu_and_slides_beyond(linear):
    m = Material(mu=0.4, mu_r=10.0, linear=linear)
    s = settled(m, math.atan(0.39))
    s.step(0.5)
    at = s.bodies[0, X]
    s.step(1.0)
    assert s.bodies[0, X] == pytest.approx(at, abs=1e-5)
    angle = math.atan(0.6)
    s = settled(m, angle)
    s.step(0.1)
    before = s.bodies[0, V_X]
    s.step(0.3)
    assert (s.bodies[0, V_X] - before) / 0.3 == pytest.approx(G * (math.sin(angle) - 0.4 * math.cos(angle)), rel=0.01)
    assert abs(s.bodies[0, W_Y]) * RADIUS < 0.01 * s.bodies[0, V_X]


@pytest.mark.parametrize("linear", LAWS)
@pytest.mark.parametrize("share, hangs", [(0.98, True), (1.02, False)])
@pytest.mark.parametrize("partner", ["plane", "sphere"])
def test_cohesion_holds_a_particle_up_to_its_pull(linear, share, hangs, partner):
    m = replace(SOFT, cohesion=300.0, linear=linear)
    pull = 300.0 * (2.0 * RADIUS) ** 2 * (4.0 if partner == "plane" else 1.0)  # by R*^2: a plane's R* is twice that of equal particles
    if partner == "plane":
        s = single((0.0, 0.0, -0.9995 * RADIUS), m, [facing((0.0, 0.0, -1.0), m)], dt=2e-5, gravity=NO_GRAVITY)
    else:
        s = Simulation(np.array([[0.0, 0.0, -1.9995 * RADIUS], [0.0, 0.0, 0.0]]), np.full(2, RADIUS), m, dt=2e-5, gravity=NO_GRAVITY)
        s.step(2e-5)
        hold(s, [1])
    s.step(0.3)  # it comes to rest, pulled against the other
    for load in np.linspace(0.0, share, 400):
        s.gravity = np.array([0.0, 0.0, -load * pull / s.bodies[0, M]])
        s.step(0.002)
    height = in_order(s)[0, Z]
    assert (height > -2.0 * RADIUS if partner == "sphere" else height > -RADIUS) == hangs


def test_a_sphere_in_a_corner_of_a_box_rests_on_all_its_walls():
    m = SOFT
    s = single((0.006, 0.006, 0.006), m, box(m, (0.0,) * 3, (0.1,) * 3), gravity=np.array([-3.0, -4.0, -9.0]))
    s.step(1.0)
    walls = np.array([tool.f_0 for tool in s.tools])
    assert walls[:3].sum(axis=0) == pytest.approx(s.bodies[0, M] * s.gravity, rel=1e-6)
    assert np.diag(walls[:3]) == pytest.approx(s.bodies[0, M] * s.gravity, rel=0.5)  # friction carries a part
    assert not walls[3:].any()


def test_damping_at_a_tool_is_for_the_particles_mass_whatever_the_tools_density():
    m = Material(e=0.5)
    speeds = []
    for density in (m.density, 7800.0):
        s = single((0.0, 0.0, RADIUS), m, [Tool(replace(m, density=density))], velocity=(0.0, 0.0, -0.5), dt=1e-6, gravity=NO_GRAVITY)
        s.step(3e-3)
        speeds.append(s.bodies[0, V_Z])
    assert speeds[0] == speeds[1]


def test_a_particle_that_is_held_moves_others_but_not_itself():
    s = Simulation(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.99 * RADIUS]]), np.full(2, RADIUS), SOFT, dt=2e-5)
    hold(s, [0])
    s.step(0.2)
    b = in_order(s)
    assert not b[0, :3].any() and not velocities(b)[0].any()
    weight = b[1, M] * G
    overlap = (0.75 * weight / (effective(SOFT)[0] * math.sqrt(0.5 * RADIUS))) ** (2.0 / 3.0)
    assert b[1, Z] == pytest.approx(2.0 * RADIUS - overlap, abs=0.02 * overlap)


def test_a_period_too_short_for_the_particles_is_refused():
    with pytest.raises(
        ModelError, match=r"the period along y is 0.03 m, but at least 0.0375 m is needed, 7.5 radii of the largest particle: len"
    ):
        Simulation(np.zeros((1, 3)), np.full(1, RADIUS), SOFT, periods=(0.0, 0.03))


@pytest.mark.parametrize("value", [math.nan, math.inf, 1e30])
def test_a_particle_that_is_lost_ends_the_run_with_a_message(value):
    s = Simulation(np.array([[0.0, 0.0, RADIUS], [0.1, 0.0, 0.1]]), np.full(2, RADIUS), SOFT, [Tool(SOFT)])
    s.step(1e-3)
    s.bodies[0, V_X] = value
    with pytest.raises(RuntimeError, match="particles are lost or pressed together beyond all bounds: check dt and how tools move"):
        s.step(1e-3)
