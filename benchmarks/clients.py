"""The same packages in masters of others, each in an environment of its own, beside our own runs.

    cdl export two_wheel --tiers SCM,BCM -o x.ssp
    python benchmarks/clients.py x.ssp --stop-time 2

For native FMUs an environment holds the client alone; for FMUs written in Python this package, too. Compared are the forces that the wheels
get, the heights of their centres and their trajectories. FMPy puts zeros on all inputs of the first step, so its reference is our Jacobi
scheme that begins like this; the distance from the scheme as it is stands beside it. ``wall`` is the time of the steps, without loading.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from zipfile import ZipFile

import numpy as np

from orchestrator.master import Master
from orchestrator.ssp import System, read_system

CHECKOUT = Path(__file__).resolve().parents[1]
CLIENT = CHECKOUT / "benchmarks" / "client.py"
#: Client -> what its environment needs from PyPI.
PACKAGES = {"libcosim": ["libcosimpy"], "ecos": ["ecospy", "tbb"], "c_host": [], "fmpy": ["fmpy"]}
LOAD = 27.0 * 9.81  # [N] on each wheel at rest: half of the point mass and the wheel's own
LENGTH = 1.0  # [m]
STEP = 1e-3  # [s] communication step


@dataclass(frozen=True)
class Recording:
    """Values [n_times, n_signals] of the signals compared, and the wall time of the steps [s]."""

    values: np.ndarray
    wall_s: float
    version: str


def signals_of(system: System) -> tuple[list[str], list[str]]:
    """Names of the forces on the wheels, as their tiers send them, and of the wheels' positions, in the world's axes."""
    forces = [
        f"{c.source_component}.{c.source_variable}"
        for i in (1, 2)
        for axis in (1, 2, 3)
        for c in system.connections
        if (c.target_component, c.target_variable) == ("rover", f"wheel[{i}].f_0[{axis}]")
    ]
    return forces, [f"rover.wheel[{i}].r_0[{axis}]" for i in (1, 2) for axis in (1, 2, 3)]


def ours(system: System, scheme: str, signals: list[str], steps: int, every: int, *, begin_with_zeros: bool = False) -> Recording:
    """Our own run; ``begin_with_zeros``: all inputs of the first step are zero, as in FMPy."""
    warnings: list[str] = []
    master = Master(system, scheme, steps * STEP, warnings.append)
    columns = [master.output_index[tuple(name.split(".", 1))] for name in signals]
    if begin_with_zeros:
        master.outputs[:] = 0.0
    rows = []
    master.step(0.0, STEP)
    began = time.perf_counter()
    for k in range(1, steps):
        master.step(k * STEP, STEP)
        if (k + 1) % every == 0:
            rows.append(master.outputs[columns])
    wall = time.perf_counter() - began
    master.close()
    for text in dict.fromkeys(warnings):
        print(f"warning: {text}", file=sys.stderr)
    return Recording(np.array(rows), wall, "")


def environment(client: str, folder: Path, with_us: bool) -> list[str | Path]:
    """Command that starts Python in the client's environment and in no other; the environment is made if it is missing."""
    place = folder / (f"{client}_with_cdl" if with_us else client)
    python = place / "bin" / "python"
    if not (place / "complete").exists():
        print(f"making {place}", file=sys.stderr)
        subprocess.run([sys.executable, "-m", "venv", "--clear", place], check=True)
        if needed := [*PACKAGES[client], *([CHECKOUT] if with_us else [])]:
            subprocess.run([python, "-m", "pip", "install", "-q", *needed], check=True)
        (place / "complete").touch()
    return [python, "-I"]


def theirs(client: str, python: list, ssp: Path, signals: list[str], steps: int, every: int) -> Recording:
    """The client's run of a package in a process of its own, started by ``python``; raises RuntimeError with what it said if it fails."""
    with tempfile.TemporaryDirectory() as folder:
        if client == "c_host":
            from c_host import run_c_host  # the others need no C compiler

            return Recording(*run_c_host(ssp, Path(folder), signals, steps, every, str(Path(python[0]).parent)), "")
        out = Path(folder, "recorded.json")
        command = [*python, CLIENT, client, ssp, str(steps * STEP), out, "--every", str(every * STEP), *signals]
        done = subprocess.run(command, capture_output=True, text=True, cwd=folder)
        if done.returncode:
            raise RuntimeError(f"{client} ended with {done.returncode}: {(done.stderr or done.stdout).strip()}")
        found = json.loads(out.read_text())
    return Recording(np.array([found["values"][name] for name in signals]).T, found["wall_s"], found["version"])


def written_in_python(ssp: Path) -> bool:
    """Whether FMUs of the package need this package to run."""
    with ZipFile(ssp) as package:
        for name in package.namelist():
            if name.endswith(".fmu"):
                with package.open(name) as file, ZipFile(file) as fmu:
                    if "resources/slavemodule.txt" in fmu.namelist():
                        return True
    return False


def deviation(a: Recording, b: Recording, n_forces: int) -> tuple[float, float]:
    """Largest differences of forces over the wheel load and of positions over a metre."""
    difference = np.abs(a.values - b.values)
    return difference[:, :n_forces].max() / LOAD, difference[:, n_forces:].max() / LENGTH


def rms(a: Recording, b: Recording, n_forces: int) -> float:
    """Largest rms difference of a force over the wheel load."""
    return float(np.sqrt(np.mean((a.values - b.values)[:, :n_forces] ** 2, axis=0)).max() / LOAD)


def compare(ssp: Path, clients: list[str], environments: Path, stop_time: float, every_s: float) -> list[list[str]]:
    """Rows of the table for one package."""
    python_fmus = written_in_python(ssp)
    kind, steps, every = "Python" if python_fmus else "native", round(stop_time / STEP), round(every_s / STEP)
    with tempfile.TemporaryDirectory() as folder:
        system = read_system(ssp, Path(folder))
        forces, positions = signals_of(system)
        signals, n = forces + positions, len(forces)
        jacobi, default = (ours(system, scheme, signals, steps, every) for scheme in ("jacobi", "ij"))
        zeros = ours(system, "jacobi", signals, steps, every, begin_with_zeros=True) if "fmpy" in clients else None
    rows = [["cdl, ij", "", kind, *[""] * 4, f"{default.wall_s:.2f} s"]]

    def row(name: str, found: Recording, reference: Recording) -> list[str]:
        force, length = deviation(found, reference, n)
        from_jacobi = deviation(found, jacobi, n)[0]
        figures = f"{force:.1e}", f"{length:.1e}", f"{from_jacobi:.1e}", f"{100.0 * rms(found, default, n):.2f} %"
        return [name, found.version, kind, *figures, f"{found.wall_s:.2f} s"]

    rows.append(row("cdl, jacobi", jacobi, jacobi))
    for client in clients:
        try:
            found = theirs(client, environment(client, environments, python_fmus), ssp.resolve(), signals, steps, every)
            rows.append(row(client, found, zeros if client == "fmpy" else jacobi))
        except (RuntimeError, subprocess.CalledProcessError) as error:
            print(error, file=sys.stderr)
            rows.append([client, "", kind, str(error).splitlines()[-1], *[""] * 4])
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("packages", nargs="+", type=Path, metavar="SSP")
    parser.add_argument("--clients", default=",".join(PACKAGES), help="of %(default)s")
    parser.add_argument("--environments", type=Path, help="folder to keep the clients' environments in; a temporary one by default")
    parser.add_argument("--stop-time", type=float, default=2.0, help="[s], default %(default)g")
    parser.add_argument("--every", type=float, default=0.01, help="time between two rows compared [s], default %(default)g")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = (given.environments or Path(temporary)).resolve()
        print("| client | version | FMUs | force / load | position / m | force / load, from jacobi | rms from ij | wall |")
        print("| --- | --- | --- | --- | --- | --- | --- | --- |")
        for package in given.packages:
            for cells in compare(package, given.clients.split(","), folder, given.stop_time, given.every):
                print(f"| {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
