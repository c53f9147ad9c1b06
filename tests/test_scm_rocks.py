"""Rocks in SCM's soil: free bodies on the interface Jacobian that it sends, and bodies around which the soil is laid at the start."""

import math

import numpy as np
import pytest
import trimesh
from free_bodies import FreeBody, G, turn
from scipy.spatial import ConvexHull
from soil import surface, volume_error

from cdl_fmu.frames import axis_rotation
from cdl_fmu.slave.model import ModelError

DENSITY = 2700.0
AT = (0.003, -0.002)
TURNED = dict(roll=15.0, pitch=-10.0, yaw=30.0)
H = 1e-3
#: Columns of a run.
Z, V, W, F, ENERGY = 2, slice(3, 6), slice(6, 9), slice(9, 12), 12


def ball(mass):
    return trimesh.creation.icosphere(3, (0.75 * mass / DENSITY / math.pi) ** (1.0 / 3.0))


def box(mass, *sides):
    return trimesh.creation.box(np.array(sides) * (mass / DENSITY / np.prod(sides)) ** (1.0 / 3.0))


def boulder(mass, seed=0):
    """An irregular convex rock."""
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(14, 3))
    corners *= (rng.uniform(0.8, 1.1, 14) / np.linalg.norm(corners, axis=1))[:, None] * [0.1, 0.08, 0.07]
    mesh = trimesh.convex.convex_hull(corners)
    mesh.apply_translation(-mesh.center_mass)
    return mesh.apply_scale((mass / DENSITY / mesh.volume) ** (1.0 / 3.0))


def free(tmp_path, mesh, mass, z=0.0, **more) -> FreeBody:
    mesh.export(tmp_path / "rock.stl")
    return FreeBody(tmp_path / "rock.stl", mass, z, at=AT, **more)


def speeds(rows):
    return np.linalg.norm(rows[:, V], axis=1)


def assert_at_rest(rows, mass, fastest=1e-4):
    """No motion, no noise of the force, and a force that is the weight."""
    assert speeds(rows).max() < fastest
    assert rows[:, F][:, 2] == pytest.approx(mass * G, rel=0.005)
    assert np.abs(np.diff(rows[:, F], 2, axis=0)).max() < 1e-3 * mass * G


def assert_energy_decays(rows, mass):
    """What springs back is less every time: from one 50 ms to the next the most that there is falls."""
    most = rows[: len(rows) // 50 * 50, ENERGY].reshape(-1, 50).max(axis=1)
    assert (np.diff(most) < 1e-5 * mass * G).all()


@pytest.mark.parametrize(
    ("mesh", "mass", "z", "attitude"),
    [
        (ball(0.5), 0.5, 0.04, {}),
        (box(0.5, 1.0, 1.2, 0.8), 0.5, 0.035, dict(roll=5.0, pitch=3.0, yaw=20.0)),
        (box(3.0, 1.0, 1.2, 0.8), 3.0, 0.055, dict(roll=5.0, pitch=3.0, yaw=20.0)),
    ],
    ids=["ball", "light box", "box"],
)
def test_a_body_that_is_dropped_comes_to_rest_without_chatter(tmp_path, mesh, mass, z, attitude):
    body = free(tmp_path, mesh, mass, z, **attitude)
    rows = body.run(1.5)
    assert rows[:, F][:, 2].max() > 2.0 * mass * G and rows[-1, Z] > 0.0
    assert_at_rest(rows[1300:], mass)
    assert_energy_decays(rows, mass)
    assert volume_error(body.instance) == 0.0


@pytest.mark.parametrize(("mass", "cell"), [(0.5, 0.01), (3.0, 0.01), (20.0, 0.02)])
def test_a_half_buried_box_that_is_pushed_sideways_comes_to_rest(tmp_path, mass, cell):
    body = free(tmp_path, box(mass, 1.0, 1.2, 0.8), mass, yaw=20.0, cell=cell)
    rows = body.run(0.6)
    assert_at_rest(rows[500:], mass)
    assert np.abs(rows[500:, F][:, :2]).max() < 1e-3 * mass * G
    pushed = body.run(1.2, push=(0.5 * mass * G, 0.0, 0.0))
    assert_at_rest(pushed[1100:], mass)
    assert pushed[-1, F][0] == pytest.approx(-0.5 * mass * G, rel=0.01)
    assert 5e-5 < pushed[-1, 0] - rows[-1, 0] < 1e-3


def test_steps_of_1_ms_sink_as_deep_as_short_ones(tmp_path):
    mesh = box(3.0, 1.0, 1.2, 0.8)
    depths = [free(tmp_path, mesh, 3.0, yaw=20.0).run(0.12, h)[-1, Z] for h in (1e-3, 5e-5)]
    assert depths[0] == pytest.approx(depths[1], rel=0.04) and depths[1] < -0.01


def test_a_box_tips_over_its_edge(tmp_path):
    """Its middle is beyond the edge that it stands on: it falls, as on rigid ground at first, and lies flat in the end."""
    mesh = box(3.0, 1.0, 1.0, 2.0)
    half, height = mesh.extents[0] / 2.0, mesh.extents[2] / 2.0
    lean = math.degrees(math.atan(half / height)) + 6.0
    top = math.hypot(half, height) * math.cos(math.radians(6.0))
    body = free(tmp_path, mesh, 3.0, top - 0.002, pitch=lean)
    rows = body.run(2.0)
    assert 1.0 < np.abs(rows[:, W][:, 1]).max() < 10.0
    assert abs(body.body["T"][2, 2]) < 0.15 and rows[-1, Z] < half
    assert speeds(rows[1900:]).max() < 1e-3


def test_the_jacobian_is_nowhere_softer_than_the_ground(tmp_path):
    """Small motions of a body at rest along and about each axis change its wrench by no more than it says, and by some share of it."""
    body = free(tmp_path, boulder(2.0), 2.0, c_d=0.0, tau_r=0.0)
    body.run(0.8)
    support = body.instance.y.support[0]
    body.body.v_0[:] = body.body.w_0[:] = 0.0
    body.instance.step(0.0, 0.0)
    at_rest = body.instance.save()
    stiffness, point = np.array([*support.K, *support.K_r]), support.point_0.copy()
    origin, T = body.body.r_0.copy(), body.body["T"].copy()

    def wrench():
        y = body.instance.y.body[0]
        return np.concatenate([y.f_0, y.t_0 + np.cross(origin - point, y.f_0)])

    f_0 = wrench()
    shares = []
    for axis in range(6):
        body.instance.restore(at_rest)
        unit = np.eye(3)[axis % 3]
        if axis < 3:
            # Displacements of friction are integrals of the velocity.
            body.body.r_0[:], body.body.v_0[:] = origin + 4e-6 * unit, 4e-3 * unit
        else:
            body.body.r_0[:] = point + turn(4e-5 * unit) @ (origin - point)
            body.body["T"][:] = T @ turn(-4e-5 * unit)
            body.body.w_0[:] = 4e-2 * unit
            body.body.v_0[:] = np.cross(body.body.w_0, origin - point)
        body.instance.step(0.0, H)
        shares.append(-(wrench() - f_0)[axis] / (4e-6 if axis < 3 else 4e-5) / stiffness[axis])
    assert max(shares) < 1.02 and min(shares) > 0.1


@pytest.mark.parametrize("step", [1e-3, pytest.param(2e-4, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("mesh", "mass", "z"),
    [(ball(3.0), 3.0, 0.07), *((boulder(5.0, seed), 5.0, 0.0) for seed in (2, 4, 5)), pytest.param(ball(20.0), 20.0, 0.126)],
    ids=["ball", "boulder 2", "boulder 4", "boulder 5", "large ball"],
)
def test_a_body_that_rocks_comes_to_rest(tmp_path, mesh, mass, z, step):
    """Soil gives back no more energy than it got, whatever loads and unloads its cells while they are sheared."""
    rows = free(tmp_path, mesh, mass, z).run(1.6, step)
    assert speeds(rows[-round(0.1 / step) :]).max() < 1e-4
    assert np.abs(rows[-1, F][:2]).max() < 1e-3 * mass * G


def test_soil_that_was_pressed_before_bears_a_body_from_the_first_step_on(tmp_path):
    mass, mesh = 5.0, boulder(5.0, 3)
    low, high = 0.0, 0.05
    for _ in range(16):
        settled = 0.5 * (low + high)
        force = free(tmp_path, mesh, mass, **{"body[1].settled": settled}).instance.y.body[0].f_0[2]
        low, high = (settled, high) if force < mass * G else (low, settled)
    assert 0.005 < settled < 0.02
    body = free(tmp_path, mesh, mass, **{"body[1].settled": settled})
    start = body.body["T"].copy()
    rows = body.run(0.5)
    assert np.abs(rows[:, :3] - [*AT, 0.0]).max() < 1e-3 and speeds(rows).max() < 0.02
    assert math.degrees(math.acos(min(1.0, 0.5 * (np.trace(start @ body.body["T"].T) - 1.0)))) < 1.0
    assert volume_error(body.instance) == 0.0


def test_the_contact_of_a_body_at_rest_is_worked_out_again_when_it_or_the_soil_changes(tmp_path):
    body = free(tmp_path, boulder(5.0, 1), 5.0)
    body.run(0.8)
    body.instance.p.tau_r = 0.0  # force by displacement alone
    memory = body.instance.x.body[0]
    assert memory.steps > 0.0
    at_rest = body.body.r_0.copy()
    # What pushes it on slowly meets all of its friction, though most of its way is gone in steps that only continue the last wrench.
    forces = []
    for speed in (2e-5, 4e-3):
        body.body.r_0[:] = at_rest
        saved = body.instance.save()
        body.body.v_0[:], body.body.w_0[:] = [speed, 0.0, 0.0], 0.0
        n_steps = round(2e-4 / speed / H)
        for _ in range(n_steps):
            body.body.r_0[0] += speed * H
            body.instance.step(0.0, H)
        forces.append(body.instance.y.body[0].f_0[0])
        body.instance.restore(saved)
    assert forces[0] < -0.5 and forces[0] == pytest.approx(forces[1], rel=0.1)


def test_a_body_in_the_air_has_no_support(tmp_path):
    body = free(tmp_path, ball(1.0), 1.0, 1.0)
    body.instance.step(0.0, H)
    support = body.instance.y.support[0]
    assert support.in_contact == 0.0 and not any(getattr(support, name).any() for name in ("K", "D", "K_r", "D_r"))
    assert np.array_equal(support.anchor.r_0, body.body.r_0) and not surface_is_disturbed(body)


def surface_is_disturbed(body):
    ground = surface(body.instance)
    return ground is not None and np.nanmax(np.abs(ground.z)) > 0.0


@pytest.mark.parametrize(
    ("mesh", "attitude"),
    [(ball(5.0), {}), (box(5.0, 1.2, 1.0, 0.9), TURNED), (boulder(5.0), {}), (boulder(5.0, seed=3), TURNED)],
    ids=["ball", "box", "boulder", "another"],
)
def test_soil_is_laid_around_a_body_that_begins_in_it(tmp_path, mesh, attitude):
    """Nothing presses it, the hole below fits, soil around it stays; then it sinks until the soil bears it, and stays."""
    mass = 5.0
    body = free(tmp_path, mesh, mass, **attitude)
    assert not surface_is_disturbed(body)
    for _ in range(3):
        body.instance.step(0.0, H)
        assert np.linalg.norm(body.instance.y.body[0].f_0) < 0.02 * mass * G
    held = surface(body.instance)
    solid = trimesh.load_mesh(tmp_path / "rock.stl").apply_transform(placed(body))
    assert np.nanmin(held.z) == pytest.approx(solid.bounds[0, 2], abs=0.006)
    assert -np.nansum(held.z) * held.spacing**2 == pytest.approx(volume_below_ground(solid), rel=0.3)
    for _ in range(200):
        body.instance.step(0.0, H)
    assert np.nanmax(np.abs(surface(body.instance).z - held.z)) < 5e-4

    rows = body.run(0.9)
    p, hull = body.instance.p, ConvexHull(solid.vertices[:, :2])
    modulus = p.k_c / (2.0 * hull.volume / hull.area) + p.k_phi  # of two dimensions: area and perimeter
    bekker = (mass * G / hull.volume / modulus) ** (1.0 / p.n)
    assert 0.7 * bekker < -rows[-1, Z] < 2.5 * bekker
    assert rows[600:, F].mean(axis=0) == pytest.approx([0.0, 0.0, mass * G], abs=0.005 * mass * G)
    assert np.ptp(rows[600:, :3], axis=0).max() < 1e-4
    assert volume_error(body.instance) == 0.0


def volume_below_ground(solid):
    fine = solid.subdivide_to_size(0.005)
    z = np.minimum(fine.triangles_center[:, 2], 0.0)
    return (fine.area_faces * fine.face_normals[:, 2] * z).sum()  # divergence theorem


def placed(body):
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = body.body["T"].T, body.body.r_0
    return transform


def test_a_half_buried_box_resists_by_rankines_pressure_more_than_one_on_top(tmp_path):
    mesh, mass, forces = box(5.0, 1.2, 1.0, 0.9), 5.0, []
    for z in (0.0, mesh.extents[2] / 2.0):
        body = free(tmp_path, mesh, mass, z + 1e-3)
        body.run(0.5)
        start, depth = body.body.r_0[0], mesh.extents[2] / 2.0 - body.body.r_0[2]
        for share in np.arange(0.2, 4.0, 0.2):
            body.run(0.1, push=(share * mass * G, 0.0, 0.0))
            if body.body.r_0[0] - start > 0.003:
                break
        forces.append((share * mass * G, depth))
    p = body.instance.p
    N_phi = math.tan(math.pi / 4 + p.phi / 2) ** 2
    (buried, depth), (on_top, _) = forces
    rankine = mesh.extents[1] * depth * (0.5 * p.rho * G * depth * N_phi + 2.0 * p.c * math.sqrt(N_phi))
    assert rankine < buried - on_top < 4.0 * rankine


def test_a_wheel_passes_beside_a_half_buried_rock(tmp_path):
    mass = 3.0
    body = free(tmp_path, boulder(mass), mass, yaw=10.0)
    body.run(0.6)
    start = body.body.r_0.copy()
    most = 0.0
    for k in range(1500):
        set_wheel(body, -0.15 + 2e-4 * k, 0.17, min(0.02, 1e-4 * k), 0.2)
        body.step(H)
        most = max(most, np.abs(body.instance.y.body[0].f_0 - [0.0, 0.0, mass * G]).max())
    assert body.instance.y.wheel[0].f_0[2] > 50.0
    assert most < 0.2 * mass * G and np.abs(body.body.r_0 - start).max() < 1e-3
    assert volume_error(body.instance) == 0.0


def set_wheel(body, x, y, sinkage, speed=0.0):
    wheel = body.instance.u.wheel[0]
    wheel.active, wheel.r_0[:], wheel.v_0[:] = 1.0, [x, y, 0.125 - sinkage], [speed, 0.0, 0.0]
    wheel.w_0[:], wheel["T"][:] = [0.0, speed / 0.125, 0.0], axis_rotation(2, x / 0.125)


def test_soil_below_a_rock_bears_no_wheel_that_is_above_the_rock(tmp_path):
    forces = []
    for z in (0.01, 1.0):
        body = free(tmp_path, trimesh.creation.box((0.3, 0.3, 0.1)), 20.0, z)
        set_wheel(body, 0.0, 0.0, 0.01)
        for _ in range(5):
            body.instance.step(0.0, H)
        forces.append(body.instance.y.wheel[0].f_0[2])
    assert forces[0] == 0.0 and forces[1] > 10.0


def test_soil_leans_against_a_rock_and_slides_into_its_hole_when_it_is_gone(tmp_path):
    """Nothing slides on a slope of less than the angle of repose, whose heights go on through the rock."""
    body = free(tmp_path, box(5.0, 1.2, 1.0, 0.9), 5.0, slope=0.3)
    body.instance.step(0.0, H)
    held = surface(body.instance).z
    for _ in range(300):
        body.instance.step(0.0, H)
    assert np.array_equal(surface(body.instance).z, held, equal_nan=True)
    for k in range(1000):
        body.body.r_0[2] = min(2e-4 * k, 1.0)
        body.instance.step(0.0, H)
    assert steepest(held) > 0.05 and steepest(surface(body.instance).z) < 0.02
    assert volume_error(body.instance) == 0.0


def steepest(z):
    """Largest drop between neighbouring cells [m]."""
    return max(np.nanmax(np.abs(np.diff(z, axis=axis))) for axis in range(2))


def test_a_body_that_was_in_the_air_is_pressed_in_and_nothing_is_laid_around_it(tmp_path):
    body = free(tmp_path, box(5.0, 1.2, 1.0, 0.9), 5.0, 0.5)
    body.instance.step(0.0, H)
    body.body.r_0[2] = 0.0
    body.instance.step(0.0, H)
    assert body.instance.y.body[0].f_0[2] > 10.0 * 5.0 * G


def test_steps_taken_back_lay_the_soil_around_it_again_to_the_same_bits(tmp_path):
    body = free(tmp_path, boulder(3.0), 3.0)
    untouched = body.instance.save()
    first = body.run(0.05)
    laid = body.instance.save()
    second, rows = body.run(0.05), body.instance.pool.rows.copy()
    body.instance.restore(laid)
    assert np.array_equal(body.run(0.05), second) and np.array_equal(body.instance.pool.rows, rows)
    body.instance.restore(untouched)
    assert np.array_equal(body.run(0.05), first)


def test_a_step_that_is_refused_lays_no_soil(tmp_path):
    runs = []
    for refused in (False, True):
        body = free(tmp_path, boulder(3.0), 3.0, layer_depth=0.1)
        if refused:
            set_wheel(body, 1.0, 0.0, 0.11)
            with pytest.raises(ModelError, match="wheel 1 is pressed through the soil's layer"):
                body.instance.step(0.0, H)
            assert not surface_is_disturbed(body)
            body.instance.u.wheel[0].active = 0.0
        runs.append(body.run(0.05))
    assert np.array_equal(*runs)


def test_a_rock_without_room_for_its_tiles_is_refused(tmp_path):
    trimesh.creation.box((0.5, 0.5, 0.1)).export(tmp_path / "rock.stl")
    with pytest.raises(ModelError, match=r"the soil's pool is full, max_tiles = 3 of .*: raise max_tiles"):
        FreeBody(tmp_path / "rock.stl", 20.0, 0.0, at=AT, max_tiles=3)
