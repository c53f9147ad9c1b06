"""The exported package and its FMUs in tools of others, as they are: FMPy, libcosim, Ecos."""

import json
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from zipfile import ZipFile

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu

from orchestrator.experiment import load_experiment
from orchestrator.fmu import Slave
from orchestrator.results import open_result
from orchestrator.run import run
from orchestrator.ssp import read_system

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
import client as in_client
import clients

HIGHER = 0.0990 + 0.005  # [m] start height of the axles, 5 mm above their height at rest


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """Export the shipped experiment on these tiers with changed values, once for each set of them."""
    folder, packages = tmp_path_factory.mktemp("exported"), {}

    def export(*tiers, **overrides):
        key = json.dumps([tiers, overrides])
        if key not in packages:
            packages[key] = folder / f"{len(packages)}.ssp"
            values = {k.replace("__", "."): v for k, v in overrides.items()}
            load_experiment("two_wheel", tiers=tiers or None, overrides=values).write_system(packages[key])
        return packages[key]

    return export


@pytest.fixture
def client(tmp_path):
    """Run a package in a foreign master, in a process of its own, and return the final outputs."""

    def simulate(name, ssp, stop_time):
        require(name)
        out = tmp_path / "final.json"
        command = [sys.executable, in_client.__file__, name, ssp, str(stop_time), out]
        done = subprocess.run(command, capture_output=True, text=True, timeout=300, cwd=tmp_path)
        assert done.returncode == 0, f"{name} ended with {done.returncode}:\n{done.stdout}{done.stderr}"
        return {signal: values[-1] for signal, values in json.loads(out.read_text())["values"].items()}

    return simulate


def require(name):
    distribution = in_client.CLIENTS[name][1]
    if find_spec(distribution) is None:
        pytest.skip(f"{distribution} is not installed; it has wheels for some platforms only: pip install {distribution}")


def own(ssp, folder, stop_time, scheme):
    outcome = run(read_system(ssp, folder / "unpacked"), folder / "own", scheme=scheme, stop_time=stop_time)
    assert not outcome.warnings
    last = open_result(outcome.result).series.isel(time=-1)
    return {str(name): float(value) for name, value in zip(last.channel.values, last.values)}


def of_wheels(values, name):
    return np.array([values[name.format(i=i)] for i in (1, 2)])


@pytest.mark.parametrize("name", in_client.CLIENTS)
def test_a_rover_put_down_5_mm_too_high_comes_to_the_same_rest(name, exported, client, tmp_path):
    ssp = exported(driver__wheel_rate=0.0, rover__start__z=HIGHER)
    ours, theirs = own(ssp, tmp_path, 0.4, "ij"), client(name, ssp, 0.4)
    assert of_wheels(ours, "bcm.wheel[{i}].f_0[3]") == pytest.approx(clients.LOAD, rel=0.01)
    sinkage = of_wheels(ours, "bcm.diagnostics[{i}].sinkage")
    assert (sinkage > 0.02).all()
    assert of_wheels(theirs, "bcm.diagnostics[{i}].sinkage") == pytest.approx(sinkage, rel=0.01)


@pytest.mark.parametrize("tiers", [("SCM", "BCM"), ("BCM", "SCM")], ids="-".join)
@pytest.mark.parametrize("name", in_client.CLIENTS)
def test_deforming_soil_below_one_wheel_bears_it_at_the_same_rest_and_has_no_crater_elsewhere(name, tiers, exported, client, tmp_path):
    """FMPy sends zeros before its first step: neither must SCM press the soil at the origin then, nor BCM take that for its ground."""
    ssp = exported(*tiers, driver__wheel_rate=0.0, rover__start__z=HIGHER)
    ours, theirs = own(ssp, tmp_path, 0.4, "ij"), client(name, ssp, 0.4)
    for tier in ("scm", "bcm"):
        sinkage = ours[f"{tier}.diagnostics[1].sinkage"]
        assert sinkage > 0.02
        assert theirs[f"{tier}.diagnostics[1].sinkage"] == pytest.approx(sinkage, rel=0.01)
    patch = {v for n, v in theirs.items() if n.startswith("scm.patch[1].z[")}
    assert theirs["scm.patch[1].spacing"] == 0.03 and patch == {0.0}  # around the other wheel, 0.6 m away


# libcosim and Ecos exchange as our Jacobi scheme does, from the first step on; FMPy puts zeros on all inputs of its first step, so that the
# rover falls for 2 ms before its wheels bear: its twin among our runs begins like that.
@pytest.mark.parametrize("tiers, stop_time", [((), 0.5), (("SCM", "BCM"), 0.1)], ids=["BCM-BCM", "SCM-BCM"])
@pytest.mark.parametrize("name", in_client.CLIENTS)
def test_a_drive_is_the_same_as_under_our_jacobi_scheme(name, tiers, stop_time, exported, tmp_path):
    require(name)
    ssp, steps = exported(*tiers), round(stop_time * 1e3)
    system = read_system(ssp, tmp_path / "unpacked")
    forces, positions = clients.signals_of(system)
    ours = clients.ours(system, "jacobi", forces + positions, steps, 10, begin_with_zeros=name == "fmpy")
    theirs = clients.theirs(name, [sys.executable], ssp, forces + positions, steps, 10)
    assert ours.values[-1, 6] - ours.values[0, 6] > 1e-3  # it drives
    assert ours.values[-1, [2, 5]] == pytest.approx(clients.LOAD, rel=0.1)
    assert theirs.values.shape == ours.values.shape == (steps // 10, 12)
    assert max(clients.deviation(theirs, ours, len(forces))) < 1e-6


@pytest.mark.parametrize("name", in_client.CLIENTS)
def test_a_testbed_measures_what_it_does_under_our_jacobi_scheme(name, client, tmp_path):
    short = {"carriage.lowering_time": 0.2, "carriage.start_ramp": 0.1, "run.step": 1e-3, "scm.cell": 0.01, "slip_angle": 0.3}
    load_experiment("single_wheel", overrides=short).write_system(tmp_path / "x.ssp")
    ours, theirs = own(tmp_path / "x.ssp", tmp_path, 0.6, "jacobi"), client(name, tmp_path / "x.ssp", 0.6)
    assert ours["carriage.travel"] == pytest.approx(0.05 * 0.35) == theirs["carriage.travel"]
    for quantity, least in (("drawbar_pull", 1.0), ("lateral_force", -1.0), ("normal_load", 90.0), ("drive_torque", 0.5)):
        channel = f"scm.diagnostics[1].{quantity}"
        assert abs(ours[channel]) > abs(least) and np.sign(ours[channel]) == np.sign(least)
        assert theirs[channel] == pytest.approx(ours[channel], abs=0.5)
    assert theirs["scm.diagnostics[1].sinkage"] == pytest.approx(ours["scm.diagnostics[1].sinkage"], rel=0.01)


@pytest.fixture(scope="module")
def fmus(exported, tmp_path_factory):
    """Component -> FMU file of the exported package."""
    folder = tmp_path_factory.mktemp("fmus")
    ZipFile(exported()).extractall(folder)
    return {name: folder / "resources" / f"cdl_{name}_w2.fmu" for name in ("bcm", "rover", "driver")}


def test_each_fmu_of_the_package_is_valid_and_runs_alone_in_fmpy(fmus):
    last = {}
    for name, path in fmus.items():
        assert validate_fmu(str(path)) == []
        rows = fmpy.simulate_fmu(str(path), stop_time=0.01, step_size=1e-3)
        assert len(rows) == 11, f"{name} stopped early"
        last[name] = {column: rows[column][-1] for column in rows.dtype.names}
    # The package's start values are the FMUs' own: wheels at rest on the ground, a rover that this bears, a driver that starts.
    assert last["bcm"]["wheel[2].f_0[3]"] == pytest.approx(clients.LOAD, rel=1e-6)
    assert last["rover"]["wheel[1].r_0[3]"] == pytest.approx(0.0990, abs=1e-4)
    assert last["driver"]["command.wheel_rate[1]"] > 0.0


def test_zeros_on_all_inputs_of_the_first_step_mean_no_data_yet(fmus, tmp_path):
    warnings = []

    def first_step(name):
        """The outputs after a step as FMPy's simulate_ssp begins, whatever the start values are."""
        description = fmpy.read_model_description(str(fmus[name]))
        slave = Slave(name, description, fmpy.extract(str(fmus[name]), str(tmp_path / name)), warnings.append)
        names = {c: [v.name for v in description.modelVariables if v.causality == c] for c in ("input", "output")}
        inputs = [n for n in names["input"] if not n.endswith(".active")]  # FMPy sets what has a connector
        slave.connect(inputs, np.zeros(len(inputs)), names["output"], np.zeros(len(names["output"])))
        slave.initialise(0.0, None, {})
        slave.set(0.0)
        slave.step(0.0, 1e-3)
        slave.get(1e-3)
        slave.close()
        return dict(zip(names["output"], slave.y))

    bcm, rover = first_step("bcm"), first_step("rover")
    acts = ("wheel[", "contact[1].F", "contact[1].in_contact", "diagnostics[1].sinkage")
    assert not any(value for name, value in bcm.items() if name.startswith(acts))
    assert rover["wheel[1].v_0[3]"] == pytest.approx(-9.81e-3)
    assert [w for w in warnings if "has no pose yet" in w] == warnings and warnings
