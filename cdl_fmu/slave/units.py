"""Unit strings such as ``kg.m2/s`` as the exponents of SI base units that FMI asks for."""

from __future__ import annotations

import re

# Symbol -> exponents of SI base units (FMI 2.0, section 2.2.2); only coherent SI units are used in the records.
_SYMBOLS = {
    "1": {},
    "kg": {"kg": 1},
    "m": {"m": 1},
    "s": {"s": 1},
    "rad": {"rad": 1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "Pa": {"kg": 1, "m": -1, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
    "W": {"kg": 1, "m": 2, "s": -3},
}
_FACTOR = re.compile(r"([A-Za-z]+|1)(-?\d+)?")


def base_unit(unit: str) -> dict[str, int] | None:
    """Exponents of the base units, or None where the unit has none (``N/m^(n+2)``: FMI 2.0 exponents are integers).

    Factors are joined by ``.``; all that follows a ``/`` is below the line. Raises ValueError for an unknown symbol.
    """
    if "^" in unit:
        return None
    exponents: dict[str, int] = {}
    for position, part in enumerate(unit.split("/")):
        sign = 1 if position == 0 else -1
        for factor in part.split("."):
            match = _FACTOR.fullmatch(factor)
            if match is None or match[1] not in _SYMBOLS:
                raise ValueError(f"unit {unit!r}: {factor!r} is none of {', '.join(_SYMBOLS)} with an integer exponent")
            for base, exponent in _SYMBOLS[match[1]].items():
                exponents[base] = exponents.get(base, 0) + sign * exponent * int(match[2] or 1)
    return {base: exponent for base, exponent in exponents.items() if exponent}
