"""The drives BxB, SxB, SxB+ and SxS of one experiment, measured against each other and section 8.5: what ``cdl compare`` does."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

from .claims import RUNS, Verdict, judge, load_claims
from .courses import SIGNALS, WHEELS, Course
from .drive import facts_of, simulate
from .results import open_result
from .run import Outcome, RunError
from .terminal import Display

#: Computation time of each run relative to BxB's as Table 8.4 has it.
TABLE_8_4 = {"BxB": 1.0, "SxB": 1.5, "SxS": 2.3}

#: The run beyond the chapter, whose trailing wheel feels what pressed the soil before: its tiers, and what is set for it alone. It is
#: measured as the others are, and the claims, which are the chapter's, do not know it.
_BEYOND = {"SxB+": (("SCM", "BCM"), {"bcm.compaction": True})}

#: The run that the others are measured against.
REFERENCE = "SxS"

#: Run -> tiers and own settings, in the order in which they are run and shown, the reference last. The chapter's wheels feel heights alone.
DRIVES = (
    {run: (tiers, {"bcm.compaction": False}) for run, tiers in RUNS.items() if run != REFERENCE}
    | _BEYOND
    | {REFERENCE: (RUNS[REFERENCE], {})}
)

#: Table 8.3's variables, and the distance of a wheel's path from the reference's.
_FORCES_AND_PLACES = ("front.F_x", "rear.F_x", "front.F_y", "rear.F_y", "front.z", "rear.z", "front.y", "rear.y")
_PATHS = {"front.path": "front", "rear.path": "rear"}

#: Unit -> the one in tables, and how many of those one is.
_SHOWN = {"m": ("mm", 1e3), "rad": ("deg", 180.0 / np.pi), "1": ("", 1.0)}
#: Picture -> what it shows, in the words of a caption.
_CAPTIONS = {
    "fig_8_4": "The plane that BCM fits into the ground below SxB's rear wheel in the rut: rays, what they hit, normals",
    "fig_8_5": "SxS: front wheel and rut, before the rear wheel is in it",
    "fig_8_8": "SxB: the rear wheel's contact plane in the rut of the front wheel",
    "fig_8_9": "SxS at the end: traces of both wheels",
    "fig_8_10": "The three set-ups",
    "fig_8_11": "SxS as the rear wheel is steered back: traces of both wheels",
    "fig_8_12": "Forces in the heading frame, divided by the largest F_x of SxS's front wheel after its start, heights and trajectories; "
    "sections A to E of the drive",
}
_HOLDS = {True: "yes", False: "no", None: "not reached"}


@dataclass(frozen=True)
class Sheet:
    """A table for people: title, columns, rows of text, and what has to be known to read it; ``wide`` columns need a wide window."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str
    wide: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Comparison:
    """What the runs of an experiment came to.

    Attributes:
        out: Folder with everything.
        outcomes: Run -> how it ended.
        time_factors: Run -> its wall time in the loop for the same simulated time, relative to BxB's [1].
        span: First and last x of the rear wheel [m] over which ``rms`` is taken; None if it did not move.
        rms: Run -> signal -> rms difference from SxS at the same x of the rear wheel, in the signal's unit; ``front.path`` and
            ``rear.path`` are distances of the wheel's centre from the path of SxS's [m].
        verdicts: What the runs say of each claim.
        pictures: Their paths.
    """

    out: Path
    outcomes: Mapping[str, Outcome]
    time_factors: Mapping[str, float]
    span: tuple[float, float] | None
    rms: Mapping[str, Mapping[str, float]]
    verdicts: Sequence[Verdict]
    pictures: Sequence[Path]

    def facts(self) -> dict:
        """Everything, as ``comparison.json`` has it; SI units."""
        return {
            "runs": {run: facts_of(outcome) for run, outcome in self.outcomes.items()},
            "time_factors": dict(self.time_factors),
            "span_m": self.span,
            "rms": self.rms,
            "rms_units": {signal: _unit(signal) for signal in self.rms["BxB"]},
            "claims": [_claim_facts(verdict) for verdict in self.verdicts],
            "pictures": [str(path) for path in self.pictures],
        }

    def sheets(self) -> list[Sheet]:
        """Tables 8.3 and 8.4 as numbers, and the claims."""
        return [self._table_8_3(), self._table_8_4(), self._claims()]

    def _table_8_3(self) -> Sheet:
        rows = [[signal, *(_shown(self.rms[run][signal], _unit(signal)) for run in self.rms)] for signal in self.rms["BxB"]]
        over = "nothing: the rear wheel did not move" if self.span is None else f"x = {self.span[0]:.3g} to {self.span[1]:.3g} m"
        note = f"over {over}; F_x, F_y in the heading frame, z and y of the wheel's centre, path: distance from SxS's path"
        return Sheet("Table 8.3: rms difference from SxS", ["signal", *self.rms], rows, note)

    def _table_8_4(self) -> Sheet:
        rows = [
            [run, f"{outcome.wall_s:.3g} s", f"{self.time_factors[run]:.2f}", f"{TABLE_8_4[run]:g}" if run in TABLE_8_4 else ""]
            for run, outcome in self.outcomes.items()
        ]
        simulated = self.outcomes["BxB"].simulated_s
        return Sheet("Table 8.4: computation time", ["run", "wall", "factor", "chapter"], rows, f"for {simulated:g} simulated s each")

    def _claims(self) -> Sheet:
        rows = []
        for verdict in self.verdicts:
            claim, finding = verdict.claim, verdict.finding
            numbers = [""] * 5
            if finding is not None:
                values = (finding.left, finding.right, finding.measured, finding.threshold)
                numbers = [str(finding.relation), *(_shown(value, claim.unit) for value in values)]
            rows.append([claim.place, claim.text, "must" if claim.must else "", *numbers, _HOLDS[verdict.holds]])
        columns = ["place", "statement", "has to hold", "decided by", "left", "right", "difference", "threshold", "holds"]
        note = "of several relations the one that holds by least, or fails by most; '~': they differ by less than the threshold"
        wide = frozenset({"decided by", "left", "right"})
        return Sheet(f"Statements of section 8.5: {self._tally()}", columns, rows, note, wide)

    def _tally(self) -> str:
        def count(verdicts: list[Verdict]) -> str:
            return f"{sum(verdict.holds is True for verdict in verdicts)} of {len(verdicts)}"

        must = [verdict for verdict in self.verdicts if verdict.claim.must]
        rest = [verdict for verdict in self.verdicts if not verdict.claim.must]
        n_missing = sum(verdict.holds is None for verdict in self.verdicts)
        missing = f"; {n_missing} were not reached" if n_missing else ""
        return f"{count(must)} that must hold do, and {count(rest)} others{missing}"


def compare(
    experiment: str | Path = "two_wheel",
    out: str | Path | None = None,
    *,
    soil: str | Path | None = None,
    overrides: Mapping[str, object] | None = None,
    stop_time: float | None = None,
    watch: Callable[[str], AbstractContextManager[Display]] = lambda run: nullcontext(Display()),
) -> Comparison:
    """Run an experiment as BxB, SxB, SxB+ and SxS, one after another, and compare them.

    Args:
        experiment: Name of a shipped experiment or path of an experiment's .toml, with the manoeuvre of ``two_wheel``.
        out: Folder for ``BxB``, ``SxB``, ``SxB+``, ``SxS`` (as :func:`orchestrator.simulate` leaves them), ``comparison.json``,
            ``comparison.md`` and the pictures; ``results/compare_<name>`` by default.
        soil: Name of a soil set or path of its .toml, for all runs.
        overrides: ``{"soil.phi": 0.6}``, for all runs.
        stop_time: End [s]; the experiment's own by default. Claims on what lies behind it are not reached.
        watch: Called with each run's name; a context that receives what :func:`orchestrator.simulate` reports.

    Raises:
        RunError: the experiment is a finished system, or has no front and rear wheel, or what tells the runs apart is set.
        ExperimentError, SlaveError: see :func:`orchestrator.simulate`.
        KeyboardInterrupt: a run was interrupted; the results up to there are kept.
    """
    from fmus import CLAIMS, TIERS  # with all models, which take a second

    from .experiment import meant_for, wheels_in

    experiment = Path(experiment)
    if experiment.suffix == ".ssp":
        raise RunError(f"{experiment.name} is a finished system, whose tiers cannot be changed: compare an experiment, such as two_wheel")
    if not set(WHEELS) <= set(wheels := wheels_in(experiment)):
        has = f"wheel{'s' if len(wheels) > 1 else ''} {', '.join(wheels)}"
        raise RunError(f"{experiment.stem} has the {has}: a comparison needs a front and a rear wheel, as two_wheel has them")
    if "bcm.compaction" in (overrides or {}):
        raise RunError("--set bcm.compaction: a comparison runs both, SxB without and SxB+ with it; leave it out")
    out = Path("results", f"compare_{experiment.stem}") if out is None else Path(out)
    claims = load_claims(CLAIMS)
    outcomes, results, courses = {}, {}, {}
    for run, (tiers, own) in DRIVES.items():
        with watch(run) as display:
            outcome = simulate(
                experiment,
                out / run,
                tiers=tiers,
                soil=soil,
                overrides=meant_for(tiers, TIERS, overrides) | own,
                stop_time=stop_time,
                progress=display.progress,
                status=display.status,
            )
        if outcome.status == "interrupted":
            raise KeyboardInterrupt
        outcomes[run], results[run] = outcome, open_result(outcome.result)
        courses[run] = Course(results[run])
    time_factors = {run: outcome.wall_s / outcomes["BxB"].wall_s for run, outcome in outcomes.items()}
    span = _common_span(list(courses.values()))
    rms = {run: _rms_differences(course, courses[REFERENCE], span) for run, course in courses.items() if run != REFERENCE}
    verdicts = judge(claims, courses, time_factors)
    with watch("pictures") as display:
        display.status("drawing")
        from .pictures import write

        pictures = write(results, out)
    comparison = Comparison(out, outcomes, time_factors, span, rms, verdicts, pictures)
    (out / "comparison.json").write_text(json.dumps(comparison.facts(), indent=2) + "\n", encoding="utf-8")
    (out / "comparison.md").write_text(_markdown(experiment.stem, comparison), encoding="utf-8")
    return comparison


def _common_span(courses: Sequence[Course]) -> tuple[float, float] | None:
    """First and last x [m] that all courses have."""
    if not all(course.x.size for course in courses):
        return None
    return max(float(course.x[0]) for course in courses), min(float(course.x[-1]) for course in courses)


def _rms_differences(course: Course, reference: Course, span: tuple[float, float] | None) -> dict[str, float]:
    """rms over the span of what a course is off the reference, by signal."""
    if span is None:
        return {}
    here, there = course.window(*span), reference.window(*span)
    differences = {name: course.signal(name)[here] - reference.signal(name)[there] for name in _FORCES_AND_PLACES}
    for name, wheel in _PATHS.items():
        # All of the reference's path: the front wheel is not at the same x at both ends of the span.
        differences[name] = KDTree(_path(reference, wheel)).query(_path(course, wheel)[here])[0]
    return {name: float(np.sqrt(np.mean(values**2))) for name, values in differences.items()}


def _path(course: Course, wheel: str) -> np.ndarray:
    """x and y of a wheel's centre [m], shape [n, 2]."""
    return np.column_stack([course.signal(f"{wheel}.x"), course.signal(f"{wheel}.y")])


def _unit(signal: str) -> str:
    return "m" if signal in _PATHS else SIGNALS[signal].unit


def _shown(value: float, unit: str) -> str:
    unit, factor = _SHOWN.get(unit, (unit, 1.0))
    return f"{value * factor:z.4g} {unit}".rstrip()


def _claim_facts(verdict: Verdict) -> dict:
    claim, finding = verdict.claim, verdict.finding
    facts = {"id": claim.id, "place": claim.place, "text": claim.text, "must": claim.must, "unit": claim.unit, "holds": verdict.holds}
    numbers = ("measured", "threshold", "noise", "left", "right")
    return facts | {
        "relation": None if finding is None else str(finding.relation),
        **{name: None if finding is None else getattr(finding, name) for name in numbers},
    }


def _markdown(name: str, comparison: Comparison) -> str:
    lines = [f"# {name}: {', '.join(comparison.outcomes)}", ""]
    for sheet in comparison.sheets():
        rows = [sheet.columns, ["---"] * len(sheet.columns), *([cell.replace("|", "\\|") for cell in row] for row in sheet.rows)]
        lines += [f"## {sheet.title}", "", *(f"| {' | '.join(row)} |" for row in rows), "", f"{sheet.note}.", ""]
    lines += ["## Pictures", ""]
    for path in comparison.pictures:
        figure = path.stem.removeprefix("fig_").replace("_", ".")
        lines += [f"![{path.stem}]({path.name})", "", f"As Fig. {figure}. {_CAPTIONS[path.stem]}.", ""]
    return "\n".join(lines) + "\n"
