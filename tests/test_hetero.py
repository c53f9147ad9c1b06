"""The two-wheel rover on deforming soil: SCM below both wheels, and below one with BCM on patches of its soil below the other."""

import numpy as np
import pytest
from systems import run_two_wheel

import orchestrator
from orchestrator.assemble import assemble
from orchestrator.experiment import ExperimentError, load_experiment
from orchestrator.report import wheels_of
from orchestrator.results import open_result

LOAD = 27.0 * 9.81  # [N] on each wheel at rest: half of the point mass and the wheel's own
PAIRS = [("SCM", "SCM"), ("SCM", "BCM"), ("BCM", "SCM")]
every_pair = pytest.mark.parametrize("tiers", PAIRS, ids="-".join)


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """Run the shipped experiment, once for each set of arguments; returns its result, opened."""
    folder, results = tmp_path_factory.mktemp("drives"), {}

    def result(*tiers, overrides=None, **options):
        key = repr((tiers, overrides, options))
        if key not in results:
            outcome = run_two_wheel(folder / str(len(results)), tiers=tiers, overrides=overrides, **{"stop_time": 0.6, **options})
            assert outcome.warnings == []
            results[key] = open_result(outcome.result)
        return results[key]

    return result


@pytest.fixture
def standing(drive):
    """Run it with wheels that do not turn."""
    return lambda *tiers: drive(*tiers, overrides={"driver.wheel_rate": 0.0}, stop_time=0.3)


def loads(result):
    return np.array([wheel.diagnostic("normal_load") for wheel in wheels_of(result)])


def rms(difference):
    """Of each wheel."""
    return np.sqrt(np.mean(difference**2, axis=1))


# -- assembly


@pytest.mark.parametrize(
    "tiers, models",
    [
        (("SCM", "SCM"), {"scm": "cdl_scm_w2"}),
        (("SCM", "BCM"), {"scm": "cdl_scm_w1p1", "bcm": "cdl_bcm_w1p1"}),
        (("BCM", "SCM"), {"scm": "cdl_scm_w1p1", "bcm": "cdl_bcm_w1p1"}),
        (("BCM", "BCM"), {"bcm": "cdl_bcm_w2"}),
    ],
)
def test_wheels_of_other_tiers_stand_on_patches_of_the_soil(tiers, models):
    parts = load_experiment("two_wheel", tiers=tiers).instances()
    assert {name: part.model.identifier for name, part in parts.items() if name not in ("rover", "driver")} == models


def test_patches_carry_what_pressed_the_soil_where_that_is_wanted():
    experiment = load_experiment("two_wheel", tiers=("SCM", "BCM"), overrides={"bcm.compaction": True})
    models = {name: part.model.identifier for name, part in experiment.instances().items()}
    assert (models["scm"], models["bcm"], experiment.warnings) == ("cdl_scm_w1p1c1", "cdl_bcm_w1p1c1", [])
    ends = {
        f"{c.source_component}.{c.source_variable}": f"{c.target_component}.{c.target_variable}" for c in assemble(experiment).connections
    }
    assert ends["scm.patch[1].yield_pressure[13,9]"] == "bcm.patch[1].yield_pressure[13,9]" and "scm.patch[1].sinkage[1,1]" in ends
    idle = load_experiment("two_wheel", tiers=("BCM", "BCM"), overrides={"bcm.compaction": True})
    text = "--set bcm.compaction: bcm.compaction has no effect: no wheel on SCM presses the soil that wheels on BCM stand on"
    assert idle.warnings == [text]
    apart = load_experiment(
        "two_wheel", tiers=("SCM", "BCM"), overrides={"bcm.compaction": True, "bcm.k_0": 1e6, "scm.pressure_model": "reece"}
    )
    assert apart.warnings == [
        "two_wheel.toml: bcm.k_0 = 1e+06 Pa/m, but scm.k_0 = 0 Pa/m: with compaction both tiers press one soil; set both alike",
        "two_wheel.toml: scm.pressure_model = reece: with compaction wheels on BCM bear by Bekker's law on soil that was pressed by "
        "Reece's",
    ]
    with pytest.raises(ExperimentError, match=r"--set bcm.compaction: bcm.compaction = 2: use true \(.*\) or false"):
        load_experiment("two_wheel", overrides={"bcm.compaction": 2})


def test_the_patch_of_a_wheel_is_connected_to_that_wheel():
    system = assemble(load_experiment("two_wheel", tiers=("BCM", "SCM")))
    ends = {f"{c.source_component}.{c.source_variable}": f"{c.target_component}.{c.target_variable}" for c in system.connections}
    trailing = [c for c in system.connections if c.target_variable.startswith("trailing[")]
    assert {(c.source_variable, c.target_variable) for c in trailing} == {
        (f"wheel[1].r_0[{i}]", f"trailing[1].r_0[{i}]") for i in (1, 2, 3)
    }
    assert ends["scm.patch[1].z[13,9]"] == "bcm.patch[1].z[13,9]" and ends["scm.patch[1].spacing"] == "bcm.patch[1].spacing"
    assert ends["scm.wheel[1].f_0[3]"] == "rover.wheel[2].f_0[3]" and ends["bcm.contact[1].F[3]"] == "rover.contact[1].F[3]"


# -- rest


@every_pair
def test_smooth_wheels_rest_where_the_closed_form_says(tiers):
    """26.65 mm under 27 kg, from Bekker's law integrated over the arc."""
    parts = assemble(load_experiment("two_wheel", tiers=tiers, overrides={"wheel.n_g": 0, "scm.strength": "plates"})).instances
    for name in {tier.lower() for tier in tiers}:
        assert parts[name].y["diagnostics"]["sinkage"] == pytest.approx(26.65e-3, rel=0.02)
        assert parts[name].y["wheel"]["f_0"][:, 2] == pytest.approx(LOAD, rel=1e-6)
    assert abs(float(parts["rover"].p.start.pitch)) < 1e-4


@every_pair
def test_a_patch_is_there_from_the_start(tiers):
    parts = assemble(load_experiment("two_wheel", tiers=tiers, overrides={"scm.strength": "plates"})).instances
    if "bcm" in parts:
        patch, wheel = parts["bcm"].u["patch"][0], parts["bcm"].u["wheel"][0]
        assert patch["spacing"] == 0.03 and not patch["z"].any()
        assert np.abs(patch["origin"] + 0.03 * np.array([6, 4]) - wheel["r_0"][:2]).max() <= 0.015
    assert parts["scm"].y["wheel"]["f_0"][:, 2] == pytest.approx(LOAD, rel=1e-6)


@every_pair
def test_a_run_starts_at_rest(tiers, standing):
    result = standing(*tiers)
    start = loads(result)[:, :2]  # and after a step
    assert start.sum(axis=0) == pytest.approx(2 * LOAD, rel=1e-5)
    assert start == pytest.approx(LOAD, rel=1e-3)  # it leans where one tier lets its wheel sink deeper
    assert loads(result).sum(axis=0)[-1] == pytest.approx(2 * LOAD, rel=0.01)
    for wheel in wheels_of(result):
        assert np.abs(wheel.diagnostic("drawbar_pull")[:2]).max() < 1e-3 * LOAD


@every_pair
def test_a_wheel_that_stands_stays_as_it_is(tiers, standing):
    assert loads(standing(*tiers)) == pytest.approx(LOAD, rel=0.01)


# -- a drive


@every_pair
def test_forces_under_jacobi_stay_near_those_of_the_default_scheme(tiers, drive):
    """All slaves step at once on the values of t, as in plain tools; patches come one step late then."""
    difference = loads(drive(*tiers, scheme="jacobi")) - loads(drive(*tiers))
    assert rms(difference).max() < 0.05 * LOAD
    assert np.abs(difference).max() < 0.15 * LOAD


@pytest.mark.parametrize("tiers", PAIRS[:2], ids="-".join)
def test_a_scheme_that_undoes_steps_leaves_the_same_soil(tiers, drive):
    """Once it is at rest: up to 0.1 m behind a wheel's centre, where the rim rises from the rut, soil slides in by up to 0.5 mm a step."""
    reference, other = drive(*tiers, stop_time=2.0), drive(*tiers, stop_time=2.0, scheme="aitken")
    assert rms(loads(other) - loads(reference)).max() < 0.02 * LOAD
    z, z_other = (result.cdl.soil(result.cdl.soil_times[-1]) for result in (reference, other))
    x = wheels_of(reference)[0].centre("x")
    rut = z.where((z.x > x[0]) & (z.x < x[-1] - 0.1))
    assert float(rut.min()) < -0.01
    assert float(np.abs(z_other - rut).max()) < 1e-4


def test_a_resumed_run_goes_on_with_the_same_soil(tmp_path, drive):
    whole = drive("SCM", "BCM")
    run_two_wheel(tmp_path, tiers=("SCM", "BCM"), stop_time=0.3, checkpoint_every=0.3)
    resumed = run_two_wheel(tmp_path, tiers=("SCM", "BCM"), stop_time=0.6, resume=tmp_path / "checkpoint_0.300s.npz")
    assert np.array_equal(open_result(resumed.result).series.values, whole.series.values)


def test_the_rear_wheel_rolls_down_into_the_rut(drive):
    """Of a short rover, to get there soon; BCM on flat ground knows nothing of the rut."""
    fell = {}
    for front in ("SCM", "BCM"):
        _, rear = wheels_of(drive(front, "BCM", overrides={"rover.wheel_base": 0.3}, stop_time=2.6))
        x, z = rear.centre("x"), rear.centre("z")
        assert x[-1] - x[0] > 0.2
        fell[front] = z[x < x[0] + 0.03].min() - z[-1]
    assert fell["SCM"] > 5e-3 > 1e-3 > abs(fell["BCM"])


def test_simulate_runs_a_pair_of_tiers(tmp_path, drive):
    outcome = orchestrator.simulate("two_wheel", tmp_path, tiers=("SCM", "BCM"), stop_time=0.05)
    ours = drive("SCM", "BCM").series.values[: len(open_result(outcome.result).time)]
    assert np.array_equal(open_result(outcome.result).series.values, ours)
    assert [wheel.tier for wheel in wheels_of(open_result(outcome.result))] == ["SCM", "BCM"]
