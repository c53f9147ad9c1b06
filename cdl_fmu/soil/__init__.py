"""Soil parameters and the sets shipped with the package: TOML files in which each value has a unit and a source."""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Collection
from pathlib import Path

from ..slave.interface import ENVIRONMENT
from ..slave.model import Rule
from ..slave.records import Real, Record

_FOLDER = Path(__file__).parent
_DEFAULT = tomllib.loads((_FOLDER / "mss_d.toml").read_text(encoding="utf-8"))

_LIGHTEST = 100.0  # kg/m3

#: How parameters are measured.
_MEASURES = {
    frozenset(("k_c", "k_phi", "n")): "by plate tests (cdl identify plates.csv)",
    frozenset(("c", "phi", "K")): "by shear tests (cdl identify plates.csv --shear shear.csv)",
    frozenset(("rho",)): "by weighing a known volume",
}


def _soil(name: str, unit: str, description: str, low: float, high: float) -> Real:
    return Real(_DEFAULT[name]["value"], unit, description, min=low, max=high)


#: Soil of a contact; starts are MSS-D's. k_c may be negative: bearing pressure then grows with the plate's size.
SOIL = Record(
    k_c=_soil("k_c", "N/m^(n+1)", "Bekker's cohesive modulus of sinkage", -1e12, 1e12),
    k_phi=_soil("k_phi", "N/m^(n+2)", "Bekker's frictional modulus of sinkage", 0.0, 1e12),
    n=_soil("n", "1", "Bekker's exponent of sinkage", 0.0, 5.0),
    c=_soil("c", "Pa", "Cohesion", 0.0, 1e6),
    phi=_soil("phi", "rad", "Angle of internal friction", 0.0, 1.3),
    K=_soil("K", "m", "Shear displacement modulus of Janosi and Hanamoto", 1e-6, 10.0),
    rho=_soil("rho", "kg/m3", "Bulk density", 0.0, 1e4),
)


#: Density of a soil, which people give in g/cm3; 0 takes the soil's weight away.
RHO_RULE = Rule(
    f"rho = {{p.rho:g}} kg/m3: lighter than any soil; use at least {_LIGHTEST:g} kg/m3 (1 g/cm3 is 1000 kg/m3), or 0",
    lambda p: 0.0 < p.rho < _LIGHTEST,
)

_BEARING = "k_c = {p.k_c:g} N/m^{power:.4g}: k_c/b + k_phi %s 0 for wheel width b = {p.b_w:g} m; use %sanother soil"
_ABOVE_0 = "a wheel wider than {least:.3g} m or "
_TELL = dict(power=lambda p: p.n + 1.0, least=lambda p: -p.k_c / p.k_phi)

#: Soil that bears something under the width of the wheel, by Bekker's law.
BEARING_RULES = (
    Rule(_BEARING % ("<", _ABOVE_0), lambda p: p.k_c / p.b_w + p.k_phi < 0.0 < p.k_phi, _TELL),
    Rule(_BEARING % ("=", _ABOVE_0), lambda p: p.k_c / p.b_w + p.k_phi == 0.0 < p.k_phi, _TELL),
    Rule(_BEARING % ("<", ""), lambda p: p.k_c < 0.0 == p.k_phi, dict(power=_TELL["power"])),
    Rule(_BEARING % ("=", ""), lambda p: p.k_c == 0.0 == p.k_phi, dict(power=_TELL["power"])),
)


class SoilError(ValueError):
    """A soil file is wrong; the message names the file, the key and the remedy."""


def shipped_soils() -> list[str]:
    """Names of the sets shipped with the package."""
    return sorted(path.stem for path in _FOLDER.glob("*.toml"))


def load_soil(name_or_path: str | Path, given: Collection[str] = ()) -> dict[str, float]:
    """Values of a shipped set (``"mss_d"``) or of a TOML file, ready as parameters: ``Instance(BCM(), **load_soil("mss_d"))``.

    Each parameter is a table ``[k_c]`` with ``value``, ``unit`` and ``source``; the unit must be the record's. A table without value, or no
    table, says that the value is not known. ``title``, a table ``[gravity]`` of where the plates were tested, Earth without one, and a
    table ``[fit]``, of what an identification found, may stand beside them.

    Args:
        name_or_path: Name of a shipped set, or path of a file that ends in .toml.
        given: Parameters whose values come from elsewhere, so that the file may lack them; those it lacks are not returned.

    Raises:
        SoilError: The set or file does not exist, a value is missing, or a key, value, unit, source or bound is wrong.
    """
    file, tables = _read(name_or_path)
    values = {key: _value(file, key, tables[key], field) for key, field in SOIL.fields.items() if key in tables}
    known = {key: value for key, value in values.items() if value is not None}
    if missing := [key for key in SOIL.fields if key not in known and key not in given]:
        what = ", ".join(f"{key} ({SOIL.fields[key].description}, in {SOIL.fields[key].unit})" for key in missing)
        settings = " ".join(f"--set soil.{key}=<number>" for key in missing)
        how = " and ".join(measure for keys, measure in _MEASURES.items() if not keys.isdisjoint(missing))
        raise SoilError(f"{file} has no value for {what}: give {settings}, write them into the file with unit and source, or measure {how}")
    return known


def usable_widths(name_or_path: str | Path) -> tuple[float, float] | None:
    """Least and largest width [m] of wheels for which a soil file's fit is good; None if it has none. Raises SoilError as load_soil."""
    match _read(name_or_path)[1].get("fit", {}).get("widths"):
        case [int() | float() as low, int() | float() as high]:
            return float(low), float(high)
    return None


def plates_gravity(name_or_path: str | Path) -> float:
    """Acceleration of gravity [m/s2] at which a soil's plates were tested. Raises SoilError as load_soil."""
    file, tables = _read(name_or_path)
    field = ENVIRONMENT.fields["gravity"]
    value = _value(file, "gravity", tables["gravity"], field) if "gravity" in tables else None
    return field.start if value is None else value


def _read(name_or_path: str | Path) -> tuple[str, dict]:
    """Name of a soil's file, and what stands in it under known keys."""
    path = Path(name_or_path)
    if path.suffix != ".toml":
        path = _FOLDER / f"{name_or_path}.toml"
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except FileNotFoundError:
        raise SoilError(f"no soil set {str(name_or_path)!r}: use one of {', '.join(shipped_soils())} or the path of a .toml file") from None
    except tomllib.TOMLDecodeError as error:
        raise SoilError(f"{path.name} is no TOML file: {error}") from None
    for key in tables.keys() - SOIL.fields.keys() - {"title", "gravity", "fit"}:
        near = difflib.get_close_matches(key, SOIL.fields, 1)
        remedy = f"did you mean {near[0]}?" if near else f"remove it; a soil has {', '.join(SOIL.fields)}"
        raise SoilError(f"{path.name}: unknown key {key!r}: {remedy}")
    if not isinstance(tables.get("fit", {}), dict):
        raise SoilError(f"{path.name}: fit = {tables['fit']!r} is no table: write [fit] with what the identification found, or remove it")
    return path.name, tables


def _value(file: str, key: str, table: object, field: Real) -> float | None:
    """A parameter's value, None if its table has none."""
    example = f'write [{key}] with value = <number>, unit = "{field.unit}", source = "<where the number is from>"'
    if not isinstance(table, dict):
        raise SoilError(f"{file}: {key} = {table!r} is no table: {example}")
    for part in ("unit", "source"):
        if part not in table:
            raise SoilError(f"{file}: {key} has no {part}: {example}")
    for part in table.keys() - {"value", "unit", "source"}:
        raise SoilError(f"{file}: {key} has an unknown part {part!r}: {example}")
    if table["unit"] != field.unit:
        raise SoilError(f"{file}: {key} has the unit {table['unit']!r}: convert the value to {field.unit!r}")
    if "value" not in table:
        return None
    value = table["value"]
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise SoilError(f"{file}: {key} = {value!r} is no number: {example}")
    if not field.min <= value <= field.max:
        raise SoilError(f"{file}: {key} = {value:g} {field.unit}: it must be between {field.min:g} and {field.max:g} ({field.description})")
    return float(value)
