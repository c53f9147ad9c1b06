"""Soil parameters and the sets shipped with the package: TOML files in which each value has a unit and a source."""

from __future__ import annotations

import difflib
import tomllib
from pathlib import Path

from ..slave.model import ModelError
from ..slave.records import Real, Record

_FOLDER = Path(__file__).parent
_DEFAULT = tomllib.loads((_FOLDER / "mss_d.toml").read_text(encoding="utf-8"))


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


def check_bearing(p) -> None:
    """Raise ModelError for a soil that bears nothing under the width of the wheel, by Bekker's law."""
    modulus = p.k_c / p.b_w + p.k_phi
    if modulus <= 0.0:
        least = f"a wheel wider than {-p.k_c / p.k_phi:.3g} m or " if p.k_phi > 0.0 else ""
        raise ModelError(
            f"k_c = {p.k_c:g} N/m^{p.n + 1:.4g}: k_c/b + k_phi {'<' if modulus < 0.0 else '='} 0 for wheel width b = {p.b_w:g} m; "
            f"use {least}another soil"
        )


class SoilError(ValueError):
    """A soil file is wrong; the message names the file, the key and the remedy."""


def shipped_soils() -> list[str]:
    """Names of the sets shipped with the package."""
    return sorted(path.stem for path in _FOLDER.glob("*.toml"))


def load_soil(name_or_path: str | Path) -> dict[str, float]:
    """Values of a shipped set (``"mss_d"``) or of a TOML file, ready as parameters: ``Instance(BCM(), **load_soil("mss_d"))``.

    Each parameter is a table ``[k_c]`` with ``value``, ``unit`` and ``source``; the unit must be the record's.

    Raises:
        SoilError: The set or file does not exist, or a key, value, unit, source or bound is wrong.
    """
    path = Path(name_or_path)
    if path.suffix != ".toml":
        path = _FOLDER / f"{name_or_path}.toml"
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except FileNotFoundError:
        raise SoilError(f"no soil set {str(name_or_path)!r}: use one of {', '.join(shipped_soils())} or the path of a .toml file") from None
    except tomllib.TOMLDecodeError as error:
        raise SoilError(f"{path.name} is no TOML file: {error}") from None
    for key in tables.keys() - SOIL.fields.keys() - {"title"}:
        near = difflib.get_close_matches(key, SOIL.fields, 1)
        remedy = f"did you mean {near[0]}?" if near else f"remove it; a soil has {', '.join(SOIL.fields)}"
        raise SoilError(f"{path.name}: unknown key {key!r}: {remedy}")
    return {key: _value(path.name, key, tables.get(key), field) for key, field in SOIL.fields.items()}


def _value(file: str, key: str, table: object, field: Real) -> float:
    example = f'write [{key}] with value = <number>, unit = "{field.unit}", source = "<where the number is from>"'
    if not isinstance(table, dict):
        raise SoilError(f"{file}: {key} ({field.description}) is missing: {example}")
    for part in ("value", "unit", "source"):
        if part not in table:
            raise SoilError(f"{file}: {key} has no {part}: {example}")
    value = table["value"]
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise SoilError(f"{file}: {key} = {value!r} is no number: {example}")
    if table["unit"] != field.unit:
        raise SoilError(f"{file}: {key} has the unit {table['unit']!r}: convert the value to {field.unit!r}")
    if not field.min <= value <= field.max:
        raise SoilError(f"{file}: {key} = {value:g} {field.unit}: it must be between {field.min:g} and {field.max:g} ({field.description})")
    return float(value)
