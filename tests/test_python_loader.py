"""FMUs in Python load in a host in C, which finds Python by itself or says what it lacks."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import fmpy
import numpy as np
import pytest
from typer.testing import CliRunner

from cdl_fmu import BCM, Instance
from cdl_fmu.slave import build, embedding
from cdl_fmu.slave.build import build_fmu, cached_fmu
from cdl_fmu.slave.compiler import CompilerError, compiler
from cdl_fmu.slave.loader import WRAPPER
from mbs.driver import Driver
from orchestrator import cli

ROOT = Path(__file__).parents[1]
ROLLING = {"wheel[1].r_0[3]": 0.11, "wheel[1].v_0[1]": 0.1, "wheel[1].w_0[2]": 1.0}  # 15 mm deep in the soil, with slip
STEERING = {"wheel[2].r_0[1]": 1.0}  # the steered wheel past its first threshold


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    """The host, compiled."""
    if sys.platform != "linux":
        pytest.skip("the loader is for Linux")
    try:
        command = compiler("linux64")
    except CompilerError as error:
        pytest.skip(str(error))
    if embedding.shared_library() is None:
        pytest.skip("this Python has no shared library for a host in C; use one built with --enable-shared")
    out = tmp_path_factory.mktemp("host") / "host"
    headers = Path(fmpy.__file__).parent / "c-code"
    source = Path(__file__).with_name("python_loader_host.c")
    subprocess.run([*command, "-I", headers, "-o", out, source, "-ldl"], check=True, capture_output=True)
    return out


@pytest.fixture(scope="module")
def host(program, tmp_path_factory):
    """Run FMUs in the host: ``host([(model, inputs, outputs)], VARIABLE=value)`` with this Python unless variables say else."""

    def run(slaves, **variables):
        arguments = []
        for model, inputs, outputs in slaves:
            folder = tmp_path_factory.mktemp("fmu")
            path = cached_fmu(model)
            fmpy.extract(str(path), str(folder))
            description = fmpy.read_model_description(str(path))
            references = {v.name: v.valueReference for v in description.modelVariables}
            library = folder / "binaries" / "linux64" / f"{description.coSimulation.modelIdentifier}.so"
            arguments += [library, description.guid, (folder / "resources").as_uri()]
            arguments += [",".join(f"{references[name]}={value!r}" for name, value in inputs.items())]
            arguments += [",".join(str(references[name]) for name in outputs)]
        environment = {"PYTHONPATH": str(ROOT), "CDL_PYTHON": sys.executable} | variables
        environment = {name: value for name, value in (os.environ | environment).items() if value is not None}
        return subprocess.run([program, *arguments], env=environment, capture_output=True, text=True, timeout=300)

    return run


def outputs_of(model):
    return [scalar.name for scalar in model.scalars["y"]]


def in_python(model, inputs):
    """All outputs after the host's steps."""
    instance = Instance(model)
    instance.set_starts(inputs)
    instance.initialise()
    for k in range(100):
        instance.step(1e-3 * k, 1e-3)
    return instance.block[instance.slices["y"]].tolist()


def lines_of(done):
    assert done.returncode == 0, f"{done.returncode}: {done.stdout}{done.stderr}"
    return [[float(value) for value in line.split()] for line in done.stdout.splitlines()]


def test_a_host_in_c_gets_what_python_computes(host):
    model = BCM(1)
    wanted = in_python(model, ROLLING)
    forces = [wanted[outputs_of(model).index(f"wheel[1].f_0[{axis}]")] for axis in (1, 3)]
    assert forces[0] > 1.0 and forces[1] > 10.0
    assert lines_of(host([(model, ROLLING, outputs_of(model))])) == [wanted, wanted]


def test_two_models_in_one_process(host):
    slaves = [(BCM(1), ROLLING), (Driver(2), STEERING)]
    wanted = [in_python(model, inputs) for model, inputs in slaves]
    done = host([(model, inputs, outputs_of(model)) for model, inputs in slaves])
    assert lines_of(done) == [*wanted, *wanted]


def test_python_is_found_on_path(host, tmp_path):
    (tmp_path / "python3").symlink_to(sys.executable)
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    model = BCM(1)
    assert lines_of(host([(model, ROLLING, outputs_of(model))], CDL_PYTHON=None, PATH=path))[0] == in_python(model, ROLLING)


def test_a_host_that_runs_python_for_itself_alone(host):
    """Its Python is taken, whatever CDL_PYTHON says, and made global."""
    site = os.pathsep.join([str(ROOT), str(Path(np.__file__).parents[1])])
    model = BCM(1)
    own = dict(HOST_LIBPYTHON=embedding.shared_library(), PYTHONPATH=site, CDL_PYTHON="/nowhere")
    assert lines_of(host([(model, ROLLING, outputs_of(model))], **own))[0] == in_python(model, ROLLING)


def refused(done):
    """What the host logged, which lives on after no instance."""
    assert done.returncode == 3, f"{done.returncode}: {done.stdout}{done.stderr}"
    begin = "slave: status 3: this FMU runs in Python 3.11 or newer with cdl-fmu 0.1.0, and "
    end = ". Set the environment variable CDL_PYTHON to a python that has it, or use the native FMU (cdl build --native)\n"
    assert done.stdout.startswith(begin) and done.stdout.endswith(end)
    return done.stdout[len(begin) : -len(end)]


def test_no_python_on_path(host, tmp_path):
    said = refused(host([(BCM(1), {}, [])], CDL_PYTHON=None, PATH=str(tmp_path)))
    assert said == "python3 on PATH: 'python3' does not run: No such file or directory"


def test_no_python_where_the_variable_says(host, tmp_path):
    said = refused(host([(BCM(1), {}, [])], CDL_PYTHON=f"{tmp_path}/100%s"))
    assert said == f"CDL_PYTHON: '{tmp_path}/100%s' does not run: No such file or directory"


def test_what_is_no_python(host):
    said = refused(host([(BCM(1), {}, [])], CDL_PYTHON="true"))
    assert said == "CDL_PYTHON: 'true' is no Python that answers, see its messages"


@pytest.fixture
def bare(tmp_path):
    """A Python environment with nothing in it."""
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", tmp_path / "bare"], check=True)
    return tmp_path / "bare" / "bin" / "python"


def test_a_python_without_the_package(host, bare):
    said = refused(host([(BCM(1), {}, [])], CDL_PYTHON=str(bare), PYTHONPATH=None))
    assert said == f"CDL_PYTHON is Python {sys.version_info[0]}.{sys.version_info[1]}, {bare}, which has no cdl-fmu"


def test_a_python_without_a_shared_library(host, tmp_path):
    python = tmp_path / "python"
    python.write_text("#!/bin/sh\necho hello\nprintf 'cdl-fmu\\t3.12\\t/opt/python\\t\\t0.1.0\\n'\n")
    python.chmod(0o755)
    said = refused(host([(BCM(1), {}, [])], CDL_PYTHON=str(python)))
    assert said == (
        "CDL_PYTHON is Python 3.12, /opt/python, which has no shared library libpython: use a Python that was built with --enable-shared"
    )


def test_a_python_without_what_the_package_needs(host, bare):
    """The FMU's own message reaches a host that asked for no logging."""
    (site,) = bare.parents[1].glob("lib/python*/site-packages")
    (site / "cdl_fmu-0.1.0.dist-info").mkdir()
    (site / "cdl_fmu-0.1.0.dist-info" / "METADATA").write_text("Metadata-Version: 2.1\nName: cdl-fmu\nVersion: 0.1.0\n")
    done = host([(BCM(1), {}, [])], CDL_PYTHON=str(bare))
    assert done.returncode == 3
    assert "FMU cdl_bcm_w1 needs cdl-fmu 0.1.0 in the Python that runs it: pip install cdl-fmu==0.1.0 (No module named" in done.stdout


def no_compiler():
    raise CompilerError("there is no C compiler; install one: pip install ziglang")


def test_without_a_compiler_an_fmu_is_for_hosts_in_python(monkeypatch, tmp_path):
    usual = cached_fmu(BCM(1))  # with the loader where a compiler is at hand
    monkeypatch.setattr(build, "python_loader", no_compiler)
    path = build_fmu(BCM(1), tmp_path / "bcm.fmu")
    assert usual.parent != cached_fmu(BCM(1)).parent
    with zipfile.ZipFile(path) as archive:
        binaries = {name for name in archive.namelist() if name.startswith("binaries/linux64/") and not name.endswith("/")}
    assert binaries == {"binaries/linux64/cdl_bcm_w1.so"}
    assert len(fmpy.simulate_fmu(str(path), stop_time=0.01, step_size=1e-3, start_values=ROLLING)) == 11


def test_the_loader_stands_in_for_the_wrapper_beside_it(tmp_path):
    try:
        compiler("linux64")
    except CompilerError as error:
        pytest.skip(str(error))
    paths = [build_fmu(BCM(1), tmp_path / folder / "bcm.fmu") for folder in ("one", "two")]
    with zipfile.ZipFile(paths[0]) as archive:
        binaries = {name for name in archive.namelist() if name.startswith("binaries/linux64/") and not name.endswith("/")}
    assert binaries == {"binaries/linux64/cdl_bcm_w1.so", f"binaries/linux64/{WRAPPER}"}
    assert paths[0].read_bytes() == paths[1].read_bytes()
    assert str(tmp_path).encode() not in b"".join(zipfile.ZipFile(paths[0]).read(name) for name in binaries)


def test_a_build_without_a_compiler_says_so(monkeypatch, tmp_path):
    monkeypatch.setattr("cdl_fmu.slave.loader.python_loader", no_compiler)
    monkeypatch.setattr(build, "python_loader", no_compiler)
    done = CliRunner().invoke(cli.app, ["build", "cdl_bcm_w1", "--out", str(tmp_path)])
    assert done.exit_code == 0
    assert "note: tools in C and C++ on Linux do not find Python by themselves for these FMUs: there is no C compiler" in done.stderr
