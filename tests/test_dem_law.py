"""One contact of particles: against the law in plain Python, against its differential equation, and against closed forms."""

import math
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from grains import contact, in_order, spins, springs, velocities
from scipy.integrate import solve_ivp

from cdl_fmu.dem.material import Material
from cdl_fmu.dem.particles import V_X, W_X, W_Y, M, R
from cdl_fmu.dem.simulation import Simulation, Tool
from cdl_fmu.frames import axis_rotation
from cdl_fmu.mesh.surface import surface_of

NO_GRAVITY = (0.0, 0.0, 0.0)
SOFT = Material(E=5e6)
LAWS = [False, True]  # linear


def single(position, material, tools=(), *, r=5e-3, velocity=(0.0, 0.0, 0.0), spin=(0.0, 0.0, 0.0), **options):
    """A simulation of one sphere."""
    s = Simulation(np.array([position], float), np.array([r]), material, tools, **options)
    s.bodies[0, V_X : V_X + 3], s.bodies[0, W_X : W_X + 3] = velocity, spin
    return s


def pair(material, *, dt, radii=(5e-3, 3e-3), turn=0.3):
    """Two spheres that meet obliquely and spin, and the time [s] that a head-on impact would take, about."""
    n = np.array([math.cos(turn), math.sin(turn) * 0.6, math.sin(turn) * 0.8])
    s = Simulation(
        np.array([[0.01, 0.02, 0.03], [0.01, 0.02, 0.03] - n * sum(radii)]), np.array(radii), material, dt=dt, gravity=NO_GRAVITY
    )
    s.bodies[:, V_X : V_X + 3] = [[-0.3, 0.25, 0.1], [0.2, -0.1, 0.05]]
    s.bodies[:, W_X : W_X + 3] = [[20.0, -35.0, 10.0], [-15.0, 5.0, 40.0]]
    return s


# --- The law in plain Python, in the same steps ---


def leapfrog(bodies, material, dt, n_steps, gravity=NO_GRAVITY, tool=None):
    """What ``Simulation`` does with a pair of spheres, or with a sphere and a tool whose ``tool(step)`` is its contact.

    ``tool(step)`` gives distance and normal from the sphere's position, and the tool's position, velocity and spin.
    """
    bodies, history = bodies.copy(), np.zeros((2, 3))
    touched, slid, stuck = 0, 0, 0
    for step in range(n_steps):
        x, v, w, m, r = bodies[:, :3], velocities(bodies), spins(bodies), bodies[:, M], bodies[:, R]
        if tool is None:
            distance = np.linalg.norm(x[0] - x[1])
            n, overlap = (x[0] - x[1]) / distance, r.sum() - distance
            r_eff, m_eff, arms = r.prod() / r.sum(), m.prod() / m.sum(), r - 0.5 * overlap
            u, turns = v[0] - v[1] - np.cross(arms[0] * w[0] + arms[1] * w[1], n), w[0] - w[1]
        else:
            distance, n, r_0, v_0, w_0 = tool(step, x[0])
            overlap, r_eff, m_eff, arms = r[0] - distance, r[0], m[0], [distance]
            u, turns = v[0] - v_0 - np.cross(w_0, x[0] - n * distance - r_0) - distance * np.cross(w[0], n), w[0] - w_0
        force, torques = np.zeros((len(bodies), 3)), np.zeros((len(bodies), 3))
        if overlap > 0.0:
            touched += 1
            shear = history[0] - n * (history[0] @ n) + (u - n * (u @ n)) * dt
            roll = history[1] - n * (history[1] @ n) + (turns - n * (turns @ n)) * dt
            f, q, *history = contact(material, overlap, r_eff, m_eff, n, u, turns, shear, roll)
            slid += np.linalg.norm(history[0]) < 0.999999 * np.linalg.norm(shear)
            stuck += np.linalg.norm(history[0]) >= 0.999999 * np.linalg.norm(shear)
            force[0], torques[0] = f, arms[0] * np.cross(f, n) + q
            if tool is None:
                force[1], torques[1] = -f, arms[1] * np.cross(f, n) - q
        else:
            history = np.zeros((2, 3))
        v += (force / m[:, None] + gravity) * dt
        w += torques / (0.4 * m * r**2)[:, None] * dt
        x += v * dt
    return bodies, (touched, slid, stuck)


def assert_same(bodies, expected, rtol=1e-8):
    for columns in (slice(0, 3), slice(V_X, V_X + 3), slice(W_X, W_X + 3)):
        scale = np.abs(expected[:, columns]).max()
        assert bodies[:, columns] == pytest.approx(expected[:, columns], rel=rtol, abs=rtol * scale)


@pytest.mark.parametrize("linear", LAWS)
@pytest.mark.parametrize("changes", [{}, {"mu": 0.1}, {"mu": 3.0, "mu_r": 2.0}, {"cohesion": 200.0}, {"e": 0.9, "mu_r": 0.01}])
def test_two_spheres_move_as_the_law_in_plain_python(linear, changes):
    material, dt = replace(SOFT, linear=linear, **changes), 2e-6
    s = pair(material, dt=dt)
    start = in_order(s)
    s.step(800 * dt)
    expected, (touched, slid, stuck) = leapfrog(start, material, dt, 800)
    assert touched > 100 and slid and (stuck or material.mu == 0.1)
    assert_same(in_order(s), expected)


def moving(kind, material):
    """A tool that moves and spins, its reference for ``leapfrog`` in substeps of dt, and where its pose is after a time."""
    v_0 = np.array([0.05, -0.02, 0.1])
    axis, rate = (2, 8.0) if kind == "wheel" else (3, 20.0)
    w_0 = rate * np.eye(3)[axis - 1]
    tool = Tool(material)
    if kind == "wheel":
        tool.wheel = (0.05, 0.06, 0.0, 0.0, 0.0)
    elif kind == "mesh":
        tool.surface = surface_of(trimesh.creation.box(bounds=[[-0.05, -0.05, -0.02], [0.05, 0.05, 0.0]]))

    def place(time):
        tool.r_0, tool.T = v_0 * time, axis_rotation(axis, rate * time)

    def reference(dt):
        def at(step, x):
            d = x - v_0 * step * dt
            rho = math.hypot(d[0], d[2])
            distance, n = (rho - 0.05, np.array([d[0], 0.0, d[2]]) / rho) if kind == "wheel" else (d[2], np.array([0.0, 0.0, 1.0]))
            return distance, n, v_0 * step * dt, v_0, w_0

        return at

    return tool, place, reference


@pytest.mark.parametrize("linear", LAWS)
@pytest.mark.parametrize("kind", ["plane", "wheel", "mesh"])
def test_a_sphere_on_a_moving_tool_moves_as_the_law_in_plain_python(kind, linear):
    material, dt, gravity = replace(SOFT, linear=linear, mu=0.15, cohesion=50.0), 4e-6, np.array([0.5, 0.2, -9.81])
    tool, place, reference = moving(kind, material)
    height = 0.055 if kind == "wheel" else 0.005
    s = single((0.01, 0.004, height), material, [tool], velocity=(0.2, 0.1, -0.3), spin=(10.0, -30.0, 20.0), dt=dt, gravity=gravity)
    start = in_order(s)
    for k in range(50):
        place((k + 1) * 20 * dt)
        s.step(20 * dt)
    expected, (touched, slid, stuck) = leapfrog(start, material, dt, 1000, gravity, reference(dt))
    assert touched > 100 and slid and stuck
    assert_same(in_order(s), expected)


# --- The differential equation ---


def sticking(material, bodies, time):
    """Motion of a pair of spheres in contact that neither slide nor roll freely, by its differential equation: their records then."""
    m, r = bodies[:, M], bodies[:, R]
    r_eff, m_eff = r.prod() / r.sum(), m.prod() / m.sum()

    def rates(_, y):
        x, v, w, (shear, roll) = y[:6].reshape(2, 3), y[6:12].reshape(2, 3), y[12:18].reshape(2, 3), y[18:].reshape(2, 3)
        distance = np.linalg.norm(x[0] - x[1])
        n, overlap = (x[0] - x[1]) / distance, max(r.sum() - distance, 1e-16)
        arms = r - 0.5 * overlap
        u, turns = v[0] - v[1], w[0] - w[1]
        n_rate = (u - n * (u @ n)) / distance
        slip = u - n * (u @ n) - np.cross(arms[0] * w[0] + arms[1] * w[1], n)
        f, _, k_t, c_n, c_t = springs(material, overlap, r_eff, m_eff)
        f_t, q = -k_t * shear - c_t * slip, -k_t * r_eff**2 * roll
        force = (f - c_n * (u @ n) - material.cohesion * (4.0 * r_eff) ** 2) * n + f_t
        torque = np.array([arms[0] * np.cross(f_t, n) + q, arms[1] * np.cross(f_t, n) - q])
        moved = np.concatenate([slip - n * (shear @ n_rate), turns - n * (turns @ n) - n * (roll @ n_rate)])
        return np.concatenate([v.ravel(), np.outer(1.0 / m, force)[0], -force / m[1], (torque / (0.4 * m * r**2)[:, None]).ravel(), moved])

    start = np.concatenate([bodies[:, :3].ravel(), velocities(bodies).ravel(), spins(bodies).ravel(), np.zeros(6)])
    end = solve_ivp(rates, (0.0, time), start, rtol=1e-11, atol=1e-14, method="DOP853").y[:, -1]
    result = bodies.copy()
    result[:, :3], result[:, V_X : V_X + 3], result[:, W_X : W_X + 3] = end[:18].reshape(3, 2, 3)
    return result


@pytest.mark.parametrize("linear", LAWS)
@pytest.mark.parametrize("cohesion", [0.0, 200.0])
def test_two_spheres_that_stick_converge_to_the_differential_equation(linear, cohesion):
    material, time = replace(SOFT, linear=linear, mu=1e3, mu_r=1e3, cohesion=cohesion), 4e-4
    exact = sticking(material, in_order(pair(material, dt=1e-6)), time)
    results = []
    for dt in (2e-6, 1e-6, 5e-7):
        s = pair(material, dt=dt)
        s.step(time)
        results.append(in_order(s))
    for columns in (slice(V_X, V_X + 3), slice(W_X, W_X + 3)):
        errors = [np.linalg.norm((result - exact)[:, columns]) for result in results]
        change = np.linalg.norm((exact - in_order(pair(material, dt=1e-6)))[:, columns])
        assert errors[1] / errors[2] == pytest.approx(2.0, abs=0.1)  # first order: damping takes the velocity of half a step before
        extrapolated = 2.0 * results[2] - results[1]
        assert np.linalg.norm((extrapolated - exact)[:, columns]) < 1e-4 * change


def impact(material, v_x, v_z, w_y, r, m):
    """Impact of a sphere on a plane in x and z, by its differential equation: v_x, v_z, w_y after it, and what the contact did in turn."""

    def law(y):
        overlap = max(r - y[0], 1e-16)
        f, _, k_t, c_n, c_t = springs(material, overlap, r, m)
        f -= c_n * y[2]
        return f, k_t, c_t, material.mu * max(f, 0.0)

    def rates(_, y, side):
        """y: height, v_x, v_z, w_y, shear; side: +-1 while it slides, 0 while it sticks."""
        f, k_t, c_t, most = law(y)
        slip = y[1] - y[0] * y[3]
        shear = side * most / k_t if side else y[4]
        f_t = min(max(-k_t * shear - c_t * slip, -most), most)
        return np.array([y[2], f_t / m, f / m, -y[0] * f_t / (0.4 * m * r**2), 0.0 if side else slip])

    def slides(_, y, side):
        f, k_t, _, most = law(y)
        return 1.0 if side else k_t * abs(y[4]) - most

    def sticks(_, y, side):
        if not side:
            return 1.0
        dy = 1e-9 * rates(0.0, y, side)
        growth = (law(y + dy)[3] / law(y + dy)[1] - law(y - dy)[3] / law(y - dy)[1]) / 2e-9
        return side * (y[1] - y[0] * y[3]) - growth

    def ends(_, y, side):
        return y[0] - r

    slides.terminal = sticks.terminal = ends.terminal = True
    slides.direction, sticks.direction, ends.direction = 1.0, -1.0, 1.0
    y, time, side, phases = np.array([r * (1.0 - 1e-12), v_x, v_z, w_y, 0.0]), 0.0, 0.0, ["sticks"]
    while True:
        run = solve_ivp(rates, (time, 1.0), y, args=(side,), events=(slides, sticks, ends), rtol=1e-10, atol=1e-14, max_step=2e-5)
        y, time = run.y[:, -1], run.t[-1]
        if run.t_events[2].size:
            return y[1:4], phases
        if side:
            _, k_t, _, most = law(y)
            y[4], side = side * most / k_t, 0.0
        else:
            side = math.copysign(1.0, y[4])
        phases.append("slides" if side else "sticks")


@pytest.mark.parametrize("linear", LAWS)
@pytest.mark.parametrize("v_x, w_y", [(0.05, 0.0), (0.3, -20.0), (0.1, 60.0), (1.0, 0.0)])
def test_an_oblique_impact_that_sticks_and_slides_converges_to_the_differential_equation(linear, v_x, w_y):
    material, r = replace(SOFT, linear=linear, mu=0.3, mu_r=0.0), 5e-3
    results = []
    for dt in (1e-6, 5e-7):
        s = single((0.0, 0.0, r), material, [Tool(material)], velocity=(v_x, 0.0, -0.3), spin=(0.0, w_y, 0.0), dt=dt, gravity=NO_GRAVITY)
        s.step(4e-3)
        results.append(s.bodies[0, [V_X, V_X + 2, W_Y]] * [1.0, 1.0, r])
        assert s.bodies[0, 2] > r
    exact, phases = impact(material, v_x, -0.3, w_y, r, s.bodies[0, M])
    exact = exact * [1.0, 1.0, r]
    assert phases[:2] == ["sticks", "slides"]
    errors = [np.abs(result - exact).max() for result in results]
    assert errors[0] < 1e-3 and errors[1] < 0.7 * errors[0] + 1e-6
