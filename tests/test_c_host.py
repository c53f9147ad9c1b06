"""The host in plain C, and the folder of unpacked FMUs with a table that it runs."""

import os
import re
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import fmpy
import numpy as np
import platformdirs
import pytest
from ssp_fmus import PLANT, write_fmu

from orchestrator.experiment import load_experiment
from orchestrator.results import open_result
from orchestrator.run import run
from orchestrator.ssp import Connection, SspError, read_system, write_system
from orchestrator.unpacked import TABLE, write_unpacked

SOURCES = Path(__file__).parents[1] / "examples" / "c_host"
HEADERS = Path(fmpy.__file__).parent / "c-code"


@pytest.fixture(scope="module")
def host(tmp_path_factory):
    """The compiled host."""
    compiler = [sys.executable, "-m", "ziglang", "cc"] if find_spec("ziglang") else [found] if (found := shutil.which("cc")) else None
    if compiler is None or sys.platform != "linux":
        pytest.skip("the C host is compiled on Linux, with cc or with zig (pip install ziglang)")
    program = tmp_path_factory.mktemp("c_host") / "host"
    flags = ["-std=c99", "-Wall", "-Werror", "-O2", "-I", HEADERS]
    subprocess.run([*compiler, *flags, SOURCES / "host.c", "-o", program, "-ldl", "-lm"], check=True)
    return program


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    """The shipped experiment on these tiers, short, as a package; made once for each choice."""
    folder = tmp_path_factory.mktemp("packages")

    def write(*tiers, native=False):
        path = folder / f"{'-'.join(tiers)}{'-native' if native else ''}.ssp"
        if not path.exists():
            load_experiment("two_wheel", tiers=tiers, overrides={"run.stop_time": 0.3}).write_system(path, native=native)
        return path

    return write


def call(host, *arguments, path=str(Path(sys.executable).parent)):
    """Run the host where FMUs written in Python find this one, and native ones nothing that they need."""
    environment = {"PATH": path, "PYTHONPATH": os.pathsep.join(sys.path), "XDG_CACHE_HOME": str(platformdirs.user_cache_path())}
    return subprocess.run([host, *arguments], env=environment, capture_output=True, text=True, timeout=300)


@pytest.mark.parametrize("tiers, native", [("BCM-BCM", True), ("BCM-BCM", False), ("SCM-BCM", False)])
def test_a_drive_in_the_c_host_is_the_one_under_our_jacobi_scheme(tiers, native, host, package, tmp_path):
    tiers = tiers.split("-")
    ssp = package(*tiers, native=native)
    write_unpacked(ssp, tmp_path / "unpacked")
    done = call(host, tmp_path / "unpacked", tmp_path / "theirs.csv", "--times", **({"path": ""} if native else {}))
    assert done.returncode == 0, done.stderr
    assert {line.split()[0] for line in done.stdout.splitlines()} >= {"rover", "driver", *(t.lower() for t in tiers), "routing"}

    ours = open_result(run(read_system(ssp, tmp_path / "cache"), tmp_path / "own", scheme="jacobi").result)
    with (tmp_path / "theirs.csv").open() as csv:
        names = csv.readline().rstrip().replace('"', "").split(",")
        theirs = np.loadtxt(csv, delimiter=",")
    assert names == ["time", *(name.replace(",", "][") for name in ours.channel.values)]
    assert ours.cdl["rover.wheel[2].r_0[1]"][-1] > 0.015  # it begins at 0
    # Seen: the same bits in all channels.
    np.testing.assert_allclose(theirs[:, 1:], ours.series.values, rtol=1e-9, atol=1e-9)
    assert theirs[:, 0] == pytest.approx(ours.time.values, abs=1e-12)


def test_a_system_of_native_fmus_runs_there_with_no_python_anywhere(host, package, tmp_path):
    native, out = tmp_path / "native.ssp", tmp_path / "theirs.csv"
    load_experiment("two_wheel", tiers=("BCM", "BCM"), overrides={"run.stop_time": 0.3}).write_system(native, native=True)
    write_unpacked(native, tmp_path / "unpacked")
    done = subprocess.run([host, tmp_path / "unpacked", out], env={}, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    ours = open_result(run(read_system(package("BCM", "BCM"), tmp_path / "cache"), tmp_path / "own", scheme="jacobi").result)
    # Seen: the same bits in all channels.
    np.testing.assert_allclose(np.loadtxt(out, delimiter=",", skiprows=1)[:, 1:], ours.series.values, rtol=1e-10, atol=1e-10)


def test_the_c_host_ends_with_what_went_wrong_and_where(host, package, tmp_path):
    folder, table = tmp_path / "unpacked", tmp_path / "unpacked" / TABLE
    out = tmp_path / "out.csv"
    write_unpacked(package("BCM", "BCM"), folder)
    text = table.read_text()

    def refusal():
        done = call(host, folder, out)
        assert done.returncode == 1
        return done.stderr

    # All inputs of bcm from one output of the rover, a position: no rotation, which is an error once it lasts.
    position = re.search(r"^0 (\d+) rover\.wheel\[1\]\.r_0\[1\]$", text, re.MULTILINE)[1]
    table.write_text(re.sub(r"^0 \d+ 2 ", f"0 {position} 2 ", text, flags=re.MULTILINE))
    said = refusal()
    assert "is no rotation" in said and said.endswith("bcm: fmi2DoStep at t = 0.002 s returned fmi2Discard\n")
    assert len(out.read_text().splitlines()) == 4  # names, the start and two steps

    table.write_text(text.replace("instances 3", "instances three"))
    assert "system.txt: expected ' start %lf step %lf stop %lf instances %u' at byte" in refusal()
    table.write_text(text)
    (folder / "bcm" / "binaries" / "linux64" / "cdl_bcm_w2.so").write_bytes(b"")
    assert f"bcm: {folder}/bcm/binaries/linux64/cdl_bcm_w2.so does not load: " in refusal()
    table.unlink()
    assert f"{table}: no such file; write it with 'cdl export EXPERIMENT --unpacked {folder}'" in refusal()


def test_unpacked_package_is_refused_where_its_table_would_not_hold_it(tmp_path):
    plant, package = write_fmu(tmp_path / "plant.fmu", PLANT), tmp_path / "x.ssp"
    scaled = [Connection("a", "y", "b", "u", factor=2.0)]

    write_system(package, "demo", {"a": plant, "b": plant}, scaled, stop_time=1.0, step_size=0.1)
    with pytest.raises(SspError, match=r"b\.u: the table holds connections of Reals in one unit only"):
        write_unpacked(package, tmp_path / "x")
    write_system(package, "demo", {"a": plant}, [], step_size=0.1)
    with pytest.raises(SspError, match="demo: the table needs a step and a stop time"):
        write_unpacked(package, tmp_path / "x")
    assert not (tmp_path / "x").exists()
    with pytest.raises(SspError, match="holds something already: name a new or an empty folder"):
        write_unpacked(package, tmp_path)
