"""Speed of the BxB co-simulation through pythonfmu FMUs on one core, and where a step's time goes.

    python benchmarks/speed.py

Costs of a call are best / median over blocks of calls: the best is the machine undisturbed, the median what its other guests leave.
Absolute figures are read beside the calibration loop: 1e8 dependent double multiply-adds.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numba
import numpy as np
from fmpy.fmi2 import FMU2Slave

import orchestrator
from cdl_fmu import BCM, Instance
from mbs.driver import Driver
from mbs.rover import Rover
from orchestrator.master import Master
from orchestrator.ssp import UNPACKED, read_system

H = 1e-3
BLOCKS = 30


@numba.njit
def _calibration_loop(x, a, b):
    for _ in range(100_000_000):
        x = x * a + b
    return x


def calibration() -> float:
    """Wall time of the calibration loop [s]."""
    _calibration_loop(1.0, 0.999999, 1e-9)
    return min(_timed(lambda: _calibration_loop(1.0, 0.999999, 1e-9), 1) for _ in range(3))


def _timed(function, n: int) -> float:
    start = time.perf_counter()
    for _ in range(n):
        function()
    return (time.perf_counter() - start) / n


def cost(function, n: int = 250) -> str:
    """Best and median over blocks of the mean time of a call [us]."""
    function()
    blocks = sorted(1e6 * _timed(function, n) for _ in range(BLOCKS))
    return f"{blocks[0]:.1f} / {blocks[BLOCKS // 2]:.1f}"


def main() -> None:
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    print(f"calibration loop                       {calibration():.3f} s")
    with tempfile.TemporaryDirectory() as folder:
        outcomes = [orchestrator.simulate("two_wheel", Path(folder, str(i))) for i in range(7)]
        rates = [o.simulated_s / o.wall_s for o in outcomes]
        print(f"BxB, 17 s, default scheme, 1 ms        {statistics.median(rates):.1f} simulated s per wall s (best {max(rates):.1f})")
        command = [sys.executable, "-c", "from orchestrator.cli import app; app()", "run", "two_wheel", "--stop-time", "0.001", "--json"]
        wall = [_timed(lambda: subprocess.run([*command, "--out", folder], check=True, capture_output=True), 1) for _ in range(3)]
        print(f"start-up, warm cache: a run of one step {statistics.median(wall):.2f} s")
        system = read_system(Path(folder, "0", "system.ssp"), UNPACKED)
    _parts(Master(system, "ij"))
    _kernels()
    _fmpy_lists(system)


def _parts(master: Master) -> None:
    exchange, step = master.scheme.exchange, iter(range(10**9))
    print(f"one step of the master                 {cost(lambda: master.step(H * next(step), H))} us, of which")
    for slave in master.slaves:
        parts = {
            "route": cost(lambda s=slave: exchange.route(s)),
            "set": cost(lambda s=slave: s.set(0.0)),
            "doStep": cost(lambda s=slave: s.step(0.0, H)),
            "get": cost(lambda s=slave: s.get(0.0)),
        }
        text = ", ".join(f"{name} {us}" for name, us in parts.items())
        print(f"  {slave.name:8s} {slave.u.size:3d} in {slave.y.size:3d} out     {text} us")
    master.close()


def _kernels() -> None:
    for model in (BCM(2), Rover(), Driver()):
        instance = Instance(model)
        instance.initialise()
        if isinstance(model, BCM):
            instance.u["wheel"]["r_0"][:, 2] = 0.1
            instance.u["wheel"]["v_0"][:, 0] = 0.12
            instance.u["wheel"]["w_0"][:, 1] = 1.0
        print(f"  {model.identifier:14s} in process       {cost(lambda i=instance: i.step(0.0, H))} us a step")


def _fmpy_lists(system) -> None:
    """The same exchange, with routing, through FMPy's own list API."""
    slaves = {}
    for name, component in system.components.items():
        description = component.model_description
        identifier = description.coSimulation.modelIdentifier
        slave = FMU2Slave(guid=description.guid, unzipDirectory=str(component.directory), modelIdentifier=identifier, instanceName=name)
        slave.instantiate()
        slave.setupExperiment(startTime=0.0)
        slave.enterInitializationMode()
        slave.exitInitializationMode()
        slaves[name] = slave
    reference = {(n, v.name): v.valueReference for n, c in system.components.items() for v in c.model_description.modelVariables}
    sources = sorted({(c.source_component, c.source_variable) for c in system.connections})
    values = dict.fromkeys(sources, 0.0)
    for name, slave in slaves.items():
        own = [s for s in sources if s[0] == name]
        values.update(zip(own, slave.getReal([reference[s] for s in own])))
    plan = []
    for name, slave in slaves.items():
        inputs = [c for c in system.connections if c.target_component == name]
        outputs = [s for s in sources if s[0] == name]
        plan.append(
            (
                slave,
                [reference[name, c.target_variable] for c in inputs],
                [(c.source_component, c.source_variable) for c in inputs],
                [reference[s] for s in outputs],
                outputs,
            )
        )

    def step():
        for slave, targets, feeding, references, outputs in plan:
            slave.setReal(targets, [values[s] for s in feeding])
            slave.doStep(0.0, H)
            values.update(zip(outputs, slave.getReal(references)))

    print(f"one step with FMPy's list API          {cost(step, 50)} us, same FMUs and connections (anchors included)")
    for slave in slaves.values():
        slave.freeInstance()


if __name__ == "__main__":
    np.seterr(all="raise")
    main()
