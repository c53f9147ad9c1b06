"""Experiments: what their values become, and where a run starts."""

import zipfile
from importlib import resources

import numpy as np
import pytest

import orchestrator
from cdl_fmu.slave.model import ModelError
from orchestrator.assemble import assemble
from orchestrator.experiment import ExperimentError, load_experiment
from orchestrator.results import open_result
from orchestrator.run import run
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


# -- tiers, and files that their models read

SLOPE = 0.1


@pytest.fixture
def sloping(tmp_path):
    """An experiment on a raster of ground 2 m up that rises along x, in a folder of its own: its path, and options become overrides."""
    folder = tmp_path / "sloping"
    folder.mkdir()
    x = np.arange(-1.0, 2.01, 0.1)
    np.savez(folder / "base.npz", z=np.repeat(2.0 + SLOPE * x[:, None], 21, axis=1), origin=(-1.0, -1.0), spacing=0.1)
    path = folder / "sloping.toml"
    path.write_text('[tiers]\nfront = "SCM"\nrear = "BCM"\n[scm]\nbase = "base.npz"\nground_z = 2.0\n[bcm]\nground_z = 2.0\n')
    return path


def test_sections_of_all_tiers_are_checked_and_those_in_use_count(tmp_path):
    own = tmp_path / "own.toml"
    own.write_text('[tiers]\nfront = "BCM"\nrear = "BCM"\n[scm]\nplasticity = 0.5\ncell = 0.02\n')
    assert set(load_experiment(own).instances()) == {"rover", "driver", "bcm"}
    one = load_experiment(own, tiers=("SCM", "BCM"), overrides={"scm.cell": 0.005}).instances()["scm"]
    assert (one.p.plasticity, one.p.cell) == (0.5, 0.005)
    own.write_text('[tiers]\nfront = "BCM"\nrear = "BCM"\n[scm]\nplastcity = 0.5\n')
    with pytest.raises(ExperimentError, match=r"own\.toml, line 5: scm\.plastcity is unknown; did you mean plasticity\?"):
        load_experiment(own)
    with pytest.raises(
        ExperimentError, match=r"--set scm\.cell: scm\.cell = 0\.05 m: larger than a third of the wheel's width .* use at most"
    ):
        load_experiment("two_wheel", tiers=("SCM", "SCM"), overrides={"scm.cell": 0.05}).instances()


def test_a_rover_rests_on_ground_from_a_raster_that_lies_beside_the_experiment(sloping, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    parts = assemble(load_experiment("sloping/sloping.toml", overrides={"scm.strength": "plates"})).instances
    assert float(parts["rover"].p.start.pitch) == pytest.approx(-np.arctan(SLOPE), abs=2e-3)
    for tier, i in (("scm", 0), ("bcm", 1)):
        assert parts[tier].y["wheel"]["f_0"][0, 2] == pytest.approx(WEIGHT / 2, rel=0.1)
        x, _, z = parts["rover"].y["wheel"]["r_0"][i]
        assert 2.0 + SLOPE * x + 0.08 < z < 2.0 + SLOPE * x + 0.12
    load_experiment("sloping/sloping.toml", overrides={"scm.strength": "plates"}).write_system(tmp_path / "x.ssp")
    (sloping.parent / "base.npz").unlink()  # it is in the FMU
    with zipfile.ZipFile(tmp_path / "x.ssp") as package, zipfile.ZipFile(package.open("resources/cdl_scm_w1p1.fmu")) as fmu:
        assert "resources/base.npz" in fmu.namelist()
    outcome = run(read_system(tmp_path / "x.ssp", tmp_path / "unpacked"), tmp_path / "out", scheme="jacobi", stop_time=0.01)
    series = open_result(outcome.result).cdl
    assert series["scm.diagnostics[1].normal_load"][-1] == pytest.approx(float(parts["scm"].y["wheel"]["f_0"][0, 2]), rel=0.2)


def test_a_file_of_an_option_is_meant_from_where_it_is_given(sloping, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    chosen = {"scm.base": "sloping/base.npz", "scm.ground_z": 2.0}
    base = load_experiment("two_wheel", tiers=("SCM", "SCM"), overrides=chosen).instances()["scm"].files["base"]
    assert base == str(sloping.parent / "base.npz")
    none = load_experiment(sloping, overrides={"scm.base": ""})
    assert none.instances()["scm"].files["base"] == ""


def test_files_that_cannot_be_read_are_refused_with_their_line(sloping, tmp_path):
    def refused(old, new):
        path = sloping.with_name("other.toml")
        path.write_text(sloping.read_text().replace(old, new))
        with pytest.raises(ExperimentError) as caught:
            load_experiment(path).write_system(tmp_path / "x.ssp")
        return str(caught.value)

    missing = refused("base.npz", "bse.npz")
    assert missing.startswith("other.toml, line 5: scm.base = 'bse.npz': no such file; correct the path ")
    assert "(Raster of heights of the undisturbed ground" in missing
    assert "other.toml, line 5: scm.base = 3: the path of a file is needed (Raster" in refused('"base.npz"', "3")
    assert "line 5: scm.bse is unknown; did you mean base?" in refused("base =", "bse =")
    (sloping.parent / "base.txt").write_text("1 2 3")
    assert "base.txt: a raster of heights is read from .npz, .asc" in refused("base.npz", "base.txt")
    assert refused("[bcm]\nground_z = 2.0\n", "") == (
        "other.toml: bcm.ground_z = 0 m, but scm.ground_z = 2 m: the wheels stand on one ground; set both alike"
    )


def test_a_start_height_counts_from_the_raster(sloping):
    with pytest.raises(
        ModelError, match=r"start\.z = 0\.15 m puts the axle of wheel front 1\.91 m below the surface: use a start\.z between 2\.06 "
    ):
        assemble(load_experiment(sloping, overrides={"rover.start.z": 0.15}))


@pytest.fixture
def measured(tmp_path):
    """An experiment on a soil as an identification without shear tests writes it, for wheels from 40 to 100 mm."""
    text = (resources.files("cdl_fmu.soil") / "mss_d.toml").read_text(encoding="utf-8")
    assert text.count("value = 0.640535835481919\n") == 1
    (tmp_path / "sand.toml").write_text(text.replace("value = 0.640535835481919\n", "") + "[fit]\nwidths = [0.04, 0.1]\n", encoding="utf-8")
    own = tmp_path / "own.toml"
    own.write_text('[tiers]\nfront = "BCM"\nrear = "BCM"\n[soil]\nset = "sand.toml"\n')
    return own


def test_what_a_soil_file_lacks_the_experiment_gives(measured):
    with pytest.raises(ExperimentError, match=r"own.toml, line 5: sand.toml has no value for phi .*: give --set soil.phi=<number>, write"):
        load_experiment(measured)
    with pytest.raises(ExperimentError, match=r"--set soil.phy: soil.phy is unknown; did you mean phi\?"):
        load_experiment(measured, overrides={"soil.phy": 0.6})
    assert load_experiment(measured, overrides={"soil.phi": 0.6}).instances()["bcm"].p.phi == 0.6
    measured.write_text(measured.read_text() + "phi = 0.5\n")
    assert load_experiment(measured).instances()["bcm"].p.phi == 0.5


def test_a_wheel_for_which_the_soils_fit_is_not_good_is_warned_of(measured):
    warning = "{}: wheel.b_w = {} m: the soil's plate tests are good for wheels 0.04 to 0.1 m wide (widths in its file); test plates whose "

    def warnings(**more):
        return load_experiment(measured, overrides={"soil.phi": 0.6, **more}).warnings

    assert warnings() == [warning.format("own.toml", "0.125") + "radius is nearer to the wheel's width"]
    assert warnings(**{"wheel.b_w": 0.03})[0].startswith(warning.format("--set wheel.b_w", "0.03"))
    assert warnings(**{"wheel.b_w": 0.1}) == []
    assert warnings(**{"soil.k_c": 0.0}) == []  # no longer that fit
    outcome = orchestrator.simulate(measured, measured.parent / "out", overrides={"soil.phi": 0.6}, stop_time=0.0)
    assert outcome.warnings == warnings()


def test_gravity_that_is_not_that_of_the_plate_tests_is_warned_of(tmp_path):
    text = (
        "--set environment.gravity: environment.gravity = 1.62 m/s2: Bekker's k_c and k_phi of this soil are as measured at 9.81 m/s2, and "
        "soil is weaker at less gravity, which a wheel whose weight is reduced on Earth does not show (Kobayashi et al. 2010, Wong 2012); "
        "use {}scm.pressure_model=reece (k_c_1, k_phi_1), whose pressure grows with gravity, or a soil tested at that gravity, with "
        "[gravity] in its file"
    )

    def warnings(tier, gravity="Moon", soil=None, **more):
        overrides = {"tier": tier, "environment.gravity": gravity} | {key.replace("__", "."): value for key, value in more.items()}
        return load_experiment("single_wheel", soil=soil, overrides=overrides).warnings

    assert warnings("SCM") == [text.format("")]
    assert warnings("BCM") == [text.format("SCM for all wheels and ")]
    assert warnings("SCM", scm__pressure_model="reece") == []
    assert warnings("SCM", "Earth") == warnings("SCM", 9.8) == []
    assert len(warnings("SCM", 9.7)) == 1
    assert warnings("SCM", soil__k_phi=2e8) == []  # no longer the tests'
    mixed = {"environment.gravity": 1.62, "scm.pressure_model": "reece"}
    assert load_experiment("two_wheel", tiers=["SCM", "BCM"], overrides=mixed).warnings == warnings("BCM")
    source = (resources.files("cdl_fmu.soil") / "mss_d.toml").read_text(encoding="utf-8")
    (tmp_path / "moon.toml").write_text(source + '[gravity]\nvalue = 1.62\nunit = "m/s2"\nsource = "a test"\n', encoding="utf-8")
    assert warnings("BCM", soil=tmp_path / "moon.toml") == []
    assert " as measured at 1.62 m/s2, " in warnings("BCM", "Earth", soil=tmp_path / "moon.toml")[0]
    outcome = orchestrator.simulate("two_wheel", tmp_path / "out", overrides={"environment.gravity": "Moon"}, stop_time=0.0)
    assert outcome.warnings == warnings("BCM")


@pytest.mark.parametrize(("name", "gravity"), [("Moon", 1.62), ("moon", 1.62), ("MARS", 3.71), ("Earth", 9.81)])
def test_gravity_by_name(tmp_path, name, gravity):
    assert load_experiment("two_wheel", overrides={"environment.gravity": name}).instances()["rover"].p.gravity == gravity
    own = tmp_path / "own.toml"
    own.write_text(f'[environment]\ngravity = "{name}"\n[tiers]\nfront = "BCM"\nrear = "BCM"\n')
    assert load_experiment(own).instances()["bcm"].p.gravity == gravity


def test_another_name_for_gravity_is_answered_with_the_list():
    text = r"--set environment.gravity: environment.gravity = 'Venus': use Earth \(9.81\), Mars \(3.71\), Moon \(1.62\) or a number in m/s2"
    with pytest.raises(ExperimentError, match=text):
        load_experiment("two_wheel", overrides={"environment.gravity": "Venus"})
