"""What ``cdl run`` does where a key of a testbed is given a list: reads options, calls the library, prints."""

from __future__ import annotations

import json
from pathlib import Path

import typer

from .refusals import say


def measured_in(path: Path | None):
    """The tests in a table, None without one."""
    from .measured import read_measured

    return None if path is None else read_measured(path)


def run_sweeps(source: str, out: Path | None, options: dict, measured: Path | None, as_json: bool, checkpoints: bool) -> bool:
    """Run an experiment's sweep; false if no key of it is given a list. ``checkpoints``: whether some were asked for."""
    from .experiment import swept_keys

    keys = swept_keys(source, **{name: options[name] for name in ("tiers", "soil", "overrides") if name in options})
    if not keys:
        return False
    if checkpoints:
        raise typer.BadParameter(f"{', '.join(keys)}: a sweep has no checkpoints; run one point", param_hint="--checkpoint-every, --resume")
    from .single_wheel import run_sweep
    from .summaries import print_sweep

    tests = measured_in(measured)
    sweep = run_sweep(keys, source, out, **options, status=(lambda text: None) if as_json else say)
    sweep.draw(tests)
    if as_json:
        print(json.dumps(sweep.facts()))
    else:
        print_sweep(sweep)
    for warning in sweep.warnings:
        say(f"warning: {warning}")
    for failure in sweep.failures():
        say(f"error: {failure}")
    if sweep.interrupted:
        say(f"interrupted; the points so far are in {sweep.out}")
        raise typer.Exit(130)
    if sweep.failed:
        raise typer.Exit(2)
    return True
