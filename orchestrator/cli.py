"""The command line ``cdl``: reads options, calls the library, prints. Whatever is slow to import is imported inside a command."""

from __future__ import annotations

import json
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Literal

import typer

from .assignments import values_of
from .cli_build import build
from .cli_identify import identify
from .cli_particles import study, virtual
from .cli_remote import remote, serve
from .cli_sweep import measured_in, run_sweeps
from .cli_validate import validate
from .refusals import Commands, require_platform, say

_EXAMPLES = {
    "run": "cdl run two_wheel --tiers BCM,BCM --stop-time 2 --set soil.phi=0.6",
    "sweep": 'cdl run single_wheel --set "slip=[0,0.2,0.4]" --set tier=BCM --soil lunar_nominal',
    "compare": "cdl compare two_wheel --out results/compare",
    "build": "cdl build cdl_scm_w4b1 --file body[1].mesh=rock.stl --out my_fmus",
    "info": "cdl info cdl_bcm_w2",
    "plot": "cdl plot results/two_wheel -o drive.pdf",
    "export": "cdl export two_wheel -o rover.ssp",
    "serve": "cdl serve rover.ssp scm --port 9000",
    "remote": "cdl remote rover.ssp scm=127.0.0.1:9000 -o remote.ssp",
    "diff": "cdl diff results/two_wheel baseline.nc --rtol 1e-6",
    "identify": "cdl identify plates.csv --shear shear.csv --rho 1600 -o sand.toml",
    "virtual": "cdl virtual mss_d --out results/virtual_mss_d",
    "validate": "cdl validate --quick --out results/validation",
    "doctor": "cdl doctor",
}

app = typer.Typer(
    cls=Commands,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="\n\n".join(["Examples:", *_EXAMPLES.values()]),
)

Tiers = Annotated[str | None, typer.Option(metavar="FRONT,REAR", help="Contact model of each wheel, in place of the experiment's.")]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="A value in place of the experiment's, e.g. soil.phi=0.6; may be repeated."),
]
Soil = Annotated[str | None, typer.Option(metavar="SET|FILE", help="Soil set, by name or .toml file, in place of the experiment's.")]
StopTime = Annotated[float | None, typer.Option(metavar="S", help="End of the run, in s.")]
MeasuredTable = Annotated[
    Path | None, typer.Option("--measured", metavar="CSV", help="Tests to lay over a testbed's picture: slip, beta_deg, Fx_N, Fy_N, ...")
]
Native = Annotated[bool, typer.Option("--native", help="FMUs that need no Python, where there are such.")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of progress and tables.")]
Scheme = Literal["ij", "ij-free", "gs-mid", "gs", "jacobi", "aitken"]
Result = Annotated[Path, typer.Argument(metavar="RESULT", help="result.nc, or the folder of a run.")]


def _show_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        print(f"cdl-fmu {version('cdl-fmu')}")
        raise typer.Exit


@app.callback()
def main(
    version: Annotated[bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version and exit.")] = False,
) -> None:
    """Contact Dynamics Library: wheel-ground contact for planetary rovers as co-simulation FMUs."""


@app.command(epilog=f"Examples:  {_EXAMPLES['run']}\n\n{_EXAMPLES['sweep']}")
def run(
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE",
            help="A shipped experiment (two_wheel, rocks_in_sand, single_wheel), an experiment's .toml, or an .ssp package.",
        ),
    ],
    tiers: Tiers = None,
    soil: Soil = None,
    settings: Settings = None,
    stop_time: StopTime = None,
    step: Annotated[float | None, typer.Option(metavar="S", help="Communication step, in s.")] = None,
    scheme: Annotated[Scheme | None, typer.Option(help="How the FMUs are coupled. Default: the experiment's, else ij.")] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="DIR", help="Folder to write. Default: results/<name>, or the checkpoint's.")
    ] = None,
    checkpoint_every: Annotated[float | None, typer.Option(metavar="S", help="Simulated time between checkpoints, in s.")] = None,
    resume: Annotated[Path | None, typer.Option(metavar="CHECKPOINT", help="Go on from a checkpoint, with the options of its run.")] = None,
    particles_every: Annotated[
        float | None, typer.Option(metavar="S", help="Simulated time between particles of a DEM in VTK files, particles/*, in s.")
    ] = None,
    measured: MeasuredTable = None,
    native: Native = False,
    as_json: Json = False,
) -> None:
    """Run an experiment or a system of FMUs; leaves result.nc, system.ssp and result.png in a folder, with a DEM also particles.png.

    On a single-wheel testbed a list of values sweeps its key, e.g. --set "slip=[0,0.2,0.4]".
    """
    require_platform()
    from .drive import facts_of, simulate
    from .summaries import print_run
    from .terminal import follow

    options = dict(soil=soil, overrides=values_of(settings), scheme=scheme, step=step, stop_time=stop_time)
    options |= dict(particles_every=particles_every, native=native)
    if Path(source).suffix != ".ssp":
        given = options | ({"tiers": _tiers(tiers)} if tiers else {})
        if run_sweeps(source, out, given, measured, as_json, checkpoints=checkpoint_every is not None or resume is not None):
            return
    if out is None and resume is not None:
        out = resume.parent
    with follow(quiet=as_json) as display:
        outcome = simulate(
            source,
            out,
            **options,
            tiers=_tiers(tiers),
            checkpoint_every=checkpoint_every,
            resume=resume,
            measured=measured_in(measured),
            progress=display.progress,
            status=display.status,
        )
    facts = facts_of(outcome)
    if as_json:
        print(json.dumps(facts))
    else:
        print_run(outcome, facts, resumed=resume is not None)
    for warning in outcome.warnings:
        say(f"warning: {warning}")
    if outcome.status == "interrupted":
        say(f"interrupted at t = {outcome.simulated_s:g} s; all steps so far are in {outcome.result}")
        raise typer.Exit(130)


@app.command(epilog=f"Example:  {_EXAMPLES['compare']}")
def compare(
    experiment: Annotated[str, typer.Argument(metavar="EXPERIMENT", help="A shipped experiment (two_wheel), or an experiment's .toml.")],
    soil: Soil = None,
    settings: Settings = None,
    stop_time: StopTime = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="DIR", help="Folder to write. Default: results/compare_<name>.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Run an experiment with BCM, with SCM in front, that with compaction, and with SCM; measure what the chapter's section 8.5 says."""
    require_platform()
    from .compare import compare as compare_runs
    from .terminal import follow, output, table

    comparison = compare_runs(
        experiment, out, soil=soil, overrides=values_of(settings), stop_time=stop_time, watch=lambda run: follow(quiet=as_json, run=run)
    )
    if as_json:
        print(json.dumps(comparison.facts()))
    else:
        console = output()
        for sheet in comparison.sheets():
            shown = [i for i, column in enumerate(sheet.columns) if console.width >= 120 or column not in sheet.wide]
            rows = table(*(sheet.columns[i] for i in shown))
            for row in sheet.rows:
                rows.add_row(*(row[i] for i in shown))
            console.print(sheet.title, rows, sheet.note, "", sep="\n")
        print(*(comparison.out / name for name in ("comparison.json", "comparison.md")), *comparison.pictures, sep="\n")
    for run, outcome in comparison.outcomes.items():
        for warning in outcome.warnings:
            say(f"warning: {run}: {warning}")


@app.command(epilog=f"Example:  {_EXAMPLES['info']}")
def info(
    what: Annotated[str, typer.Argument(metavar="FMU|RESULT", help="An .fmu of any tool, a shipped FMU's name, or a result.")],
) -> None:
    """Show an FMU's parameters, inputs and outputs, or what a result holds."""
    from .info import describe
    from .terminal import output

    output().print(*describe(what), sep="\n")


@app.command(epilog=f"Example:  {_EXAMPLES['plot']}")
def plot(
    result: Result,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="FILE", help="Picture to write, .png, .pdf or .svg. Default: beside the result.")
    ] = None,
    measured: MeasuredTable = None,
) -> None:
    """Draw a result: forces and sinkage of the wheels, and their paths; or a sweep (sweep.json, or its folder)."""
    from .measurement import SWEEP, open_sweep
    from .report import plot as draw
    from .results import FILE_NAME, open_result

    tests = measured_in(measured)
    if result.suffix == ".json" or (not (result / FILE_NAME).exists() and (result / f"{SWEEP}.json").exists()):
        from .testbed_picture import sweep_picture

        sweep = open_sweep(result)
        figure = sweep_picture(sweep["swept"], sweep["runs"], tests)
        out = _prepared(out or (result / SWEEP if result.is_dir() else result).with_suffix(".png"))
    else:
        figure = draw(open_result(result), tests)
        out = _prepared(out or _beside(result, ".png"))
    if out.suffix[1:] not in figure.canvas.get_supported_filetypes():
        raise typer.BadParameter(f"{out}: choose a name that ends in .png, .pdf or .svg", param_hint="--out")
    figure.savefig(out)
    print(out)


@app.command(epilog=f"Example:  {_EXAMPLES['export']}")
def export(
    source: Annotated[str, typer.Argument(metavar="EXPERIMENT|RESULT", help="An experiment, to become an SSP package, or a result.")],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="FILE", help="File to write. Default: <experiment>.ssp, or beside the result.")
    ] = None,
    csv: Annotated[bool, typer.Option("--csv", help="Write a result as CSV, as FMPy does.")] = False,
    mat: Annotated[bool, typer.Option("--mat", help="Write a result as MAT trajectories for Modelica tools.")] = False,
    unpacked: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write an experiment as unpacked FMUs and a plain text table, for hosts without SSP.")
    ] = None,
    tiers: Tiers = None,
    soil: Soil = None,
    settings: Settings = None,
    native: Native = False,
) -> None:
    """Write an experiment as an SSP package or unpacked for other tools, or a result as CSV or MAT."""
    if csv + mat + (unpacked is not None) > 1 or (unpacked and out):
        raise typer.BadParameter("choose one of them", param_hint="--csv, --mat, --unpacked (which names its own folder)")
    if csv or mat:
        from .export import to_csv, to_mat
        from .results import open_result

        out = _prepared(out or _beside(Path(source), ".csv" if csv else ".mat"))
        (to_csv if csv else to_mat)(open_result(source), out)
    elif Path(source).is_dir() or Path(source).suffix == ".nc":
        raise typer.BadParameter(f"{source} is a result: add --csv or --mat", param_hint="EXPERIMENT|RESULT")
    else:
        from .experiment import load_experiment

        experiment = load_experiment(source, tiers=_tiers(tiers), soil=soil, overrides=values_of(settings))
        if unpacked:
            from .unpacked import write_unpacked

            out = unpacked
            with TemporaryDirectory() as folder:
                package = Path(folder, "system.ssp")
                experiment.write_system(package, native=native)
                write_unpacked(package, unpacked)
        else:
            out = _prepared(out or Path(f"{experiment.name}.ssp"))
            experiment.write_system(out, native=native)
        for warning in experiment.warnings:
            say(f"warning: {warning}")
    print(out)


@app.command(epilog=f"Example:  {_EXAMPLES['diff']}")
def diff(
    result: Result,
    baseline: Annotated[Path, typer.Argument(metavar="BASELINE", help="The result to compare with.")],
    rtol: Annotated[float, typer.Option(metavar="R", min=0.0, help="Allowed difference, relative to each signal's largest magnitude.")],
    atol: Annotated[float, typer.Option(metavar="A", min=0.0, help="Allowed difference in each signal's unit.")] = 0.0,
) -> None:
    """Compare a result with a baseline: exit code 0 if they agree, 1 with the first signal and time that differ."""
    from .results import open_result
    from .results_diff import diff_results

    found = diff_results(open_result(result), open_result(baseline), rtol, atol)
    print(found or f"{result} agrees with {baseline} (rtol {rtol:g}, atol {atol:g})")
    raise typer.Exit(1 if found else 0)


app.command(epilog=f"Example:  {_EXAMPLES['build']}")(build)
app.command(epilog=f"Example:  {_EXAMPLES['serve']}")(serve)
app.command(epilog=f"Example:  {_EXAMPLES['remote']}")(remote)
app.command(epilog=f"Example:  {_EXAMPLES['identify']}")(identify)
app.command(epilog=f"Example:  {_EXAMPLES['validate']}")(validate)
app.command(epilog=f"Example:  {_EXAMPLES['virtual']}")(virtual)
app.add_typer(study, name="study")


@app.command(epilog=f"Example:  {_EXAMPLES['doctor']}")
def doctor() -> None:
    """Check that this machine can build and run FMUs; exit code 1 if not, with what to do."""
    from .doctor import examine
    from .terminal import output

    console, failed = output(), 0
    for finding in examine():
        console.print(f"{finding.state:6} ", end="", style={"ok": "green", "note": "yellow", "failed": "bold red"}[finding.state])
        console.print(f"{finding.what}: {finding.detail}", soft_wrap=True)
        if finding.remedy:
            console.print(f"       {finding.remedy}", soft_wrap=True)
        failed += finding.state == "failed"
    console.print(f"{failed} failed" if failed else "all is well", style="bold")
    raise typer.Exit(1 if failed else 0)


def _tiers(text: str | None) -> list[str] | None:
    return None if text is None else [tier.strip() for tier in text.split(",")]


def _beside(result: Path, suffix: str) -> Path:
    from .results import FILE_NAME

    return (result / FILE_NAME if result.is_dir() else result).with_suffix(suffix)


def _prepared(out: Path) -> Path:
    """``out``, its folder made if needed."""
    out.parent.mkdir(parents=True, exist_ok=True)
    return out
