"""Validation: what the models compute beside measurements and closed forms, each number from a run of its own.

A check is a function of a :class:`.bench.Bench` that returns :class:`.rows.Findings`: rows of the one table, and where it helps a figure
and further tables. Its docstring is its title, and ``CHECKS`` has its name. What it runs on the single-wheel testbed it asks the bench for,
all at once, so that no core waits.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ..side_by_side import Crew
from . import closed_forms, hard, identification, multipass, predictions, repetitive, scm, sensitivities, single_wheel, slopes
from .bench import Bench
from .report import Report
from .rows import Findings

#: Every check, in the order of the report: its name, which is its picture's, -> function.
CHECKS: dict[str, Callable[[Bench], Findings]] = {
    "single_wheel": single_wheel.check,
    "sensitivities": sensitivities.check,
    "predictions": predictions.check,
    "scm_grid": scm.grid,
    "scm_soil": scm.soil,
    "multipass": multipass.check,
    "slopes": slopes.check,
    "closed_forms": closed_forms.check,
    "repetitive": repetitive.check,
    "hard_ground": hard.check,
    "identification": identification.check,
}

#: Checks that are left out where there is little time.
SLOW = {"sensitivities"}


def validate(
    out: str | Path,
    *,
    quick: bool = False,
    processes: int | None = None,
    status: Callable[[str], None] = lambda text: None,
) -> Report:
    """Run all checks and write the table, its figures and ``results.json``; in a script call it below ``if __name__ == "__main__":``.

    Args:
        out: Folder to write.
        quick: Fewer runs, and none of ``SLOW``.
        processes: Processes side by side; one for each core by default.
        status: Called with a line for each check, and for each run that starts or is done.
    """
    findings, titles = {}, {}
    with Crew(processes) as crew:
        bench = Bench(crew, quick, status)
        for name, check in CHECKS.items():
            if quick and name in SLOW:
                continue
            bench.about = name
            titles[name] = (check.__doc__ or name).splitlines()[0]
            status(f"{name}: {titles[name]}")
            try:
                findings[name] = check(bench)
            except Exception as error:  # whatever it is, the other checks are not to be lost
                bench.failed.append(f"{name}: {type(error).__name__}: {error}")
    report = Report(Path(out), quick, findings, titles, bench.failed)
    report.write()
    return report
