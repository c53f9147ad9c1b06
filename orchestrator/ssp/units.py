"""Units as FMI and SSP define them, and the conversions between them."""

from __future__ import annotations

from dataclasses import dataclass

from fmpy.model_description import ModelDescription

from .archive import SspError
from .xml import Node

BASE_UNITS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")


@dataclass(frozen=True)
class Unit:
    """A unit: base value = factor * value + offset (FMI 2.0.4, section 2.2.2); ``exponents`` of BASE_UNITS, None where undefined."""

    name: str
    exponents: tuple[float, ...] | None = None
    factor: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class Transform:
    """What a value undergoes on its way: ``factor * value + offset``, which is in ``unit`` (None: not known)."""

    unit: Unit | None
    factor: float = 1.0
    offset: float = 0.0

    @property
    def is_identity(self) -> bool:
        return self.factor == 1.0 and self.offset == 0.0

    def into(self, unit: Unit | None, factor: float = 1.0, offset: float = 0.0, suppress_conversion: bool = False) -> Transform:
        """Followed by a conversion to ``unit`` and then a linear transformation (the order SSP 1.0 asks for).

        Raises ValueError, naming both units, if there is no conversion.
        """
        scale, shift = 1.0, 0.0
        if not suppress_conversion:
            if unit is None or self.unit is None:
                unit = unit or self.unit
            else:
                scale, shift = conversion(self.unit, unit)
        return Transform(unit, factor * scale * self.factor, factor * (scale * self.offset + shift) + offset)


def conversion(source: Unit, target: Unit) -> tuple[float, float]:
    """(factor, offset) that turn a value in ``source`` into one in ``target``. Raises ValueError, naming both, where there is none."""
    if source.exponents is None or target.exponents is None:
        if source.name == target.name:
            return 1.0, 0.0
        undefined = source if source.exponents is None else target
        raise ValueError(f"unit {source.name!r} to unit {target.name!r}: {undefined.name!r} has no base unit; define it")
    if source.exponents != target.exponents:
        raise ValueError(f"unit {source.name!r} ({_spelled(source)}) to unit {target.name!r} ({_spelled(target)}) is not the same quantity")
    if target.factor == 0:
        raise ValueError(f"unit {source.name!r} to unit {target.name!r}: the latter has factor 0; define it with another")
    return source.factor / target.factor, (source.offset - target.offset) / target.factor


def _spelled(unit: Unit) -> str:
    return ".".join(base + (f"{n:g}" if n != 1 else "") for base, n in zip(BASE_UNITS, unit.exponents) if n) or "1"


def units_of_file(root: Node) -> dict[str, Unit]:
    """Unit definitions of an SSD or a parameter set."""
    units = {}
    for node in root.children("Units", "Unit"):
        name, base = node.required("name"), node.child("BaseUnit")
        if base is None:
            raise SspError(f"{node.where}: unit {name!r} has no BaseUnit; add it")
        exponents = tuple(base.number(key, 0.0) for key in BASE_UNITS)
        units[name] = Unit(name, exponents, base.number("factor", 1.0), base.number("offset", 0.0))
    return units


def units_of_fmu(description: ModelDescription) -> dict[str, Unit]:
    """Unit definitions of an FMU."""
    units = {}
    for unit in description.unitDefinitions:
        base = unit.baseUnit
        exponents = tuple(int(getattr(base, key)) for key in BASE_UNITS) if base else None
        units[unit.name] = Unit(unit.name, exponents, float(base.factor), float(base.offset)) if base else Unit(unit.name)
    return units


def unit_of(node: Node, units: dict[str, Unit]) -> Unit | None:
    """Unit that an SSP element's ``unit`` attribute names. Raises SspError if its file does not define it."""
    name = node.get("unit")
    if name is None:
        return None
    if name not in units:
        raise SspError(f"{node.where}: unit {name!r} is not defined in {node.file}; add it to its Units")
    return units[name]
