"""Native FMUs against those in Python: whole systems under ``cdl run``, calls from the host in plain C, and what building costs.

    python benchmarks/native.py

One core; ``--build`` measures the build instead, on all cores. Systems: the shipped drive on three pairs of tiers, default scheme, every
step written; rates are medians (best) of five runs of 18 s. Calls: microseconds of the host in C, whose exchange is Jacobi's.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import fmpy

import orchestrator
from benchmarks.speed import calibration
from orchestrator.experiment import load_experiment
from orchestrator.unpacked import write_unpacked

HOST = Path(__file__).parents[1] / "examples" / "c_host" / "host.c"
TIERS = (("BCM", "BCM"), ("SCM", "BCM"), ("SCM", "SCM"))


def rates(tiers: tuple[str, str], native: bool, folder: Path, runs: int) -> list[float]:
    """Simulated seconds per wall second of some runs."""
    found = []
    for _ in range(runs):
        outcome = orchestrator.simulate("two_wheel", folder / "run", tiers=tiers, native=native, picture=False)
        found.append(outcome.simulated_s / outcome.wall_s)
    return found


def calls(host: Path, tiers: tuple[str, str], native: bool, folder: Path) -> str:
    """What the host in C says of an exchange's times over 2 s."""
    package, unpacked = folder / "x.ssp", folder / f"{'-'.join(tiers)}{native}"
    load_experiment("two_wheel", tiers=tiers, overrides={"run.stop_time": 2.0}).write_system(package, native=native)
    write_unpacked(package, unpacked)
    environment = os.environ | {"CDL_PYTHON": sys.executable, "PYTHONPATH": os.pathsep.join(sys.path)}
    done = [
        subprocess.run([host, unpacked, folder / "x.csv", "--times"], env=environment, capture_output=True, text=True) for _ in range(3)
    ]
    assert all(one.returncode == 0 for one in done), done[0].stderr
    return min((one.stdout for one in done), key=lambda text: float(text.splitlines()[1].split()[2]))


def build_time(folder: Path) -> float:
    """Wall time of ``cdl build --native`` with nothing in the cache, all cores [s]."""
    command = [sys.executable, "-c", "from orchestrator.cli import app; app()", "build", "--native", "--out", str(folder / "fmus")]
    start = time.perf_counter()
    subprocess.run(command, env=os.environ | {"XDG_CACHE_HOME": str(folder / "cache")}, check=True, capture_output=True)
    return time.perf_counter() - start


def main() -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if "--build" in sys.argv:
            print(f"all native FMUs, cold: {build_time(folder):.0f} s")
            return
        if hasattr(os, "sched_setaffinity"):
            os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
        print(f"calibration loop {calibration():.3f} s")
        for tiers in TIERS:
            for native in (False, True):
                found = rates(tiers, native, folder, 5)
                kind = "native" if native else "Python"
                print(f"{'-'.join(tiers)} {kind}: {statistics.median(found):.1f} ({max(found):.1f}) simulated s per wall s", flush=True)
        host = folder / "host"
        headers = Path(fmpy.__file__).parent / "c-code"
        subprocess.run([sys.executable, "-m", "ziglang", "cc", "-O2", "-I", headers, HOST, "-o", host, "-ldl", "-lm"], check=True)
        for tiers in TIERS[:2]:
            for native in (False, True):
                print(f"\n{'-'.join(tiers)} {'native' if native else 'Python'}\n{calls(host, tiers, native, folder)}", flush=True)


if __name__ == "__main__":
    main()
