"""Records: the one declaration of a model's parameters, inputs, state and outputs.

A :class:`Record` names fields (:class:`Real`, :class:`Choice`), nested records and arrays of records. From it come the NumPy
dtype that the kernels read and write, the FMI scalar variables with unit, bounds and description, and the checks of values.
Everything is stored as float64, so a model's memory is one block and a value reference is an offset into it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product, takewhile

import numpy as np


@dataclass(frozen=True)
class Real:
    """A real number or array of them: start value, unit, description, shape, bounds (inclusive), and names that people give to values."""

    start: object
    unit: str
    description: str
    shape: tuple[int, ...] = ()
    min: float = -np.inf
    max: float = np.inf
    names: Mapping[str, float] | None = None

    def starts(self) -> np.ndarray:
        """Start values, broadcast to the declared shape."""
        return np.broadcast_to(np.asarray(self.start, dtype=float), self.shape)


@dataclass(frozen=True, init=False)
class Choice:
    """One of several named options; an FMI Enumeration, stored as its item value 1, 2, ... in a float64.

    ``Choice("How the ...", constant="one V_j for all speeds", mapped="V_j from K and omega")``; the first option is the start, or the one
    that ``starting_with`` names.
    """

    description: str
    options: Mapping[str, str]
    unit = "1"
    shape = ()
    start = 1.0
    min = 1.0

    def __init__(self, description: str, /, **options: str):
        object.__setattr__(self, "description", description)
        object.__setattr__(self, "options", options)

    def starting_with(self, option: str) -> Choice:
        """The same with another start."""
        other = Choice(self.description, **self.options)
        object.__setattr__(other, "start", self.value(option))
        return other

    @property
    def max(self) -> float:
        return float(len(self.options))

    def starts(self) -> np.ndarray:
        """Item value of the start option."""
        return np.asarray(self.start)

    def value(self, option: str) -> float:
        """Item value of an option, as the kernels see it."""
        return float(list(self.options).index(option) + 1)


@dataclass(frozen=True)
class Array:
    """A record repeated ``n`` times; FMI names count from 1: ``wheel[1].r_0[3]``."""

    n: int
    record: Record


@dataclass(frozen=True)
class Variable:
    """A field of a record, all its elements in one: its FMI name, the offset in the record at which it begins, and the field."""

    name: str
    offset: int
    field: Real | Choice

    @property
    def length(self) -> int:
        """Number of its elements."""
        return math.prod(self.field.shape)


@dataclass(frozen=True)
class Scalar:
    """One float64 of a record: its FMI name, offset in the record, its field, start value and where the array it is part of begins."""

    name: str
    offset: int
    field: Real | Choice
    start: float


class Record:
    """Named fields in order. ``a | b`` joins two records; arrays of one name and length are joined element by element."""

    def __init__(self, **fields: Real | Choice | Record | Array):
        self.fields = fields

    def __or__(self, other: Record) -> Record:
        joined = dict(self.fields)
        for name, field in other.fields.items():
            mine = joined.get(name)
            if mine is None:
                joined[name] = field
            elif isinstance(mine, Array) and isinstance(field, Array) and mine.n == field.n:
                joined[name] = Array(mine.n, mine.record | field.record)
            else:
                raise ValueError(f"record field {name!r} is declared twice")
        return Record(**joined)

    @property
    def dtype(self) -> np.dtype:
        """NumPy dtype of the record: float64 throughout, nested."""

        def one(field):
            if isinstance(field, Array):
                return field.record.dtype, (field.n,)
            if isinstance(field, Record):
                return field.dtype
            return np.dtype((np.float64, field.shape))

        # An empty array has no memory and numba cannot type it, so it is not part of the dtype.
        return np.dtype([(n, one(f)) for n, f in self.fields.items() if not (isinstance(f, Array) and f.n == 0)])

    @property
    def head(self) -> Record:
        """The fields before the first array of records."""
        return Record(**dict(takewhile(lambda item: not isinstance(item[1], Array), self.fields.items())))

    def variables(self) -> list[Variable]:
        """Every field of the record and of those in it, in memory order."""
        out: list[Variable] = []
        self._walk("", out)
        return out

    def _walk(self, prefix: str, out: list[Variable]) -> None:
        for name, field in self.fields.items():
            if isinstance(field, Array):
                for i in range(field.n):
                    field.record._walk(f"{prefix}{name}[{i + 1}].", out)
            elif isinstance(field, Record):
                field._walk(f"{prefix}{name}.", out)
            else:
                out.append(Variable(f"{prefix}{name}", out[-1].offset + out[-1].length if out else 0, field))

    def scalars(self) -> list[Scalar]:
        """Every float64 of the record in memory order (row-major)."""
        return [
            Scalar(f"{variable.name}{index}", variable.offset + i, variable.field, float(start))
            for variable in self.variables()
            for i, (index, start) in enumerate(zip(_indices(variable.field.shape), variable.field.starts().flat))
        ]

    def starts(self) -> np.ndarray:
        """Start values of all scalars, in memory order."""
        return np.array([s.start for s in self.scalars()], dtype=float)

    def __len__(self) -> int:
        return len(self.scalars())


def _indices(shape: tuple[int, ...]) -> Iterator[str]:
    if not shape:
        yield ""
    else:
        for index in product(*(range(1, n + 1) for n in shape)):
            yield "[" + ",".join(map(str, index)) + "]"
