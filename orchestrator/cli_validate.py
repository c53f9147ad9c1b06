"""The command ``cdl validate``: reads options, calls the library, prints. What is slow to import is imported inside."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from .checkout import home
from .refusals import require_platform, say

_WIDE = {"data or closed form"}  # columns that need a wide window


def validate(
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="DIR",
            help="Folder to write. Default: validation, of a checkout if there is one; quick: results/validation.",
        ),
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Fewer runs, no sensitivities: two minutes in place of ten.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of progress and tables.")] = False,
) -> None:
    """Compute what was measured or is known in closed form; leaves a table (README.md), figures and results.json in a folder.

    A bar that is missed is no failure of the command, the table says so; a run that fails is (exit 2).
    """
    require_platform()
    from .terminal import follow, output, table
    from .validate import validate as run_checks
    from .validate.report import RESULTS, TABLE
    from .validate.rows import COLUMNS

    with follow(quiet=as_json) as display:
        report = run_checks(out or (Path("results", "validation") if quick else home() / "validation"), quick=quick, status=display.status)
    if as_json:
        print(json.dumps(report.facts()))
    else:
        console = output()
        kept = [i for i, column in enumerate(COLUMNS) if console.width >= 120 or column not in _WIDE]
        rows = table(*(COLUMNS[i] for i in kept), right=("expected", "computed", "error"))
        for row in report.rows:
            cells = row.cells()
            rows.add_row(*(cells[i] for i in kept))
        console.print(rows, report.tally, sep="\n")
        print(*(report.out / name for name in (TABLE, RESULTS)), *report.pictures.values(), sep="\n")
    for text in report.failed:
        say(f"error: {text}")
    if report.failed:
        raise typer.Exit(2)
