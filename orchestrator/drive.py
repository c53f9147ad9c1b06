"""From an experiment or an SSP package to a folder with its results: what ``cdl run`` does."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory

from .measured import Measured
from .measurement import measure_result
from .particles import FOLDER, film_of
from .particles_picture import particles_picture
from .report import is_testbed, plot, summary
from .results import ResultError, open_result
from .run import Outcome, RunError, run
from .soil_map import soil_of
from .ssp import UNPACKED, System, read_system
from .wheels import carriage_of, dimensions_of, environment_of, ground_of, rocks_of, wheels_of

_TOOLS = ("cdl-fmu", "numba", "numpy", "mujoco-core", "FMPy", "pythonfmu")


def simulate(
    source: str | Path,
    out: str | Path | None = None,
    *,
    tiers: Sequence[str] | None = None,
    soil: str | Path | None = None,
    overrides: Mapping[str, object] | None = None,
    scheme: str | None = None,
    step: float | None = None,
    stop_time: float | None = None,
    checkpoint_every: float | None = None,
    resume: str | Path | None = None,
    particles_every: float | None = None,
    measured: Measured | None = None,
    native: bool = False,
    picture: bool = True,
    progress: Callable[[float, float], None] = lambda t, stop: None,
    status: Callable[[str], None] = lambda text: None,
) -> Outcome:
    """Run an experiment and leave ``system.ssp``, ``result.nc`` and ``result.png`` in a folder, with a DEM also ``particles.png``.

    Args:
        source: Name of a shipped experiment, path of an experiment's .toml, or of an .ssp package.
        out: Folder; ``results/<name>`` by default.
        tiers: Tier of each wheel, front first; experiments only.
        soil: Name of a soil set or path of its .toml; experiments only.
        overrides: ``{"soil.phi": 0.6}``; experiments only.
        scheme: Coupling scheme; the experiment's own or ``ij`` by default.
        step: Communication step [s]; the source's own by default.
        stop_time: End [s]; the source's own by default.
        checkpoint_every: Simulated time between checkpoints [s].
        resume: Checkpoint to go on from.
        particles_every: Simulated time between two looks at the particles of a DEM [s], each written as VTK files to ``particles/``.
        measured: Tests that are laid over the picture of a single-wheel testbed.
        native: Take native FMUs, where there are such, in place of those in Python; experiments only.
        picture: Whether to draw ``result.png``, and ``particles.png`` with a DEM, which takes seconds.
        progress: Called now and then with the time reached and the stop time [s].
        status: Called with what is being done before the run.

    Raises:
        ExperimentError, SspError, RunError, SlaveError: see there; each names what is wrong and the remedy.
    """
    source = Path(source)
    out = Path("results", source.stem) if out is None else Path(out)
    record_interval = None
    warnings: list[str] = []
    attributes: dict[str, object] = {"versions": {name: version(name) for name in _TOOLS}}
    # Not yet in ``out``: a run that is refused leaves the folder of an earlier one as it is.
    with TemporaryDirectory() as folder:
        if source.suffix == ".ssp":
            if tiers or soil or overrides or native:
                raise RunError(
                    f"--tiers, --soil, --set and --native change an experiment; {source.name} is a finished system: export it anew with "
                    "them"
                )
            package = source
        else:
            status("loading models")
            from .experiment import load_experiment  # the models' libraries take a second; an SSP does without

            experiment = load_experiment(source, tiers=tiers, soil=soil, overrides=overrides)
            settings = experiment.settings
            scheme, step = scheme or settings.scheme, settings.step if step is None else step
            record_interval = settings.record_interval
            attributes |= {"title": experiment.title, "experiment": experiment.text, "overrides": dict(overrides or {})}
            attributes["soil"] = str(soil or "")
            experiment.prepare(status)
            status("placing the wheels and building the FMUs; the first time, kernels are compiled")
            package = Path(folder, "system.ssp")
            experiment.write_system(package, native=native)
            warnings = experiment.warnings
            if stop_time is None:
                stop_time = settings.stop_time
        status("loading the FMUs")
        system = read_system(package, UNPACKED)
        attributes |= {"wheels": wheels_of(system), "ground_z": ground_of(system), "dimensions": dimensions_of(system)}
        attributes |= {"carriage": carriage_of(system), "environment": environment_of(system), "hard": rocks_of(system)}
        film = film_of(system, None if particles_every is None else out / FOLDER)
        if film is None and particles_every is not None:
            raise RunError(
                f"--particles-every {particles_every:g}: no wheel is on particles, only on {_tiers_of(system)}; put one on DEM, or leave "
                "the option out"
            )
        outcome = run(
            system,
            out,
            scheme=scheme or "ij",
            step=(system.step_size or 1e-3) if step is None else step,
            stop_time=stop_time,
            record_interval=record_interval,
            attributes=attributes,
            package=package,
            soil=soil_of(system),
            progress=progress,
            checkpoint_every=checkpoint_every,
            resume=None if resume is None else Path(resume),
            particles=film,
            particles_every=particles_every,
        )
    outcome.warnings[:0] = warnings
    try:
        if picture:
            plot(open_result(outcome.result), measured).savefig(out / "result.png")
            if film is not None and film.last is not None:
                particles_picture(film.last).savefig(out / "particles.png")
    except ResultError as error:  # a foreign system has no wheels to draw
        outcome.warnings.append(f"no picture: {error}")
    return outcome


def _tiers_of(system: System) -> str:
    return ", ".join(dict.fromkeys(str(wheel["tier"]) for wheel in wheels_of(system))) or "none of our tiers"


def facts_of(outcome: Outcome) -> dict[str, object]:
    """What a script wants to know of a run, as ``cdl run --json`` prints it; SI units.

    ``wheels`` is as :func:`.report.summary` has them; a testbed has what :meth:`.measurement.Measurement.facts` says instead. Rigid
    contacts add ``solver``: shares of the steps with contacts in which Lemke's method helped, or the tolerance was missed, largest error.
    """
    result = open_result(outcome.result)
    facts = {key: getattr(outcome, key) for key in ("simulated_s", "wall_s", "scheme", "step_s")} | {"result": str(outcome.result)}
    if is_testbed(result):
        return facts | measure_result(result).facts()
    facts |= {"wheels": summary(result) if json.loads(result.attrs["wheels"]) else []}
    hard = json.loads(result.attrs.get("hard", "{}")).get("instance")
    if hard and f"{hard}.residual" in result.cdl:
        solver = {name: float(result.cdl[f"{hard}.{name}"].values[-1]) for name in ("pivoted", "unsolved")}
        facts["solver"] = solver | {"residual_m_s": float(result.cdl[f"{hard}.residual"].values.max())}
    return facts
