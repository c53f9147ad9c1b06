"""The command ``cdl identify``: reads options, calls the library, prints. What is slow to import is imported inside."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

_GIVEN = "; wins over the shear tests."


def identify(
    plates: Annotated[Path, typer.Argument(metavar="PLATES", help="CSV of plate tests: columns test, plate_diam_mm, z_mm, p_Pa.")],
    shear: Annotated[Path | None, typer.Option(metavar="FILE", help="CSV of shear tests: columns test, p_Pa, j_mm, tau_Pa.")] = None,
    c: Annotated[float | None, typer.Option("--c", metavar="PA", help="Cohesion" + _GIVEN)] = None,
    phi: Annotated[float | None, typer.Option("--phi", metavar="RAD", help="Angle of internal friction" + _GIVEN)] = None,
    K: Annotated[float | None, typer.Option("--K", metavar="M", help="Shear displacement modulus" + _GIVEN)] = None,
    k_c: Annotated[
        float | None, typer.Option("--k-c", metavar="N/M^(N+1)", help="Cohesive modulus of sinkage; needed with plates of one size.")
    ] = None,
    rho: Annotated[float | None, typer.Option("--rho", metavar="KG/M3", help="Bulk density; no test tells it.")] = None,
    apply_offset: Annotated[
        bool, typer.Option("--apply-offset", help="Count sinkage from where the fit says that the plates touched, not from z = 0.")
    ] = False,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="Soil file to write; a picture goes beside it.")] = Path(
        "soil.toml"
    ),
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of tables.")] = False,
) -> None:
    """Find a soil's parameters from plate and shear tests; leaves a soil file and a picture of the fits."""
    if out.suffix != ".toml":
        raise typer.BadParameter(f"{out}: choose a name that ends in .toml", param_hint="--out")
    from cdl_fmu.soil import SOIL
    from cdl_fmu.soil.identify import identify as find

    from .soil_picture import figure

    found = find(plates, shear, k_c=k_c, c=c, phi=phi, K=K, rho=rho, apply_offset=apply_offset)
    out.parent.mkdir(parents=True, exist_ok=True)
    found.write(out)
    picture = out.with_suffix(".png")
    figure(found).savefig(picture)
    if as_json:
        values = {
            key: {
                "value": value.value,
                "unit": SOIL.fields[key].unit,
                "source": value.sentence,
                "standard_error_by_rows": value.rows_error,
                "standard_error_by_tests": value.tests_error,
            }
            for key, value in found.values.items()
        }
        print(json.dumps({"soil": str(out), "picture": str(picture), "values": values, "fit": found.fit(), "notes": found.notes}))
        return
    _show(found)
    print(out, picture, sep="\n")
    if found.missing:
        settings = " ".join(f"--set soil.{key}=..." for key in found.missing)
        print(f"a run on it needs what is missing: --set soil.set={out} {settings}")


def _show(found) -> None:
    from cdl_fmu.soil import SOIL

    from .terminal import output, table

    def show(first: str, *numbers: str, text: str = "", rows) -> None:
        made = table(first, *numbers, *([text] if text else []), right=numbers)
        for row in rows:
            made.add_row(*row)
        console.print(made)

    console, fit = output(), found.sinkage
    wide = console.width >= 120
    show(
        "soil",
        "value",
        "+- by tests",
        "+- by rows",
        text="unit, and source" if wide else "unit",
        rows=(
            (
                key,
                *(_number(x, digits) for x, digits in ((value.value, 6), (value.tests_error, 3), (value.rows_error, 3))),
                f"{SOIL.fields[key].unit:9}  {value.source}" if wide else SOIL.fields[key].unit,
            )
            for key, value in found.values.items()
        ),
    )
    show(
        "plate test",
        "diameter [mm]",
        "rows",
        "own n",
        "goodness",
        "of its own law",
        rows=(
            (
                one.test.name,
                *(f"{2e3 * one.test.b:g}", str(len(one.test.z)), f"{one.n:.3f}"),
                *(f"{x:.3f}" for x in (one.goodness, one.goodness_own)),
            )
            for one in fit.plates
        ),
    )
    if found.shear is not None:
        show(
            "shear test",
            "p [kPa]",
            "tau_max [kPa]",
            "K [mm]",
            "+-",
            rows=(
                (one.test.name, *(f"{1e-3 * x:.3f}" for x in (one.test.p, one.tau_max)), *(f"{1e3 * x:.2f}" for x in (one.K, one.K_error)))
                for one in found.shear.tests
            ),
        )
    print(*_sentences(found), *(f"note: {note}" for note in found.notes), sep="\n")


def _sentences(found) -> list[str]:
    fit, other = found.sinkage, found.other
    (z_low, z_high), (low, high) = ([1e3 * x for x in window] for window in (fit.z_window, fit.widths))
    p_low, p_high = (1e-3 * x for x in fit.p_window)
    said = [
        f"goodness {fit.goodness:.3f} of the common law, z from {z_low:.3g} to {z_high:.3g} mm, p from {p_low:.3g} to {p_high:.3g} kPa; "
        f"k and n correlate by {fit.correlation:.4f}",
        f"good for wheels {low:.3g} to {high:.3g} mm wide"
        + (f"; bears nothing below b_crit = {1e3 * fit.b_crit:.3g} mm" if fit.b_crit > 0.0 else ""),
    ]
    if other is not None:
        moved = fit if fit.has_offset else other
        error, by = (moved.standard_errors, "rows") if moved.over_tests is None else (moved.over_tests, "tests")
        place = f"the plates touched at z = {1e3 * moved.offset:.3g} mm (+- {1e3 * error[3]:.2g} mm by {by})"
        end = "applied; without," if fit.has_offset else "not applied (--apply-offset); with it,"
        said.append(f"offset: by the fit {place}; {end} n = {other.n:.4g}, goodness {other.goodness:.3f}")
    return said


def _number(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}g}"
