"""A soil set from a bevameter's tests: ``identify("plates.csv", "shear.csv").write("soil.toml")``.

What no test tells and nobody gives stays without value, and a run on the soil says so.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from ..slave.model import describe_violation
from . import SOIL
from .measurements import IdentifyError, read_plates, read_shear, spans
from .shear import Shear, fit_shear
from .sinkage import PARAMETERS, Sinkage, fit_sinkage

#: Bulk density [kg/m3] where none is given: quartz sand, 2650 kg/m3, that was poured to a void ratio of 0.9.
_RHO = 1400.0


@dataclass(frozen=True)
class Value:
    """A soil parameter [SI], None if it is missing; where it is from; standard errors by rows and by the scatter of tests, None without."""

    value: float | None
    source: str
    rows_error: float | None = None
    tests_error: float | None = None

    @property
    def sentence(self) -> str:
        """The source, with the standard errors."""
        errors = {"tests": self.tests_error, "rows": self.rows_error}
        said = ", ".join(f"{error:.3g} by {name}" for name, error in errors.items() if error is not None)
        return f"{self.source}; standard error {said}" if said else self.source


@dataclass(frozen=True, eq=False)
class Identification:
    """What was found.

    Attributes:
        plates_file, shear_file: Names of the files; the second None without.
        values: Every parameter of a soil.
        sinkage: The fit of the plates that the values are from.
        other: The same with an offset if ``sinkage`` has none, and the other way round; None if no offset can be told.
        shear: The fit of the shear tests, None without.
        notes: What the user should know.
    """

    plates_file: str
    shear_file: str | None
    values: dict[str, Value]
    sinkage: Sinkage
    other: Sinkage | None
    shear: Shear | None
    notes: list[str]

    @property
    def title(self) -> str:
        """What the picture and the soil file are called."""
        return "Soil identified from " + " and ".join(filter(None, (self.plates_file, self.shear_file)))

    @property
    def missing(self) -> list[str]:
        """Parameters without value."""
        return [key for key, value in self.values.items() if value.value is None]

    def fit(self) -> dict[str, object]:
        """Statistics of the fits [SI], as the soil file's table ``[fit]`` has them."""
        fit, names = self.sinkage, PARAMETERS[: len(self.sinkage.covariance)]
        facts: dict[str, object] = {
            "plates": self.plates_file,
            "goodness": fit.goodness,
            "correlation_k_n": fit.correlation,
            "b_crit": fit.b_crit,
            "widths": list(fit.widths),
            "z_window": list(fit.z_window),
            "p_window": list(fit.p_window),
            "parameters": list(names),
            "covariance": fit.covariance.tolist(),
            "standard_errors_by_rows": fit.standard_errors.tolist(),
        }
        if fit.over_tests is not None:
            facts["standard_errors_by_tests"] = fit.over_tests.tolist()
        facts["offset_is_applied"] = fit.has_offset
        if self.other is not None:
            other = self.other
            facts["with_offset" if other.has_offset else "without_offset"] = {
                **{name: getattr(other, name) for name in (*PARAMETERS, "goodness")},
                "standard_errors_by_rows": other.standard_errors.tolist(),
                **({} if other.over_tests is None else {"standard_errors_by_tests": other.over_tests.tolist()}),
            }
        facts["plate_tests"] = [
            {"test": one.test.name, "b": one.test.b, "rows": len(one.test.z), "outliers": one.outliers.tolist()}
            | {name: getattr(one, name) for name in ("n", "k", "goodness", "goodness_own")}
            for one in fit.plates
        ]
        if self.shear is not None:
            facts["shear"] = self.shear_file
            facts["shear_tests"] = [
                {"test": one.test.name, "p": one.test.p, "tau_max": one.tau_max, "K": one.K, "K_standard_error": one.K_error}
                for one in self.shear.tests
            ]
        return facts

    def write(self, path: str | Path) -> None:
        """Write the soil file, for ``[soil] set = "soil.toml"`` and :func:`cdl_fmu.load_soil`."""
        lines = [f"title = {_toml(self.title)}"]
        for key, value in self.values.items():
            lines += ["", f"[{key}]"]
            if value.value is not None:
                lines.append(f"value = {_toml(value.value)}")
            lines += [f"unit = {_toml(SOIL.fields[key].unit)}", f"source = {_toml(value.sentence)}"]
        lines += ["", "[fit] # of the tests; a run takes the widths from here, nothing else"]
        for key, fact in self.fit().items():
            if isinstance(fact, list) and fact and isinstance(fact[0], dict):
                lines += [f"{key} = [", *(f"  {_toml(one)}," for one in fact), "]"]
            else:
                lines.append(f"{key} = {_toml(fact)}")
        Path(path).write_text("\n".join(lines) + "\n", encoding="utf-8")


def identify(
    plates: str | Path,
    shear: str | Path | None = None,
    *,
    k_c: float | None = None,
    c: float | None = None,
    phi: float | None = None,
    K: float | None = None,
    rho: float | None = None,
    apply_offset: bool = False,
) -> Identification:
    """Find the parameters of a soil from plate tests and shear tests.

    Args:
        plates, shear: CSV files, see :func:`.measurements.read_plates` and :func:`.measurements.read_shear`.
        k_c, c, phi, K, rho: Values that are given, in the soil's units, and win over the tests; what else is fitted, is fitted with them.
        apply_offset: Take the law of sinkage with the fitted depth at which the plates touched, not the one of z as it is in the file.

    Raises:
        IdentifyError: A file or value is wrong, or does not tell the parameters.
        OSError: A file cannot be read.
    """
    given = {key: float(value) for key, value in dict(k_c=k_c, c=c, phi=phi, K=K, rho=rho).items() if value is not None}
    for key, value in given.items():
        if said := _violation(key, value):
            hint = f"; {value:g} deg are {math.radians(value):.4g} rad" if key == "phi" and value > SOIL.fields["phi"].max else ""
            raise IdentifyError(f"{_option(key)}: {said}{hint}")
    plates = Path(plates)
    sinkage, other, notes = _fit_plates(plates, given.get("k_c"), apply_offset)
    values = _of_sinkage(plates.name, sinkage)
    sheared = None
    if shear is not None:
        shear = Path(shear)
        tests, said = read_shear(shear)
        notes += said
        with _about(shear):
            sheared, said = fit_shear(tests, given.get("c"), given.get("phi"))
        notes += [f"{shear.name}: {note}" for note in said]
        values |= _of_shear(shear.name, sheared)
    for key, value in given.items():
        if key in values:
            notes.append(f"{key} = {value:g} {SOIL.fields[key].unit} is given and wins over the tests")
        values[key] = Value(value, f"given, {_option(key)}")
    for key, value in values.items():
        if said := _violation(key, value.value):
            raise IdentifyError(f"{shear.name if key in ('c', 'phi', 'K') else plates.name}: the tests give {said}; check the columns")
    values.setdefault("rho", Value(_RHO, "assumption: poured dry sand; not measured, give --rho: sheared soil bears in proportion to it"))
    lacking = "missing: no shear tests were given; measure it (cdl identify --shear), give {}, or set soil.{} in the experiment"
    values = {key: values.get(key) or Value(None, lacking.format(_option(key), key)) for key in SOIL.fields}
    return Identification(plates.name, None if shear is None else shear.name, values, sinkage, other, sheared, notes)


def _fit_plates(plates: Path, k_c: float | None, apply_offset: bool) -> tuple[Sinkage, Sinkage | None, list[str]]:
    """The fit that is taken, the other one, and what the user should know."""
    tests, notes = read_plates(plates)
    other, more = None, []
    with _about(plates):
        taken, said = fit_sinkage(tests, k_c, apply_offset)
        try:
            other, _ = fit_sinkage(tests, k_c, not apply_offset)
        except IdentifyError as error:
            more = [str(error)]
    for one in taken.plates:
        if one.outliers.size:
            where = spans(one.outliers)
            more.append(f"test {one.test.name} has outliers, 3 robust standard deviations off its own law, kept: {where}")
    return taken, other, notes + [f"{plates.name}: {note}" for note in (*said, *more)]


def _of_sinkage(file: str, fit: Sinkage) -> dict[str, Value]:
    diameters = ", ".join(f"{2e3 * b:g}" for b in fit.radii)
    tests = f"{len(fit.plates)} plate test{'s' if len(fit.plates) > 1 else ''} ({diameters} mm)"
    method = f"{file}: Wong's weighted fit of {tests}"
    if fit.has_offset:
        method += f", z counted from {1e3 * fit.offset:.4g} mm, where the plates touched by the fit"
    found = {}
    for i, key in enumerate(PARAMETERS[:3]):
        tests_error = None if fit.over_tests is None else float(fit.over_tests[i])
        found[key] = Value(getattr(fit, key), method, float(fit.standard_errors[i]), tests_error)
    if fit.k_phi == 0.0:
        found["k_phi"] = Value(0.0, f"{method}; set to 0, as the fit would have it negative")
    return found


def _of_shear(file: str, fit: Shear) -> dict[str, Value]:
    tests = f"{len(fit.tests)} shear test{'s' if len(fit.tests) > 1 else ''}"
    found = {}
    for key, method in (("c", "line through the strengths"), ("phi", "line through the strengths"), ("K", "Wong's K")):
        found[key] = Value(getattr(fit, key), f"{file}: {method} of {tests}", None, getattr(fit, f"{key}_error"))
    if fit.c == 0.0:
        found["c"] = Value(0.0, f"{file}: {tests}; set to 0, as the line through the strengths would have it negative")
    return found


def _option(key: str) -> str:
    return f"--{key.replace('_', '-')}"


def _violation(key: str, value: float) -> str:
    """What is wrong with a value for a soil, "" if nothing is."""
    (scalar,) = (scalar for scalar in SOIL.scalars() if scalar.name == key)
    return "" if scalar.field.min <= value <= scalar.field.max else describe_violation(scalar, value)


@contextmanager
def _about(path: Path) -> Iterator[None]:
    """Put the file's name before what is wrong with its tests."""
    try:
        yield
    except IdentifyError as error:
        raise IdentifyError(f"{path.name}: {error}") from None


def _toml(value: object) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {_toml(one)}" for key, one in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    return str(value).lower() if isinstance(value, bool) else repr(value)
