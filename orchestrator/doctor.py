"""What this machine needs to build and run FMUs, each point tried, with the remedy where it fails."""

from __future__ import annotations

import platform
import sys
import sysconfig
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import packages_distributions, version
from pathlib import Path
from typing import Literal

_DISTRIBUTION = "cdl-fmu"
_REINSTALL = f"install it again into a fresh environment: pip install --force-reinstall {_DISTRIBUTION}"


@dataclass(frozen=True)
class Finding:
    """One point: ``note`` is worth knowing and no failure; whatever failed has a remedy."""

    what: str
    state: Literal["ok", "note", "failed"]
    detail: str
    remedy: str = ""


def examine() -> Iterator[Finding]:
    """Try each point, one after the other; the kernels' first compilation takes a while."""
    yield python()
    yield system()
    yield libraries()
    yield names()
    cached = cache()
    yield cached
    if cached.state == "ok":  # else the next two fail for the same reason
        yield _tried("kernels", "compiled and run", _run_kernels, _REINSTALL)
        yield _tried("FMU", "built, loaded and stepped", _run_fmu, "see the message; 'cdl info cdl_bcm_w1' shows the FMU's binaries")
    yield other_tools()


def python() -> Finding:
    """The wrappers in the FMUs are 64 bit."""
    bits = platform.architecture()[0]
    detail = f"{platform.python_version()}, {bits}, {sys.executable}"
    if bits != "64bit":
        return Finding("Python", "failed", detail, "use a 64-bit Python")
    return Finding("Python", "ok", detail)


def system() -> Finding:
    """The wrappers exist for Linux and Windows on x86-64."""
    detail = f"{platform.system()} {platform.release()}, {platform.machine()}"
    if sys.platform not in ("linux", "win32") or platform.machine().lower() not in ("x86_64", "amd64"):
        return Finding("platform", "failed", detail, "FMUs run on x86-64 Linux and Windows: use one of them or a container")
    if sys.platform == "win32":
        return Finding("platform", "note", f"{detail}: less tried than Linux")
    return Finding("platform", "ok", detail)


def libraries() -> Finding:
    """Those with binaries of their own, which fail at import if they do not fit the machine."""
    modules = {"numpy": "numpy", "numba": "numba", "mujoco-core": "mujoco", "FMPy": "fmpy", "pythonfmu": "pythonfmu", "h5py": "h5py"}
    try:
        for module in modules.values():
            import_module(module)
    except Exception as error:
        return Finding("libraries", "failed", f"{type(error).__name__}: {error}", _REINSTALL)
    return Finding("libraries", "ok", ", ".join(f"{name} {version(name)}" for name in (_DISTRIBUTION, *modules)))


def names() -> Finding:
    """Our top-level names are taken on PyPI too; of two owners the one installed last wins, file by file."""
    owners = packages_distributions()
    for name in ("mbs", "orchestrator"):
        if others := sorted(set(owners.get(name, ())) - {_DISTRIBUTION}):
            detail = f"'{name}' also belongs to {', '.join(others)}"
            return Finding("names", "failed", detail, f"pip uninstall {' '.join(others)}, then {_REINSTALL}")
        found = Path(import_module(name).__file__).resolve().parents[1]
        if found != Path(__file__).resolve().parents[1]:
            return Finding("names", "failed", f"'{name}' is imported from {found}", f"rename or leave the folder {found / name}")
    return Finding("names", "ok", f"mbs and orchestrator belong to {_DISTRIBUTION}")


def cache() -> Finding:
    """Compiled kernels, FMUs and unpacked packages go here."""
    try:
        from cdl_fmu.slave.kernel import cache_folder  # the import itself raises CacheError: kernels are looked up there

        return Finding("cache", "ok", str(cache_folder()))
    except Exception as error:
        detail, _, remedy = str(error).partition(": ")
        return Finding("cache", "failed", detail, remedy)


def other_tools() -> Finding:
    """What a C or C++ tool needs to run our FMUs in Python."""
    if sys.platform != "linux":
        return Finding("other tools", "note", f"they need {Path(sys.executable).parent} on PATH to find python3.dll")
    try:
        # The first import itself raises CacheError: kernels are looked up there.
        from cdl_fmu.slave.compiler import CompilerError
        from cdl_fmu.slave.embedding import shared_library
        from cdl_fmu.slave.loader import python_loader
    except Exception as error:
        return Finding("other tools", "note", f"not examined: {error}", "mend what failed above")
    library = shared_library()
    if library is None:
        return Finding(
            "other tools",
            "note",
            "this Python has no libpython, so tools in C or C++ cannot run these FMUs",
            "install a Python built with --enable-shared for them",
        )
    try:
        python_loader()
    except CompilerError as error:
        by_hand = f"those in C or C++ find Python only with  LD_PRELOAD={library} PYTHONPATH={sysconfig.get_path('purelib')}"
        return Finding("other tools", "note", f"{by_hand}, as {error}", "then build FMUs again: they find Python by themselves")
    return Finding("other tools", "ok", f"those in C or C++ find this Python with  CDL_PYTHON={sys.executable}  or as python3 on PATH")


def _tried(what: str, done: str, attempt: Callable[[], None], remedy: str) -> Finding:
    began = time.perf_counter()
    try:
        attempt()
    except Exception as error:
        return Finding(what, "failed", f"{type(error).__name__}: {error}", remedy)
    return Finding(what, "ok", f"{done} in {time.perf_counter() - began:.1f} s")


def _run_kernels() -> None:
    from cdl_fmu.bcm import BCM
    from cdl_fmu.slave.model import Instance

    instance = Instance(BCM(1))
    instance.initialise()
    instance.step(0.0, 1e-3)


def _run_fmu() -> None:
    from cdl_fmu.bcm import BCM
    from cdl_fmu.slave.build import cached_fmu

    from .fmu import Slave
    from .ssp import UNPACKED
    from .ssp.system import load_component

    model = BCM(1)
    component = load_component(model.identifier, cached_fmu(model), UNPACKED)
    slave = Slave(component.name, component.model_description, component.directory, lambda text: None)
    try:
        slave.initialise(0.0, 1e-3, {})
        slave.step(0.0, 1e-3)
    finally:
        slave.close()
