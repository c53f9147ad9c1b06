"""The command line as a user meets it: what is printed where, what is written, which exit code."""

import io
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
import zipfile
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
import ssp_fmus
import trimesh
from fmpy.util import read_csv
from rich.console import Console
from scipy.io import loadmat
from typer.testing import CliRunner

from fmus import SHIPPED
from orchestrator import checkout, cli, drive, terminal
from orchestrator.info import fold
from orchestrator.results import Channel, ResultWriter, open_result
from orchestrator.schemes import SCHEMES
from orchestrator.ssp import Connection, read_system, write_system


def cdl(*arguments):
    """Run a command; a bug's exception comes through."""
    done = CliRunner().invoke(cli.app, [str(a) for a in arguments], env={"COLUMNS": "200"})
    if done.exception and not isinstance(done.exception, SystemExit):
        raise done.exception
    return done


def refusal(*arguments) -> str:
    """What a command that must be refused says on stderr, borders and line breaks taken out."""
    done = cdl(*arguments)
    assert done.exit_code == 2
    return " ".join(re.sub("[│╭╮╰╯─]", " ", done.stderr).split())


@pytest.fixture(scope="module")
def drive_folder(tmp_path_factory):
    """Folder of a short drive with a checkpoint, and what the command printed."""
    out = tmp_path_factory.mktemp("cli") / "drive"
    return out, cdl("run", "two_wheel", "--stop-time", 0.05, "--checkpoint-every", 0.02, "--out", out)


@pytest.fixture
def folder(drive_folder):
    return drive_folder[0]


@pytest.fixture(scope="module")
def foreign(tmp_path_factory):
    """Runnable FMUs of no model of ours, and a package of them."""
    home = tmp_path_factory.mktemp("foreign")
    fmus = ssp_fmus.build_slaves(home)
    connections = [Connection("i", "port.y[1]", "g", "port.u[1]"), Connection("g", "port.y[1]", "i", "port.u[1]")]
    package = home / "loop.ssp"
    write_system(package, "loop", {"g": fmus["gain"], "i": fmus["integrator"]}, connections, stop_time=0.1, step_size=0.01)
    return fmus, package


def write_result(path, values, name="a.f[1]"):
    with ResultWriter(path, [Channel(name, "N", "Force")], {"scheme": "ij", "step_s": 0.1, "wheels": []}) as writer:
        for k, value in enumerate(values):
            writer.append(0.1 * k, np.array([value]))
    return path


# -- help


def test_help_shows_every_command_with_an_example():
    text = cdl("--help").stdout
    for name in ("run", "build", "info", "plot", "export", "diff", "identify", "validate", "doctor"):
        assert re.search(rf"^ cdl {name}\b", text, re.MULTILINE)
        assert f"cdl {name}" in cdl(name, "--help").stdout
    assert "Usage" in cdl().stdout


def test_examples_of_the_help_are_commands_that_parse():
    for example in cli._EXAMPLES.values():
        assert cdl(*example.split()[1:], "--help").exit_code == 0


def test_help_is_quick_for_it_imports_nothing_heavy():
    code = (
        "import sys; from orchestrator.cli import app\n"
        "try: app(['--help'])\n"
        "except SystemExit: print(sorted({'numpy', 'numba', 'matplotlib', 'xarray', 'fmpy', 'mujoco'} & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.splitlines()[-1] == "[]"


def test_version_and_schemes_are_those_of_the_library():
    assert re.fullmatch(r"cdl-fmu \d+\.\d+\.\d+\S*\n", cdl("--version").stdout)
    assert get_args(cli.Scheme) == tuple(SCHEMES)


# -- run


def test_run_leaves_a_folder_and_a_summary(drive_folder):
    out, done = drive_folder
    assert done.exit_code == 0
    assert {"system.ssp", "result.nc", "result.png", "checkpoint_0.020s.npz"} <= {p.name for p in out.iterdir()}
    assert "simulated 0.05 s in" in done.stdout and "scheme ij, step 1 ms" in done.stdout
    for wheel in ("front", "rear"):
        assert re.search(rf"{wheel} +BCM +\d+\.\d\d ", done.stdout)
    assert "means over the last 0.05 s" in done.stdout
    assert str(out / "result.nc") in done.stdout.splitlines()
    assert "loading models" in done.stderr  # progress keeps out of what a script reads


def test_json_is_one_object_and_nothing_else(tmp_path):
    done = cdl("run", "two_wheel", "--stop-time", 0.01, "--step", 5e-4, "--scheme", "jacobi", "--json", "--out", tmp_path)
    assert done.stderr == ""
    facts = json.loads(done.stdout)
    assert set(facts) == {"simulated_s", "wall_s", "scheme", "step_s", "result", "wheels"}
    assert (facts["simulated_s"], facts["scheme"], facts["step_s"]) == (0.01, "jacobi", 5e-4)
    assert open_result(facts["result"]).time[-1] == pytest.approx(0.01)
    assert [w["name"] for w in facts["wheels"]] == ["front", "rear"]
    assert set(facts["wheels"][0]) == {"name", "tier", "sinkage_m", "z_m", "f_long_N", "f_lat_N", "f_n_N", "slip", "slip_angle_rad"}


def test_settings_are_toml_values_or_words(tmp_path):
    settings = ["soil.phi=0.6", "rover.mass=6e1", "bcm.normal_model=wong_reece"]
    done = cdl("run", "two_wheel", "--stop-time", 0, "--json", "--out", tmp_path, *(x for s in settings for x in ("--set", s)))
    assert done.exit_code == 0
    expected = {"soil.phi": 0.6, "rover.mass": 60.0, "bcm.normal_model": "wong_reece"}
    assert json.loads(open_result(tmp_path).attrs["overrides"]) == expected


def test_a_resumed_run_completes_the_folder_of_its_checkpoint_with_the_same_bits(tmp_path, folder):
    copy = shutil.copytree(folder, tmp_path / "copy")
    done = cdl("run", copy / "system.ssp", "--resume", copy / "checkpoint_0.020s.npz", "--stop-time", 0.05)
    assert "resumed, up to 0.05 s" in done.stdout and str(copy / "result.nc") in done.stdout
    assert cdl("diff", copy, folder, "--rtol", 0).exit_code == 0


def test_a_foreign_system_runs_without_wheels(tmp_path, foreign):
    done = cdl("run", foreign[1], "--json", "--out", tmp_path)
    facts = json.loads(done.stdout)
    assert (facts["simulated_s"], facts["step_s"], facts["wheels"]) == (0.1, 0.01, [])
    assert "no picture" in done.stderr
    assert "simulated 0.1 s" in cdl("run", foreign[1], "--out", tmp_path).stdout


def test_sigint_leaves_a_readable_result(tmp_path):
    def interrupt():
        while not (tmp_path / "result.nc").exists():
            time.sleep(0.01)
        time.sleep(0.2)
        os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=interrupt).start()
    done = cdl("run", "two_wheel", "--json", "--out", tmp_path)
    assert done.exit_code == 130
    reached = json.loads(done.stdout)["simulated_s"]
    assert f"interrupted at t = {reached:g} s; all steps so far are in {tmp_path / 'result.nc'}" in done.stderr
    result = open_result(tmp_path)
    assert result.attrs["status"] == "interrupted"
    assert result.time[-1] == pytest.approx(reached) and 0 < reached < 17


def test_ctrl_c_before_the_first_step_is_no_traceback(monkeypatch):
    def loading(*args, **kwargs):
        raise KeyboardInterrupt

    monkeypatch.setattr(drive, "simulate", loading)
    done = cdl("run", "two_wheel")
    assert (done.exit_code, done.stderr) == (130, "interrupted\n")


# -- refusals


@pytest.mark.parametrize(
    "arguments, text",
    [
        (["nowhere"], "error: no experiment 'nowhere': use one of rocks_in_sand, single_wheel, two_wheel or the path of a .toml file"),
        (["nowhere.ssp"], "error: nowhere.ssp: no such file; give the path of an existing package"),
        (["two_wheel", "--tiers", "BCM"], "error: --tiers BCM: give 2 tiers, FRONT,REAR"),
        (["two_wheel", "--tiers", "BCM,XYZ"], "tier 'XYZ' of wheel rear is unknown; use one of BCM"),
        (["two_wheel", "--set", "soil.phi"], "'soil.phi': write KEY=VALUE, e.g. soil.phi=0.6"),
        (["two_wheel", "--set", "soil.phi=nan"], "--set soil.phi: soil.phi = nan rad: it must be finite"),
        (["two_wheel", "--set", "soil.phi=9"], "soil.phi = 9 rad: it must be at most 1.3 rad"),
        (["two_wheel", "--set", "soil.phi=steep"], "soil.phi = 'steep': a number in rad is needed"),
        (["two_wheel", "--set", "soil=3"], "--set soil: soil = 3 is in no section"),
        (["two_wheel", "--set", "title.x=3"], "--set title.x: title is a value, not a section"),
        (["two_wheel", "--scheme", "rk4"], "'rk4' is not one of 'ij', 'ij-free', 'gs-mid', 'gs', 'jacobi', 'aitken'"),
        (["two_wheel", "--step", 0], "error: step = 0 s: it must be positive"),
        (["two_wheel", "--stop-time", "nan"], "error: stop time nan s: it must be finite and at least 0 s"),
        (["two_wheel", "--stop-time", 0.0105], "stop time 0.0105 s is no multiple of the step 0.001 s; the nearest are 0.01 s and 0.011 s"),
        (["two_wheel", "--checkpoint-every", 0], "checkpoint interval 0 s: it must be finite and at least 0.001 s"),
        (["two_wheel", "--resume", "nowhere.npz"], "error: checkpoint nowhere.npz does not exist"),
    ],
)
def test_run_refuses_without_a_traceback(tmp_path, arguments, text):
    assert text in refusal("run", *arguments, "--out", tmp_path)


def test_checkpoints_that_do_not_fit_are_refused(tmp_path, folder):
    checkpoint = folder / "checkpoint_0.020s.npz"
    resume = ["run", "two_wheel", "--out", tmp_path, "--resume"]
    assert "was written by another run" in refusal(*resume, checkpoint, "--scheme", "gs")
    assert "lies at t = 0.02 s, after the stop time 0.01 s; give a later one" in refusal(*resume, checkpoint, "--stop-time", 0.01)
    (tmp_path / "half.npz").write_bytes(checkpoint.read_bytes()[:1000])
    assert "half.npz is no checkpoint, or a damaged one" in refusal(*resume, tmp_path / "half.npz")
    (tmp_path / "alone.npz").write_bytes(checkpoint.read_bytes())
    assert "a checkpoint is resumed together with the result file beside it" in refusal(*resume, tmp_path / "alone.npz")


def test_a_refused_run_leaves_the_folder_as_it_is(tmp_path, folder):
    shutil.copytree(folder, copy := tmp_path / "copy")
    refusal("run", "two_wheel", "--resume", copy / "checkpoint_0.020s.npz", "--set", "soil.phi=0.3")
    for file in folder.iterdir():
        assert (copy / file.name).read_bytes() == file.read_bytes()


def test_a_failed_run_says_what_it_leaves_and_what_it_had_warned_of(tmp_path):
    text = refusal("run", "two_wheel", "--scheme", "gs", "--set", "bcm.c_d=1000", "--stop-time", 0.1, "--out", tmp_path)
    assert text.index("error: rover did not do the step") < text.index(f"the steps before it are in {tmp_path / 'result.nc'}")
    assert "warned before: rover.wheel[1]: friction and damping need a step below" in text
    assert open_result(tmp_path).attrs["status"].startswith("failed: rover did not do the step")


def test_bugs_keep_their_traceback(monkeypatch):
    def bug(*args, **kwargs):
        raise KeyError("a bug")

    monkeypatch.setattr(drive, "simulate", bug)
    with pytest.raises(KeyError, match="a bug"):
        cdl("run", "two_wheel")


def test_other_platforms_get_a_clear_message(monkeypatch):
    monkeypatch.setattr(sys, "platform", "darwin")
    for command in (["run", "two_wheel"], ["build"]):
        assert "FMUs run on Linux and Windows, not on darwin: use one of them or a container" in refusal(*command)


# -- build, info


def test_build_makes_every_shipped_fmu(tmp_path):
    done = cdl("build", "--out", tmp_path / "new")
    assert {p.name for p in (tmp_path / "new").iterdir()} == {f"{m.identifier}.fmu" for m in SHIPPED}
    assert all(f"{m.identifier}.fmu" in done.stdout for m in SHIPPED)
    assert f"written to {tmp_path / 'new'}" in done.stdout


def test_build_makes_an_fmu_in_any_sizes_with_files_in_it(tmp_path):
    rock = tmp_path / "rock.stl"
    trimesh.creation.icosphere(subdivisions=2, radius=0.05).export(rock)
    cdl("build", "cdl_scm_w1b1", "--file", f"body[1].mesh={rock}", "--out", tmp_path)
    assert "resources/rock.stl" in zipfile.ZipFile(tmp_path / "cdl_scm_w1b1.fmu").namelist()
    assert "body[1].r_0[1..3]" in cdl("info", tmp_path / "cdl_scm_w1b1.fmu").stdout


def test_build_refuses_what_there_is_not(tmp_path):
    assert "there is no FMU 'cdl_scm_w0'; shipped are cdl_bcm_w1, " in refusal("build", "cdl_scm_w0")
    assert "there is no FMU 'cdl_bcm_w3p1': n_patches = 1: choose 0 (flat ground) or 3" in refusal("build", "cdl_bcm_w3p1")
    assert "'rock.stl': write KEY=VALUE, e.g. body[1].mesh=rock.stl" in refusal("build", "cdl_scm_w1b1", "--file", "rock.stl")
    assert "body[1].mesh = 'no.stl': no such file" in refusal("build", "cdl_scm_w1b1", "--file", "body[1].mesh=no.stl", "--out", tmp_path)
    rock = tmp_path / "rock.stl"
    trimesh.creation.icosphere(subdivisions=2, radius=50.0).export(rock)
    text = refusal("build", "cdl_scm_w1b1", "--file", f"body[1].mesh={rock}", "--out", tmp_path)
    assert "body[1].mesh = rock.stl is 100 m across: the file is most likely in millimetres; scale it by 0.001" in text


def test_what_belongs_to_a_checkout_goes_into_one_only(tmp_path, monkeypatch):
    assert checkout.home() == Path(checkout.__file__).parents[1]
    monkeypatch.setattr(checkout, "__file__", str(tmp_path / "site-packages" / "orchestrator" / "checkout.py"))
    assert checkout.home() == Path()


def test_info_names_everything_of_a_shipped_fmu():
    text = cdl("info", "cdl_bcm_w2").stdout
    assert text.startswith("cdl_bcm_w2 ") and "guid {" in text and "binaries: linux64, win64" in text
    assert re.search(r"r_w +0.125 +m +0.001 \.\. 10 +Wheel radius without grousers", text)
    assert re.search(r"normal_model +1 .*: 1 bekker, 2 wong_reece", text)
    assert "38 inputs" in text
    assert re.search(r"wheel\[1\.\.2\]\.r_0\[1\.\.3\] +0 +m ", text)
    assert re.search(r"wheel\[1\.\.2\]\.T\[1\.\.3,1\.\.3\] +1, 0, 0, 0, 1, 0, 0, 0, 1, \.\.\. +1 ", text)


def test_info_of_foreign_fmus(tmp_path, foreign):
    text = cdl("info", foreign[0]["gain"]).stdout
    assert "1 parameter\n" in re.sub(" +\n", "\n", text) and "port.u[1]" in text
    plant = cdl("info", ssp_fmus.write_fmu(tmp_path / "plant.fmu", ssp_fmus.PLANT)).stdout
    assert "binaries: none" in plant
    assert re.search(r"mode +1 +1 slow, 2 fast", plant) and re.search(r"on +true", plant) and re.search(r"v\[1\.\.3\] +0 +m", plant)
    exchange = ssp_fmus.write_fmu(tmp_path / "me.fmu", ssp_fmus.describe(kind="ModelExchange"))
    assert "model exchange is not supported" in refusal("info", exchange)


def test_info_of_a_result_lists_its_channels(folder):
    text = cdl("info", folder).stdout
    assert "complete, 0 to 0.05 s in 51 rows; scheme ij, step 0.001 s" in text
    assert "wheel front: BCM, bcm.diagnostics[1], rover.wheel[1]" in text
    assert re.search(r"bcm\.diagnostics\[1\.\.2\]\.sinkage +m +Sinkage", text)


def test_info_of_nothing():
    assert "no FMU or result 'wheel': give a path, or a name: there is no FMU 'wheel'; shipped are cdl_bcm_w1, " in refusal("info", "wheel")


def test_fold_joins_whole_blocks_alone():
    names = ["v", "a[1].x", "a[2].x", "m[1,1]", "m[1,2]", "m[2,1]", "m[2,2]", "h[1]", "h[3]"]
    facts = dict.fromkeys(names, "m")
    assert [name for name, _ in fold(facts)] == ["v", "a[1..2].x", "m[1..2,1..2]", "h[1]", "h[3]"]
    assert [name for name, _ in fold(facts | {"a[2].x": "N"})][1:3] == ["a[1].x", "a[2].x"]


# -- plot, export, diff


def test_plot_is_put_beside_the_result_or_where_asked(tmp_path, folder):
    assert cdl("plot", folder).stdout == f"{folder / 'result.png'}\n"
    assert cdl("plot", folder / "result.nc", "-o", tmp_path / "new" / "a.pdf").exit_code == 0
    assert (tmp_path / "new" / "a.pdf").read_bytes().startswith(b"%PDF")
    assert "choose a name that ends in .png, .pdf or .svg" in refusal("plot", folder, "-o", tmp_path / "a.xyz")
    assert "`cdl run` writes one" in refusal("plot", tmp_path / "none.nc")


def test_export_of_an_experiment_is_a_package(tmp_path):
    done = cdl("export", "two_wheel", "--set", "soil.phi=0.6", "-o", tmp_path / "x.ssp")
    assert done.stdout == f"{tmp_path / 'x.ssp'}\n"
    assert read_system(tmp_path / "x.ssp", tmp_path / "cache").components["bcm"].parameters["phi"] == 0.6


def test_export_of_an_experiment_for_hosts_that_read_no_package(tmp_path):
    assert cdl("export", "two_wheel", "--unpacked", tmp_path / "x").stdout == f"{tmp_path / 'x'}\n"
    assert sorted(path.name for path in (tmp_path / "x").iterdir()) == ["bcm", "driver", "rover", "system.txt"]
    assert (tmp_path / "x" / "bcm" / "modelDescription.xml").is_file()
    assert "holds something already" in refusal("export", "two_wheel", "--unpacked", tmp_path / "x")


def test_export_of_a_result_for_other_tools(tmp_path, folder):
    assert cdl("export", folder, "--csv").stdout == f"{folder / 'result.csv'}\n"
    assert read_csv(folder / "result.csv")["time"][-1] == pytest.approx(0.05)
    cdl("export", folder / "result.nc", "--mat", "-o", tmp_path / "x.mat")
    assert loadmat(tmp_path / "x.mat")["data_2"].shape[1] == 51
    assert "is a result: add --csv or --mat" in refusal("export", folder)
    assert "choose one of them" in refusal("export", folder, "--csv", "--mat")
    assert "choose one of them" in refusal("export", folder, "--csv", "--unpacked", tmp_path / "x")


def test_diff_names_the_first_signal_and_time_that_differ(tmp_path):
    baseline = write_result(tmp_path / "a.nc", [1.0, 2.0, 4.0])
    other = write_result(tmp_path / "b.nc", [1.0, 2.1, 4.0])
    assert cdl("diff", other, baseline, "--rtol", 0.1).exit_code == 0
    done = cdl("diff", other, baseline, "--rtol", 1e-3)
    assert done.exit_code == 1 and done.stdout.startswith("a.f[1] at t = 0.1 s: 2.1")
    assert cdl("diff", other, baseline, "--rtol", 1e-3, "--atol", 0.2).exit_code == 0
    assert "Missing option '--rtol'" in refusal("diff", other, baseline)


# -- progress


def test_progress_on_a_terminal_is_a_spinner_and_a_bar():
    shown = io.StringIO()
    with terminal._bar(Console(file=shown, force_terminal=True, width=100)) as display:
        display.status("loading models")
        time.sleep(0.2)
        for t in (1.0, 2.0, 3.0):
            display.progress(t, 4.0)
            time.sleep(0.02)
    assert "loading models" in shown.getvalue()
    assert "3.00 of 4 s" in shown.getvalue() and "x real time" in shown.getvalue()


def test_progress_elsewhere_is_a_line_now_and_then(monkeypatch, capsys):
    now = 100.0
    monkeypatch.setattr(terminal.time, "perf_counter", lambda: now)
    display = terminal._lines()
    for t in range(9):
        display.progress(1.0 + 10.0 * t, 101.0)  # simulated 10 s a second
        now += 1.0
    assert capsys.readouterr().err == "61.00 of 101 s, 10.0 x real time, 4 s left\n"
