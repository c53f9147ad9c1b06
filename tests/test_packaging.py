"""What is installed, and that it runs from wherever it was installed and wherever the user is."""

import os
import shutil
import subprocess
import sys
import sysconfig
from email import message_from_bytes
from pathlib import Path
from zipfile import ZipFile

import pytest

from cdl_fmu import BCM
from cdl_fmu.slave.build import build_fmu, cached_fmu
from orchestrator.fmu import Slave, SlaveError
from orchestrator.ssp.system import load_component

ROOT = Path(__file__).parents[1]
PACKAGES = ("cdl_fmu", "fmus", "mbs", "orchestrator")
# What people call their folders: pythonfmu's wrapper takes only blanks from a URI.
AWKWARD = "jürgen@example.org (1) + #2"


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The wheel of a copy of this checkout in which FMUs were built."""
    folder = tmp_path_factory.mktemp("packaging")
    checkout = folder / "checkout"
    for name in (*PACKAGES, "benchmarks", "examples", "tests", "validation"):
        shutil.copytree(ROOT / name, checkout / name, ignore=shutil.ignore_patterns("__pycache__", "build"))
    for name in ("pyproject.toml", "MANIFEST.in", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, checkout)
    (checkout / "fmus" / "build").mkdir()
    for name in ("cdl_bcm_w2.fmu", "note.toml"):
        (checkout / "fmus" / "build" / name).touch()
    build = f"from setuptools import build_meta; build_meta.build_wheel({str(folder)!r})"
    subprocess.run([sys.executable, "-c", build], cwd=checkout, check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    return wheel


def test_the_wheel_holds_the_packages_with_their_data_and_nothing_else(wheel):
    wanted = {
        path.relative_to(ROOT).as_posix()
        for package in PACKAGES
        for path in (ROOT / package).rglob("*")
        if (path.suffix in (".c", ".h", ".py", ".toml") or path.parent.name == "data") and ROOT / "fmus" / "build" not in path.parents
    }
    assert {"cdl_fmu/soil/mss_d.toml", "fmus/two_wheel.toml", "orchestrator/validate/data/cmu_plates.csv"} <= wanted
    with ZipFile(wheel) as archive:
        assert {name for name in archive.namelist() if ".dist-info/" not in name} == wanted


def test_the_wheel_says_what_it_is_and_needs(wheel):
    with ZipFile(wheel) as archive:
        content = {Path(name).name: archive.read(name) for name in archive.namelist() if ".dist-info/" in name}
    metadata = message_from_bytes(content["METADATA"])
    assert metadata["Name"] == "cdl-fmu" and metadata["License-Expression"] == "BSD-3-Clause"
    assert f"\nversion: {metadata['Version']}\n" in (ROOT / "CITATION.cff").read_text()
    assert metadata.get_payload().startswith("# ")
    assert b"cdl = orchestrator.cli:app" in content["entry_points.txt"]
    assert b"BSD 3-Clause" in content["LICENSE"] and b"Permission is hereby granted" in content["LICENSE.cmu.txt"]


def test_a_cache_that_cannot_be_written_is_refused_with_the_remedy(tmp_path):
    (tmp_path / "file").touch()
    run = "from orchestrator.cli import app; app()"
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "file")}
    done = subprocess.run([sys.executable, "-c", run, "run", "two_wheel"], env=environment, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 2 and "Traceback" not in done.stderr
    assert f"the cache folder {tmp_path / 'file' / 'cdl-fmu'}" in done.stderr
    assert "cannot be written (Not a directory): make it writable, or on Linux set XDG_CACHE_HOME to a folder that is" in done.stderr


def test_an_fmu_runs_from_a_folder_of_any_name(tmp_path):
    component = load_component("bcm", cached_fmu(BCM(1)), tmp_path / AWKWARD)
    slave = Slave("bcm", component.model_description, component.directory, lambda text: None)
    slave.initialise(0.0, None, {})
    slave.step(0.0, 1e-3)
    slave.close()


def test_windows_refuses_an_fmu_in_a_folder_that_its_wrapper_does_not_find(tmp_path, monkeypatch):
    component = load_component("bcm", cached_fmu(BCM(1)), tmp_path / "jürgen")
    monkeypatch.setattr("orchestrator.fmu.sys.platform", "win32")
    with pytest.raises(SlaveError, match=r"letters outside ASCII, such as .*jürgen.*; set WIN_PD_OVERRIDE_LOCAL_APPDATA to a folder"):
        Slave("bcm", component.model_description, component.directory, lambda text: None)


def test_a_built_fmu_is_alone_in_its_folder_and_readable_to_those_the_umask_allows(tmp_path):
    path = build_fmu(BCM(1), tmp_path / AWKWARD / "bcm.fmu")
    reference = tmp_path / "reference"
    reference.touch()
    assert path.stat().st_mode == reference.stat().st_mode
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.slow
def test_two_users_of_a_read_only_installation_drive_at_the_same_time_with_a_cold_cache(wheel, tmp_path):
    environment = tmp_path / "environment"
    subprocess.run([sys.executable, "-m", "venv", environment], check=True)
    python = environment / "bin" / "python"
    variables = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    subprocess.run([python, "-m", "pip", "install", "--quiet", "--no-deps", wheel], env=variables, check=True)
    ask = "import sysconfig; print(sysconfig.get_path('purelib'))"
    installed = Path(subprocess.run([python, "-c", ask], check=True, capture_output=True, text=True).stdout.strip())
    # The dependencies of this Python, but not its editable installations: a folder named in a .pth file is no site folder.
    (installed / "dependencies.pth").write_text(sysconfig.get_path("purelib"))
    before = sorted(installed.rglob("*"))
    for path in (installed, *before):
        path.chmod(path.stat().st_mode & ~0o222)

    folder = tmp_path / AWKWARD
    folder.mkdir()
    variables |= {"XDG_CACHE_HOME": str(folder / "cache"), "MPLCONFIGDIR": str(folder)}
    command = [environment / "bin" / "cdl", "run", "two_wheel", "--stop-time", "0.02", "--out"]
    runs = [subprocess.Popen([*command, f"dür {i}"], cwd=folder, env=variables) for i in (1, 2)]
    assert [run.wait() for run in runs] == [0, 0]
    subprocess.run([environment / "bin" / "cdl", "diff", "dür 1", "dür 2", "--rtol", "0"], cwd=folder, env=variables, check=True)
    assert {path.name for path in (folder / "dür 1").iterdir()} == {"result.nc", "result.png", "system.ssp"}
    assert sorted(installed.rglob("*")) == before
