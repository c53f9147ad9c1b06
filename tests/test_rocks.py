"""Rocks of the rover: free bodies, pairs of contacts between them and wheels, support by soil, and what rigid contacts are told."""

import numpy as np
import pytest
from test_rover import whole

from cdl_fmu.slave.model import Instance, ModelError
from mbs.rover import Rover

H, G = 1e-3, 9.81
BOX = (0.2, 0.1, 0.05)  # sides [m]


def with_rocks(n=1, n_hard=1, **parameters):
    r = Instance(Rover(2, n, n_hard), **parameters)
    for j in range(n):
        rock = r.p.rock[j]
        rock.mass = 5.0
        a, b, c = BOX
        rock.inertia[:] = *(5.0 / 12 * np.array([b * b + c * c, a * a + c * c, a * a + b * b])), 0, 0, 0
    return r


def momenta(r):
    """Momentum and angular momentum about the origin of a rock whose centre of mass is its origin."""
    rock, p = r.y.rock[0], r.p.rock[0]
    T = rock["T"]
    spin = T.T @ (p.inertia[:3] * (T @ rock.w_0))
    return np.concatenate([p.mass * rock.v_0, p.mass * np.cross(rock.r_0, rock.v_0) + spin])


def test_a_rock_falls_and_starts_as_it_is_told():
    r = with_rocks(**{"rock[1].x": 1.0, "rock[1].z": 2.0, "rock[1].yaw": 0.3, "rock[1].pitch": 0.2, "rock[1].roll": -0.5})
    r.initialise()
    rock = r.y.rock[0]
    x = rock["T"].T @ (1, 0, 0)
    assert x == pytest.approx([np.cos(0.2) * np.cos(0.3), np.cos(0.2) * np.sin(0.3), -np.sin(0.2)])
    for k in range(100):
        r.step(k * H, H)
    assert rock.v_0 == pytest.approx([0, 0, -G * 0.1])
    assert rock.w_0 == pytest.approx(np.zeros(3))


def test_a_spinning_rock_keeps_its_momenta():
    errors = []
    for h in (1e-3, 2.5e-4):
        r = with_rocks(gravity=0.0)
        r.initialise()
        r.u.rock[0].t_0[:], r.u.rock[0].f_0[:] = (2.0, 1.0, 3.0), (1.0, 2.0, 3.0)
        for _ in range(round(0.05 / h)):
            r.step(0, h)
        r.u.rock[0].t_0[:] = r.u.rock[0].f_0[:] = 0.0
        start = momenta(r)
        for _ in range(round(0.5 / h)):
            r.step(0, h)
        assert np.linalg.norm(r.y.rock[0].w_0) > 5
        assert momenta(r)[:3] == pytest.approx(start[:3])
        errors.append(np.linalg.norm(momenta(r)[3:] - start[3:]) / np.linalg.norm(start[3:]))
    assert errors[0] < 0.05
    assert errors[1] < errors[0] / 3  # first order in the step


def test_a_fixed_rock_stays():
    r = with_rocks(**{"rock[1].fixed": "on", "rock[1].x": 0.5})
    r.initialise()
    r.u.rock[0].f_0[:] = 100.0
    for k in range(10):
        r.step(k * H, H)
    assert r.y.rock[0].r_0 == pytest.approx([0.5, 0, 0])
    assert not r.y.rock[0].v_0.any()


def lying(stiffness, *, n_hard=1, damping=0.0, friction=0.0, **parameters):
    """A rover whose front wheel stands on a rock that rests on soil."""
    r = with_rocks(n_hard=n_hard, **{"start.z": 0.125, "rock[1].x": 0.6, "rock[1].z": -0.025, **parameters})
    r.initialise()
    return r


def press(r, stiffness, damping=0.0, friction=0.0):
    """Front wheel on the rock's top: a pair; rear wheel on the ground, and the rock on soil: springs of their own."""
    for i, wheel in enumerate(r.y.wheel):
        top = r.y.rock[0].r_0[2] + 0.025 if i == 0 else 0.0
        depth = top + 0.125 - wheel.r_0[2]
        rate = (r.y.rock[0].v_0[2] if i == 0 else 0.0) - wheel.v_0[2]
        load = max(stiffness * depth + damping * rate, 0.0) if depth > 0 else 0.0
        point = wheel.r_0 - (0, 0, 0.125)
        if i == 0:
            hard, pair = r.u.hard[0], r.u.hard[0].pair[0]
            hard.wheel[0].f_0[2], hard.body[0].f_0[2] = load, -load
            pair.on, pair.against = (1.0, 3.0) if load else (0.0, 0.0)
            pair.point_0[:], pair.F[2], pair.K[2], pair.D[2] = point, load, stiffness, damping
            hard.body[0].t_0[:] = np.cross(point - r.y.rock[0].r_0, hard.body[0].f_0)
        else:
            r.u.wheel[i].f_0[2] = load
            c = r.u.contact[i]
            c.in_contact, c.F[2], c.K[2], c.D[2] = float(load > 0), load, stiffness, damping
            c.point_0[:] = point


def rest_on_soil(r, stiffness=2e5, damping=2e3):
    rock, s = r.y.rock[0], r.u.support[0]
    depth = -0.05 - (rock.r_0[2] - 0.025)
    load = max(stiffness * depth - damping * rock.v_0[2], 0.0)
    r.u.rock[0].f_0[2] = load
    tilt = np.cross(rock["T"][2], (0, 0, 1))
    r.u.rock[0].t_0[:] = 1e3 * tilt - 10 * rock.w_0
    s.in_contact, s.K[:], s.D[:], s.K_r[:], s.D_r[:] = 1.0, (1e5, 1e5, stiffness), (1e3, 1e3, damping), 1e3, 10.0
    s.point_0[:] = rock.r_0 - (0, 0, 0.025)


@pytest.mark.parametrize("stiffness", [1e6, 1e7, 1e8])
@pytest.mark.parametrize("ratio", [0.05, 1.0])
def test_a_wheel_on_a_movable_rock_is_stable_and_action_is_reaction(stiffness, ratio):
    r = lying(stiffness)
    damping = 2 * ratio * np.sqrt(stiffness * 2.0)
    loads = []
    for k in range(1500):
        rest_on_soil(r)
        press(r, stiffness, damping)
        before = r.y.rock[0].v_0[2]
        r.step(k * H, H)
        gained = 5.0 * (r.y.rock[0].v_0[2] - before) / H + 5.0 * G
        loads.append((r.y.applied[0].f_0[2], gained))
    assert np.abs(r.y.rock[0].v_0).max() < 1e-3
    weight = (50 + 4) * G
    assert r.y.applied["f_0"][:, 2].sum() == pytest.approx(weight, rel=2e-3)
    assert -r.y.rock[0].r_0[2] - 0.025 == pytest.approx((weight / 2 + 5 * G) / 2e5, rel=0.02)  # what it sank in


def test_free_twist_and_inverse_inertia_are_those_of_the_next_step():
    """With linear contacts whose forces go on along their Jacobian the prediction is exact, and an impulse adds to it by the matrix."""
    r = lying(1e6, with_inverse_inertia="on")
    for k in range(50):
        rest_on_soil(r)
        press(r, 1e6, 200.0)
        r.step(k * H, H)
    predicted, A = r.y.free_twist.copy(), whole(r.y.inverse_inertia)
    assert pytest.approx(A.T) == A
    assert np.linalg.eigvalsh(A).min() > -1e-9
    impulse = np.zeros(18)
    impulse[[0, 2, 7, 14, 16]] = 0.02, 0.05, 0.03, -0.04, 0.002  # on wheels and rock
    rest_on_soil(r)
    press(r, 1e6, 200.0)
    state = r.save()

    def twist():
        return np.concatenate([np.concatenate([f["v_0"], f["w_0"]]) for f in (*r.y.wheel, r.y.rock[0])])

    r.step(0.05, H)
    free = twist()
    assert free == pytest.approx(predicted, abs=1e-3 * np.abs(free).max())
    r.restore(state)
    for f, tool in zip(impulse.reshape(3, 6), (*r.u.hard[0].wheel, r.u.hard[0].body[0])):
        tool.f_0 += f[:3] / H
        tool.t_0 += f[3:] / H
    r.step(0.05, H)
    assert twist() - free == pytest.approx(A @ impulse, rel=1e-3, abs=1e-5)


def test_a_pair_that_would_pull_is_left_out():
    r = lying(1e6, gravity=0.0)
    hard, pair = r.u.hard[0], r.u.hard[0].pair[0]
    hard.wheel[0].f_0[2], hard.body[0].f_0[2] = 1.0, -1.0
    pair.on, pair.against, pair.F[2], pair.D[2] = 1.0, 3.0, 1.0, 1e5
    pair.point_0[:] = r.y.wheel[0].r_0 - (0, 0, 0.125)
    r.u.rock[0].f_0[2] = -500.0  # tears the rock off the wheel
    r.step(0, H)
    assert r.y.applied[0].f_0 == pytest.approx(np.zeros(3))
    assert r.y.rock[0].v_0[2] == pytest.approx(-500.0 / 5.0 * H)


def test_state_with_rocks_restores_to_the_same_bits():
    def walk(r, n):
        for k in range(n):
            rest_on_soil(r)
            press(r, 1e6, 200.0)
            r.u.command.wheel_rate[:] = 0.2
            r.step(k * H, H)
        return r.block.copy()

    r = lying(1e6, with_inverse_inertia="on")
    walk(r, 20)
    saved = r.save()
    once = walk(r, 20)
    r.restore(saved)
    assert np.array_equal(walk(r, 20), once)


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"rock[1].mass": 0.0}, "rock\\[1\\].mass = 0 kg: it must be at least 0.001 kg"),
        ({"rock[1].inertia": [0.1, 0.01, 0.01, 0, 0, 0]}, "rock\\[1\\].inertia = 0.1, 0.01, 0.01, .*no body has these"),
    ],
)
def test_bad_rocks_are_refused(values, text):
    with pytest.raises(ModelError, match=text):
        Instance(Rover(2, 1, 0), **values).initialise()
