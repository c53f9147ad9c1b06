"""Bad input as a user gives it, in experiments, from peer FMUs and by interrupts: refused with name, value, unit, place and remedy."""

import re
import signal
import subprocess
import sys
import time
from zipfile import ZipFile

import numpy as np
import pytest
import ssp_fmus
from pythonfmu import FmuBuilder
from systems import same_names

from cdl_fmu import BCM
from cdl_fmu.slave.build import cached_fmu
from mbs.rover import Rover
from orchestrator import simulate
from orchestrator.experiment import ExperimentError, load_experiment
from orchestrator.fmu import SlaveError
from orchestrator.results import open_result
from orchestrator.run import run
from orchestrator.ssp import Connection, SspError, read_system, write_system

OWN = """title = "Own"
[run]
stop_time = 0.01
[tiers]
front = "BCM"
rear = "BCM"
[soil]
set = "mss_d"
"""  # 8 lines: what a test appends begins on line 9


def refusal(source, folder=None, **more) -> str:
    """What is said about an experiment, when it is read or else when it is written to ``folder`` as a system."""
    with pytest.raises(ExperimentError) as caught:
        load_experiment(source, **more).write_system(folder / "x.ssp")
    assert folder is None or not (folder / "x.ssp").exists()
    return str(caught.value)


@pytest.fixture
def own(tmp_path):
    """What is said about an experiment in a file of one's own."""

    def said(text) -> str:
        path = tmp_path / "own.toml"
        path.write_text(text)
        return refusal(path, tmp_path)

    return said


# -- experiments


@pytest.mark.parametrize(
    "old, new, text",
    [
        ('rear = "BCM"', 'rear = "SCN"', "own.toml, line 6: tier 'SCN' of wheel rear is unknown; use one of BCM"),
        ('rear = "BCM"', 'rear = ["BCM"]', "own.toml, line 6: tier ['BCM'] of wheel rear is unknown; use one of BCM"),
        ('rear = "BCM"', "", "own.toml, line 4: wheel rear has no tier; use one of BCM"),
        ('rear = "BCM"', 'rear = "BCM"\nmiddle = "BCM"', "own.toml, line 7: tiers.middle is unknown; use one of front, rear"),
        ("0.01", '0.01\nscheme = "rk4"', "own.toml, line 4: run.scheme = 'rk4': choose one of ij, ij-free, gs-mid, gs, jacobi, aitken"),
        ("0.01", "nan", "own.toml, line 3: run.stop_time = nan s: it must be finite"),
        ("0.01", "-1", "own.toml, line 3: run.stop_time = -1 s: it must be at least 0 s"),
        ("mss_d", "mss_e", "own.toml, line 8: no soil set 'mss_e': use one of"),
    ],
)
def test_lines_of_a_file(own, old, new, text):
    assert text in own(OWN.replace(old, new))


@pytest.mark.parametrize(
    "lines, text",
    [
        # out of bounds, not finite
        ("phi = 9.0", "line 9: soil.phi = 9 rad: it must be at most 1.3 rad (Angle of internal friction)"),
        ("phi = -0.1", "line 9: soil.phi = -0.1 rad: it must be at least 0 rad"),
        ("phi = nan", "line 9: soil.phi = nan rad: it must be finite"),
        ("k_c = inf", "line 9: soil.k_c = inf N/m^(n+1): it must be finite"),
        ("[rover]\nstart.z = nan", "line 10: rover.start.z = nan m: it must be finite"),
        ("[rover]\nstart = { z = nan }", "line 10: rover.start.z = nan m: it must be finite"),
        ("[driver]\nsteer_to = [0.1, 2.0]", "line 10: driver.steer_to[2] = 2 rad: it must be at most 1.5708 rad"),
        # of another type
        ('phi = "steep"', "line 9: soil.phi = 'steep': a number in rad is needed"),
        ("phi = true", "line 9: soil.phi = True: a number in rad is needed"),
        ("phi = 2026-01-01", "line 9: soil.phi = datetime.date(2026, 1, 1): a number in rad is needed"),
        ("phi = [0.5, 0.6]", "line 9: soil.phi needs one value, not 2"),
        ("[driver]\nsteer_at = [0.9]", "line 10: driver.steer_at needs 2 values, not 1"),
        ('[bcm]\nnormal_model = "wong"', "line 10: bcm.normal_model = 'wong': choose one of bekker, wong_reece"),
        # unknown
        ("phy = 0.5", "line 9: soil.phy is unknown; did you mean phi?"),
        ("phi.value = 0.5", "line 9: soil.phi.value is unknown"),
        ("[sol]\nphi = 0.5", "line 9: sol is unknown; did you mean soil?"),
        ("[wheel]\nradius = 0.1", "line 10: wheel.radius is unknown; use one of b_w, h_g, n_g, r_w, t_g"),
        ("[rover.start]\nzz = 0.1", "line 10: rover.start.zz is unknown; did you mean start.z?"),
        # each within its bounds, but not together
        ("[wheel]\nn_g = 2.5", "line 10: wheel.n_g = 2.5: the number of grousers must be whole"),
        ("[driver]\nsteer_at = [1.2, 0.9]", "line 10: driver.steer_at[2] = 0.9 m: it must be at least steer_at[1] = 1.2 m"),
        # no TOML
        ("phi = = 3", "Invalid value (at line 9, column 7)"),
    ],
)
def test_lines_added_to_a_file(own, lines, text):
    assert f"own.toml, {text}" in own(OWN + lines) or f"own.toml: {text}" in own(OWN + lines)


def test_a_file_that_is_no_text(tmp_path):
    path = tmp_path / "own.toml"
    path.write_bytes(b"\xff\xfe\x00")
    assert "own.toml is no text in UTF-8" in refusal(path)


@pytest.mark.parametrize(
    "more, text",
    [
        ({"tiers": ["BCM", "XYZ"]}, "--tiers BCM,XYZ: tier 'XYZ' of wheel rear is unknown; use one of BCM"),
        ({"overrides": {"soil.phy": 1.0}}, "--set soil.phy: soil.phy is unknown; did you mean phi?"),
        ({"overrides": {"sol.phi": 1.0}}, "--set sol.phi: sol is unknown; did you mean soil?"),
        ({"overrides": {"wheel.r_w": -1.0}}, "--set wheel.r_w: wheel.r_w = -1 m: it must be at least 0.001 m (Wheel radius"),
        ({"overrides": {"wheel.r_w": float("nan")}}, "--set wheel.r_w: wheel.r_w = nan m: it must be finite"),
        ({"overrides": {"wheel.r_w": None}}, "--set wheel.r_w: wheel.r_w = None: a number in m is needed"),
        ({"overrides": {"driver.steer_to": (0.1, 0.2, 0.3)}}, "--set driver.steer_to: driver.steer_to needs 2 values, not 3"),
        ({"overrides": {"rover.wheel_inertia_axle": 1.0}}, "rover.wheel_inertia_axle = 1 kg.m2: it must be at most twice"),
    ],
)
def test_options(tmp_path, more, text):
    assert text in refusal("two_wheel", tmp_path, **more)


def test_a_soil_that_bears_nothing_under_a_narrow_wheel(tmp_path):
    text = "soil.k_c = -2.86e+06 N/m^3.49: k_c/b + k_phi < 0 for wheel width b = 0.01 m; use a wheel wider than 0.0116 m or another soil"
    assert text in refusal("two_wheel", tmp_path, overrides={"wheel.b_w": 0.01})
    assert text in refusal("two_wheel", tmp_path, overrides={"wheel.b_w": 0.01, "rover.start.z": 0.1})


@pytest.mark.parametrize(
    "start, text",
    [
        ({"z": -0.01}, "rover.start.z = -0.01 m puts the axle of wheel front 0.01 m below the surface: use a start.z between 0 and 0.25 m"),
        ({"z": 0.26}, "rover.start.z = 0.26 m puts the axle of wheel front 0.26 m above the surface, its rim more than the wheel's radius"),
        ({"z": 0.1, "pitch": 0.4}, "rover.start.z = 0.1 m puts the axle of wheel front 0.01683 m below the surface"),
        ({"z": 0.2, "pitch": 0.4}, "rover.start.z = 0.2 m puts the axle of wheel rear 0.3168 m above the surface"),
    ],
)
def test_a_start_pose_in_the_ground_or_the_air(tmp_path, start, text):
    said = refusal("two_wheel", tmp_path, overrides={f"rover.start.{key}": value for key, value in start.items()})
    assert text in said and "or leave it out to start on the ground" in said


def test_a_start_pose_counts_from_the_ground(tmp_path):
    said = refusal("two_wheel", tmp_path, overrides={"bcm.ground_z": 1.0, "rover.start.z": 0.1})
    assert "0.9 m below the surface: use a start.z between 1 and 1.25 m" in said


def test_a_rover_that_the_soil_does_not_bear(tmp_path):
    said = refusal("two_wheel", tmp_path, overrides={"rover.mass": 1e5})
    assert re.search(r"rover is not borne at rest: bcm: wheel \d is buried.*; check mass, wheel, soil, gravity and slope", said)


# -- peers


@pytest.fixture(scope="module")
def peer(tmp_path_factory):
    """Build a peer FMU that gives 1, and from 4.5 ms on a bad value."""
    folder = tmp_path_factory.mktemp("peers")

    def build(name, value):
        script = folder / f"cdltestpeer{name}.py"
        step = f"float('{value}') if t > 0.0045 else 1.0"
        script.write_text(ssp_fmus._SLAVE.format(name=f"CdlTestPeer{name}", k=1.0, step=step))
        return FmuBuilder.build_FMU(script, dest=folder, needsExecutionTool="false")

    return {name: build(name, value) for name, value in (("nan", "nan"), ("fast", "1e9"))}


def with_peer(folder, fmu, *inputs):
    """The rover on BCM, and the peer connected to the given inputs."""
    rover, bcm = Rover(), BCM(2)
    connections = same_names("rover", rover, "bcm", bcm) + same_names("bcm", bcm, "rover", rover)
    connections += [Connection("peer", "port.y[1]", *target.split(".", 1)) for target in inputs]
    fmus = {"rover": cached_fmu(rover), "bcm": cached_fmu(bcm), "peer": fmu}
    write_system(folder / "x.ssp", "x", fmus, connections, parameters={"rover": {"start.z": 0.1}}, stop_time=0.02, step_size=1e-3)
    return read_system(folder / "x.ssp", folder / "unpacked")


RATES = ("rover.command.wheel_rate[1]", "rover.command.wheel_rate[2]")
WEIGHTS = ("bcm.wheel[1].active", "bcm.wheel[2].active")


@pytest.mark.parametrize(
    "name, inputs, scheme, text",
    [
        ("nan", RATES, "ij", "rover did not do the step ... input command.wheel_rate[1] = nan rad/s: it must be finite"),
        ("nan", WEIGHTS, "ij", "bcm did not do the step ... input wheel[1].active = nan: it must be finite"),
        ("nan", RATES, "jacobi", "output peer.port.y[1] is not finite after the step at t = 0.005 s; correct the FMU that gives it"),
        ("fast", RATES, "ij", "input command.wheel_rate[1] = 1e+09 rad/s: it must be at most"),
        ("fast", WEIGHTS, "jacobi", "bcm did not do the step ... input wheel[1].active = 1e+09: it must be at most 1"),
    ],
)
def test_a_bad_value_from_a_peer_ends_the_run_with_its_sender_and_keeps_the_rows(tmp_path, peer, name, inputs, scheme, text):
    with pytest.raises(SlaveError) as caught:
        run(with_peer(tmp_path, peer[name], *inputs), tmp_path, scheme=scheme)
    said = str(caught.value)
    assert all(part in said for part in text.split(" ... ")), said
    assert re.search(r"at t = 0\.00[56] s", said) and "peer.port.y[1]" in said
    assert f"the steps before it are in {tmp_path / 'result.nc'}" in said
    result = open_result(tmp_path)
    assert result.attrs["status"].startswith("failed: ")
    assert 0.005 <= result.time.values[-1] <= 0.0061 and np.isfinite(result.sel(channel="rover.wheel[1].r_0[3]").series.values).all()


def test_a_foreign_package_that_would_write_elsewhere(tmp_path):
    """As `cdl run` and simulate() meet it; what else is refused of archives is in test_ssp_archive.py."""
    evil = ssp_fmus.write_fmu(tmp_path / "evil.fmu", ssp_fmus.PLANT)
    with ZipFile(evil, "a") as archive:
        archive.writestr("../../outside", "x")
    package = ssp_fmus.write_ssp(tmp_path / "x.ssp", ssp_fmus.one(), {"plant": evil})
    with pytest.raises(SspError, match=r"plant\.fmu: entry '\.\./\.\./outside' points outside the package"):
        simulate(package, tmp_path / "out")
    assert not list(tmp_path.rglob("outside"))


# -- interrupts


def test_ctrl_c_at_the_shell_leaves_a_readable_result(tmp_path):
    command = [
        sys.executable,
        "-c",
        "from orchestrator.cli import app; app()",
        "run",
        "two_wheel",
        "--stop-time",
        "1000",
        "--out",
        tmp_path,
    ]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        deadline = time.monotonic() + 120.0
        while not any(tmp_path.glob("result.nc*")) and process.poll() is None and time.monotonic() < deadline:
            time.sleep(0.02)
        time.sleep(0.5)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 130, said
    reached = float(re.search(rf"interrupted at t = (\S+) s; all steps so far are in {tmp_path / 'result.nc'}", said)[1])
    assert "Traceback" not in said
    result = open_result(tmp_path)
    assert result.attrs["status"] == "interrupted"
    assert result.time.values[-1] == pytest.approx(reached) and 0.0 < reached < 1000.0
    assert len(result.time) == round(reached / 1e-3) + 1 and np.isfinite(result.series.values).all()


def test_an_interrupt_while_the_fmus_are_loaded_is_no_failure_of_theirs(tmp_path, monkeypatch):
    script = tmp_path / "cdltestloading.py"
    source = ssp_fmus._SLAVE.format(name="CdlTestLoading", k=1.0, step="1.0")
    interrupt = "import os, signal; 'CDL_TEST' in os.environ and os.kill(os.getpid(), signal.SIGINT)"
    script.write_text(source.replace("self.u = 0.0\n", f"self.u = 0.0\n        {interrupt}\n", 1))
    fmu = FmuBuilder.build_FMU(script, dest=tmp_path, needsExecutionTool="false")
    loop = [Connection("a", "port.y[1]", "a", "port.u[1]")]
    write_system(tmp_path / "x.ssp", "x", {"a": fmu}, loop, stop_time=1.0, step_size=1e-3)
    system = read_system(tmp_path / "x.ssp", tmp_path / "unpacked")
    monkeypatch.setenv("CDL_TEST", "1")
    outcome = run(system, tmp_path)
    assert (outcome.status, outcome.simulated_s) == ("interrupted", 0.0)
    assert open_result(tmp_path).time.values.tolist() == [0.0]
