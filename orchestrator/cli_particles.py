"""The commands ``cdl virtual`` and ``cdl study``: read options, call the library, print. What is slow to import is imported inside."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Annotated

import typer

from .refusals import require_platform

study = typer.Typer(help="Studies that regenerate their figures and tables.", no_args_is_help=True)

Soil = Annotated[str, typer.Argument(metavar="SOIL", help="Name of a soil set (mss_d), or path of its .toml: phi, c and rho are taken.")]
Porosity = Annotated[float, typer.Option(metavar="SHARE", help="Porosity of the bed.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of progress and tables.")]


def virtual(
    soil: Soil = "mss_d",
    porosity: Porosity = 0.43,
    d: Annotated[float, typer.Option("--d", metavar="M", help="Mean diameter of the particles.")] = 0.008,
    seeds: Annotated[int, typer.Option(min=1, help="Beds on which the angle of repose is measured.")] = 2,
    threads: Annotated[int, typer.Option(min=1, help="Threads.")] = 1,
    out: Annotated[Path | None, typer.Option("--out", "-o", metavar="DIR", help="Folder. Default: results/virtual_<soil>.")] = None,
    as_json: AsJson = False,
) -> None:
    """Test a soil as particles: direct shear, angle of repose, plates; leaves files that cdl identify reads, and the soil it finds."""
    require_platform()
    from .terminal import follow, output, table
    from .virtual import PLATES, SHEAR, SOIL_FILE, angle_of_repose, run_virtual_tests

    folder = out or Path("results", f"virtual_{Path(soil).stem}")
    given = _given(soil, porosity)
    with follow(quiet=as_json) as display:
        found = run_virtual_tests(given, folder, d=d, seeds=seeds, threads=threads, status=display.status)
    if as_json:
        print(json.dumps(found.facts() | {"out": str(folder)}))
        return
    values = {key: value.value for key, value in found.found.values.items()}
    angle, deviation = angle_of_repose(found.repose)
    rows = table("", "given", "found", right=("given", "found"))
    rows.add_row("phi [deg], direct shear", f"{math.degrees(given['phi']):.1f}", f"{math.degrees(values['phi']):.1f}")
    rows.add_row("c [Pa]", f"{given['c']:.3g}", f"{values['c']:.3g}")
    scatter = "" if math.isnan(deviation) else f" ± {deviation:.1f}"
    rows.add_row("angle of repose [deg]", f"{math.degrees(given['phi']):.1f}", f"{angle:.1f}{scatter}")
    bekker = _bekker(soil)
    for diameter, p in found.pressure.items():
        expected = "" if bekker is None else f"{_pressure(bekker, 0.5 * diameter):.0f}"
        rows.add_row(f"pressure at 20 mm, plate of {1e3 * diameter:g} mm [Pa]", expected, f"{p:.0f}")
    rows.add_row("k_c [N/m^(n+1)], k_phi [N/m^(n+2)], n", "", f"{values['k_c']:.4g}, {values['k_phi']:.4g}, {values['n']:.3f}")
    output().print(rows)
    print(*(folder / name for name in (PLATES, SHEAR, SOIL_FILE)), sep="\n")


@study.command()
def tiers(
    soil: Soil = "mss_d",
    porosity: Porosity = 0.43,
    processes: Annotated[int | None, typer.Option(min=1, help="Runs side by side. Default: one for each core.")] = None,
    slips: Annotated[str, typer.Option(metavar="LIST", help="Slips, with commas between.")] = "",
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Folder.")] = Path("results", "study_tiers"),
    as_json: AsJson = False,
) -> None:
    """One wheel over one soil on DEM, SCM and BCM, Bekker's parameters from the particles' own bevameter; leaves figure and table."""
    require_platform()
    from .refusals import say
    from .study_tiers import SLIPS, TABLE, study_tiers
    from .terminal import follow

    try:
        chosen = [float(slip) for slip in slips.split(",")] if slips else list(SLIPS)
    except ValueError:
        raise typer.BadParameter(f"{slips!r}: give numbers with commas between, -0.5,0,0.5", param_hint="--slips") from None
    with follow(quiet=as_json) as display:
        done = study_tiers(_given(soil, porosity), out, slips=chosen, processes=processes, status=display.status)
    if as_json:
        print(json.dumps({"out": str(out), "soil": done.soil.facts(), **done.sweep.facts()}))
        return
    print(done.table(), out / TABLE, out / "sweep.png", sep="\n")
    for warning in done.sweep.warnings:
        say(f"warning: {warning}")


def _given(soil: str, porosity: float) -> dict[str, float]:
    from cdl_fmu.soil import SOIL, SoilError, load_soil

    known = load_soil(soil, given=SOIL.fields)
    if missing := [key for key in ("phi", "c", "rho") if key not in known]:
        what = ", ".join(f"{key} ({SOIL.fields[key].description}, in {SOIL.fields[key].unit})" for key in missing)
        raise SoilError(f"{soil} has no value for {what}: write them into the file with unit and source")
    return {key: known[key] for key in ("phi", "c", "rho")} | {"porosity": porosity}


def _bekker(soil: str) -> dict[str, float] | None:
    from cdl_fmu.soil import load_soil

    known = load_soil(soil, given=("k_c", "k_phi", "n", "K"))
    return known if {"k_c", "k_phi", "n"} <= known.keys() else None


def _pressure(soil: dict[str, float], radius: float) -> float:
    from .virtual import COMPARED

    return (soil["k_c"] / radius + soil["k_phi"]) * COMPARED ** soil["n"]
