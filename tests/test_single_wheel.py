"""The experiment single_wheel: what its settings become, what it measures, and its sweeps."""

import csv
import json
import math
import shutil
from types import SimpleNamespace

import numpy as np
import pytest
from test_cli import cdl, refusal

from fmus import EXPERIMENTS
from orchestrator import open_result, side_by_side, single_wheel
from orchestrator.assemble import assemble
from orchestrator.experiment import ExperimentError, load_experiment
from orchestrator.measured import MeasuredError, read_measured
from orchestrator.measurement import QUANTITIES, measure_result, open_sweep
from orchestrator.results import ResultError
from orchestrator.run import RunError
from orchestrator.single_wheel import measure, run_sweep, sweep
from orchestrator.slip import slip_of, wheel_rate_of
from orchestrator.testbed_picture import run_picture, sweep_picture

#: A small smooth wheel on a short way through coarse cells.
SHORT = {
    "wheel.r_w": 0.058,
    "wheel.b_w": 0.05,
    "wheel.n_g": 0,
    "load_N": 24.0,
    "carriage_speed": 0.05,
    "travel": 0.15,
    "scm.cell": 0.01,
    "run.step": 5e-3,
}
BOTH = pytest.mark.parametrize("tier", ["BCM", "SCM"])


def point(tier="BCM", **more):
    return measure({**SHORT, "tier": tier, **more}, soil="cmu_sand")


def carriage(**overrides):
    """Parameters of the carriage that these settings lead to."""
    return load_experiment("single_wheel", overrides=overrides).instances()["carriage"].p


def settings(*overrides):
    """Options of a short run on the command line."""
    new = {text.partition("=")[0] for text in overrides}
    given = [f"{key}={value}" for key, value in {**SHORT, "tier": "BCM"}.items() if key not in new]
    return [part for text in (*given, *overrides) for part in ("--set", text)]


@pytest.fixture
def one_core(monkeypatch):
    """Sweeps in this process: others take seconds to start."""
    monkeypatch.setattr(side_by_side, "cores", lambda: 1)


# -- settings


@pytest.mark.parametrize("slip", [-1.0, -0.5, 0.0, 0.5, 0.9])
def test_slip_is_of_the_carriages_speed_whatever_the_slip_angle(slip):
    p = carriage(slip=slip, slip_angle=0.5, carriage_speed=0.02, **{"wheel.r_w": 0.1})
    rim = 0.1 * float(p.wheel_rate)
    assert slip == pytest.approx(1.0 - 0.02 / rim if slip >= 0.0 else rim / 0.02 - 1.0)
    assert slip_of(0.02, float(p.wheel_rate), 0.1) == pytest.approx(slip)
    assert (float(p.slip_angle), float(p.speed)) == (0.5, 0.02)


def test_slip_at_the_ends():
    assert wheel_rate_of(1.0, 0.1, 0.1) == math.inf
    assert wheel_rate_of(0.5, 0.0, 0.1) == wheel_rate_of(-0.5, 0.0, 0.1) == 0.0
    assert [slip_of(0.0, rate, 0.1) for rate in (1.0, 0.0, -1.0)] == [1.0, 0.0, -1.0]
    assert slip_of(0.1, -1.0, 0.1) == -2.0  # it turns backwards


def test_a_wheel_rate_wins_over_slip_but_the_file_s_comment_gives_none():
    assert carriage(slip=0.5, wheel_rate=0.7).wheel_rate == 0.7
    assert carriage(slip=0.5, wheel_rate=0).wheel_rate == 0.0
    assert carriage().wheel_rate == pytest.approx(0.05 / (0.125 * 0.8))


def test_the_wheel_starts_on_its_grousers_where_it_has_any():
    for n_g, z in ((0, 0.125), (12, 0.135)):
        experiment = load_experiment("single_wheel", overrides={"wheel.n_g": n_g, "tier": "BCM"})
        assert assemble(experiment).instances["carriage"].p.start.z == pytest.approx(z)


@pytest.mark.parametrize(
    "overrides, step, stop_time",
    [
        ({"carriage_speed": 0.01, "slip": -0.5}, 0.01, 101.3),  # hub 10 mm/s, 8 r_w = 1 m
        ({"carriage_speed": 0.01, "slip": 0.5}, 5e-3, 101.3),  # rim 20 mm/s
        ({"carriage_speed": 0.01, "slip": 0.9, "wheel.r_w": 0.058}, 1e-3, 51.3),  # at least 0.5 m
        ({"carriage_speed": 0.1, "slip": 0.0, "travel": 0.2, "carriage.lowering_time": 2.0}, 1e-3, 4.3),
        ({"carriage_speed": 0.1, "run.step": 2e-3, "run.stop_time": 3.0}, 2e-3, 3.0),
        ({"carriage_speed": 0.0, "wheel_rate": 1.6}, 5e-4, None),
        ({"carriage_speed": 0.0, "wheel_rate": 0.0}, 0.01, None),
    ],
)
def test_step_and_stop_time_follow_from_speed_and_travel_unless_they_are_given(overrides, step, stop_time):
    found = load_experiment("single_wheel", overrides=overrides).settings
    assert (found.step, found.stop_time) == (step, stop_time)


def test_a_value_wins_over_the_soil_and_the_soil_over_the_file(tmp_path, monkeypatch):
    own = tmp_path / "own.toml"
    own.write_text('tier = "BCM"\n[carriage]\n[soil]\nset = "mss_d"\nphi = 0.1\n')
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    shutil.copy(EXPERIMENTS["single_wheel"].parents[1] / "cdl_fmu" / "soil" / "lunar_nominal.toml", "mine.toml")
    lunar = load_experiment(own, soil="lunar_nominal").instances()["bcm"].p
    assert load_experiment(own).instances()["bcm"].p.phi == 0.1 and lunar.phi != 0.1
    mine = load_experiment(own, soil="mine.toml", overrides={"soil.phi": 0.5}).instances()["bcm"].p
    assert (mine.phi, mine.n) == (0.5, lunar.n)
    with pytest.raises(ExperimentError, match="--soil nowhere: no soil set 'nowhere': use one of"):
        load_experiment(own, soil="nowhere")


@pytest.mark.parametrize(
    "overrides, text",
    [
        ({"slip": 1.0}, "--set slip: slip = 1: it needs an infinite wheel rate at a carriage_speed of 0.05 m/s; use a smaller slip, or"),
        ({"slip": 0.99999}, "slip = 0.99999: it needs a wheel rate of 4e+04 rad/s, above 1000 rad/s, at a carriage_speed of"),
        ({"slip": 1.5}, "--set slip: slip = 1.5: it must be at most 1 (Slip of the rim's speed"),
        ({"slip": "much"}, "--set slip: slip = 'much': a number is needed"),
        ({"slip": [0.1, 0.2]}, "--set slip: slip needs one value, not 2"),
        ({"tier": "FEM"}, "--set tier: tier 'FEM' of the wheel is unknown; use one of BCM, SCM"),
        ({"load_N": -5.0}, "--set load_N: load_N = -5 N: it must be at least 0.001 N (Load on the wheel along"),
        ({"load": 5.0}, "--set load: load = 5.0 is in no section"),
        ({"carriage.load": 5.0}, "--set carriage.load: carriage.load is unknown"),
        ({"rover.mass": 5.0}, "--set rover.mass: rover is unknown"),
        ({"travel": 0.0}, "--set travel: travel = 0 m: it must be at least 0.001 m"),
        ({"environment.gravity": 0.0}, "--set environment.gravity: environment.gravity = 0 m/s2: the wheel's inertia is load / gravity"),
        ({"carriage.start.z": -0.01}, "carriage.start.z = -0.01 m puts the axle of wheel wheel 0.01 m below the surface"),
    ],
)
def test_bad_settings_are_refused_with_place_and_remedy(tmp_path, overrides, text):
    with pytest.raises(ExperimentError) as caught:
        load_experiment("single_wheel", overrides=overrides).write_system(tmp_path / "x.ssp")
    assert text in str(caught.value)


def test_bad_lines_of_a_file_are_named(tmp_path):
    def said(text):
        own = tmp_path / "own.toml"
        own.write_text(text)
        with pytest.raises(ExperimentError) as caught:
            load_experiment(own)
        return str(caught.value)

    assert "own.toml: the wheel has no tier; use one of BCM, SCM" in said("[carriage]\n")
    assert "own.toml, line 2: load_N = -1 N: it must be at least" in said('tier = "BCM"\nload_N = -1\n[carriage]\n')
    tiers = '[tiers]\nfront = "BCM"\nrear = "BCM"\n'  # of a rover, which has no slip of its own
    assert "own.toml, line 1: slip = 0.5 is in no section" in said(f"slip = 0.5\n{tiers}")


# -- what it measures


@BOTH
def test_a_driving_wheel_pulls_and_a_locked_one_drags(tier):
    driving, locked = point(tier, slip=0.5), point(tier, slip=-1.0, travel=0.8)
    assert driving["drawbar_pull_N"] > 0.0 and driving["torque_Nm"] > 0.0
    assert locked["drawbar_pull_N"] < -0.3 * 24.0 and locked["torque_Nm"] < 0.0
    assert locked["wheel_rate"] == 0.0
    for facts in (driving, locked):
        assert facts["normal_load_N"] == pytest.approx(24.0, rel=0.01)
        assert abs(facts["lateral_force_N"]) < 1e-6
        assert 0.005 < facts["sinkage_m"] < 0.055


@BOTH
def test_a_wheel_that_moves_to_its_left_is_pushed_to_its_right(tier):
    left, right = point(tier, slip=0.2, slip_angle=0.3), point(tier, slip=0.2, slip_angle=-0.3)
    assert left["lateral_force_N"] < -1.0
    assert right["lateral_force_N"] == pytest.approx(-left["lateral_force_N"], rel=0.05)
    assert right["drawbar_pull_N"] == pytest.approx(left["drawbar_pull_N"], rel=0.05)


def test_forces_are_in_the_heading_frame_and_slip_angles_count_from_it():
    straight, turned = point(slip=0.2, slip_angle=0.3), point(slip=0.2, slip_angle=0.3, **{"carriage.heading": 1.0})
    for quantity in QUANTITIES:
        assert turned[quantity] == pytest.approx(straight[quantity], rel=1e-6)


def test_facts_say_everything():
    facts = point(slip=0.3, slip_angle=0.1)
    run = {"simulated_s", "wall_s", "scheme", "step_s"}  # its result is thrown away
    settings = {"tier", "load_N", "carriage_speed", "slip", "slip_angle", "wheel_rate"}
    part = {"stationary", "stationary_from_s", "stationary_travel_m"}
    drifts = {f"{key}_drift_per_m" for key in ("sinkage_m", "drawbar_pull_N", "lateral_force_N")}
    assert set(facts) == run | settings | part | drifts | {f"{key}{end}" for key in QUANTITIES for end in ("", "_std")}
    assert (facts["tier"], facts["slip"], facts["slip_angle"], facts["load_N"]) == ("BCM", 0.3, 0.1, 24.0)


def test_a_run_too_short_is_not_stationary_and_still_gives_numbers(tmp_path):
    facts = measure({**SHORT, "tier": "SCM", "slip": 0.9, "travel": 0.02, "run.step": 1e-3}, out=tmp_path)
    assert not facts["stationary"] and facts["sinkage_m"] > 0.0
    assert facts["stationary_travel_m"] == pytest.approx(0.005, abs=0.003)
    texts = [text.get_text() for text in run_picture(open_result(tmp_path)).legends[0].get_texts()]
    assert texts == ["last quarter: NOT stationary"]
    ended = point(**{"run.stop_time": 0.1})  # while it was lowered
    assert not ended["stationary"] and ended["stationary_from_s"] == 0.1


def test_a_wheel_may_spin_on_the_spot(tmp_path):
    overrides = {**SHORT, "tier": "SCM", "carriage_speed": 0.0, "wheel_rate": 1.0}
    with pytest.raises(RunError, match="no stop time: the system has none, so give --stop-time S"):
        measure(overrides)
    facts = measure(overrides, stop_time=6.0, out=tmp_path)
    assert facts["slip"] == 1.0 and facts["drawbar_pull_N"] > 0.0
    measurement = measure_result(open_result(tmp_path))
    assert measurement.path[-1] == pytest.approx(0.058 * 4.5)  # of the rim
    assert run_picture(open_result(tmp_path)).axes[-1].get_xlabel() == "path of the rim [m]"


@pytest.mark.slow
@BOTH
def test_a_stationary_part_hangs_neither_on_the_step_nor_on_the_travel(tier):
    """The shipped settings against half the step and twice the travel."""
    wheel = {**SHORT, "tier": tier, "slip": 0.4, "slip_angle": 0.2, "carriage_speed": 0.01, "travel": 0.3, "scm.cell": 0.005}
    del wheel["run.step"]
    facts = measure(wheel, soil="cmu_sand")
    finer, longer = measure({**wheel, "run.step": 2e-3}, soil="cmu_sand"), measure({**wheel, "travel": 0.6}, soil="cmu_sand")
    for other in (finer, longer):
        assert facts["stationary"] and other["stationary"]
        assert other["sinkage_m"] == pytest.approx(facts["sinkage_m"], rel=0.01)
        for force in ("drawbar_pull_N", "lateral_force_N", "normal_load_N"):
            assert other[force] == pytest.approx(facts[force], abs=0.01 * 24.0)


# -- on the command line


def test_json_has_the_measurements_in_place_of_the_wheels(tmp_path):
    done = cdl("run", "single_wheel", *settings("slip=0.5", "slip_angle=0.26"), "--soil", "cmu_sand", "--json", "--out", tmp_path)
    facts = json.loads(done.stdout)
    assert done.stderr == "warning: --set scm.cell: it has no effect: no wheel is on SCM, only on BCM\n"
    assert "wheels" not in facts
    assert facts["drawbar_pull_N"] == pytest.approx(point(slip=0.5, slip_angle=0.26)["drawbar_pull_N"], rel=1e-9)


def test_a_run_can_be_shown_resumed_run_again_as_a_system_and_compared(tmp_path):
    folder = tmp_path / "run"
    done = cdl("run", "single_wheel", *settings(), "--checkpoint-every", 2, "--out", folder)
    assert done.exit_code == 0 and "loading models" in done.stderr
    assert "drawbar pull [N]" in done.stdout and "stationary from" in done.stdout and "BCM, slip 0.2, slip angle 0 rad" in done.stdout
    assert "wheel wheel: BCM, bcm.diagnostics[1], carriage.wheel[1]" in cdl("info", folder).stdout
    assert cdl("plot", folder).stdout == f"{folder / 'result.png'}\n"
    again = cdl("run", folder / "system.ssp", "--step", 5e-3, "--json", "--out", tmp_path / "again")
    facts = json.loads(again.stdout)
    assert facts["slip"] == 0.2 and facts["stationary"]
    shutil.copytree(folder, tmp_path / "copy")
    resume = ["--resume", tmp_path / "copy" / "checkpoint_2.000s.npz"]
    assert cdl("run", "single_wheel", *settings(), *resume).exit_code == 0
    assert cdl("diff", tmp_path / "copy", folder, "--rtol", 0).exit_code == 0
    assert cdl("diff", tmp_path / "again", folder, "--rtol", 0).exit_code == 1  # every step is recorded there


def test_refusals_on_the_command_line():
    assert "--tiers BCM,SCM: give 1 tier, WHEEL" in refusal("run", "single_wheel", "--tiers", "BCM,SCM")
    text = refusal("run", "single_wheel", *settings("slip=[0,0.1]"), "--resume", "x.npz")
    assert "slip: a sweep has no checkpoints; run one point" in text
    assert "--set slip: slip = []: there is no value; a sweep needs each value once" in refusal("run", "single_wheel", *settings("slip=[]"))
    text = refusal("run", "single_wheel", *settings("slip=[0, 0.0]"))
    assert "slip = [0, 0.0]: a value is given twice; a sweep needs each value once" in text
    assert "scm.map_min needs 2 values, not 3" in refusal("run", "single_wheel", *settings("scm.map_min=[1,2,3]"))
    assert "soil.phi needs one value, not 2" in refusal("run", "two_wheel", "--set", "soil.phi=[0.5,0.6]")


# -- sweeps


def test_a_sweep_is_every_combination_in_the_order_given(tmp_path, one_core):
    swept = ["slip=[0.4,-0.2]", 'tier=["SCM","BCM"]']
    done = cdl("run", "single_wheel", *settings(*swept), "--soil", "cmu_sand", "--json", "--out", tmp_path)
    assert (done.exit_code, done.stderr) == (0, "")
    facts = json.loads(done.stdout)
    order = [(0.4, "SCM"), (0.4, "BCM"), (-0.2, "SCM"), (-0.2, "BCM")]
    assert [(run["slip"], run["tier"]) for run in facts["runs"]] == order and facts["failed"] == []
    with (tmp_path / "sweep.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0])[:2] == ["slip", "tier"]
    assert [float(row["sinkage_m"]) for row in rows] == [run["sinkage_m"] for run in facts["runs"]]
    assert open_sweep(tmp_path)["runs"] == facts["runs"]
    assert {p.name for p in tmp_path.iterdir()} == {
        *(f"sweep.{end}" for end in ("csv", "json", "png")),
        *(f"slip={slip},tier={tier}" for slip, tier in order),
    }
    (tmp_path / "sweep.png").unlink()
    assert cdl("plot", tmp_path).stdout == f"{tmp_path / 'sweep.png'}\n" and (tmp_path / "sweep.png").exists()
    # Each point is what it is alone.
    assert facts["runs"][1]["sinkage_m"] == pytest.approx(point("BCM", slip=0.4)["sinkage_m"], rel=1e-9)


def test_a_sweep_says_what_runs_and_how_many_are_left(tmp_path, one_core):
    said = []
    run_sweep({"slip": [0.1, 0.2]}, "single_wheel", tmp_path, overrides={**SHORT, "tier": "BCM", "travel": 0.02}, status=said.append)
    assert said == [
        "slip=0.1: started, 2 of 2 left",
        "slip=0.1: done, 1 of 2 left",
        "slip=0.2: started, 1 of 2 left",
        "slip=0.2: done, 0 of 2 left",
    ]
    done = cdl("run", "single_wheel", *settings("travel=0.02", "scm.cell=[0.02]", "tier=SCM"), "--out", tmp_path)
    assert "scm.cell=0.02: started, 1 of 1 left\nscm.cell=0.02: failed, 0 of 1 left" in done.stderr


def test_an_option_of_a_tier_without_wheel_is_said_to_do_nothing(tmp_path, monkeypatch, one_core):
    def simulate(experiment, out, *, overrides, **options):
        return SimpleNamespace(status="complete", warnings=load_experiment(experiment, overrides=overrides).warnings)

    monkeypatch.setattr(single_wheel, "simulate", simulate)
    monkeypatch.setattr(single_wheel, "facts_of", lambda outcome: {})
    options = {"scm.cell": 0.01, "bcm.eta": 0.1}
    warnings = run_sweep({"slip": [0.1]}, "single_wheel", tmp_path, overrides=options | {"tier": "BCM"}).warnings
    assert warnings == ["slip=0.1: --set scm.cell: it has no effect: no wheel is on SCM, only on BCM"]
    # In a sweep over tiers each has its own; a swept key is another matter.
    keys = {"tier": ["BCM", "SCM"]}
    assert run_sweep(keys, "single_wheel", tmp_path, overrides=options).warnings == []
    warnings = run_sweep(keys | {"bcm.eta": [0.0, 0.1]}, "single_wheel", tmp_path, overrides=options).warnings
    assert warnings == [f"tier=SCM,bcm.eta={eta}: --set bcm.eta: it has no effect: no wheel is on BCM, only on SCM" for eta in (0.0, 0.1)]


def test_a_point_that_fails_leaves_the_others_alone(tmp_path, one_core):
    done = cdl("run", "single_wheel", *settings("scm.cell=[0.01,0.02]", "tier=SCM", "travel=0.02"), "--out", tmp_path)
    assert done.exit_code == 2
    assert "scm.cell=0.02: --set scm.cell: scm.cell = 0.02 m: larger than a third of the wheel's width" in done.stderr
    assert [run["scm.cell"] for run in open_sweep(tmp_path)["runs"]] == [0.01]
    assert (tmp_path / "sweep.png").exists() and "0.01" in done.stdout
    with pytest.raises(RunError, match=r"scm.cell=0.02: --set scm.cell: .* larger than a third"):
        sweep({**SHORT, "tier": "SCM", "travel": 0.02, "scm.cell": [0.01, 0.02]}, out=tmp_path)


@pytest.mark.slow
def test_processes_side_by_side_measure_what_one_does(tmp_path):
    overrides = {**SHORT, "tier": "BCM", "slip": [0.1, 0.2, 0.3], "scm.cell": 0.01}
    point()  # a process that has run FMUs has their folders on its path
    alone = sweep(overrides, out=tmp_path / "alone", processes=1)
    together = sweep(overrides, out=tmp_path / "together", processes=2)
    differ = {"wall_s", "result"}
    assert [{k: v for k, v in row.items() if k not in differ} for row in together] == [
        {k: v for k, v in row.items() if k not in differ} for row in alone
    ]


def test_an_interrupt_leaves_the_points_that_are_finished(tmp_path, monkeypatch, one_core):
    def interrupted(experiment, out, **options):
        if options["overrides"]["slip"] == 0.2:
            raise KeyboardInterrupt
        return simulate(experiment, out, **options)

    simulate = single_wheel.simulate
    monkeypatch.setattr(single_wheel, "simulate", interrupted)
    keys = {"slip": [0.1, 0.2, 0.3]}
    done = run_sweep(keys, "single_wheel", tmp_path, overrides={**SHORT, "tier": "BCM"})
    assert done.interrupted and [row["slip"] for row in done.rows] == [0.1]
    assert [run["slip"] for run in open_sweep(tmp_path)["runs"]] == [0.1]
    assert cdl("run", "single_wheel", *settings("slip=[0.1,0.2]"), "--out", tmp_path).exit_code == 130


def test_a_list_in_the_file_sweeps_too_and_so_do_soils_and_files(tmp_path):
    own = tmp_path / "own.toml"
    own.write_text('tier = "BCM"\nslip = [0.0, 0.1]\n[carriage]\n[soil]\nset = ["mss_d", "cmu_sand"]\n')
    found = single_wheel.swept_keys(own, overrides={"load_N": [1.0, 2.0], "soil.phi": 0.5, "scm.map_min": [-1.0, -1.0]})
    assert found == {"load_N": [1.0, 2.0], "slip": [0.0, 0.1], "soil.set": ["mss_d", "cmu_sand"]}
    assert list(found) == ["load_N", "slip", "soil.set"]
    assert single_wheel.swept_keys("single_wheel", overrides={"scm.wheel_mesh": ["a.stl", "b.stl"]}) == {
        "scm.wheel_mesh": ["a.stl", "b.stl"]
    }
    assert single_wheel.swept_keys("two_wheel", overrides={"soil.phi": [0.5, 0.6]}) == {}


# -- measurements laid over


@pytest.fixture
def tests(tmp_path):
    """Tests at two slips straight ahead, one at a slip angle of 15 deg."""
    path = tmp_path / "tests.csv"
    path.write_text(
        "wheel,beta_deg,slip,Fx_N,Fy_N,Fz_N,sinkage_mm,sdFx\n"
        "smooth,0,0.0,-2.0,0.5,12.0,14.0,0.1\nsmooth,0,0.5,1.0,0.5,24.0,23.0,\nsmooth,15,0.5,1.0,-5.0,24.0,20.0,0.2\n"
    )
    return read_measured(path)


def rows_of(**series):
    """Rows of a sweep's file in which every quantity is 1 of its unit."""
    n = len(next(iter(series.values())))
    fixed = {"tier": "SCM", "slip": 0.0, "slip_angle": 0.0, "load_N": 24.0, "stationary": True}
    fixed |= {f"{key}{end}": 1.0 for key in QUANTITIES for end in ("", "_std")}
    return [fixed | {key: values[i] for key, values in series.items()} for i in range(n)]


def marks(ax):
    """Points of the tests that are drawn."""
    lines = [line for line in ax.get_lines() if line.get_color() == "black" and line.get_marker() in "o^sDvP"]
    return [tuple(map(float, xy)) for line in lines for xy in line.get_xydata()]


def test_tests_are_read_in_si_units(tests):
    assert [(test.slip, test.slip_angle) for test in tests.tests] == [(0.0, 0.0), (0.5, 0.0), (0.5, math.radians(15))]
    first = tests.tests[0]
    assert first.values == {"drawbar_pull_N": -2.0, "lateral_force_N": 0.5, "sinkage_m": 0.014, "normal_load_N": 12.0}
    assert first.deviations["drawbar_pull_N"] == 0.1 and tests.tests[1].deviations["drawbar_pull_N"] == 0.0
    assert first.at_load(24.0).values["drawbar_pull_N"] == -4.0 and first.at_load(24.0).values["sinkage_m"] == 0.014
    assert len(tests.near(slip=0.49)) == 2 and len(tests.near(slip=0.49, slip_angle=0.26)) == 1


def test_a_sweep_s_picture_shows_the_tests_at_its_slip_angles(tests):
    keys = {"slip": [0.0, 0.5], "tier": ["BCM", "SCM"]}
    rows = rows_of(slip=[0.0, 0.0, 0.5, 0.5], tier=["BCM", "SCM"] * 2)
    rows[3]["stationary"] = False
    figure = sweep_picture(keys, rows, tests)
    pull, lateral, torque, sinkage = figure.axes
    assert marks(pull) == [(0.0, -4.0), (0.5, 1.0)]  # the first from 12 to 24 N
    assert marks(sinkage) == [(0.0, 14.0), (0.5, 23.0)] and marks(torque) == []
    assert (pull.get_ylabel(), sinkage.get_xlabel()) == ("drawbar pull $F_x$ [N]", "slip")
    assert lateral.get_ylim()[1] >= 1.0
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert texts == ["tier = BCM", "tier = SCM", "measured, slip_angle = 0"]
    note = "bars: standard deviation; hollow: NOT stationary; 2 tests of tests.csv, forces times load / measured $F_z$"
    assert figure.get_supxlabel() == note


def test_over_slip_angles_the_tests_at_the_slip_are_shown(tests):
    figure = sweep_picture({"slip_angle": [0.0, 0.26]}, rows_of(slip_angle=[0.0, 0.26], slip=[0.5, 0.5]), tests)
    assert marks(figure.axes[1]) == [(0.0, 0.5), (math.radians(15), -5.0)]
    assert figure.axes[3].get_xlabel() == "slip_angle [rad]"


@pytest.mark.parametrize("keys", [{"soil.phi": [0.5, 0.6]}, {"slip": [0.7, 0.8]}])
def test_where_no_test_fits_the_picture_says_so(tests, keys):
    rows = rows_of(**keys, slip_angle=[1.0, 1.0])
    assert "tests.csv has no test at such a slip and slip angle" in sweep_picture(keys, rows, tests).get_supxlabel()


def test_words_stand_side_by_side():
    figure = sweep_picture({"soil.set": ["mss_d", "cmu_sand"]}, rows_of(**{"soil.set": ["mss_d", "cmu_sand"]}))
    assert [label.get_text() for label in figure.axes[3].get_xticklabels()] == ["mss_d", "cmu_sand"]


def test_a_run_s_picture_shows_the_mean_of_its_tests_and_its_stationary_part(tmp_path, tests):
    measure({**SHORT, "tier": "BCM", "slip": 0.5}, soil="cmu_sand", out=tmp_path, measured=tests)
    assert (tmp_path / "result.png").exists()
    result = open_result(tmp_path)
    figure = run_picture(result, tests)
    assert len(figure.axes) == 5
    (line,) = (line for line in figure.axes[3].get_lines() if line.get_linestyle() == "--")
    assert set(line.get_ydata()) == {23.0}
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert texts == ["stationary part, its mean and standard deviation", "1 test of tests.csv, forces times load / measured $F_z$"]
    begin = measure_result(result).part.first
    assert any(np.isclose(patch.get_x(), measure_result(result).path[begin]) for patch in figure.axes[0].patches)


@pytest.mark.parametrize(
    "text, said",
    [
        ("beta_deg,Fx_N\n0,1\n", "a table of measurements needs a column slip, and one of Fx_N, Fy_N"),
        ("slip,beta_deg\n0,1\n", "it has slip, beta_deg"),
        ("slip,Fx_N\n0.1,much\n", "tests.csv, line 2: Fx_N = 'much' is no number; leave it empty"),
        ("slip,Fx_N\n,1.0\n", "tests.csv, line 2: slip is missing; each test needs one"),
        (None, "tests.csv: No such file or directory; give a CSV table of measurements"),
    ],
)
def test_tables_that_cannot_be_read_are_refused(tmp_path, text, said):
    path = tmp_path / "tests.csv"
    if text is not None:
        path.write_text(text)
    with pytest.raises(MeasuredError) as caught:
        read_measured(path)
    assert said in str(caught.value)
    assert said in refusal("run", "single_wheel", *settings(), "--measured", path, "--out", tmp_path / "out")


def test_files_that_are_no_sweep_are_refused(tmp_path):
    with pytest.raises(ResultError, match=r"sweep.json: No such file or directory; `cdl run` with a list for a key writes one"):
        open_sweep(tmp_path)
    (tmp_path / "sweep.json").write_text("{}")
    with pytest.raises(ResultError, match=r"sweep.json is of no sweep: give the sweep.json of `cdl run`"):
        open_sweep(tmp_path)
    (tmp_path / "sweep.json").write_text("{")
    assert "sweep.json is no JSON" in refusal("plot", tmp_path / "sweep.json")
