"""The doctor: this machine is well, and what it says where one is not."""

import sys

import pytest
from typer.testing import CliRunner

from cdl_fmu.slave import embedding, kernel, loader
from cdl_fmu.slave.compiler import CompilerError
from orchestrator import cli, doctor
from orchestrator.doctor import Finding


def cdl_doctor():
    return CliRunner().invoke(cli.app, ["doctor"])


def test_this_machine_is_well():
    done = cdl_doctor()
    assert done.exit_code == 0, done.stdout
    for line in ("Python: 3.", "kernels: compiled and run in", "FMU: built, loaded and stepped in", "all is well"):
        assert line in done.stdout


def test_a_failure_is_shown_with_its_remedy_and_an_exit_code(monkeypatch):
    findings = [Finding("a", "ok", "fine"), Finding("b", "failed", "broken", "mend it")]
    monkeypatch.setattr(doctor, "examine", lambda: findings)
    done = cdl_doctor()
    assert done.exit_code == 1
    assert done.stdout == "ok     a: fine\nfailed b: broken\n       mend it\n1 failed\n"


@pytest.mark.parametrize("name", ["mbs", "orchestrator"])
def test_a_second_owner_of_a_top_level_name_is_named(monkeypatch, name):
    monkeypatch.setattr(doctor, "packages_distributions", lambda: {name: ["cdl-fmu", "other-package"]})
    found = doctor.names()
    assert (found.state, found.detail) == ("failed", f"'{name}' also belongs to other-package")
    assert "pip uninstall other-package, then install it again" in found.remedy


def test_a_folder_that_hides_a_top_level_name_is_named(monkeypatch, tmp_path):
    (tmp_path / "mbs").mkdir()
    (tmp_path / "mbs" / "__init__.py").touch()
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "mbs")
    found = doctor.names()
    assert (found.state, found.detail) == ("failed", f"'mbs' is imported from {tmp_path}")
    assert found.remedy == f"rename or leave the folder {tmp_path / 'mbs'}"


def test_a_cache_that_cannot_be_written(monkeypatch, tmp_path):
    (tmp_path / "file").touch()
    monkeypatch.setattr(kernel, "CACHE", tmp_path / "file" / "cdl-fmu")
    kernel.cache_folder.cache_clear()
    findings = {found.what: found for found in doctor.examine()}
    assert findings["cache"].state == "failed"
    assert f"the cache folder {tmp_path / 'file' / 'cdl-fmu'}" in findings["cache"].detail
    assert "XDG_CACHE_HOME" in findings["cache"].remedy
    assert "kernels" not in findings  # one cause, one failure


@pytest.mark.parametrize(
    "platform, machine, state", [("linux", "x86_64", "ok"), ("linux", "aarch64", "failed"), ("darwin", "x86_64", "failed")]
)
def test_platforms(monkeypatch, platform, machine, state):
    monkeypatch.setattr(sys, "platform", platform)
    monkeypatch.setattr(doctor.platform, "machine", lambda: machine)
    found = doctor.system()
    assert found.state == state
    assert ("use one of them or a container" in found.remedy) == (state == "failed")


def test_a_library_that_does_not_load(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    found = doctor.libraries()
    assert found.state == "failed" and "mujoco" in found.detail and "pip install --force-reinstall cdl-fmu" in found.remedy


def test_a_python_without_libpython_is_worth_a_note(monkeypatch):
    monkeypatch.setattr(embedding, "shared_library", lambda: None)
    found = doctor.other_tools()
    assert found.state == "note" and "--enable-shared" in found.remedy


def test_a_machine_without_a_compiler_is_worth_a_note(monkeypatch):
    def none():
        raise CompilerError("there is no C compiler; install one: pip install ziglang")

    monkeypatch.setattr(embedding, "shared_library", lambda: "/lib/libpython3.12.so.1.0")
    monkeypatch.setattr(loader, "python_loader", none)
    found = doctor.other_tools()
    assert found.state == "note" and "LD_PRELOAD=/lib/libpython3.12.so.1.0 " in found.detail
    assert found.detail.endswith(", as there is no C compiler; install one: pip install ziglang")


def test_whatever_goes_wrong_in_a_trial_is_a_finding(monkeypatch):
    def broken():
        raise RuntimeError("no compiler")

    monkeypatch.setattr(doctor, "_run_kernels", broken)
    kernels = next(f for f in doctor.examine() if f.what == "kernels")
    assert (kernels.state, kernels.detail) == ("failed", "RuntimeError: no compiler")
