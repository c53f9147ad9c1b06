"""Foreign masters, each run as a process of its own that needs the master and Python alone, nothing of this package.

    python benchmarks/client.py CLIENT SSP STOP_TIME OUT [--every S] [SIGNAL ...]

runs a package in fmpy, libcosim or ecos and writes as JSON what it records: ``values``, signal -> values at ``times`` [s], with the
client's ``version`` and ``wall_s``, the wall time of all steps but the first, in which libcosim initialises the FMUs. Signals are outputs,
``component.variable``; without any, all of them. Rows are ``--every`` seconds apart; without it there is one, at the end. Their times are
those at which a step ends, as in our own results.
"""

import argparse
import ctypes
import json
import sys
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from xml.etree import ElementTree
from zipfile import ZipFile

STEP = 1e-3  # [s] communication step


def outputs_of(ssp: str, signals: list[str]) -> dict[str, dict[str, int]]:
    """Component -> those of its real outputs that are asked for, or all -> their value references."""
    found = {}
    with ZipFile(ssp) as package:
        for component in ElementTree.fromstring(package.read("SystemStructure.ssd")).iterfind(".//{*}Component"):
            name = component.get("name")
            with package.open(component.get("source")) as file, ZipFile(file) as fmu:
                variables = ElementTree.fromstring(fmu.read("modelDescription.xml")).iterfind("./ModelVariables/ScalarVariable")
            real = [v for v in variables if v.get("causality") == "output" and v.find("Real") is not None]
            wanted = [v for v in real if not signals or f"{name}.{v.get('name')}" in signals]
            found[name] = {v.get("name"): int(v.get("valueReference")) for v in wanted}
    return found


def record(names: list[str], steps: int, every: int, advance: Callable[[int], None], read: Callable[[], list[float]]) -> dict:
    """Take ``steps`` steps and read the values of ``names`` after each ``every`` of them."""
    advance(1)
    began, done, rows = time.perf_counter(), 1, []
    for k in range(every, steps + 1, every):
        advance(k - done)
        done = k
        rows.append(read())
    return {"wall_s": time.perf_counter() - began, "values": dict(zip(names, zip(*rows)))}


def in_fmpy(ssp: str, signals: list[str], steps: int, every: int) -> dict:
    """FMPy records all connectors, in rows that bear the time at which their step began."""
    from fmpy.ssp.simulation import simulate_ssp

    def timed(n: int) -> tuple:
        began = time.perf_counter()
        # FMPy adds up the time: half a step less ends it where it is meant to.
        return simulate_ssp(ssp, stop_time=(n - 0.5) * STEP, step_size=STEP), time.perf_counter() - began

    rows, wall = timed(steps)
    names = signals or [name for name in rows.dtype.names if name != "time"]
    # It loads and steps in one call: the time of a run of one step is taken off.
    return {"wall_s": wall - timed(1)[1], "values": {name: rows[name][every - 1 :: every].tolist() for name in names}}


def in_libcosim(ssp: str, signals: list[str], steps: int, every: int) -> dict:
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimObserver import CosimObserver

    log_output_level(CosimLogLevel.WARNING)
    execution = CosimExecution.from_ssp_file(ssp)
    observer = CosimObserver.create_last_value()
    assert execution.add_observer(observer)
    index = {info.name.decode(): info.index for info in execution.slave_infos()}
    outputs = outputs_of(ssp, signals)
    ports = [(index[component], list(references.values())) for component, references in outputs.items() if references]

    def advance(n: int) -> None:
        assert execution.step(n), f"libcosim failed {n} steps after the last row"

    def read() -> list[float]:
        return [value for slave, references in ports for value in observer.last_real_values(slave, references)]

    return record([f"{component}.{name}" for component, names in outputs.items() for name in names], steps, every, advance, read)


def in_ecos(ssp: str, signals: list[str], steps: int, every: int) -> dict:
    tbb = Path(sys.prefix, "lib", "libtbb.so.12")
    if tbb.exists():  # from PyPI, where the loader does not look
        ctypes.CDLL(str(tbb))
    from ecospy import EcosLib, EcosSimulation

    EcosLib.set_log_level("warn")
    names = [f"{component}.{name}" for component, names in outputs_of(ssp, signals).items() for name in names]
    identifiers = [name.replace(".", "::", 1) for name in names]
    with EcosSimulation(step_size=STEP, ssp_path=ssp) as simulation:
        assert simulation.init(), EcosLib.get_last_error()

        def advance(n: int) -> None:
            until = simulation.get_time() + (n - 0.5) * STEP
            simulation.step(n)
            assert simulation.get_time() > until, f"ecos stopped at t = {simulation.get_time():g} s: {EcosLib.get_last_error()}"

        found = record(names, steps, every, advance, lambda: [simulation.get_real(identifier) for identifier in identifiers])
        simulation.terminate()
    return found


CLIENTS = {"fmpy": (in_fmpy, "fmpy"), "libcosim": (in_libcosim, "libcosimpy"), "ecos": (in_ecos, "ecospy")}

if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("client", choices=CLIENTS)
    parser.add_argument("ssp")
    parser.add_argument("stop_time", type=float)
    parser.add_argument("out", type=Path)
    parser.add_argument("signals", nargs="*")
    parser.add_argument("--every", type=float)
    given = parser.parse_intermixed_args()
    simulate, distribution = CLIENTS[given.client]
    n_steps = round(given.stop_time / STEP)
    n_every = round(given.every / STEP) if given.every else n_steps
    found = simulate(given.ssp, given.signals, n_steps, n_every)
    times = [k * STEP for k in range(n_every, n_steps + 1, n_every)]
    given.out.write_text(json.dumps({"version": version(distribution), "times": times, **found}))
