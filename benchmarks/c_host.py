"""The host in plain C (``examples/c_host``) as one more client: compiled here, run on the unpacked FMUs and their table of connections."""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path

import fmpy
import numpy as np

from cdl_fmu.slave.compiler import compiler
from orchestrator.unpacked import TABLE, write_unpacked

SOURCE = Path(__file__).resolve().parents[1] / "examples" / "c_host" / "host.c"
HEADERS = Path(fmpy.__file__).parent / "c-code"


def run_c_host(ssp: Path, folder: Path, signals: list[str], steps: int, every: int, path: str) -> tuple[np.ndarray, float]:
    """Values of the signals [n_times, n_signals] and the wall time of the steps [s], without that for writing the result.

    ``path`` is the PATH that the host gets, on which FMUs in Python look for ``python3``. Raises RuntimeError with what the host said.
    """
    program, unpacked, out = folder / "host", folder / "unpacked", folder / "result.csv"
    subprocess.run([*compiler("linux64"), "-std=c99", "-O2", "-I", HEADERS, SOURCE, "-o", program, "-ldl", "-lm"], check=True)
    write_unpacked(ssp, unpacked)
    table = (unpacked / TABLE).read_text()
    step = float(re.search(r"^step (\S+)$", table, re.M)[1])
    (unpacked / TABLE).write_text(re.sub(r"^stop .*$", f"stop {steps * step!r}", table, flags=re.M))
    cache = {name: os.environ[name] for name in ("HOME", "XDG_CACHE_HOME") if name in os.environ}  # of kernels, for FMUs in Python
    done = subprocess.run([program, unpacked, out, "--times"], env={"PATH": path, **cache}, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"c_host ended with {done.returncode}: {(done.stderr or done.stdout).strip()}")
    with out.open() as csv:
        names = csv.readline().rstrip().replace('"', "").split(",")
        rows = np.loadtxt(csv, delimiter=",")
    # A line for each instance has its us a step in set, doStep and get; one more has that of routing.
    us = sum(float(number) for line in done.stdout.splitlines()[1:] for number in line.split()[1:4])
    return rows[every::every, [names.index(name) for name in signals]], 1e-6 * us * steps
