"""Experiments: what their values become, and where a run starts."""

from importlib import resources

import numpy as np
import pytest

from orchestrator.assemble import assemble
from orchestrator.experiment import load_experiment
from orchestrator.ssp import read_system

WEIGHT = (50.0 + 2 * 2.0) * 9.81


def test_a_smooth_wheel_lowered_quasi_statically_rests_where_the_closed_form_says():
    """Symmetric contact at rest under 27 kg: 26.65 mm, from Bekker's law integrated over the arc."""
    parts = assemble(load_experiment("two_wheel", overrides={"wheel.n_g": 0})).instances
    sinkage = parts["bcm"].y["diagnostics"]["sinkage"]
    assert sinkage == pytest.approx([26.65e-3] * 2, rel=1e-3)
    assert parts["bcm"].y["wheel"]["f_0"][:, 2].sum() == pytest.approx(WEIGHT, rel=1e-6)


def test_a_high_mass_settles_level():
    """A point mass 0.5 m up makes the level pose less stable, but still the one that balances all moments."""
    parts = assemble(load_experiment("two_wheel", overrides={"rover.mass_height": 0.5})).instances
    rover, force = parts["rover"], parts["bcm"].y["wheel"]["f_0"][:, 2]
    assert abs(float(rover.p.start.pitch)) < 1e-9
    assert force == pytest.approx([WEIGHT / 2] * 2, rel=1e-6)


def test_values_reach_every_model_that_has_them(tmp_path):
    experiment = load_experiment("two_wheel", overrides={"environment.gravity": 3.71, "soil.phi": 0.6, "driver.steer_to": [0.1, -0.2]})
    parts = experiment.instances()
    assert parts["rover"].p.gravity == parts["bcm"].p.gravity == 3.71
    assert parts["bcm"].p.phi == 0.6
    assert list(parts["driver"].p.steer_to) == [0.1, -0.2]
    experiment.write_system(tmp_path / "x.ssp")
    system = read_system(tmp_path / "x.ssp", tmp_path / "unpacked")
    bcm = system.components["bcm"]
    assert bcm.parameters["phi"] == 0.6
    # The FMU itself starts there too, for tools that know no parameter files.
    starts = {v.name: v.start for v in bcm.model_description.modelVariables}
    assert float(starts["phi"]) == 0.6 and float(starts["gravity"]) == 3.71
    assert float(starts["wheel[1].r_0[1]"]) == pytest.approx(0.6)


def test_an_experiment_of_ones_own(tmp_path):
    own = tmp_path / "own.toml"
    own.write_text(
        """
title = "Reverse on lunar soil"
[run]
stop_time = 1.0
scheme = "gs-mid"
[tiers]
front = "BCM"
rear = "BCM"
[environment]
gravity = 1.62
[soil]
set = "lunar_nominal"
rho = 1700.0
[bcm]
V_j_mode = "mapped"
[rover.start]
yaw = 0.5
[driver]
wheel_rate = -0.5
"""
    )
    experiment = load_experiment(own)
    assert experiment.title == "Reverse on lunar soil"
    assert (experiment.settings.stop_time, experiment.settings.scheme, experiment.settings.step) == (1.0, "gs-mid", 1e-3)
    parts = assemble(experiment).instances
    assert parts["bcm"].p.rho == 1700.0 and parts["bcm"].p.V_j_mode == 2.0
    assert parts["bcm"].y["wheel"]["f_0"][:, 2].sum() == pytest.approx(54.0 * 1.62, rel=1e-6)
    ahead = parts["rover"].y["wheel"]["r_0"][0] - parts["rover"].y["wheel"]["r_0"][1]
    assert ahead[:2] == pytest.approx(0.6 * np.array([np.cos(0.5), np.sin(0.5)]))


def test_the_same_experiment_gives_the_same_package(tmp_path):
    for name in ("a", "b"):
        load_experiment("two_wheel").write_system(tmp_path / f"{name}.ssp")
    assert (tmp_path / "a.ssp").read_bytes() == (tmp_path / "b.ssp").read_bytes()


def test_a_start_pose_of_the_users_is_kept(tmp_path):
    parts = assemble(load_experiment("two_wheel", overrides={"rover.start.z": 0.15})).instances
    assert parts["rover"].y["wheel"]["r_0"][:, 2] == pytest.approx([0.15, 0.15])
    assert parts["bcm"].u["wheel"]["r_0"][:, 2] == pytest.approx([0.15, 0.15])


def test_a_soil_of_ones_own_lies_beside_the_experiment_wherever_that_is_run(tmp_path, monkeypatch):
    (tmp_path / "there").mkdir()
    text = (resources.files("cdl_fmu.soil") / "mss_d.toml").read_text(encoding="utf-8").replace("66.5", "99.5")
    (tmp_path / "there" / "soil.toml").write_text(text, encoding="utf-8-sig")  # as Windows' editors write it
    own = tmp_path / "there" / "own.toml"
    own.write_text('[tiers]\nfront = "BCM"\nrear = "BCM"\n[soil]\nset = "soil.toml"\n', encoding="utf-8-sig")
    monkeypatch.chdir(tmp_path)
    assert load_experiment("there/own.toml").instances()["bcm"].p.c == 99.5
    # An option means the folder it is given in.
    chosen = load_experiment("two_wheel", overrides={"soil.set": "there/soil.toml"})
    assert chosen.instances()["bcm"].p.c == 99.5
