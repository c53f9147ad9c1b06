"""Runs on the single-wheel testbed: one point, or all points of a sweep in processes side by side."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory

from .drive import facts_of, simulate
from .experiment import meant_for, swept_keys
from .measured import Measured
from .measurement import SWEEP
from .run import RunError
from .side_by_side import Crew
from .testbed_picture import sweep_picture


def measure(
    overrides: Mapping[str, object] | None = None,
    *,
    experiment: str | Path = "single_wheel",
    soil: str | Path | None = None,
    out: str | Path | None = None,
    **options,
) -> dict[str, object]:
    """Run one point on the testbed and return its measurements, for scripts that validate or fit.

    Args:
        overrides: ``{"tier": "SCM", "slip": 0.5, "wheel.n_g": 0}``; values in place of the experiment's.
        experiment: Name of a shipped experiment with a carriage, or path of one's .toml.
        soil: Name of a soil set or path of its .toml.
        out: Folder for the run's files; by default they are thrown away.
        **options: Further ones of :func:`orchestrator.simulate`, such as ``step`` and ``stop_time`` [s].

    Returns:
        ``drawbar_pull_N, lateral_force_N, torque_Nm, sinkage_m, normal_load_N``, each with ``_std``, in the wheel's heading frame,
        torque as drive torque; ``stationary``, ``stationary_from_s`` and the drifts; the settings; as ``cdl run --json`` prints, with the
        path of the result where ``out`` is given.

    Raises:
        ExperimentError, SlaveError, ResultError, RunError: see :func:`orchestrator.simulate`; each names what is wrong and the remedy.
    """
    with TemporaryDirectory() as folder:
        facts = facts_of(simulate(experiment, out or folder, overrides=overrides, soil=soil, picture=out is not None, **options))
    if out is None:
        del facts["result"]  # thrown away
    return facts


@dataclass
class Sweep:
    """Points of a sweep so far.

    Attributes:
        out: Folder with a folder for each point, ``sweep.csv`` and ``sweep.json``.
        keys: Swept key -> its values, the first key varying slowest.
        rows: What was measured at each finished point, in the order of the points: its swept values and what :func:`measure` returns.
        failed: Swept values and ``error`` of each point that failed.
        warnings: Of the runs, each with its point.
        interrupted: Whether points are left out because the user interrupted the sweep.
    """

    out: Path
    keys: Mapping[str, list]
    rows: list[dict[str, object]] = field(default_factory=list)
    failed: list[dict[str, object]] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    interrupted: bool = False

    def failures(self) -> list[str]:
        """What each failed point is and why it failed."""
        return [f"{describe(self.keys, point)}: {point['error']}" for point in self.failed]

    def facts(self) -> dict[str, object]:
        """As ``sweep.json`` has it."""
        return {"swept": dict(self.keys), "runs": self.rows, "failed": self.failed}

    def write(self) -> None:
        """Write ``sweep.csv`` and ``sweep.json``, so that what is finished outlasts an interrupt."""
        self.out.mkdir(parents=True, exist_ok=True)
        (self.out / f"{SWEEP}.json").write_text(json.dumps(self.facts(), indent=2) + "\n", encoding="utf-8")
        with (self.out / f"{SWEEP}.csv").open("w", encoding="utf-8", newline="") as file:
            columns = dict.fromkeys([*self.keys, *(key for row in self.rows for key in row)])
            table = csv.DictWriter(file, columns)
            table.writeheader()
            table.writerows(self.rows)

    def draw(self, measured: Measured | None = None) -> None:
        """Write ``sweep.png`` if a point is finished, with tests laid over it."""
        if self.rows:
            sweep_picture(self.keys, self.rows, measured).savefig(self.out / f"{SWEEP}.png")


def sweep(
    overrides: Mapping[str, object] | None = None,
    *,
    experiment: str | Path = "single_wheel",
    soil: str | Path | None = None,
    out: str | Path | None = None,
    processes: int | None = None,
    **options,
) -> list[dict[str, object]]:
    """Run all points of a sweep and return their measurements; in a script call it below ``if __name__ == "__main__":``.

    Args:
        overrides: ``{"slip": [-0.5, 0.0, 0.5], "tier": ["BCM", "SCM"]}``: every combination of the lists is a point.
        experiment, soil, **options: As for :func:`measure`.
        out: Folder; ``results/<experiment>`` by default.
        processes: Processes side by side; one for each core by default.

    Returns:
        For each point, in order, its swept values and what :func:`measure` returns.

    Raises:
        RunError: points failed; those that did not are in ``sweep.json``.
        ExperimentError: see :func:`orchestrator.experiment.load_experiment`.
        KeyboardInterrupt: interrupted; what was finished is in ``sweep.json``.
    """
    keys = swept_keys(experiment, soil=soil, overrides=overrides)
    done = run_sweep(keys, experiment, out, soil=soil, overrides=overrides, processes=processes, **options)
    if done.interrupted:
        raise KeyboardInterrupt
    if done.failed:
        raise RunError("\n".join(done.failures()))
    return done.rows


def run_sweep(
    keys: Mapping[str, list],
    experiment: str | Path,
    out: str | Path | None = None,
    *,
    overrides: Mapping[str, object] | None = None,
    processes: int | None = None,
    status: Callable[[str], None] = lambda text: None,
    **options,
) -> Sweep:
    """Run all points of a sweep over ``keys``; a point that fails leaves the others alone. Arguments are those of :func:`sweep`.

    ``status`` is called with a line for each point that starts or is done.
    """
    out = Path("results", Path(experiment).stem) if out is None else Path(out)
    points = [dict(zip(keys, values)) for values in product(*keys.values())]
    names = [describe(keys, point) for point in points]
    jobs = []
    for name, point in zip(names, points):
        common = meant_for([point["tier"]], keys["tier"], overrides) if "tier" in keys else overrides or {}
        jobs.append((experiment, out / _folder_name(name), {**common, **point}, options))
    sweep, results = Sweep(out, keys), {}

    def started(i: int) -> None:
        status(f"{names[i]}: started, {len(points) - len(results)} of {len(points)} left")

    def finished(i: int, answer: tuple[dict[str, object], list[str]] | None, error: str | None) -> None:
        results[i], warnings = answer or (error, [])
        sweep.warnings += [f"{names[i]}: {text}" for text in warnings]
        sweep.rows = [points[k] | results[k] for k in sorted(results) if isinstance(results[k], dict)]
        sweep.failed = [points[k] | {"error": results[k]} for k in sorted(results) if isinstance(results[k], str)]
        sweep.write()
        status(f"{names[i]}: {'failed' if error else 'done'}, {len(points) - len(results)} of {len(points)} left")

    try:
        with Crew(processes) as crew:
            crew.work(_run_point, jobs, started, finished)
    except KeyboardInterrupt:
        sweep.interrupted = True
    return sweep


def describe(keys: Mapping[str, list], point: Mapping[str, object]) -> str:
    """Swept values of a point in words: ``slip=0.5,tier=SCM``."""
    return ",".join(f"{key}={point[key]}" for key in keys)


def _folder_name(name: str) -> str:
    return re.sub(r"[^\w.,=+-]+", "_", name)


def _run_point(experiment, out: Path, overrides: dict, options: dict) -> tuple[dict[str, object], list[str]]:
    """What one point measures, and its run's warnings."""
    outcome = simulate(experiment, out, overrides=overrides, **options)
    if outcome.status == "interrupted":
        raise KeyboardInterrupt
    return facts_of(outcome), outcome.warnings
