"""RBC with bodies of a multibody system: rest, impacts, friction, edges; without its inverse inertia; and what survives a step."""

import math

import numpy as np
import pytest
import trimesh
from hard import Coupled, export, floor

from cdl_fmu.frames import axis_rotation
from cdl_fmu.rbc import RBC
from cdl_fmu.slave.model import Instance, ModelError

G, H = 9.81, 1e-3
AWAY = {"start.x": 500.0}  # the rover falls somewhere else
EXACT = {"tolerance": 1e-9}


@pytest.fixture(scope="module")
def meshes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("meshes")
    ball = trimesh.creation.icosphere(2, 0.1)
    lowest = ball.vertices[np.argmin(ball.vertices[:, 2])]
    ball.apply_transform(trimesh.geometry.align_vectors(lowest, [0.0, 0.0, -1.0]))
    return {
        "floor": floor(folder / "floor.stl"),
        "ball": export(folder / "ball.stl", ball),
        "box": export(folder / "box.stl", trimesh.creation.box((0.2, 0.2, 0.2))),
    }


def on_floor(meshes, *bodies, rover=None, hard=None, **options):
    """Bodies (mesh, start) above a fixed floor."""
    rocks = [(meshes["floor"], {"fixed": "on"}), *((meshes[name], start) for name, start in bodies)]
    return Coupled(RBC(2, len(rocks)), rocks, AWAY | (rover or {}), EXACT | (hard or {}), **options)


def of_all(n, **values):
    return {f"body[{j}].{name}": value for j in range(1, n + 1) for name, value in values.items()}


def energy(system, j):
    """Kinetic and potential energy [J] of a body whose origin is its centre of mass, gravity along -z."""
    rock, p = system.rover.y.rock[j], system.rover.p.rock[j]
    spin = rock["T"] @ rock.w_0
    return float(0.5 * p.mass * rock.v_0 @ rock.v_0 + 0.5 * spin @ (p.inertia[:3] * spin) + p.mass * G * rock.r_0[2])


# -- rest


def test_a_rover_at_rest_weighs_what_it_weighs(meshes):
    rest = Coupled(RBC(2, 1), [(meshes["floor"], {"fixed": "on"})], {"start.z": 0.135}, EXACT)
    weight = 54.0 * G
    rows = rest.run(0.4, lambda s: (s.rover.y.applied["f_0"][:, 2].sum(), s.rover.y.body.r_0[2], s.hard.y.sweeps, s.hard.y.n_contacts))
    load, height, sweeps, contacts = rows[100:].T
    assert np.abs(load / weight - 1.0).max() < 1e-6
    assert np.ptp(height) < 1e-9 and set(contacts) == {4.0}
    assert sweeps.mean() < 1.0  # the impulses of the last step are those of the next one
    assert rest.hard.y.pivoted < 0.1 and rest.hard.y.unsolved < 0.01
    assert rest.hard.y.body[0].f_0[2] == pytest.approx(-weight, rel=1e-6)


def test_a_stack_of_boxes(meshes):
    """Three cubes: each bears those above it."""
    stack = on_floor(meshes, *(("box", {"z": 0.1 + 0.2 * k}) for k in range(3)))
    rows = stack.run(0.4, lambda s: (*(s.rover.y.rock[j].r_0[2] for j in (1, 2, 3)), *(f["f_0"][2] for f in s.hard.y.body)))
    weight = stack.rover.p.rock[1].mass * G
    assert rows[-1, :3] == pytest.approx([0.1, 0.3, 0.5], abs=1e-6)
    assert rows[100:, 3] == pytest.approx(-3.0 * weight, rel=1e-4)
    assert rows[-1, 3:] == pytest.approx([-3.0 * weight, weight, weight, weight], rel=1e-6)


def test_a_ball_in_a_groove(meshes):
    """Two planes at 45 degrees without friction: each presses with the weight over the root of two."""
    turns = [sign * 0.25 * math.pi for sign in (1.0, -1.0)]
    normals = [axis_rotation(2, turn).T @ (0.0, 0.0, 1.0) for turn in turns]
    planes = [
        (meshes["floor"], {"fixed": "on", "pitch": turn, "x": 4.0 * up[0], "z": 4.0 * up[2]}) for turn, up in zip(turns, normals[::-1])
    ]
    groove = Coupled(RBC(2, 3), [*planes, (meshes["ball"], {"z": 0.1415})], AWAY, EXACT | of_all(3, mu=0.0))
    groove.run(0.4)
    mean = groove.run(0.1, lambda s: [f["f_0"] for f in s.hard.y.body]).mean(axis=0)
    weight = groove.rover.p.rock[2].mass * G
    assert mean[2] == pytest.approx([0.0, 0.0, weight], rel=1e-3, abs=1e-3 * weight)
    for force, normal in zip(mean, normals):
        assert force == pytest.approx(-weight / math.sqrt(2.0) * normal, rel=1e-3, abs=1e-3 * weight)


# -- impacts


def peaks(heights):
    inner = heights[1:-1]
    return inner[(inner > heights[:-2]) & (inner >= heights[2:])]


def bounce(meshes, restitution, h, seconds, start=0.3):
    """Heights of a ball above its rest, dropped from a height [m]."""
    ball = on_floor(meshes, ("ball", {"z": 0.1 + start}), hard=of_all(2, restitution=restitution), h=h)
    return ball.run(seconds, lambda s: s.rover.y.rock[1].r_0[2] - 0.1)


@pytest.mark.parametrize(("restitution", "seconds", "n"), [(0.5, 0.75, 2), (0.8, 1.4, 3)])
def test_heights_of_a_ball(meshes, restitution, seconds, n):
    """Rebound k rises to h e^(2 k)."""
    heights = peaks(bounce(meshes, restitution, 1e-4, seconds))[:n]
    assert heights == pytest.approx(0.3 * restitution ** (2.0 * np.arange(1, n + 1)), rel=0.01)


def test_the_error_of_a_rebound_falls_with_the_step(meshes):
    """In the mean over where in a step the ball meets the floor."""
    errors = []
    for h in (1e-3, 5e-4, 2.5e-4):
        starts = 0.3 + 2e-3 * np.arange(6)
        first = [peaks(bounce(meshes, 0.5, h, 0.42, start))[0] / (0.25 * start) - 1.0 for start in starts]
        errors.append(np.sqrt(np.mean(np.square(first))))
    assert errors[1] < 0.65 * errors[0] and errors[2] < 0.65 * errors[1]


def test_restitution_0_stays_and_1_returns(meshes):
    dead, elastic = bounce(meshes, 0.0, H, 0.6), bounce(meshes, 1.0, H, 0.6)
    assert np.abs(dead[300:]).max() < 1e-6
    assert peaks(elastic)[0] == pytest.approx(0.3, rel=1e-3)


@pytest.mark.parametrize("h", [1e-3, 5e-5])
def test_an_overlap_is_taken_back_without_a_hop(meshes, h):
    ball = on_floor(meshes, ("ball", {"z": 0.0995}), h=h)
    heights = ball.run(0.2, lambda s: s.rover.y.rock[1].r_0[2] - 0.1)
    assert heights.max() < 1e-4 and abs(heights[-1]) < 1e-5


# -- friction


def slide(meshes, slope, mu, uphill=0.0, **hard):
    """Velocities of a box on a slope; the world's axes lie in it."""
    hard = of_all(2, mu=mu) | hard
    box = on_floor(meshes, ("box", {"z": 0.1}), rover={"slope": slope, "uphill": uphill}, hard=hard)
    return box.run(0.3, lambda s: (*s.rover.y.rock[1].v_0, *s.rover.y.rock[1].w_0))


@pytest.mark.parametrize("mu", [0.25, 0.6])
def test_a_box_on_a_slope_sticks_up_to_its_friction(meshes, mu):
    for uphill in (0.0, math.pi / 8.0):
        below = math.atan(mu * math.cos(math.pi / 8.0)) - 0.01
        assert np.abs(slide(meshes, below, mu, uphill)).max() < 1e-6
    above = slide(meshes, math.atan(mu) + 0.05, mu)
    assert above[-1, 0] == pytest.approx(-G * (math.sin(math.atan(mu) + 0.05) - mu * math.cos(math.atan(mu) + 0.05)) * 0.3, rel=1e-6)
    assert np.abs(above[:, 1:]).max() < 1e-6  # straight, without turning


@pytest.mark.parametrize("n_directions", [4, 8, 16])
def test_between_the_pyramid_s_edges_friction_is_less(meshes, n_directions):
    """By 1 - cos(pi / n), the most it can be off."""
    slope, mu = 0.6, 0.3
    for uphill, share in ((0.0, 1.0), (math.pi / n_directions, math.cos(math.pi / n_directions))):
        v = slide(meshes, slope, mu, uphill, n_directions=float(n_directions))[-1, :2]
        assert np.hypot(*v) == pytest.approx(G * (math.sin(slope) - share * mu * math.cos(slope)) * 0.3, rel=1e-6)


def test_a_box_beyond_an_edge_tips_over_it(meshes):
    """One with its centre of mass on the floor stays, one with it beyond the floor's end falls, without a gain of energy."""
    stays = on_floor(meshes, ("box", {"x": 3.95, "z": 0.1}))
    stays.run(0.5)
    assert stays.rover.y.rock[1].r_0 == pytest.approx([3.95, 0.0, 0.1], abs=1e-6)
    falls = on_floor(meshes, ("box", {"x": 4.03, "z": 0.1}))
    energies = falls.run(0.8, lambda s: energy(s, 1))
    assert falls.rover.y.rock[1].r_0[2] < -0.3 and falls.rover.y.rock[1].w_0[1] > 0.5
    assert np.diff(energies).max() < 2e-3 * energies[0]


# -- without the inverse inertia


def test_a_scalar_mass_bears_a_rover(meshes):
    """A system that tells nothing: the wheel's own mass, shared by its contacts, holds it; the forces end at the weight."""
    rest = Coupled(RBC(2, 1), [(meshes["floor"], {"fixed": "on"})], {"start.z": 0.135}, EXACT, tells=False)
    rows = rest.run(1.0, lambda s: (s.rover.y.applied["f_0"][:, 2].sum(), s.rover.y.body.r_0[2]))
    assert rows[500:, 0].mean() == pytest.approx(54.0 * G, rel=0.01)
    assert np.abs(rows[:, 1] - 0.135).max() < 2e-3
    assert not rest.hard.warnings


def test_a_scalar_mass_above_what_is_carried_is_warned_of(meshes):
    heavy = {"effective_mass": 200.0, **of_all(1, restitution=0.5)}
    drop = Coupled(RBC(2, 1), [(meshes["floor"], {"fixed": "on"})], {"start.z": 0.2}, heavy, tells=False)
    drop.run(0.15)
    assert any("rebounds faster than it came: effective_mass = 200 kg is more than what it carries" in text for text in drop.hard.warnings)


def wheel_on_floor(meshes, **parameters):
    instance = Instance(RBC(1, 1), **{"body[1].mesh": meshes["floor"], "body[1].fixed": "on"}, **parameters)
    wheel = instance.u.wheel[0]
    wheel["T"][:] = np.eye(3)
    wheel.r_0[:] = 0.0, 0.0, 0.5
    instance.initialise()
    return instance


@pytest.mark.parametrize("n_contacts", [2, 4])
def test_contacts_share_the_scalar_mass(meshes, n_contacts):
    """Of N contacts each has 1 / N of it: together they stop that mass, (1 + e) m v."""
    tips = {"n_g": 12.0, "h_g": 0.01} if n_contacts == 4 else {"n_g": 0.0, "h_g": 0.0}
    instance = wheel_on_floor(meshes, effective_mass=3.0, **{"body[1].restitution": 0.5}, **tips, spacing=1e-3)
    wheel = instance.u.wheel[0]
    wheel.r_0[2], wheel.v_0[2] = (0.135 if n_contacts == 4 else 0.125), -0.4
    instance.step(0.0, H)
    assert instance.y.n_contacts == n_contacts
    assert instance.y.wheel[0].f_0[2] * H == pytest.approx(3.0 * 1.5 * 0.4)


# -- what survives a step


def test_states_restore_to_the_same_bits(meshes):
    system = on_floor(meshes, ("box", {"z": 0.11}), ("ball", {"x": 0.05, "z": 0.33}))
    system.run(0.05)

    def go_on():
        system.run(0.05)
        return system.hard.block.copy(), system.rover.block.copy()

    saved = system.hard.save(), system.rover.save()
    once = go_on()
    system.hard.restore(saved[0]), system.rover.restore(saved[1])
    again = go_on()
    assert all(np.array_equal(a, b) for a, b in zip(once, again))


def test_a_refused_step_changes_nothing(meshes):
    instance = wheel_on_floor(meshes)
    instance.u.wheel[0].r_0[2] = 0.135
    instance.u.wheel[0].v_0[2] = -0.1
    instance.step(0.0, H)
    before = instance.block[instance.slices["x"]].copy()
    assert before.any()
    for height, text in ((0.12, "body 1, at .* is overlapped by more than reach = 0.005 m"), (math.nan, r"wheel\[1\].r_0\[3\] = nan m")):
        instance.u.wheel[0].r_0[2] = height
        with pytest.raises(ModelError, match=text):
            instance.step(0.0, H)
        assert np.array_equal(instance.block[instance.slices["x"]], before)


def test_a_wheel_without_a_pose_touches_nothing(meshes):
    instance = wheel_on_floor(meshes)
    instance.u.wheel[0].r_0[:] = 0.0
    instance.step(0.0, H)
    assert instance.y.n_contacts == 0.0 and "wheel 1 has no pose yet" in instance.warnings[0]


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"n_directions": 7.0}, "n_directions = 7: it must be even, so that friction is the same both ways; use 8"),
        ({"max_sweeps": 1.5}, "max_sweeps = 1.5: it must be a whole number"),
        ({"body[1].restitution": 1.2}, r"body\[1\].restitution = 1.2: it must be at most 1"),
        ({"tolerance": 0.0}, "tolerance = 0 m/s: it must be at least 1e-12 m/s"),
    ],
)
def test_bad_parameters_are_refused(meshes, change, text):
    with pytest.raises(ModelError, match=text):
        wheel_on_floor(meshes, **change)


def test_a_model_without_bodies_is_refused():
    with pytest.raises(ValueError, match="rigid wheels need a body to stand on; choose 1 or more"):
        RBC(1, 0)
