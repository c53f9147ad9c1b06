"""Run a system: the loop over communication steps, with results, checkpoints, progress and a clean end whatever happens."""

from __future__ import annotations

import hashlib
import math
import shutil
import signal
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from .fmu import SlaveError
from .master import Master, is_recorded
from .results import FILE_NAME, Channel, ResultWriter, open_result
from .results_soil import Surface, read_surface
from .ssp import System

#: Simulated time between two snapshots of the soil [s]: the rover of Table 8.2 moves 3 cm, one node of a BCM wheel's patch.
SOIL_INTERVAL = 0.25


#: Most steps, and about the most wall time [s], between two looks at progress and at whether the user wants to stop.
_BATCH, _PATIENCE = 64, 0.05


class RunError(Exception):
    """A run cannot start as asked; the message names the value and the remedy."""


@dataclass
class Outcome:
    """How a run ended: result file, last time [s], wall time of the loop [s], status and warnings."""

    result: Path
    simulated_s: float
    wall_s: float
    status: str
    scheme: str
    step_s: float
    warnings: list[str] = field(default_factory=list)


def run(
    system: System,
    out: Path,
    *,
    scheme: str = "ij",
    step: float = 1e-3,
    stop_time: float | None = None,
    record_interval: float | None = None,
    attributes: Mapping[str, object] | None = None,
    package: Path | None = None,
    soil: Callable[[Master], Surface | None] | None = None,
    progress: Callable[[float, float], None] = lambda t, stop: None,
    checkpoint_every: float | None = None,
    resume: Path | None = None,
    particles: Callable[[float, Master], None] | None = None,
    particles_every: float | None = None,
) -> Outcome:
    """Run ``system`` and write ``out/result.nc``.

    Args:
        system: What to run.
        out: Folder for result and checkpoints, made if needed.
        scheme: Coupling scheme.
        step: Communication step H [s].
        stop_time: End [s]; the system's own by default.
        record_interval: Time between two recorded rows [s], taken as the nearest multiple of the step; by default every step.
        attributes: Stored with the result.
        package: The system's SSP, kept beside the result once nothing refuses the run any more.
        soil: Tells the surface of the soil in the master's slaves, None if none was touched yet. The result keeps it as of
            the start, of every ``SOIL_INTERVAL``, and of the end, whatever ends the run.
        progress: Called now and then with the time reached and the stop time [s].
        checkpoint_every: Simulated time between checkpoints [s].
        resume: Checkpoint to go on from, with the same system, scheme and step; its result file is completed.
        particles: Looks at the particles in the master's slaves: called with the time [s] and the master at the end, whatever ends the run.
        particles_every: Simulated time between further looks [s], also at the start and after the first step; None: at the end only.

    Raises:
        RunError: step, stop time or checkpoint do not fit.
        SlaveError: a slave failed; the rows so far are in the result.
    """
    start = system.start_time
    stop = system.stop_time if stop_time is None else stop_time
    if stop is None:
        raise RunError("no stop time: the system has none, so give --stop-time S")
    n_steps = _whole(stop - start, step, "stop time")
    every = 1 if record_interval is None else max(1, round(record_interval / step))
    soil_steps = 0 if soil is None else max(1, round(SOIL_INTERVAL / step))
    particle_steps = 0 if particles_every is None else _whole(particles_every, step, "interval of particles", least=1)
    checkpoint_steps = 0 if checkpoint_every is None else _whole(checkpoint_every, step, "checkpoint interval", least=1)
    out.mkdir(parents=True, exist_ok=True)
    warnings: list[str] = []
    identity = _identity(system, scheme, step)
    saved = None if resume is None else _read_checkpoint(resume, identity)
    if saved is not None and int(saved["step"]) > n_steps:
        raise RunError(f"{resume} lies at t = {start + int(saved['step']) * step:g} s, after the stop time {stop:g} s; give a later one")
    replay = None if saved is None else _earlier_result(resume, saved)
    # From before the FMUs are loaded: an interrupt while one that is written in Python starts would look like that one's failure.
    with _interrupts() as interrupted, closing(Master(system, scheme, stop, warnings.append)) as master:
        recorded = [(key, i) for key, i in master.output_index.items() if is_recorded(key[1])]
        columns = np.array([i for _, i in recorded])
        channels = [_channel(system, *key) for key, _ in recorded]
        facts = {"scheme": scheme, "step_s": step, "identity": identity, "fmu_hashes": _hashes(system), **(attributes or {})}
        try:
            with ResultWriter(out / FILE_NAME, channels, facts) as result:
                _keep(package, out)

                def keep_soil(k: int) -> None:
                    if soil is not None and (surface := soil(master)) is not None:
                        result.append_soil(start + k * step, surface)

                def look(k: int) -> None:
                    keep_soil(k)
                    if particles is not None:
                        particles(start + k * step, master)

                k = 0
                pauses = [n for n in (soil_steps, particle_steps, checkpoint_steps) if n]
                rows, batch = np.empty((_BATCH, columns.size)), 1
                if saved is None:
                    result.append(start, master.outputs[columns])
                    keep_soil(k)
                else:
                    master.restore(saved)
                    k = int(saved["step"])
                    replay(start + k * step, channels, result)
                if particle_steps:
                    particles(start + k * step, master)
                shown, checkpoint = 0.0, resume
                began = looked = time.perf_counter()
                try:
                    while k < n_steps and not interrupted():
                        n = min(batch, n_steps - k, *(interval - k % interval for interval in pauses))
                        done, error = master.advance(start, step, k, rows[:n], columns)
                        for row in rows[:done]:
                            k += 1
                            if k % every == 0 or k == n_steps:
                                result.append(start + k * step, row)
                        if error:
                            raise error
                        if soil_steps and k % soil_steps == 0:
                            keep_soil(k)
                        if particle_steps and (k == 1 or k % particle_steps == 0) and k < n_steps:  # they come with the first step
                            particles(start + k * step, master)
                        if checkpoint_steps and k % checkpoint_steps == 0:
                            result.flush()
                            last_row = start + (k if k == n_steps else k - k % every) * step
                            checkpoint = out / f"checkpoint_{start + k * step:.3f}s.npz"
                            _write_checkpoint(checkpoint, master, identity, k, last_row)
                        now = time.perf_counter()
                        batch = min(2 * batch, _BATCH) if now - looked < 0.5 * _PATIENCE else max(batch // 2, 1)
                        looked = now
                        if now - shown > 0.1 or k == n_steps:
                            shown = now
                            progress(start + k * step, stop)
                except SlaveError as error:
                    with suppress(Exception):  # the slave may not give its state any more; its failure is what counts
                        look(k)
                    if checkpoint is None:
                        raise
                    raise SlaveError(f"{error}; once its cause is mended, go on with --resume {checkpoint}") from error
                look(k)
                status = "complete" if k == n_steps else "interrupted"
                result.close(status)
        except SlaveError as error:
            warned = "".join(f"\nwarned before: {text}" for text in warnings)
            raise SlaveError(f"{error}; the steps before it are in {out / FILE_NAME}{warned}") from error
    wall = time.perf_counter() - began
    return Outcome(out / FILE_NAME, start + k * step, wall, status, scheme, step, warnings)


def _keep(package: Path | None, out: Path) -> None:
    kept = out / "system.ssp"
    if package is not None and not (kept.exists() and package.samefile(kept)):
        shutil.copyfile(package, kept)


def _whole(duration: float, step: float, what: str, least: int = 0) -> int:
    if not (math.isfinite(step) and step > 0.0):
        raise RunError(f"step = {step:g} s: it must be positive")
    if not (math.isfinite(duration) and duration > (least - 0.5) * step):
        raise RunError(f"{what} {duration:g} s: it must be finite and at least {least * step:g} s")
    n = round(duration / step)
    if abs(n * step - duration) > 1e-9 * max(abs(duration), step):
        low = int(duration / step) * step
        raise RunError(f"{what} {duration:g} s is no multiple of the step {step:g} s; the nearest are {low:g} s and {low + step:g} s")
    return n


def _channel(system: System, component: str, variable: str) -> Channel:
    declared = next(v for v in system.components[component].model_description.modelVariables if v.name == variable)
    unit = declared.unit or (declared.declaredType.unit if declared.declaredType else None) or "1"
    return Channel(f"{component}.{variable}", unit, declared.description or "")


def _hashes(system: System) -> dict[str, str]:
    return {name: hashlib.sha256(Path(c.fmu_path).read_bytes()).hexdigest()[:16] for name, c in system.components.items()}


@contextmanager
def _interrupts():
    """Catch SIGINT as a flag: an exception would surface inside a slave. Only the main thread may set handlers."""
    flag = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield flag.is_set
        return
    before = signal.signal(signal.SIGINT, lambda *_: flag.set())
    try:
        yield flag.is_set
    finally:
        signal.signal(signal.SIGINT, before)


# -- checkpoints: what the master saved, and what it must meet again to go on with the same bits


def _identity(system: System, scheme: str, step: float) -> str:
    parameters = {name: sorted(c.parameters.items()) for name, c in system.components.items()}
    return hashlib.sha256(repr((_hashes(system), parameters, system.connections, scheme, step)).encode()).hexdigest()


def _write_checkpoint(path: Path, master: Master, identity: str, k: int, last_row: float) -> None:
    part = path.with_suffix(".part")
    with part.open("wb") as file:
        np.savez_compressed(file, identity=identity, step=k, last_row=last_row, **master.save())
    part.replace(path)


def _read_checkpoint(path: Path, identity: str) -> dict[str, np.ndarray]:
    try:
        with np.load(path, allow_pickle=False) as data:
            saved = dict(data)
    except FileNotFoundError:
        raise RunError(f"checkpoint {path} does not exist") from None
    except (OSError, ValueError, EOFError, BadZipFile) as error:
        raise RunError(f"{path} is no checkpoint, or a damaged one: give a checkpoint_*.npz that 'cdl run' wrote") from error
    if str(saved.get("identity")) != identity:
        raise RunError(
            f"{path} was written by another run (FMUs, parameters, scheme or step differ); resume it with those it was written with"
        )
    return saved


def _earlier_result(resume: Path, saved: Mapping[str, np.ndarray]):
    """Function that repeats the result up to the checkpoint, from the file beside it; read now, as the new result may replace that."""
    path = resume.parent / FILE_NAME
    if not path.exists():
        raise RunError(f"{path} is missing: a checkpoint is resumed together with the result file beside it")
    earlier = open_result(path)
    # The folder may have been used again since.
    if earlier.attrs.get("identity") != str(saved["identity"]) or not np.any(earlier["time"].values >= float(saved["last_row"]) - 1e-9):
        raise RunError(f"{path} is not the result that {resume.name} belongs to: it was replaced by another run; run again from the start")

    def replay(until: float, channels: list[Channel], result: ResultWriter) -> None:
        if [c.name for c in channels] != list(earlier["channel"].values):
            raise RunError(f"{path} records other channels than this run; resume with the same settings")
        for t, row in zip(earlier["time"].values, earlier["series"].values):
            if t <= until + 1e-9:
                result.append(t, row)
        for snapshot, t in enumerate(earlier.cdl.soil_times):
            if t <= until + 1e-9:
                result.append_soil(t, read_surface(earlier, snapshot))

    return replay
