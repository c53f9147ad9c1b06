"""Rigid contact as a linear complementarity problem: sweeps, Lemke's method, and what comes out of them."""

import numpy as np
import pytest
from rigid import GROUND, LEVEL, of_each, random_scene, scene, solved, stack, violation

from cdl_fmu.rbc.friction import friction_directions, least, nearest
from cdl_fmu.rbc.lemke import SOLVED, lemke
from cdl_fmu.rbc.solve import BY_PIVOTS, BY_SWEEPS, UNSOLVED, scratch, solve
from cdl_fmu.rbc.sweeps import gauss_seidel, residual, velocities
from cdl_fmu.slave.model import ModelError

GRAVITY, H = 9.81, 1e-3
SLIDING = GRAVITY * H  # [m/s] what gravity makes in a step


def by_pivots(G, b, mu, target=0.0, n_directions=8):
    """Impulses, velocities, status and residual of Lemke's method alone."""
    n = len(b) // 3
    p, v, target, mu = np.zeros(3 * n), np.zeros(3 * n), of_each(target, n), of_each(mu, n)
    directions, _, tableau, basis = scratch(n, n_directions)
    status, _ = lemke(np.int64(n), G, b, target, mu, p, directions, tableau, basis)
    velocities(np.int64(n), G, b, p, v)
    return p, v, status, residual(np.int64(n), G, target, mu, p, v, directions)


def by_sweeps(G, b, mu, tolerance, max_sweeps, n_directions=8):
    """Impulses, velocities and residual of sweeps alone."""
    n = len(b) // 3
    p, v, mu, directions = (
        np.zeros(3 * n),
        np.zeros(3 * n),
        np.broadcast_to(1.0 * np.asarray(mu), n).copy(),
        friction_directions(n_directions),
    )
    _, off = gauss_seidel(np.int64(n), G, b, np.zeros(n), mu, p, v, tolerance, np.int64(max_sweeps), directions)
    return p, v, off


def test_ten_boxes_stand_and_steps_after_the_first_need_few_sweeps():
    mass, n = 2.5, 10
    tower = stack(n, mass)
    falling = np.tile([0, 0, -SLIDING, 0, 0, 0], n)
    b = tower.J @ falling
    p, v, status, sweeps, off = solved(tower.G, b, 0.5, max_sweeps=100)
    assert (status, off <= 1e-8) == (BY_PIVOTS, True)
    weight = mass * GRAVITY * H
    carried = p[::3].reshape(n, 4).sum(axis=1)
    assert carried == pytest.approx(weight * np.arange(n, 0, -1), abs=1e-8 * n * weight)
    assert np.abs(v).max() < 1e-8
    after = falling + tower.per_mass * (tower.J.T @ p)
    q, _, status, sweeps, _ = solved(tower.G, tower.J @ (after + falling), 0.5, p=p, max_sweeps=100)
    assert (status, sweeps) == (BY_SWEEPS, 0)
    b = tower.J @ (after + falling + np.tile([0.01 * SLIDING, 0, 0, 0, 0, 0], n))  # leant on
    *_, status, warm, _ = solved(tower.G, b, 0.5, p=q, tolerance=1e-5)
    *_, cold, _ = solved(tower.G, b, 0.5, tolerance=1e-5)
    assert status == BY_SWEEPS
    assert warm < cold / 5


@pytest.mark.parametrize("mu", [1.5, 2.0, 5.0])
@pytest.mark.parametrize("speed", [0.1, 3.0])
def test_painleve_rod_jams(mu, speed):
    """No force keeps the sliding end of the rod from going through the ground: an impulse ends the sliding (Stewart 2000)."""
    mass, half, angle = 1.3, 0.4, np.arctan(2.0)
    end = half * np.array([-np.cos(angle), 0, -np.sin(angle)])
    rod = scene([(mass, (1.0, mass * half**2 / 3.0, 1.0))], [(0, end, GROUND, None, LEVEL)])
    slope = rod.G[0, 0] - mu * abs(rod.G[0, 1])
    assert slope < 0.0  # sliding friction presses the end down by more than the normal impulse lifts it
    b = rod.J @ np.array([-speed, 0, -SLIDING, 0, 0, 0])
    for p, v, *_ in (solved(rod.G, b, mu), by_pivots(rod.G, b, mu)):
        assert violation(rod.G, b, mu, 0.0, p, 8) < 1e-7
        assert v[:2] == pytest.approx(0.0, abs=1e-7)
        assert p[0] > 0.1 * mass * speed


@pytest.mark.parametrize("n_directions", [4, 8, 16])
def test_friction_is_as_far_from_the_cone_as_the_polygon(n_directions):
    mass, mu, load = 3.0, 0.6, 3.0 * SLIDING
    shares = []
    for angle in np.linspace(0.0, 2.0 * np.pi, 73):
        b = np.array([-SLIDING, np.cos(angle), np.sin(angle)])
        p, v, *_ = solved(np.eye(3) / mass, b, mu, n_directions=n_directions)
        assert p[0] == pytest.approx(load)
        assert np.hypot(p[1], p[2]) <= mu * load * (1.0 + 1e-12)
        shares.append(-(p[1] * v[1] + p[2] * v[2]) / (np.hypot(v[1], v[2]) * mu * load))
    assert min(shares) >= np.cos(np.pi / n_directions) - 1e-12
    assert max(shares) == pytest.approx(1.0)


@pytest.mark.parametrize("mu", [0.2, 0.5, 0.9])
@pytest.mark.parametrize("corner", [0, 3, 6])
def test_a_block_on_an_incline_sticks_or_slides_as_coulomb_says(mu, corner):
    downhill = 2.0 * np.pi * corner / 8
    for alpha in (0.999 * np.arctan(mu), 1.001 * np.arctan(mu), 0.8):
        speed = 0.0
        for _ in range(5):
            pull = speed + SLIDING * np.sin(alpha)
            b = np.array([-SLIDING * np.cos(alpha), pull * np.cos(downhill), pull * np.sin(downhill)])
            _, v, *_ = solved(np.eye(3) / 4.0, b, mu)
            speed = v[1] * np.cos(downhill) + v[2] * np.sin(downhill)
        slides = max(0.0, np.sin(alpha) - mu * np.cos(alpha))
        assert speed == pytest.approx(5.0 * SLIDING * slides, rel=1e-9, abs=1e-12)
        assert (slides == 0.0) == (np.tan(alpha) < mu)


@pytest.mark.parametrize("epsilon", [0.0, 0.4, 1.0])
def test_head_on_impact_of_two_bodies(epsilon):
    m_1, m_2, v_1, v_2 = 2.0, 0.5, 1.2, -0.3
    axes = np.array([[-1.0, 0, 0], [0, 1, 0], [0, 0, 1]])
    bodies = scene([(m_1, (1, 1, 1)), (m_2, (1, 1, 1))], [(0, np.array([0.1, 0, 0]), 1, np.array([-0.1, 0, 0]), axes)])
    before = np.zeros(12)
    before[[0, 6]] = v_1, v_2
    b = bodies.J @ before
    p, *_ = solved(bodies.G, b, 0.3, target=-epsilon * b[0])
    after = before + bodies.per_mass * (bodies.J.T @ p)
    mean = (m_1 * v_1 + m_2 * v_2) / (m_1 + m_2)
    assert after[0] == pytest.approx(mean - epsilon * m_2 * (v_1 - v_2) / (m_1 + m_2))
    assert after[6] == pytest.approx(mean + epsilon * m_1 * (v_1 - v_2) / (m_1 + m_2))


@pytest.mark.parametrize("seed", range(30))
def test_contacts_give_no_energy(seed):
    rng = np.random.default_rng(seed)
    bodies = random_scene(rng, 10, 4)
    before = rng.normal(size=24)
    start = bodies.energy(before)
    b = bodies.J @ before
    for mu, epsilon in ((0.7, 0.0), (0.0, 0.0), (0.0, 0.5), (0.0, 1.0)):
        p, *_, off = solved(bodies.G, b, mu, target=-epsilon * b[::3])
        assert off <= 1e-8
        end = bodies.energy(before + bodies.per_mass * (bodies.J.T @ p))
        assert end <= start * (1.0 + 1e-7)
        if epsilon == 1.0:
            assert end == pytest.approx(start, rel=1e-6)


@pytest.mark.parametrize("n_directions", [4, 8])
@pytest.mark.parametrize("decades", [0.0, 1.0, 3.0])
@pytest.mark.parametrize("size", [(1, 1), (3, 2), (8, 3), (16, 2)])
def test_conditions_hold_in_random_problems(size, decades, n_directions):
    """16 contacts on 2 bodies of 12 degrees of freedom: more rows than G has rank."""
    for seed in range(10):
        rng = np.random.default_rng(seed)
        bodies = random_scene(rng, *size, decades)
        mu, b = rng.uniform(0.0, 1.0, size[0]), bodies.J @ rng.normal(size=6 * size[1])
        p, v, status, _, off = solved(bodies.G, b, mu, n_directions=n_directions, max_sweeps=50)
        assert status in (BY_SWEEPS, BY_PIVOTS)
        assert off <= 1e-8
        assert v == pytest.approx(b + bodies.G @ p, abs=1e-9)
        assert violation(bodies.G, b, mu, 0.0, p, n_directions) < 1e-7


@pytest.mark.parametrize("mu", [0.0, 0.2])
@pytest.mark.parametrize("seed", range(10))
def test_sweeps_and_pivots_agree_where_there_is_one_solution(mu, seed):
    """Velocities always without friction, impulses where no contact is redundant."""
    rng = np.random.default_rng(seed)
    for n, n_bodies in ((4, 4), (10, 2)):
        bodies = random_scene(rng, n, n_bodies)
        b = bodies.J @ rng.normal(size=6 * n_bodies)
        p, v, status, off_pivots = by_pivots(bodies.G, b, mu)
        q, u, off = by_sweeps(bodies.G, b, mu, 1e-10, 20000)
        assert status == SOLVED
        assert max(off_pivots, off) <= 1e-10
        assert u == pytest.approx(v, abs=1e-6)
        if n == n_bodies:
            assert q == pytest.approx(p, abs=1e-6)


def test_no_contacts_no_friction_and_unused_rows():
    assert solved(np.zeros((0, 0)), np.zeros(0), 0.5)[2:] == (BY_SWEEPS, 0, 0.0)
    assert by_pivots(np.zeros((0, 0)), np.zeros(0), 0.5)[2] == SOLVED
    for max_sweeps in (0, 10):
        p, v, *_ = solved(np.eye(3) / 2.0, [-1.0, 0.3, 0.4], 0.0, max_sweeps=max_sweeps)
        assert p == pytest.approx([2.0, 0.0, 0.0])
        assert v == pytest.approx([0.0, 0.3, 0.4])
    # room for 7 contacts, of which 3 are used
    bodies = random_scene(np.random.default_rng(1), 3, 2)
    b = bodies.J @ np.random.default_rng(2).normal(size=12)
    p, _, *few = solved(bodies.G, b, 0.5, max_sweeps=5)
    G, more, velocity, p_room = np.full((21, 21), np.nan), np.full(21, np.nan), np.zeros(21), np.zeros(21)
    G[:9, :9], more[:9] = bodies.G, b
    room = solve(np.int64(3), G, more, np.zeros(7), np.full(7, 0.5), p_room, velocity, 1e-8, np.int64(5), *scratch(7, 8))
    assert list(room) == few
    assert p_room[:9].tolist() == p.tolist()
    assert not p_room[9:].any()


def test_masses_of_any_unit_give_the_same():
    """By a power of 4, to the last bit."""
    for seed in range(10):
        rng = np.random.default_rng(seed)
        bodies = random_scene(rng, 6, 3)
        b = bodies.J @ rng.normal(size=18)
        p, v, *result = solved(bodies.G, b, 0.6, max_sweeps=20)
        q, u, *scaled = solved(bodies.G * 4.0**9, b, 0.6, max_sweeps=20)
        assert scaled == result
        assert (q * 4.0**9).tolist() == p.tolist()
        assert u.tolist() == v.tolist()


def test_residual_is_the_velocity_by_which_a_condition_is_broken():
    G, directions, mass = np.eye(3) / 5.0, friction_directions(8), 5.0

    def off(p, v, target=0.0):
        return residual(np.int64(1), G, np.array([target]), np.array([0.5]), mass * np.array(p), np.array(v), directions)

    assert off([1.0, 0.0, 0.0], [0.0, 0.0, 0.0]) == 0.0
    assert off([1.0, -0.5, 0.0], [0.0, 2.0, 0.0]) < 1e-15
    assert off([1.0, 0.0, 0.0], [-1e-3, 0.0, 0.0]) == pytest.approx(1e-3)  # approaches
    assert off([0.0, 0.0, 0.0], [0.2, 0.0, 0.0], target=0.201) == pytest.approx(1e-3)  # rebounds too slowly
    assert off([1e-3, 0.0, 0.0], [0.2, 0.0, 0.0]) == pytest.approx(1e-3)  # bears although it separates
    assert off([-1e-3, 0.0, 0.0], [0.2, 0.0, 0.0]) == pytest.approx(1e-3)  # pulls
    assert off([1.0, 0.2, 0.1], [0.0, 1e-3, 0.0]) == pytest.approx(1e-3)  # slides within the cone
    assert off([1.0, -0.499, 0.0], [0.0, 2.0, 0.0]) == pytest.approx(1e-3)  # slides with less than friction's bound
    assert off([1.0, -0.501, 0.0], [0.0, 2.0, 0.0]) == pytest.approx(1e-3)  # with more
    assert np.isnan(off([1.0, 0.0, np.nan], [0.0, 0.0, 0.0]))


@pytest.mark.parametrize("n_directions", [4, 6, 16])
def test_friction_of_one_contact_dissipates_most(n_directions):
    directions = friction_directions(n_directions)
    rng = np.random.default_rng(n_directions)
    weights = rng.dirichlet(np.full(n_directions, 0.2), 500)
    for k in range(200):
        root = rng.normal(size=(2, 2)) * (1.0, 0.0 if k % 4 == 0 else 10.0 ** rng.uniform(-3, 0))
        A, radius, v = root @ root.T, 10.0 ** rng.uniform(-2, 1), rng.normal(size=2)
        p = radius * (directions[:, :2].T @ weights[0])
        q = np.array(least(directions, radius, A[0, 0], A[0, 1], A[1, 1], *p, *v))
        assert (directions[:, 2:] @ q).max() <= radius * np.cos(np.pi / n_directions) * (1.0 + 1e-12)
        slope = v + A @ (q - p)
        # No point of the polygon lies down the slope: its lowest corner does not.
        assert (radius * directions[:, :2] @ slope).min() >= slope @ q - 1e-9 * radius * (1.0 + np.linalg.norm(slope))


def test_nearest_point_of_the_polygon():
    directions = friction_directions(8)
    rng = np.random.default_rng(0)
    for _ in range(200):
        point = rng.normal(size=2)
        q = np.array(nearest(directions, 0.7, *point))
        assert (directions[:, 2:] @ q).max() <= 0.7 * np.cos(np.pi / 8) + 1e-15
        assert (0.7 * directions[:, :2] @ (point - q)).max() <= (point - q) @ q + 1e-12
    assert nearest(directions, 0.0, 0.3, -0.2) == (0.0, 0.0)


def test_what_has_no_solution_says_so():
    """A body between two walls that both ask it to move away from them."""
    axes = np.array([[-1.0, 0, 0], [0, 1, 0], [0, 0, 1]])
    block = scene([(1.0, (1, 1, 1))], [(0, np.zeros(3), GROUND, None, -axes), (0, np.zeros(3), GROUND, None, axes)])
    p, v, status, _, off = solved(block.G, np.zeros(6), 0.5, target=0.1, max_sweeps=50)
    assert status == UNSOLVED
    assert off >= 0.1 - 1e-12
    assert np.isfinite([*p, *v]).all()
    _, _, status, _, off = solved(np.eye(3), [-1.0, np.nan, 0.0], 0.5)
    assert status == UNSOLVED
    assert np.isnan(off)


def test_sizes_that_make_no_sense_are_refused():
    with pytest.raises(ModelError, match=r"n_directions = 7: it must be an even number and at least 4 .* 8 leaves an error of 7\.6 %"):
        scratch(3, 7)
    with pytest.raises(ModelError, match=r"n_directions = 2: it must be an even number and at least 4"):
        scratch(3, 2)
    with pytest.raises(ModelError, match=r"most_contacts = -1: it must be 0 or above"):
        scratch(-1, 8)
