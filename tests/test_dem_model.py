"""The DEM slave: boxes that move with wheels, what is left behind, the whole state, forces and bodies."""

import beds
import numpy as np
import pytest
import trimesh
from beds import B_W, R_W, D, by_number, dem, place

from cdl_fmu.bcm import BCM
from cdl_fmu.dem.bed import replicate
from cdl_fmu.dem.particles import CELLS_X, CELLS_Z, FREE, V_X, V_Z, M, X, Z
from cdl_fmu.dem.simulation import Tool
from cdl_fmu.dem.tools import CONTACTS
from cdl_fmu.mesh.surface import load_surface
from cdl_fmu.slave.model import Instance
from cdl_fmu.slave.state import State

H = 1e-3


def above() -> float:
    """Height of a wheel's centre that touches no particle of the undisturbed bed [m]."""
    return R_W + beds.highest_particle() + 1e-4


def at_rest(n_patches=0, n_bodies=0, **parameters) -> Instance:
    one = dem(1, n_patches, n_bodies, **parameters)
    place(one.u["wheel"][0], (0.01, 0.02, above()))
    one.initialise()
    return one


def drive(one, t, n, speed=0.5, sinkage=4e-3, heading=0.0, slip=0.0, begin=(0.01, 0.02), seen=lambda: None):
    """Lower the wheel within 40 ms and drive on; n steps from t on."""
    for k in range(n):
        end = t + H * (k + 1)
        fraction, way = min(end / 0.04, 1.0), speed * max(end - 0.04, 0.0)
        z = above() - fraction * (above() - R_W + sinkage)
        rate = speed / R_W / (1.0 - slip) if end > 0.04 and slip < 1.0 else 0.0
        r_0 = (begin[0] + way * np.cos(heading), begin[1] + way * np.sin(heading), z)
        velocity = speed * (end > 0.04) * np.array([np.cos(heading), np.sin(heading), 0.0])
        place(one.u["wheel"][0], r_0, velocity, rate, rate * max(end - 0.04, 0.0), heading)
        one.step(end - H, H)
        seen()
    return t + n * H


def pool_bytes(one) -> bytes:
    return one.pool.to_bytes(one.pool.save())


def test_undisturbed_soil_stays_where_it_is():
    one = at_rest()
    one.step(0.0, H)
    _, first = by_number(one)
    assert 1000 < np.count_nonzero(first[:, FREE]) < len(first)
    for k in range(1, 100):
        one.step(k * H, H)
    _, bodies = by_number(one)
    ways = np.sort(np.abs(bodies[:, X : Z + 1] - first[:, X : Z + 1]).max(axis=1))
    # Here and there a particle lies in a void of its own and bears nothing: it may still roll. Which ones do depends on the machine's bed.
    assert ways[-3] < 2e-6 and ways[-1] < 0.1 * D
    assert (bodies[:, V_X : V_Z + 1] ** 2).sum(axis=1).mean() < 1e-6 * 9.81 * D
    assert not one.y["wheel"]["f_0"].any() and one.y["contact"]["in_contact"][0] == 0.0


def test_a_bed_of_which_nothing_is_live_is_one_empty_cell_and_comes_back():
    one = at_rest(rest_speed=0.1)
    one.step(0.0, H)
    one.u["wheel"]["active"] = 0.0
    for k in range(1, 100):
        one.step(k * H, H)
    assert len(one.pool.live) == 0 and one.pool._grains.count[CELLS_X : CELLS_Z + 1].tolist() == [1, 1, 1]
    one.u["wheel"]["active"] = 1.0
    one.step(0.1, H)
    assert len(one.pool.live) > 1000 and not one.y["wheel"]["f_0"].any()


@pytest.fixture(scope="module")
def train():
    """Two wheels, one in the rut of the other, and a third one behind on a patch: driven for five boxes. Wheels' loads, live particles."""
    one = dem(2, 1, rest_speed=0.01)
    wheels, loads, live = one.u["wheel"], [], []
    apart, speed, n = 0.17, 1.0, 700
    for i in range(2):
        place(wheels[i], (-apart * i, 0.02, above()))
    one.u["trailing"]["r_0"][0] = -2.0 * apart, 0.02, R_W
    one.initialise()
    for k in range(n):
        way = speed * H * k
        for i in range(2):
            z = above() - min(way / 0.05, 1.0) * (above() - R_W + 5e-3)
            place(wheels[i], (way - apart * i, 0.02, z), (speed, 0.0, 0.0), speed / R_W, way / R_W)
        one.u["trailing"]["r_0"][0] = way - 2.0 * apart, 0.02, R_W
        one.step(k * H, H)
        loads.append(one.y["wheel"]["f_0"][:, 2].copy())
        live.append(len(one.pool.live))
    return one, np.array(loads), np.array(live)


def test_work_does_not_grow_with_the_way(train):
    _, _, live = train
    assert live[350:].max() < 1.3 * live[150:350].max()


def test_no_grain_is_lost_or_made(train):
    one, _, _ = train
    ground = one.pool.ground
    numbers = [by_number(one)[0], *(grains.ident for grains in ground.stored.values())]
    assert len(np.unique(np.concatenate(numbers))) == sum(map(len, numbers))
    assert beds.total_mass(one) == pytest.approx(sum(ground.copy(key).grains.bodies[:, M].sum() for key in ground.touched), rel=1e-12)


def test_the_second_wheel_rolls_in_the_rut_of_the_first(train):
    _, loads, _ = train
    first, second = loads[350:].mean(axis=0)
    assert 0.0 < second < 0.6 * first


def test_a_patch_shows_the_rut_as_the_particles_have_it(train):
    one, _, _ = train
    patch = one.y["patch"][0]
    x, y = (patch["origin"][k] + patch["spacing"] * np.arange(n) for k, n in enumerate(patch["z"].shape))
    in_rut, beside = abs(y - 0.02) < 0.5 * B_W - 0.015, abs(y - 0.02) > B_W
    rut = patch["z"][:, in_rut].mean()
    # The wheels' lowest points are 5 mm deep, and mean heights of a plane of grains are up to half a diameter below their tops.
    assert -12e-3 < rut < -4e-3 and abs(patch["z"][:, beside].mean()) < 2e-3
    # By hand, what is stored and live alike: the tops of the highest grains in the square of a node.
    ground = one.pool.ground
    bodies = np.concatenate([one.pool.live, *(grains.bodies for grains in ground.stored.values())])
    k, m = len(x) // 2, int(np.flatnonzero(in_rut)[0])
    there = bodies[(abs(bodies[:, X] - x[k]) < 0.015) & (abs(bodies[:, X + 1] - y[m]) < 0.015)]
    top = (there[:, Z] + there[:, 3]).max()
    assert top - 0.8 * D < patch["z"][k, m] < top
    # A wheel of another tier stands on it.
    bcm = Instance(BCM(1, 1), r_w=R_W, b_w=B_W, n_g=0)
    place(bcm.u["wheel"][0], (float(x[k]), 0.02, R_W + rut - 5e-3), (0.01, 0.0, 0.0), 0.01 / R_W)
    for name in ("origin", "spacing", "z"):
        bcm.u["patch"][0][name] = patch[name]
    bcm.initialise()
    bcm.step(0.0, H)
    assert bcm.y["wheel"]["f_0"][0, 2] > 0.2


def test_drivers_find_their_rut_again(train):
    one, _, _ = train
    saved = one.save()
    one.u["wheel"]["active"] = 0.0
    one.step(1.0, H)
    one.u["wheel"]["active"] = 1.0
    for i in range(2):
        place(one.u["wheel"][i], (0.15 - 0.17 * i, 0.02, above() + 0.03))
    one.u["trailing"]["r_0"][0] = 0.15, 0.02, R_W
    for k in range(60):  # until what was left in motion is stored
        one.step(1.0 + k * H, H)
    z = one.y["patch"][0]["z"]
    assert z[:, z.shape[1] // 2].min() < -3e-3
    assert beds.total_mass(one) == pytest.approx(
        sum(one.pool.ground.copy(key).grains.bodies[:, M].sum() for key in one.pool.ground.touched), rel=1e-12
    )
    one.restore(saved)


def test_wheels_side_by_side_on_copies_of_one_soil_feel_the_same():
    one = dem(2)
    apart = 3 * beds.bed().periods[1]
    for k in range(60):
        for i in range(2):
            place(one.u["wheel"][i], (1e-4 * k, 0.02 + apart * i, above() - 1e-4 * k), (0.1, 0.0, -0.1), 2.0, 2e-3 * k)
        one.initialise() if k == 0 else None
        one.step(k * H, H)
    f, t = one.y["wheel"]["f_0"], one.y["wheel"]["t_0"]
    assert f[0, 2] > 2.0 and f[1] == pytest.approx(f[0], rel=1e-4, abs=1e-4) and t[1] == pytest.approx(t[0], rel=1e-4, abs=1e-5)


def test_the_whole_state_comes_back_to_the_same_bits():
    one = at_rest(1)
    one.u["trailing"]["r_0"][0] = -0.1, 0.02, R_W
    t = drive(one, 0.0, 80)
    saved = one.save()
    packed = saved.to_bytes(one.model.pool_class)
    drive(one, t, 25)
    after, soil = one.block.copy(), pool_bytes(one)
    one.restore(saved)
    assert one.save().to_bytes(one.model.pool_class) == packed
    drive(one, t, 25)
    assert one.block.tobytes() == after.tobytes() and pool_bytes(one) == soil
    # In another instance, whose memory is larger and whose tool is elsewhere, and that does on with two threads.
    other = at_rest(1)
    drive(other, 0.0, 10, begin=(3.0, 1.0))
    other.pool._make_room(20_000)
    other.restore(State.from_bytes(packed, one.model.pool_class))
    drive(other, t, 25)
    assert other.block.tobytes() == after.tobytes() and pool_bytes(other) == soil


def test_threads_change_no_bit():
    one, two = at_rest(), at_rest(threads=2)
    for each in (one, two):
        drive(each, 0.0, 60)
    assert one.block[one.slices["y"]].tobytes() == two.block[two.slices["y"]].tobytes() and pool_bytes(one) == pool_bytes(two)


def test_a_tool_that_is_away_is_saved_as_away():
    one = at_rest()
    t = drive(one, 0.0, 60)
    one.u["wheel"]["active"] = 0.0
    one.step(t, H)
    saved = one.save()
    # Memory that had a wheel there forgets it.
    other = at_rest()
    drive(other, 0.0, 60)
    other.restore(saved)
    for each in (one, other):
        each.u["wheel"]["active"] = 1.0
        place(each.u["wheel"][0], (0.3, 0.02, above()))
        each.step(t + H, H)
    assert not one.y["wheel"]["f_0"].any() and pool_bytes(one) == pool_bytes(other)


def test_a_wheel_is_lifted_switched_off_and_put_down_again():
    one = at_rest(rest_speed=0.01)
    t = drive(one, 0.0, 60)
    saved, load = one.save(), one.y["wheel"]["f_0"][0, 2]
    assert load > 2.0 and one.pool._tools.sums[1, CONTACTS] > 2.0
    r_0 = one.u["wheel"]["r_0"][0].copy()
    place(one.u["wheel"][0], np.add(r_0, (0.0, 0.0, 0.03)))
    one.step(t, H)
    one.step(t + H, H)
    assert not one.y["wheel"]["f_0"].any() and one.pool._tools.sums[1, CONTACTS] == 0.0
    one.restore(saved)
    one.u["wheel"]["active"] = 0.0
    for k in range(300):  # nearly all comes to rest and is stored
        one.step(t + k * H, H)
        assert not one.y["wheel"]["f_0"].any()
    assert len(one.pool.live) < 2500
    one.u["wheel"]["active"] = 1.0
    place(one.u["wheel"][0], np.add(r_0, (0.0, 0.0, 4e-3)))  # the rut's walls have fallen in meanwhile
    one.step(t, H)
    assert one.y["wheel"]["f_0"][0, 2] >= 0.0
    # A weight scales what the wheel feels, not what it does.
    one.restore(saved)
    one.step(t, H)
    whole, bodies = one.y["wheel"]["f_0"].copy(), by_number(one)[1]
    one.restore(saved)
    one.u["wheel"]["active"] = 0.5
    one.step(t, H)
    assert np.array_equal(one.y["wheel"]["f_0"], 0.5 * whole) and np.array_equal(by_number(one)[1], bodies)


@pytest.mark.parametrize("slip", (1.0, 0.6, 0.0))
def test_signs_of_forces_are_those_of_the_other_tiers(slip):
    """Locked: it is towed and braked. With slip: it drives."""
    one, bcm = at_rest(), Instance(BCM(1), r_w=R_W, b_w=B_W, n_g=0)
    shown = []
    drive(one, 0.0, 110, speed=0.3, slip=slip, sinkage=6e-3, seen=lambda: shown.append(one.y["diagnostics"][0].copy()))
    mean = {name: np.mean([row[name] for row in shown[60:]]) for name in ("drawbar_pull", "drive_torque", "normal_load")}
    bcm.u["wheel"][0] = one.u["wheel"][0]
    bcm.initialise()
    bcm.step(0.0, H)
    if slip != 0.0:  # a free-rolling wheel's torque is small on both
        assert np.sign(mean["drive_torque"]) == np.sign(bcm.y["diagnostics"]["drive_torque"][0]) == (-1.0 if slip == 1.0 else 1.0)
        assert abs(mean["drive_torque"]) > 0.1 * R_W * mean["normal_load"]
    if slip != 0.6:
        assert mean["drawbar_pull"] < -0.1 * mean["normal_load"]
    for name in ("slip", "sinkage", "slip_angle"):
        assert one.y["diagnostics"][name][0] == pytest.approx(bcm.y["diagnostics"][name][0], abs=1e-6)
    assert one.y["diagnostics"]["theta_entry"][0] > 0.1


def test_what_turns_with_the_heading_turns():
    """Towed along y it feels along y what it feels along x."""
    means = []
    for heading in (0.0, 0.5 * np.pi):
        one, felt = at_rest(), []
        drive(one, 0.0, 140, speed=0.3, slip=1.0, heading=heading, seen=lambda: felt.append(one.y["wheel"]["f_0"][0].copy()))  # noqa: B023
        f = np.mean(felt[60:], axis=0)
        means.append((f[0] * np.cos(heading) + f[1] * np.sin(heading), f[1] * np.cos(heading) - f[0] * np.sin(heading), f[2]))
        contact = one.y["contact"][0]
        assert contact["axes"][0] == pytest.approx([np.cos(heading), np.sin(heading), 0.0], abs=1e-12)
        assert contact["F"] == pytest.approx(contact["axes"] @ one.y["wheel"]["f_0"][0]) and np.all(contact["K"] >= 0.0)
    (along, across, up), (other_along, _, other_up) = means
    assert along < -1.0 and other_along == pytest.approx(along, rel=0.5) and other_up == pytest.approx(up, rel=0.5)
    assert abs(across) < 0.5 * up


def with_body(tmp_path, mesh, **parameters) -> Instance:
    """An instance with a body alone: its wheel is switched off."""
    mesh.export(tmp_path / "body.stl")
    one = dem(1, 0, 1, **{"body[1].mesh": tmp_path / "body.stl", **parameters})
    one.u["wheel"]["active"] = 0.0
    return one


def test_a_plate_feels_what_it_feels_in_a_simulation_of_the_whole_bed(tmp_path):
    one = with_body(tmp_path, trimesh.creation.box((0.05, 0.05, 0.02)))
    beginning = np.array([0.198, 0.198, 0.01 + beds.highest_particle() + 1e-4])
    place(one.u["body"][0], beginning)
    one.initialise()
    plate = Tool(beds.KEY.material, surface=load_surface(tmp_path / "body.stl"), r_0=beginning)
    whole = replicate(beds.bed(), 3, 3).simulation([plate])
    for k in range(100):
        r_0 = beginning - [0.0, 0.0, 1e-4 * (k + 1)]
        place(one.u["body"][0], r_0, (0.0, 0.0, -0.1))
        plate.r_0 = r_0
        one.step(k * H, H)
        whole.step(H)
        if k == 10:
            assert plate.f_0[2] > 1.0 and one.y["body"]["f_0"][0] == pytest.approx(plate.f_0, rel=1e-6, abs=1e-5)
    assert one.y["body"]["f_0"][0, 2] == pytest.approx(plate.f_0[2], rel=0.1)  # the box is finite
    support = one.y["support"][0]
    assert support["in_contact"] == 1.0 and support["K"][2] > 1e3 and np.all(support["D"] > 0.0)
    assert support["point_0"] == pytest.approx(one.u["body"]["r_0"][0] - [0.0, 0.0, 0.01], abs=0.02)


def test_a_cone_is_harder_to_press_in_the_deeper_it_is(tmp_path):
    cone = trimesh.creation.cone(radius=0.015, height=0.045)
    cone.apply_transform(trimesh.transformations.rotation_matrix(np.pi, (1.0, 0.0, 0.0)))
    cone.apply_translation((0.0, 0.0, 0.045 - cone.bounds[1, 2]))  # its tip is the body's origin
    one, felt = with_body(tmp_path, cone), []
    place(one.u["body"][0], (0.02, 0.02, 0.01))
    one.initialise()
    for k in range(110):
        place(one.u["body"][0], (0.02, 0.02, 0.01 - 4e-4 * (k + 1)), (0.0, 0.0, -0.4))
        one.step(k * H, H)
        felt.append(one.y["body"]["f_0"][0, 2])
    shallow, deep = np.mean(felt[30:60]), np.mean(felt[80:])
    assert 0.0 < 2.0 * shallow < deep


def test_patches_follow_and_say_when_they_changed():
    one = at_rest(1)
    trailing, patch = one.u["trailing"]["r_0"][0], one.y["patch"][0]
    trailing[:] = 0.604, -0.301, R_W  # far from all that moves
    one.step(0.0, H)
    revision, z = patch["revision"], patch["z"].copy()
    assert abs(z.mean()) < 1e-3 and np.abs(z).max() < 0.6 * D
    for k in range(25):
        one.step(k * H, H)
    assert patch["revision"] == revision and np.array_equal(patch["z"], z)
    trailing[0] += 0.008  # the nearest node is the same
    one.step(0.03, H)
    assert patch["revision"] == revision
    trailing[0] += 0.03
    one.step(0.03, H)
    assert patch["revision"] == revision + 1 and patch["z"][:-1] == pytest.approx(z[1:], abs=1e-4)
    # Undisturbed soil repeats itself, and its columns are still no matter of memory.
    assert len(one.pool.ground.touched) < 60


def test_soil_may_lie_at_any_height():
    low, high = at_rest(), at_rest(ground_z=3.25)
    for k in range(60):
        for one, level in ((low, 0.0), (high, 3.25)):
            place(one.u["wheel"][0], (0.01, 0.02, level + above() - 1e-4 * k))
            one.step(k * H, H)
    assert high.y["wheel"]["f_0"] == pytest.approx(low.y["wheel"]["f_0"], rel=1e-3, abs=1e-3)
    assert high.y["diagnostics"]["sinkage"][0] == pytest.approx(low.y["diagnostics"]["sinkage"][0], abs=1e-9)


def test_what_a_step_answers_to_a_small_move_is_told_by_stiffness_and_damping():
    """Upright, where contacts' normals point; particles that make way and friction leave a third open."""
    one, told, found = at_rest(), [], []
    t = drive(one, 0.0, 60)
    for _ in range(5):
        t = drive(one, t, 10)
        wheel, contact, saved, forces = one.u["wheel"][0], one.y["contact"][0], one.save(), []
        told.append(0.5 * contact["K"][2] + contact["D"][2] / H)  # the wheel moves evenly within the step
        for move in (-1e-7, 1e-7):
            one.restore(saved)
            wheel["r_0"][2] += move
            one.step(t, H)
            forces.append(one.y["wheel"][0]["f_0"][2])
            wheel["r_0"][2] -= move
        found.append((forces[0] - forces[1]) / 2e-7)
        one.restore(saved)
    assert np.mean(found) == pytest.approx(np.mean(told), rel=1.0 / 3.0)


def test_a_wheel_of_a_mesh_feels_what_a_cylinder_feels(tmp_path):
    mesh = trimesh.creation.cylinder(R_W, B_W, sections=256)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(0.5 * np.pi, (1.0, 0.0, 0.0)))
    mesh.export(tmp_path / "wheel.stl")

    def mean_force(one):
        seen = []
        drive(one, 0.0, 60, seen=lambda: seen.append(one.y["wheel"][0]["f_0"].copy()))
        return np.mean(seen[20:], axis=0)

    cylinder = mean_force(at_rest())
    assert cylinder[2] > 5.0
    assert mean_force(at_rest(wheel_mesh=tmp_path / "wheel.stl")) == pytest.approx(cylinder, abs=0.05 * cylinder[2])
