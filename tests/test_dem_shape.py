"""Rotation geometries: figures, the energy that their torques come from, orientations, grains that come to rest and roll."""

import math

import numpy as np
import pytest

from cdl_fmu.dem.material import Material
from cdl_fmu.dem.particles import SIDE, V_X, W_X, M, R
from cdl_fmu.dem.shape import Shape, acting, energy, orientations, shape_torque, support, turn
from cdl_fmu.dem.simulation import Simulation, Tool
from cdl_fmu.slave.model import ModelError

RADIUS, G = 5e-3, 9.81
CUBE, HEXAGON = Shape(corners=4), Shape(corners=6)
SHAPES = [CUBE, HEXAGON, Shape(corners=10), Shape(corners=16), Shape(aspect=1.2), Shape(aspect=3.0)]


def matrix(q):
    """Rotation from a grain's frame to the world."""
    w, v = q[0], q[1:]
    return (w * w - v @ v) * np.eye(3) + 2 * np.outer(v, v) + 2 * w * np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def turned(q, rotation):
    q = q.copy()
    turn(q, *rotation, 1.0)
    return q


def directions(n, seed=0):
    d = np.random.default_rng(seed).normal(size=(n, 3))
    return d / np.linalg.norm(d, axis=1)[:, None]


def now(simulation):
    """Orientations in the order in which the particles were given."""
    grains = simulation.particles
    return grains.orientation[grains.count[SIDE]][np.argsort(simulation.ident)]


def on_a_plane(shape, n=1, **material):
    """Grains far from each other on a plane."""
    material = Material(**(dict(mu=3.0, mu_r=0.02, shape=shape) | material))
    positions = np.column_stack([np.zeros(n), 0.1 * np.arange(n), np.full(n, RADIUS)])
    return Simulation(positions, np.full(n, RADIUS), material, [Tool(material)], dt=5e-5)


def tilt(simulation, angle):
    simulation.gravity[:] = G * math.sin(angle), 0.0, -G * math.cos(angle)


# ---------------------------------------------------------------------- figures


@pytest.mark.parametrize("corners", range(4, 17, 2))
def test_a_polygon_reaches_to_the_nearest_corner_unless_its_face_bulges(corners):
    figure, half = Shape(corners=corners).figure(), math.pi / corners
    for angle in np.linspace(-4.0, 4.0, 1501):
        h, lever = support(figure, math.cos(angle), math.sin(angle))
        off = (angle - math.pi / 4 + half) % (2 * half) - half
        if abs(off) < half - 0.021:
            assert h == pytest.approx(math.cos(off) / math.cos(half), abs=1e-14)
            assert lever == pytest.approx(-math.sin(off) / math.cos(half), abs=1e-14)
        assert abs(lever) < math.tan(half)


@pytest.mark.parametrize("aspect", [1.001, 1.5, 3.0])
def test_an_ellipse_has_the_sphere_s_cross_section_and_its_long_end_between_the_axes(aspect):
    figure = Shape(aspect=aspect).figure()
    root = math.sqrt(0.5)
    long, short = support(figure, root, root)[0], support(figure, -root, root)[0]
    assert long / short == pytest.approx(aspect)
    assert long * short == pytest.approx(1.0)


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_the_lever_is_the_support_function_s_derivative(shape):
    figure = shape.figure()
    for angle in np.random.default_rng(0).uniform(0, 7, 300):
        ahead, behind = (support(figure, math.cos(angle + d), math.sin(angle + d))[0] for d in (1e-5, -1e-5))
        assert support(figure, math.cos(angle), math.sin(angle))[1] == pytest.approx((ahead - behind) / 2e-5, abs=3e-4)


def test_what_is_no_shape_is_refused():
    for wrong, text in [
        (dict(corners=5), "shape.corners = 5: give an even number from 4 to 16"),
        (dict(corners=18), "shape.corners = 18: give an even number from 4 to 16"),
        (dict(aspect=0.8), "shape.aspect = 0.8: give more than 1 and at most 3; shape = None is a sphere"),
        (dict(aspect=4.0), "shape.aspect = 4: give more than 1"),
        (dict(), "shape.aspect = 1: give more than 1"),
        (dict(corners=6, aspect=1.5), "give one of both"),
    ]:
        with pytest.raises(ModelError, match=text):
            Shape(**wrong)


# ---------------------------------------------------------------------- energy and torque


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_across_each_axis_the_energy_is_the_figure_s_support_function(shape):
    figure = shape.figure()
    for angle in np.linspace(0.0, 6.0, 50):
        x, y = math.cos(angle), math.sin(angle)
        h = support(figure, x, y)[0]
        for direction in [(x, y, 0.0), (0.0, x, y), (y, 0.0, x)]:
            assert energy(figure, *direction) == pytest.approx(h, abs=1e-14)


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_the_torque_is_the_energy_s_gradient_and_has_no_part_along_the_normal(shape):
    figure = shape.figure()
    for n, q in zip(directions(200), orientations(np.arange(200))):
        torque = shape_torque(figure, tuple(q), tuple(n))
        assert np.dot(torque, n) == pytest.approx(0.0, abs=1e-15)
        for axis, part in zip(np.eye(3), torque):
            up, down = (energy(figure, *(-matrix(turned(q, sign * 1e-6 * axis)).T @ n)) for sign in (1.0, -1.0))
            assert part == pytest.approx(-(up - down) / 2e-6, abs=1e-4)


def test_a_nearly_round_grain_rolls_as_a_sphere():
    for shape, bound in [(Shape(aspect=1.0 + 1e-6), 2e-6), (Shape(corners=16), 0.35)]:
        torques = [np.linalg.norm(shape_torque(shape.figure(), (1.0, 0.0, 0.0, 0.0), tuple(n))) for n in directions(200)]
        assert max(torques) < bound


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_a_normal_along_an_axis_is_no_special_case(shape):
    figure = shape.figure()
    for axis in np.vstack([np.eye(3), -np.eye(3)]):
        torque = shape_torque(figure, (1.0, 0.0, 0.0, 0.0), tuple(axis))
        near = [shape_torque(figure, (1.0, 0.0, 0.0, 0.0), tuple(axis + 1e-9 * d)) for d in directions(10)]
        assert np.allclose(near, torque, atol=1e-6)


# ---------------------------------------------------------------------- orientations


def test_orientations_are_uniform_and_a_matter_of_a_particle_s_number_alone():
    q = orientations(np.arange(20000))
    assert np.linalg.norm(q, axis=1) == pytest.approx(1.0)
    assert np.abs(q.mean(axis=0)).max() < 0.02
    assert np.cov(q.T, bias=True) == pytest.approx(0.25 * np.eye(4), abs=0.01)
    assert np.array_equal(orientations(np.array([7, 3])), q[[7, 3]])
    assert not np.array_equal(orientations(np.arange(9), seed=1), q[:9])


def test_a_free_grain_turns_about_its_angular_velocity_and_keeps_its_orientation_when_particles_are_sorted():
    random = np.random.default_rng(0)
    positions = 0.02 * np.stack(np.meshgrid(*3 * [np.arange(3)]), axis=-1).reshape(-1, 3)
    simulation = Simulation(positions, np.full(27, RADIUS), Material(shape=HEXAGON), gravity=(0.0, 0.0, 0.0), dt=8e-5)
    spin, before = random.normal(0.0, 30.0, (27, 3)), now(simulation)
    simulation.bodies[:, V_X : V_X + 3] = 10.0 * (positions - 0.02) + random.normal(0.0, 0.05, (27, 3))  # apart, past each other
    simulation.bodies[:, W_X : W_X + 3] = spin
    simulation.step(0.2)
    assert not np.array_equal(simulation.ident, np.arange(27))
    for q, w, after in zip(before, spin, now(simulation)):
        assert after == pytest.approx(turned(q, 0.2 * w), abs=1e-12)


def test_a_turn_is_exact():
    q = np.array([1.0, 0.0, 0.0, 0.0])
    turn(q, 0.0, 0.0, 0.3, 2.0)
    assert q == pytest.approx([math.cos(0.3), 0.0, 0.0, math.sin(0.3)])
    assert matrix(q) @ [1.0, 0.0, 0.0] == pytest.approx([math.cos(0.6), math.sin(0.6), 0.0])


def test_spheres_have_no_orientation():
    assert Simulation(np.zeros((1, 3)), np.ones(1), Material()).particles.orientation.size == 0


# ---------------------------------------------------------------------- grains


def test_momentum_of_colliding_grains_is_conserved():
    random = np.random.default_rng(2)
    positions = 0.0101 * np.stack(np.meshgrid(*3 * [np.arange(4)]), axis=-1).reshape(-1, 3)
    simulation = Simulation(positions, random.uniform(0.004, 0.005, 64), Material(shape=CUBE), gravity=(0.0, 0.0, 0.0))
    simulation.bodies[:, V_X : V_X + 3] = random.normal(0.0, 0.3, (64, 3)) - 20.0 * (positions - positions.mean(axis=0))
    simulation.bodies[:, W_X : W_X + 3] = random.normal(0.0, 30.0, (64, 3))

    def angular():
        b = simulation.bodies
        spin = 0.4 * b[:, [M]] * b[:, [R]] ** 2 * b[:, W_X : W_X + 3]
        return (np.cross(b[:, :3], b[:, [M]] * b[:, V_X : V_X + 3]) + spin).sum(axis=0), np.linalg.norm(spin, axis=1).sum()

    before, scale = angular()
    simulation.step(0.02)
    assert angular()[0] == pytest.approx(before, abs=1e-12 * scale)
    assert simulation.kinetic_energy > 0.0


def rolling(returned):
    """Energy of a rolling grain over m g r: kinetic, and with what its figure stores; it rolls over many figures."""
    simulation = on_a_plane(Shape(aspect=1.3, returned=returned), mu_r=0.0)
    simulation.bodies[0, 2] -= 1.8e-6  # about where it rests
    simulation.step(0.5)
    simulation.bodies[0, V_X], simulation.bodies[0, W_X + 1] = 0.2, 0.2 / RADIUS
    figure, mass = simulation.material.shape.figure(), simulation.bodies[0, M]
    kinetic, stored = [], []
    for _ in range(400):
        simulation.step(5e-4)
        kinetic.append(simulation.kinetic_energy / (mass * G * RADIUS))
        stored.append(energy(figure, *(-matrix(now(simulation)[0])[2])))
    return np.array(kinetic), np.array(stored)


def test_a_rolling_grain_keeps_its_energy_where_all_comes_back():
    kinetic, stored = rolling(1.0)
    assert np.ptp(kinetic + stored) < 0.02


@pytest.mark.parametrize("returned", [0.09, 0.25, 0.64])
def test_of_what_a_rolling_grain_climbs_only_a_share_comes_back(returned):
    kinetic, stored = rolling(returned)
    falls = -np.minimum(np.diff(stored), 0.0).sum()
    total = kinetic + stored
    assert falls > 0.04
    assert total[0] - total[-1] == pytest.approx((1.0 - returned) * falls, rel=0.03)


def test_torques_at_rest_do_not_jump_with_the_sign_of_a_rotation():
    torque = (0.3, -0.1, 0.2)
    acts = np.array([acting(torque, (w, 0.0, 0.0), 0.25) for w in (-1.0, -1e-6, 0.0, 1e-6, 1.0)])
    assert np.allclose(acts[:3], torque)  # all of it while the grain climbs or rests
    assert acts[3] == pytest.approx(torque, rel=1e-5)
    assert acts[4] == pytest.approx(0.25 * np.array(torque))


def test_a_cube_comes_to_rest_on_a_face():
    simulation = on_a_plane(CUBE, n=6, mu_r=0.05)
    simulation.bodies[:, V_X] = 0.3
    simulation.step(2.0)
    assert simulation.kinetic_energy < 1e-12 * simulation.bodies[:, M].sum() * G * RADIUS
    for q in now(simulation):
        assert np.abs(matrix(q)[2]).max() > 0.995  # one of its axes is upright


@pytest.mark.parametrize("shape", [CUBE, Shape(corners=12)], ids=str)
def test_a_grain_stays_on_its_face_while_the_slope_is_below_pi_over_n_and_rolls_beyond(shape):
    """A polygon rolls once its centre is above a corner: at pi / n. The grain's face is down and its edge across the slope."""
    simulation = on_a_plane(shape, mu_r=0.01)
    simulation.particles.orientation[:] = 1.0, 0.0, 0.0, 0.0
    limit = math.pi / shape.corners
    for angle in np.linspace(0.0, limit - 0.03, 100):  # the bulge of a face takes 0.02 away
        tilt(simulation, angle)
        simulation.step(0.01)
    simulation.step(0.5)
    assert np.linalg.norm(simulation.bodies[0, V_X : V_X + 3]) < 1e-6
    tilt(simulation, limit + 0.02)
    simulation.step(0.5)
    assert simulation.bodies[0, V_X] > 0.1


def test_a_cube_falls_over_an_edge_at_45_and_over_a_corner_at_55_degrees():
    simulation = on_a_plane(CUBE, n=2, mu_r=0.01)
    eighth = turned(np.array([1.0, 0.0, 0.0, 0.0]), (0.0, 0.0, math.pi / 4))
    simulation.particles.orientation[:, 0], simulation.particles.orientation[:, 1] = (1.0, 0.0, 0.0, 0.0), eighth
    angles = np.zeros(2)
    for angle in np.arange(0.0, 60.0, 0.25):
        tilt(simulation, math.radians(angle))
        simulation.step(0.03)
        order = np.argsort(simulation.ident)
        angles[(simulation.bodies[order, V_X] > 0.05) & (angles == 0.0)] = angle
    assert angles == pytest.approx([45.0, math.degrees(math.atan(math.sqrt(2.0)))], abs=1.75)  # by then it has rolled a while


def test_what_a_plane_feels_balances_the_weight_of_a_grain_on_a_slope():
    simulation = on_a_plane(CUBE, mu_r=0.05)
    simulation.particles.orientation[:] = 1.0, 0.0, 0.0, 0.0
    for angle in np.linspace(0.0, 0.5, 50):
        tilt(simulation, angle)
        simulation.step(0.02)
    simulation.step(1.0)
    tool, body = simulation.tools[0], simulation.bodies[0]
    weight = body[M] * simulation.gravity
    assert tool.f_0 == pytest.approx(weight, rel=1e-4)
    assert tool.t_0 == pytest.approx(np.cross(body[:3], weight), abs=1e-4 * RADIUS * body[M] * G)


def small_bed(shape, **options):
    """Grains that fall on a plane, between periodic sides."""
    material = Material(mu_r=0.0, shape=shape, mu=options.pop("mu", 0.5))
    random = np.random.default_rng(0)
    positions = 0.011 * (np.stack(np.meshgrid(np.arange(4), np.arange(4), np.arange(6)), axis=-1).reshape(-1, 3) + 0.5)
    positions += random.uniform(-4e-4, 4e-4, positions.shape)
    radii = random.uniform(4.5e-3, 5.5e-3, len(positions))
    return Simulation(positions, radii, material, [Tool(Material())], dt=5e-5, periods=(0.044, 0.044), **options)


@pytest.mark.parametrize("shape", [CUBE, HEXAGON, Shape(aspect=1.2), Shape(aspect=1.5)], ids=str)
def test_a_bed_of_grains_comes_to_rest_without_rolling_friction(shape):
    simulation, energies = small_bed(shape), []
    simulation.step(0.6)
    for _ in range(5):
        simulation.step(0.05)
        energies.append(simulation.kinetic_energy)
    # Cubes without loss: 1.7. Now and then a grain still falls into place.
    assert np.median(energies) < 1e-3 * simulation.bodies[:, M].sum() * G * RADIUS
    assert simulation.tools[0].f_0[2] == pytest.approx(-simulation.bodies[:, M].sum() * G, rel=0.01)


def test_a_bed_of_grains_has_the_same_bits_on_two_threads():
    one, two = small_bed(HEXAGON), small_bed(HEXAGON, threads=2)
    for simulation in (one, two):
        simulation.step(0.05)
    assert np.array_equal(one.bodies, two.bodies) and np.array_equal(now(one), now(two))


def test_a_bed_of_grains_rests_in_single_precision():
    simulation = small_bed(HEXAGON, precision=np.float32)
    simulation.step(0.8)
    assert simulation.kinetic_energy < 1e-3 * simulation.bodies[:, M].sum() * G * RADIUS
    assert simulation.tools[0].f_0[2] == pytest.approx(-simulation.bodies[:, M].sum() * G, rel=0.01)
