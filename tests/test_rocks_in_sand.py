"""The experiment rocks_in_sand: a rover among rocks that lie in the soil, its wheels on two contact models at once."""

import json

import numpy as np
import pytest
import trimesh
from systems import SPARSE_ROCKS

from cdl_fmu.mesh.rocks import rock
from fmus import EXPERIMENTS
from orchestrator.drive import simulate
from orchestrator.experiment import ExperimentError, load_experiment
from orchestrator.report import plot
from orchestrator.results import open_result

WEIGHT = 54 * 9.81


@pytest.fixture(scope="module", params=["RBC", "VEM"])
def drive(request, tmp_path_factory):
    """A wheel that climbs on one rock, on each tier."""
    folder = tmp_path_factory.mktemp(request.param)
    source = folder / "one_rock.toml"
    source.write_text(SPARSE_ROCKS)
    outcome = simulate(source, folder / "out", overrides={"rocks.tier": request.param}, picture=False)
    return request.param, outcome, open_result(outcome.result)


def test_the_wheel_goes_from_sand_to_rock_and_sand_and_rock_bear_it_together(drive):
    tier, outcome, result = drive
    assert outcome.status == "complete" and not outcome.warnings
    sand, stone = (result.cdl[f"{part}.wheel[1].f_0[3]"].values for part in ("scm", "rocks"))
    both = (sand > 5.0) & (stone > 5.0)
    assert both.sum() > 50  # [ms] in which it stands on both
    assert stone[-1] > 100.0
    assert result.cdl["rover.wheel[1].r_0[3]"].values[-1] > result.cdl["rover.wheel[1].r_0[3]"].values[0] + 0.01
    assert stone[: np.argmax(stone > 0.0)].max(initial=0.0) == 0.0


def test_the_rock_sinks_under_the_wheel_and_is_not_carried_off(drive):
    _, _, result = drive
    x, z = (result.cdl[f"rover.rock[1].r_0[{k}]"].values for k in (1, 3))
    touched = np.argmax(result.cdl["rocks.wheel[1].f_0[3]"].values > 0.0)
    assert touched > 0
    assert abs(z[: touched - 1] - z[0]).max() < 1e-3  # it lies at rest until then
    assert -0.03 < z[-1] - z[0] < -1e-3
    assert abs(x[-1] - x[0]) < 0.03


def test_wheel_and_rock_push_each_other_alike(drive):
    _, _, result = drive
    forces = np.array([[result.cdl[f"rocks.{tool}.f_0[{k}]"].values for k in (1, 2, 3)] for tool in ("wheel[1]", "wheel[2]", "body[1]")])
    assert np.abs(forces.sum(axis=0)).max() < 1e-9 * np.abs(forces).max()


def test_the_result_knows_its_rocks_and_is_drawn(drive, tmp_path):
    tier, _, result = drive
    hard = json.loads(result.attrs["hard"])
    assert hard["tier"] == tier and hard["instance"] == "rocks"
    (stone,) = hard["rocks"]
    assert stone["port"] == "rover.rock[1]"
    assert np.ptp(np.array(stone["vertices"]), axis=0) == pytest.approx([0.16, 0.16, 0.08], abs=1e-4)
    plot(result).savefig(tmp_path / "rocks.png", dpi=50)
    assert (tmp_path / "rocks.png").stat().st_size > 10_000


def refused(tmp_path, overrides=None, tiers=None, edit=lambda text: text):
    source = tmp_path / "rocks.toml"
    source.write_text(edit(SPARSE_ROCKS))
    with pytest.raises(ExperimentError) as error:
        load_experiment(source, tiers=tiers, overrides=overrides).write_system(tmp_path / "x.ssp")
    return str(error.value)


@pytest.mark.parametrize(
    ("overrides", "text"),
    [
        ({"rock[1].restitution": 1.2}, "rock[1].restitution = 1.2: it must be at most 1"),
        ({"rock[1].mu": -0.1}, "rock[1].mu = -0.1: it must be at least 0"),
        ({"rock[1].density": 0.0}, "rock[1].density = 0 kg/m3: it must be at least 1 kg/m3"),
        ({"rock[1].colour": 1}, "rock[1].colour is unknown; use one of buried, damping_ratio, density,"),
        ({"rock[3].mu": 1.0}, "--set rock[3].mu: there is no [[rock]] of number 3"),
        ({"rock[1].seed": 1.5}, "rock[1].seed = 1.5: it must be a whole number"),
        ({"rock[1].size": [200, 150, 100]}, "rock[1].size[1] = 200 m: it must be at most 3 m"),
        ({"rocks.tier": "DEM"}, "rocks.tier = 'DEM' is unknown; use one of RBC, VEM"),
        ({"rocks.teir": "VEM"}, "rocks.teir is unknown; did you mean tier?"),
        ({"rbc.n_directions": 7}, "rbc.n_directions = 7: it must be even"),
        ({"rbc.k": 1}, "rbc.k is unknown; use one of effective_mass, max_sweeps,"),
        ({"rover.rock[1].mass": 1.0}, "there is no [[rock]] of number 1"),
    ],
)
def test_wrong_values_of_rocks_are_refused(tmp_path, overrides, text):
    assert text in refused(tmp_path, overrides)


def test_wrong_meshes_are_refused(tmp_path):
    stone = rock(1, (0.2, 0.15, 0.1))
    large = stone.copy()
    large.apply_scale(1000.0)
    large.export(tmp_path / "mm.stl")
    inverted = stone.copy()
    inverted.invert()
    inverted.export(tmp_path / "inverted.stl")
    trimesh.Trimesh(stone.vertices, stone.faces[3:]).export(tmp_path / "open.stl")
    for name, text in (
        ("mm.stl", "mm.stl is 200 m across: the file is most likely in millimetres; scale it by 0.001"),
        ("inverted.stl", "inverted.stl: its normals point inwards"),
        ("open.stl", "open.stl is open: "),
        ("none.stl", "no such file"),
    ):
        message = refused(tmp_path, edit=lambda t, n=name: t.replace("seed = 3", f'mesh = "{n}"'))
        assert text in message and "rocks.toml, line" in message


def test_rocks_need_soil_or_are_fixed_and_a_testbed_has_none(tmp_path):
    assert "rock[1].fixed = false: no wheel is on SCM, so there is no soil to bear the rock" in refused(tmp_path, tiers=["BCM", "BCM"])
    assert "write each rock as a section [[rock]]" in refused(tmp_path, edit=lambda text: text.replace("[[rock]]", "[rock]"))
    testbed = EXPERIMENTS["single_wheel"].read_text() + "\n[[rock]]\nx = 1.0\n"
    assert "rocks need a rover" in refused(tmp_path, edit=lambda text: testbed)


def test_rocks_that_overlap_or_lie_where_a_wheel_starts_are_refused(tmp_path):
    text = "rock[1] and the front wheel overlap at the start: move the rock (x, y or buried) or the rover (rover.start.x)"
    assert text in refused(tmp_path, {"rock[1].x": 0.6, "rock[1].buried": 0.2})
    second = "\n[[rock]]\nx = {}\nsize = {}\nseed = 3\n"
    for x, size in ((0.82, "[0.16, 0.16, 0.08]"), (0.9, "[0.16, 0.16, 0.08]"), (0.82, "[0.05, 0.05, 0.04]")):
        message = refused(tmp_path, edit=lambda t, x=x, size=size: t + second.format(x, size))
        assert "rock[1] and rock[2] overlap at the start: move them apart" in message


def test_a_pebble_in_millimetres_is_refused(tmp_path):
    rock(1, (15.0, 12.0, 10.0)).export(tmp_path / "pebble.stl")
    message = refused(tmp_path, edit=lambda t: t.replace("seed = 3", 'mesh = "pebble.stl"'))
    assert "mesh = pebble.stl: the rock is 15 m across and weighs" in message and "is the mesh in millimetres?" in message


def test_options_that_the_rocks_tier_does_not_ask_for_are_warned_of(tmp_path):
    source = tmp_path / "rocks.toml"
    source.write_text(SPARSE_ROCKS)
    warned = load_experiment(source, overrides={"rocks.tier": "VEM", "rock[1].restitution": 0.5, "vem.k": 1e7, "rock[1].k": 1e7}).warnings
    assert [text.partition(":")[0] for text in warned] == ["--set rock[1].restitution", "--set vem.k"]
    assert "no wheel stands on VEM's own ground; give rock[1].k" in warned[1]


def test_a_drive_that_meets_no_rock_is_drawn(tmp_path):
    source = tmp_path / "rocks.toml"
    source.write_text(SPARSE_ROCKS)
    outcome = simulate(source, tmp_path / "out", overrides={"rock[1].x": 50.0}, stop_time=0.02)
    assert outcome.status == "complete" and (tmp_path / "out" / "result.png").exists()
