"""Clouds of particles: what is conserved, symmetries, the same bits from any number of threads, lists against all pairs."""

from dataclasses import replace

import numpy as np
import pytest
from grains import apart, box, brute_forces, elastic_energy, facing, in_order, spins, velocities

from cdl_fmu.dem.material import Material
from cdl_fmu.dem.particles import CELLS_X, CELLS_Y, STALE, V_X, V_Z, W_X, M, R, X, Z, empty_particles
from cdl_fmu.dem.particles import SIDE as SIDE_IN_USE
from cdl_fmu.dem.simulation import Simulation, Tool
from cdl_fmu.slave.kernel import MOST_THREADS

NO_GRAVITY = (0.0, 0.0, 0.0)
SIZES = (2e-3, 6e-3)
SOFT = Material(E=2e6)
SIDE = 0.08


def cloud(material, tools=(), *, n=120, seed=1, speed=0.5, high=(SIDE,) * 3, **options):
    """Spheres of two sizes that fly about and spin."""
    random = np.random.default_rng(seed)
    centres, radii = apart(random, n, SIZES, (0.0,) * 3, high)
    s = Simulation(centres, radii, material, tools, **options)
    s.bodies[:, V_X : V_X + 3] = speed * random.normal(size=(n, 3))
    s.bodies[:, W_X : W_X + 3] = speed / SIZES[1] * random.normal(size=(n, 3))
    return s


def momenta(bodies):
    """Linear [kg.m/s] and angular momentum [kg.m2/s] of each particle."""
    p = bodies[:, M, None] * velocities(bodies)
    return p, np.cross(bodies[:, :3], p) + 0.4 * (bodies[:, M] * bodies[:, R] ** 2)[:, None] * spins(bodies)


def falling_together(material, **options):
    """A cloud whose particles fall towards its middle, so that all of them collide."""
    s = cloud(material, gravity=NO_GRAVITY, **options)
    s.bodies[:, V_X : V_X + 3] -= 20.0 * (s.bodies[:, :3] - 0.5 * SIDE)
    return s


@pytest.mark.parametrize("changes", [{}, {"linear": True, "cohesion": 100.0}, {"mu": 0.0, "e": 1.0, "mu_r": 0.0}])
def test_collisions_keep_linear_and_angular_momentum(changes):
    s = falling_together(replace(SOFT, **changes))
    before = momenta(s.bodies)
    collided = 0
    for _ in range(20):
        start = in_order(s)
        s.step(2e-3)
        collided += (velocities(in_order(s)) != velocities(start)).any()
    assert collided > 10
    for p, p_0 in zip(momenta(s.bodies), before):
        assert p.sum(axis=0) == pytest.approx(p_0.sum(axis=0), abs=1e-12 * np.abs(p_0).sum())


@pytest.mark.parametrize("linear", [False, True])
def test_energy_without_losses_is_kept_to_a_bound_that_falls_with_the_step(linear):
    m = replace(SOFT, mu=0.0, e=1.0, mu_r=0.0, linear=linear)
    errors = []
    for dt in (2e-5, 5e-6):
        s = cloud(m, box(m, (0.0,) * 3, (SIDE,) * 3), gravity=NO_GRAVITY, dt=dt, speed=0.3)
        energy = [s.kinetic_energy]
        for _ in range(100):
            s.step(1e-3)
            energy.append(s.kinetic_energy + elastic_energy(s, (0.0,) * 3, (SIDE,) * 3))
        errors.append(np.abs(np.array(energy) / energy[0] - 1.0).max())
    assert errors[0] < 4e-3
    assert errors[1] < 0.35 * errors[0]  # first order


@pytest.mark.parametrize("linear", [False, True])
@pytest.mark.parametrize("mu, mu_r, gain", [(0.0, 0.0, 1e-3), (0.5, 0.1, 2e-3)])  # tangential springs, not counted here, give some back
def test_energy_of_a_closed_system_with_losses_never_grows(linear, mu, mu_r, gain):
    m = replace(SOFT, mu=mu, e=0.7, mu_r=mu_r, linear=linear)
    s = cloud(m, box(m, (0.0,) * 3, (SIDE,) * 3), gravity=NO_GRAVITY, speed=0.3)
    energy = [s.kinetic_energy]
    for _ in range(300):
        s.step(1e-3)
        energy.append(s.kinetic_energy + elastic_energy(s, (0.0,) * 3, (SIDE,) * 3))
    assert (np.diff(energy) < gain * energy[0]).all()
    assert (np.array(energy) - np.minimum.accumulate(energy) < gain * energy[0]).all()
    assert energy[-1] < 0.5 * energy[0]


def test_a_run_gives_the_same_bits_again():
    results = []
    for _ in range(2):
        s = cloud(SOFT, [Tool(SOFT)])
        s.step(0.05)
        results.append((in_order(s), s.tools[0].f_0, s.tools[0].t_0))
    for a, b in zip(*results):
        assert a.tobytes() == b.tobytes()


def test_room_in_memory_changes_no_bit():
    """Two clouds so far apart that cells of the least size would be more than there are places for them."""
    results = []
    for room in (1, 3):
        s = cloud(SOFT, [])
        s.bodies[: len(s.bodies) // 2, X] += 3.0
        count, body, ident = s.particles.count.copy(), s.bodies.copy(), s.ident.copy()
        s.particles = empty_particles(room * len(body))
        s.particles.count[:], s.particles.body[0, : len(body)], s.particles.ident[0, : len(body)] = count, body, ident
        s.step(0.02)
        results.append(in_order(s))
    assert results[0].tobytes() == results[1].tobytes()


@pytest.mark.skipif(MOST_THREADS < 2, reason="needs two cores")
@pytest.mark.parametrize("periods", [(0.0, 0.0), (SIDE, SIDE)])
def test_two_threads_give_the_bits_of_one(periods):
    results = []
    for threads in (1, 2):
        s = cloud(SOFT, [Tool(SOFT)], n=300, threads=threads, periods=periods)
        s.step(0.05)
        results.append((in_order(s), s.tools[0].f_0, s.tools[0].t_0))
    for a, b in zip(*results):
        assert a.tobytes() == b.tobytes()


def periodic(centres_to, velocities_to, spins_to):
    """A bed on a plane that repeats itself along x and y, moved or mirrored before it falls."""
    s = cloud(SOFT, [Tool(SOFT)], n=150, periods=(SIDE, SIDE), dt=2e-5)
    s.bodies[:, :3] = centres_to(s.bodies[:, :3])
    s.bodies[:, V_X : V_X + 3] = velocities_to(velocities(s.bodies))
    s.bodies[:, W_X : W_X + 3] = spins_to(spins(s.bodies))
    s.step(0.04)
    return in_order(s), s.tools[0].f_0


def same(a):
    return a


def as_near(d):
    """Differences of positions, without whole periods."""
    return d - SIDE * np.round(d / SIDE) * [1.0, 1.0, 0.0]


@pytest.mark.parametrize("shift", [(SIDE, 0.0, 0.0), (-3.0 * SIDE, 2.0 * SIDE, 0.0), (0.0123, -0.0456, 0.0)])
def test_a_periodic_bed_is_the_same_wherever_it_is(shift):
    bodies, force = periodic(same, same, same)
    moved, moved_force = periodic(lambda x: x + shift, same, same)
    assert np.abs(as_near(moved[:, :3] - shift - bodies[:, :3])).max() < 1e-9 * SIDE
    assert np.abs(velocities(moved) - velocities(bodies)).max() < 1e-9
    assert moved_force == pytest.approx(force, rel=1e-8, abs=1e-8 * abs(force[2]))
    assert force[2] < 0.0


@pytest.mark.parametrize("axis", [0, 1])
def test_a_mirrored_bed_moves_as_in_a_mirror(axis):
    mirror = np.where(np.arange(3) == axis, -1.0, 1.0)
    bodies, force = periodic(same, same, same)
    image, image_force = periodic(lambda x: x * mirror, lambda v: v * mirror, lambda w: -w * mirror)
    assert np.abs(as_near(image[:, :3] * mirror - bodies[:, :3])).max() < 1e-9 * SIDE
    assert np.abs(velocities(image) * mirror - velocities(bodies)).max() < 1e-9
    assert np.abs(-spins(image) * mirror - spins(bodies)).max() < 1e-6
    assert image_force * mirror == pytest.approx(force, rel=1e-8, abs=1e-8 * np.abs(force).max())


def assert_forces_are_of_all_pairs(s, n_times, periods=(0.0, 0.0)):
    """Go on, and compare forces of single substeps with those of all pairs."""
    touching = 0
    for _ in range(n_times):
        s.step(11 * s.dt)
        before = in_order(s)
        expected = brute_forces(before, s.material, periods)
        s.step(s.dt)
        forces = (velocities(in_order(s)) - velocities(before)) / s.dt * before[:, M, None]
        touching += (expected != 0.0).any(axis=1).sum()
        # Velocities of 10 m/s hold their differences in a substep to 2e-15 m/s.
        assert forces == pytest.approx(expected, rel=1e-9, abs=1e-7 * np.abs(expected).max() + 1e-15 * before[:, M].max() * 10.0 / s.dt)
    return touching


@pytest.mark.parametrize("periods", [(0.0, 0.0), (SIDE, SIDE), (0.0, SIDE)])
def test_forces_are_those_of_all_pairs_among_fast_and_slow_particles(periods):
    s = falling_together(replace(SOFT, mu=0.0), n=200, dt=2e-5, periods=periods)
    fast = s.ident % 10 == 0
    s.bodies[fast, V_X : V_X + 3] *= 10.0
    assert assert_forces_are_of_all_pairs(s, 60, periods) > 500


def test_forces_are_those_of_all_pairs_in_the_shortest_period():
    period = 7.5 * SIZES[1]
    s = cloud(replace(SOFT, mu=0.0), n=40, high=(period, period, SIDE), gravity=NO_GRAVITY, dt=2e-5, periods=(period, period), speed=1.0)
    assert assert_forces_are_of_all_pairs(s, 60, (period, period)) > 100
    assert tuple(s.particles.count[[CELLS_X, CELLS_Y]]) == (3, 3)


@pytest.mark.parametrize("axis", [X, Z])
@pytest.mark.parametrize("distance", [1.0, 1e4])
def test_a_particle_that_flies_far_away_does_no_harm(axis, distance):
    s = falling_together(replace(SOFT, mu=0.0), n=250, dt=2e-5)
    far = s.ident == 7
    s.bodies[far, axis], s.bodies[far, V_X + axis] = distance, 50.0
    assert assert_forces_are_of_all_pairs(s, 20) > 100
    assert in_order(s)[7, axis] == pytest.approx(distance + 50.0 * s.time)


def test_lists_made_anew_in_each_substep_keep_the_history_of_all_contacts():
    results = []
    for always in (False, True):
        wheel, slope = Tool(SOFT, wheel=(0.03, 0.04, 0.0, 0.0, 0.0), r_0=np.array([0.04, 0.04, -0.03])), facing((1.0, 0.0, 1.0), SOFT)
        s = cloud(SOFT, [wheel, slope], n=100, dt=2e-5, speed=0.1, high=(SIDE, SIDE, 0.04))
        s.bodies[:, V_Z] -= 1.0
        made = touches = slid = 0
        for _ in range(1500):
            if always:
                s.particles.count[STALE] = 1
            made += s.particles.count[STALE]
            s.step(s.dt)
            touches += wheel.contacts + slope.contacts
            slid += (s.particles.history[s.particles.count[SIDE_IN_USE]] != 0.0).any()
        results.append((in_order(s), made, touches, slid))
    (bodies, few, touches, slid), (anew, many, *_) = results
    assert many == 1500 > 5 * few and touches > 1500 and slid > 1000
    assert np.abs(bodies[:, :3] - anew[:, :3]).max() < 1e-9
