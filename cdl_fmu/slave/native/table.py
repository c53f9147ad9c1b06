"""The table in a native FMU's binary: all that ``c/model.h`` knows of a model, from its declaration, as an object file without code."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from string import Formatter

import llvmlite.binding as llvm
import numpy as np
from llvmlite import ir

from ..model import KernelModel
from ..pool import ConstantPool, Pool, RowPool
from ..records import Array, Choice, Scalar
from .kernels import target_machine

_TEXT, _INDEX, _BLOCK, _NUMBER = range(4)
_ROWS, _MARKS, _HEAD, _ZEROS, _CONTENT, _FOREIGN = range(6)
#: Formats that C's printf understands as Python does.
_SPEC = re.compile(r"(\.\d+)?[gf]")
_INT, _DOUBLE, _POINTER = ir.IntType(64), ir.DoubleType(), ir.IntType(8).as_pointer()


def table_object(
    model: KernelModel, guid: str, starts: np.ndarray, files: Mapping[str, str], pool: Pool | None, built_in: Iterable[str], triple: str
) -> bytes:
    """Object file with the table of a model.

    Args:
        model: The model.
        guid: Of the FMU.
        starts: Of the whole block.
        files: Start value of each file parameter.
        pool: As it is made for these.
        built_in: See ``KernelModel.built_in``.
        triple: LLVM target triple.
    """
    return _Table(model, starts).emit(guid, files, pool, frozenset(built_in), triple)


def content_of(pool: Pool | None) -> list[np.ndarray]:
    """The arrays of a pool that are kept in the FMU's resources: those that are not all zeros, but for rows, marks and a library's."""
    return [] if pool is None else [a for a, kind in zip(pool.arrays, _kinds(pool)) if kind == _CONTENT]


def _kinds(pool: Pool) -> list[int]:
    kinds = [_CONTENT if np.frombuffer(a.tobytes(), np.uint8).any() else _ZEROS for a in pool.arrays]
    if isinstance(pool, RowPool):
        kinds[:3] = _ROWS, _MARKS, _HEAD
    if isinstance(pool, ConstantPool):
        kinds[len(kinds) - pool.n_foreign :] = [_FOREIGN] * pool.n_foreign
    return kinds


class _Table:
    """Constants in an LLVM module, put together from below."""

    def __init__(self, model: KernelModel, starts: np.ndarray):
        self.model, self.starts = model, starts
        self.module = ir.Module()
        self.strings: dict[str, ir.Constant] = {}

    def emit(self, guid: str, files: Mapping[str, str], pool: Pool | None, built_in: frozenset[str], triple: str) -> bytes:
        model = self.model
        sizes = [len(record) for record in (model.parameters, model.inputs, model.state, model.outputs)]
        arrays = () if pool is None else pool.arrays
        growth = (pool.per_step, pool.limit) if isinstance(pool, RowPool) else (0, 0)
        fields = [
            *(self.text(model.identifier), self.text(guid)),
            *map(_integer, (*sizes, model.feedthrough)),
            self.array(map(_double, self.starts)),
            self.array(self.variable(s, built_in) for part in "pu" for s in model.scalars[part]),
            self.array(map(_integer, _lengths(model))),
            _integer(len(files)),
            self.array(self.struct(*map(self.text, (name, files[name], about))) for name, about in model.files.items()),
            _integer(len(model.rules)),
            _integer(max((len(rule.numbers) for rule in model.rules), default=0)),
            self.array(self.message(0, True, rule.text, list(rule.numbers)) for rule in model.rules),
            _integer(len(model.events)),
            self.array(self.message(status, event.is_error, event.text) for status, event in model.events.items()),
            *map(_integer, (len(arrays), sum(a.ndim for a in arrays))),
            self.array(self.struct(*map(_integer, (kind, a.itemsize, a.ndim))) for kind, a in zip(_kinds(pool) if pool else (), arrays)),
            _integer(model.resize_kernel is not None and not built_in),
            self.array(map(_integer, [n for a in arrays for n in a.shape] + list(growth))),
        ]
        table = self.struct(*fields)
        variable = ir.GlobalVariable(self.module, table.type, "model_table")
        variable.initializer, variable.global_constant = table, True
        machine = target_machine(triple)
        self.module.triple, self.module.data_layout = triple, str(machine.target_data)
        parsed = llvm.parse_assembly(str(self.module))
        parsed.get_global_variable("model_table").visibility = "hidden"
        return machine.emit_object(parsed)

    def text(self, text: str | None) -> ir.Constant:
        """Pointer to a string."""
        if text is None:
            return ir.Constant(_POINTER, None)
        if text not in self.strings:
            data = bytearray(text.encode() + b"\0")
            self.strings[text] = self._place(ir.Constant(ir.ArrayType(ir.IntType(8), len(data)), data))
        return self.strings[text]

    def array(self, items: Iterable[ir.Constant]) -> ir.Constant:
        """Pointer to the first of these."""
        items = list(items)
        return self._place(ir.Constant(ir.ArrayType(items[0].type, len(items)), items)) if items else ir.Constant(_POINTER, None)

    def _place(self, constant: ir.Constant) -> ir.Constant:
        variable = ir.GlobalVariable(self.module, constant.type, f"constant{len(self.module.globals)}")
        variable.initializer, variable.global_constant, variable.linkage = constant, True, "internal"
        return variable.bitcast(_POINTER)

    @staticmethod
    def struct(*fields: ir.Constant) -> ir.Constant:
        return ir.Constant.literal_struct(fields)

    def variable(self, scalar: Scalar, built_in: frozenset[str]) -> ir.Constant:
        field, whole = scalar.field, scalar.name.split("[")[0]
        options = ", ".join(f"{i + 1} {option}" for i, option in enumerate(field.options)) if isinstance(field, Choice) else None
        texts = map(self.text, (scalar.name, "" if field.unit == "1" else f" {field.unit}", field.description, options))
        big = np.finfo(float).max
        bounds = map(_double, (max(field.min, -big), min(field.max, big)))
        return self.struct(*texts, *bounds, _integer(whole in built_in))

    def message(self, status: int, is_error: bool, text: str, numbers: Sequence[str] = ()) -> ir.Constant:
        pieces = [self.struct(_integer(kind), self.text(text), *map(_integer, at)) for kind, text, at in self._pieces(text, numbers)]
        return self.struct(*map(_integer, (status, is_error, len(pieces))), self.array(pieces))

    def _pieces(self, text: str, numbers: Sequence[str]):
        """Kind, text or format, and where its value is, of all pieces of a message."""
        starts = dict(zip("pu", (0, len(self.model.parameters))))
        places = {"p": _Place(self.model.parameters.dtype, 0)}
        inputs = self.model.inputs
        for name, field in inputs.fields.items():
            if isinstance(field, Array):  # nothing is ever said of an empty one
                places[name] = _Place(field.record.dtype, inputs.dtype.fields[name][1] if field.n else 0)
        for literal, field, spec, _ in Formatter().parse(text):
            if literal:
                yield _TEXT, literal, (0, 0)
            if field is None:
                continue
            if field == "i":
                yield _INDEX, "", (0, 0)
                continue
            if not _SPEC.fullmatch(spec):
                raise ValueError(f"{self.model.identifier}: '{{{field}:{spec}}}' in a message: use a format such as g or .4g")
            if field in numbers:
                yield _NUMBER, f"%{spec}", (numbers.index(field), 0)
                continue
            part = re.split(r"[.\[]", field)[0]
            offset = Formatter().get_field(field, (), places)[0].offset // 8
            if part == "p":
                yield _BLOCK, f"%{spec}", (offset, 0)
            else:
                yield _BLOCK, f"%{spec}", (starts["u"] + offset, len(inputs.fields[part].record))


class _Place:
    """Stands for a value of a record when a message is formatted, and tells where it is [bytes]."""

    def __init__(self, dtype: np.dtype, offset: int):
        self.dtype, self.offset = dtype, offset

    def __getitem__(self, key: str | int) -> _Place:
        if self.dtype.fields:
            dtype, offset = self.dtype.fields[key][:2]
            return _Place(dtype, self.offset + offset)
        base, shape = self.dtype.subdtype
        dtype = np.dtype((base, shape[1:]))
        return _Place(dtype, self.offset + int(key) * dtype.itemsize)

    __getattr__ = __getitem__


def _lengths(model: KernelModel) -> np.ndarray:
    """Of the FMI 3 variable that begins at each double of the block, 0 where none does."""
    parts = []
    for record in (model.parameters, model.inputs, model.state, model.outputs):
        part = np.zeros(len(record), np.int64)
        for variable in record.variables() if record is not model.state else ():
            part[variable.offset] = variable.length
        parts.append(part)
    return np.concatenate(parts)


def _integer(value: int) -> ir.Constant:
    return ir.Constant(_INT, int(value))


def _double(value: float) -> ir.Constant:
    return ir.Constant(_DOUBLE, float(value))
