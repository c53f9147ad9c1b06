"""A rover on rocks and steps as FMUs under the master: forces at rest, energy over a step, rocks that move, free twists."""

import numpy as np
import pytest
import trimesh
from hard import export, floor
from hard_systems import drive

from cdl_fmu.mesh.rocks import rock
from cdl_fmu.rbc import RBC
from cdl_fmu.vem import VEM

WEIGHT = 54.0 * 9.81  # Table 8.2
SMOOTH = {"n_g": 0.0, "h_g": 0.0}
CONTACTS = {"VEM": (lambda n: VEM(2, 0, n), {"effective_mass": 5.0}), "RBC": (lambda n: RBC(2, n), {"tolerance": 1e-9})}


@pytest.fixture(scope="module")
def meshes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("meshes")
    return {
        "floor": floor(folder / "floor.stl"),
        "rock": export(folder / "rock.stl", rock(3, (0.22, 0.20, 0.10))),
        "flat": export(folder / "flat.stl", rock(8, (0.30, 0.24, 0.06))),
        "step": export(folder / "step.stl", trimesh.creation.box((0.6, 1.0, 0.08))),
    }


def on_bodies(folder, meshes, tier, bodies, *, hard=None, start_z=0.125, **options):
    """The rover with smooth wheels on bodies (mesh, start); those without a mass to move are fixed."""
    contact, own = CONTACTS[tier]
    rocks = [(meshes[name], start) for name, start in bodies]
    return drive(folder, contact(len(rocks)), rocks, rover={"start.z": start_z}, hard=SMOOTH | own | (hard or {}), **options)


def values(result, part, name, shape=3):
    """Columns of an array output, [n, 3]."""
    return np.stack([result[f"{part}.{name}[{k}]"].values for k in range(1, shape + 1)], axis=1)


def loads(result):
    return sum(values(result, "rover", f"applied[{i}].f_0")[:, 2] for i in (1, 2))


FLOOR = ("floor", {"fixed": "on"})


@pytest.mark.parametrize(("tier", "scheme"), [("VEM", "ij"), ("VEM", "jacobi"), ("RBC", "ij")])
def test_forces_of_a_rover_on_two_rocks_a_wheel_are_its_weight(meshes, tier, scheme, tmp_path):
    rocks = [("rock", {"fixed": "on", "x": x + dx, "yaw": 10.0 * dx}) for x in (0.6, 0.0) for dx in (-0.12, 0.12)]
    outcome, result = on_bodies(tmp_path, meshes, tier, [FLOOR, *rocks], start_z=0.16, scheme=scheme)
    assert loads(result)[-50:] == pytest.approx(WEIGHT, rel=1e-6)
    assert result["rover.body.r_0[3]"].values[-1] > 0.14 and not outcome.warnings
    # The hard slave's wrenches on wheels and bodies, about the world's origin, sum up to 0.
    assert sum(values(result, "rocks", f"body[{j}].f_0")[-1, 2] for j in range(1, 6)) == pytest.approx(-WEIGHT, rel=1e-5)


def work_of_the_ground(result, h=1e-3):
    """What the contact forces have done on the rover up to each row [J], by the velocities at each step's end."""
    power = 0.0
    for i in (1, 2):
        power += (values(result, "rover", f"applied[{i}].f_0") * values(result, "rover", f"wheel[{i}].v_0")).sum(axis=1)
        power += (values(result, "rocks", f"wheel[{i}].t_0") * values(result, "rover", f"wheel[{i}].w_0")).sum(axis=1)
    return np.cumsum(power) * h


@pytest.mark.parametrize(("tier", "scheme", "most"), [("VEM", "ij", 1.0), ("VEM", "jacobi", 3.0), ("RBC", "ij", 1e-3)])
def test_a_rover_climbs_a_step_of_40_mm_and_gains_no_energy_by_it(meshes, tier, scheme, most, tmp_path):
    """What the ground gives back [J], of the 11 J that lift its front wheel: VEM's springs, nothing in RBC."""
    step = ("step", {"fixed": "on", "x": 1.2})
    outcome, result = on_bodies(tmp_path, meshes, tier, [FLOOR, step], driver={"wheel_rate": 2.0}, stop_time=3.0, scheme=scheme)
    z = result["rover.body.r_0[3]"].values
    assert result["rover.body.r_0[1]"].values[-1] > 0.9 and not outcome.warnings
    assert z.max() == pytest.approx(0.145, abs=0.001)  # one wheel up
    work = work_of_the_ground(result)
    assert (work - np.minimum.accumulate(work)).max() < most
    assert work[-1] < 0.0


@pytest.mark.parametrize("tier", ["VEM", "RBC"])
def test_a_rover_on_a_rock_that_moves_on_a_floor(meshes, tier, tmp_path):
    """It drives onto the rock, which stays where it is, and the floor bears both."""
    bodies = [FLOOR, ("flat", {"x": 0.85, "z": 0.031})]
    outcome, result = on_bodies(tmp_path, meshes, tier, bodies, driver={"wheel_rate": 1.5}, stop_time=2.2)
    assert not outcome.warnings
    place = values(result, "rover", "rock[2].r_0")
    assert result["rover.body.r_0[3]"].values.max() > 0.14  # the front wheel is up
    assert np.abs(place[:, :2] - (0.85, 0.0)).max() < 0.05
    mass = trimesh.load_mesh(meshes["flat"]).volume * 2700.0
    floor_load = -values(result, "rocks", "body[1].f_0")[:, 2]
    assert floor_load[300:].mean() == pytest.approx(WEIGHT + mass * 9.81, rel=0.02)


def test_a_tried_free_twist_changes_nothing_where_nothing_else_acts(meshes, tmp_path):
    """On rocks alone the rover predicts what the scheme ij-free tries, but for new commands: impacts come a step earlier or later."""
    step = ("step", {"fixed": "on", "x": 1.2})
    results = [
        on_bodies(tmp_path / scheme, meshes, "RBC", [FLOOR, step], driver={"wheel_rate": 2.0}, stop_time=1.0, scheme=scheme)[1]
        for scheme in ("ij", "ij-free")
    ]
    # Of both wheels, as how they share what drives them is open.
    one, other = (np.cumsum(sum(values(r, "rover", f"applied[{i}].f_0") for i in (1, 2)), axis=0) * 1e-3 for r in results)
    assert one[900] == pytest.approx(other[900], abs=1.0)  # impulses [N.s] until it is at the step
    heights = [result["rover.body.r_0[3]"].values for result in results]
    assert np.abs(heights[0] - heights[1]).max() < 2e-4


def test_impulses_that_act_a_step_late_are_warned_of(meshes, tmp_path):
    outcome, _ = on_bodies(tmp_path, meshes, "RBC", [FLOOR], stop_time=0.01, scheme="jacobi")
    assert outcome.warnings == [
        "rocks: impulses of rigid contacts act a step late under scheme jacobi and throw bodies about; use scheme ij"
    ]
