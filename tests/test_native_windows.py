"""The Windows binaries of native FMUs, under wine, compute what those for Linux do: another libm, so not to the last bit."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import fmpy
import numpy as np
import pytest
from native_inputs import some_inputs
from natives import MODELS
from slabs import files_of

from cdl_fmu.slave.native.build import cached_native_fmu
from orchestrator.drive import simulate
from orchestrator.experiment import load_experiment
from orchestrator.fmu import Slave
from orchestrator.unpacked import write_unpacked

TESTS = Path(__file__).parent
C_HOST = TESTS.parent / "examples" / "c_host"
H, LOAD = 1e-3, 265.0  # [s], [N]: of each wheel of the two-wheel rover

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def programs(tmp_path_factory):
    """Command of each program by its name and platform; wine runs those for Windows."""
    if shutil.which("wine") is None or sys.platform != "linux":
        pytest.skip("wine runs the Windows binaries on Linux, and is not on this machine (Debian: apt install wine)")
    folder = tmp_path_factory.mktemp("programs")
    headers = ["-I", Path(fmpy.__file__).parent / "c-code", "-I", C_HOST]
    commands = {}
    for source in (TESTS / "replay.c", C_HOST / "host.c"):
        for platform, target, libraries in ("linux64", "x86_64-linux-gnu.2.17", ["-ldl", "-lm"]), ("win64", "x86_64-windows-gnu", []):
            program = folder / f"{source.stem}_{platform}.exe"
            compiler = [sys.executable, "-m", "ziglang", "cc", "-target", target, "-O2"]
            subprocess.run([*compiler, *headers, source, "-o", program, *libraries], check=True, cwd=folder)
            commands[source.stem, platform] = ["wine", program] if platform == "win64" else [program]
    return commands


def run(command, *arguments) -> None:
    done = subprocess.run([*command, *map(str, arguments)], capture_output=True, text=True, env=os.environ | {"WINEDEBUG": "-all"})
    assert done.returncode == 0, done.stderr


def outputs(programs, fmu: Path, inputs: np.ndarray, folder: Path) -> dict[str, np.ndarray]:
    """What an FMU answers to rows of inputs, by platform."""
    unpacked = Path(fmpy.extract(str(fmu), str(folder / "fmu")))
    description = fmpy.read_model_description(str(unpacked))
    references = {c: [v.valueReference for v in description.modelVariables if v.causality == c] for c in ("input", "output")}
    assert all(r == list(range(r[0], r[0] + len(r))) for r in references.values())
    inputs.tofile(folder / "inputs")
    found = {}
    for platform in ("linux64", "win64"):
        identifier = description.coSimulation.modelIdentifier
        ranges = [n for r in references.values() for n in (r[0], len(r))]
        files = folder / "inputs", folder / platform
        run(programs["replay", platform], unpacked, identifier, description.guid, *ranges, len(inputs), H, *files)
        found[platform] = np.fromfile(folder / platform).reshape(len(inputs), -1)
    return found


def off(found: dict[str, np.ndarray]) -> np.ndarray:
    """Difference of each value [n_steps, n_outputs], over the largest of its column and 1."""
    linux, windows = found["linux64"], found["win64"]
    return np.abs(windows - linux) / np.maximum(np.abs(linux).max(axis=0), 1.0)


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.identifier)
def test_random_inputs_get_the_same_answers(model, programs, tmp_path):
    if model.library:
        pytest.skip(f"the FMU of {model.identifier} has a binary for Linux alone")
    rng = np.random.default_rng(5)
    inputs = np.array([some_inputs(model, rng) for _ in range(100)])
    found = outputs(programs, cached_native_fmu(model, {}, files_of(model)), inputs, tmp_path)
    assert np.ptp(found["linux64"], axis=0).any()
    assert off(found).max() <= 1e-12


@pytest.mark.parametrize("tiers", [("BCM", "BCM"), ("SCM", "BCM"), ("SCM", "SCM")], ids="-".join)
def test_a_drive_played_again_has_the_same_forces(tiers, programs, tmp_path, monkeypatch):
    sent: dict[str, list[np.ndarray]] = {}
    step = Slave.step

    def listening(slave, t, h):
        if slave.name in ("bcm", "scm"):
            rows = {v.name: v.start for v in slave.description.modelVariables if v.causality == "input"}
            sent.setdefault(slave.name, []).append(np.array([float((rows | dict(zip(slave.inputs, slave.u)))[name]) for name in rows]))
        step(slave, t, h)

    monkeypatch.setattr(Slave, "step", listening)
    monkeypatch.setattr("orchestrator.master.can_be_compiled", lambda slaves: False)
    package = tmp_path / "run" / "system.ssp"
    simulate("two_wheel", tmp_path / "run", tiers=tiers, native=True, stop_time=2.0, scheme="jacobi", picture=False)
    fmpy.extract(str(package), str(tmp_path / "package"))
    for name, rows in sent.items():
        (tmp_path / name).mkdir()
        fmu = next((tmp_path / "package" / "resources").glob(f"cdl_{name}_*.fmu"))
        found = outputs(programs, fmu, np.array(rows), tmp_path / name)
        variables = [v.name for v in fmpy.read_model_description(str(fmu)).modelVariables if v.causality == "output"]
        assert off(found)[:100].max() <= 1e-12
        forces = [i for i, variable in enumerate(variables) if ".f_0[" in variable]
        difference = found["win64"][:, forces] - found["linux64"][:, forces]
        print(name, "first 100:", off(found)[:100].max(), "rms of forces:", np.sqrt((difference**2).mean(axis=0)).max())
        assert np.sqrt((difference**2).mean(axis=0)).max() <= 1e-3 * LOAD


def test_a_testbed_runs_the_same_way_down(programs, tmp_path):
    """A whole system, its wheel free to sink: forces and height of the run."""
    package, load = tmp_path / "x.ssp", 100.0
    changes = {"carriage.lowering_time": 0.2, "carriage.start_ramp": 0.1, "run.step": H, "run.stop_time": 2.0, "slip_angle": 0.3}
    load_experiment("single_wheel", overrides=changes).write_system(package, native=True)
    write_unpacked(package, tmp_path / "unpacked")
    tables = {}
    for platform in ("linux64", "win64"):
        run(programs["host", platform], tmp_path / "unpacked", tmp_path / f"{platform}.csv")
        with (tmp_path / f"{platform}.csv").open() as csv:
            names = csv.readline().rstrip().replace('"', "").split(",")
            tables[platform] = np.loadtxt(csv, delimiter=",")
    assert off(tables)[:100].max() <= 1e-12
    rms = dict(zip(names, np.sqrt(((tables["win64"] - tables["linux64"]) ** 2).mean(axis=0))))
    print({name: value for name, value in rms.items() if "f_0" in name or "r_0" in name})
    assert max(value for name, value in rms.items() if "f_0" in name) <= 1e-3 * load
    z = dict(zip(names, tables["linux64"].T))["carriage.wheel[1].r_0[3]"]
    assert rms["carriage.wheel[1].r_0[3]"] <= 1e-3 * np.ptp(z) and np.ptp(z) > 0.01
