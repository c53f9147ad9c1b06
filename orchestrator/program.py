"""Communication steps without Python: what a scheme does in each step, as a list of operations that one compiled loop works off.

A step of small FMUs takes 15 us; Python's way through the same calls took as much again.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from cdl_fmu.slave.kernel import kernel

from .fmu import Call, Slave
from .schemes import Exchange

# Operations, and their arguments.
_COPY = 0  # outputs from, inputs to, number
_SCALE = 1  # inputs, number, factors
_GATHER = 2  # index, number, buffer: from inputs
_SCATTER = 3  # index, number, buffer: to outputs
_CALL = 4  # function, component, references, number, values
_STEP = 5  # function, component
_SKIP_IF_SENT = 6  # inputs, number, sent, operations to skip
_SKIP_IF_TOLD = 7  # outputs, told, operations to skip
_WIDTH = 6
_WARNING = 1
_NONE = -1  # no operation failed


class Program:
    """The operations of one step of some slaves.

    Args:
        sequence: What the scheme does: "route" or "advance", and the slave.
        exchange: The slaves' memory and routes.
    """

    def __init__(self, sequence: Sequence[tuple[str, Slave]], exchange: Exchange):
        inputs, outputs, routes = exchange.inputs, exchange.outputs, exchange.routes
        self._inputs, self._outputs = inputs, outputs
        self._operations: list[list[int]] = []
        self._index: list[int] = []
        self._n_buffer = self._n_sent = self._n_told = 0
        self._scales: list[tuple[np.ndarray, np.ndarray]] = []
        self._n_scales = 0
        #: Of each operation that can fail: what raises its error, for the time and the status.
        self._failures: dict[int, Callable[[float, int], None]] = {}
        self._buffers: list[tuple[list[int], int]] = []  # operations whose last argument is a place in the buffer
        for act, slave in sequence:
            if act == "route":
                self._route(*routes[slave.name], slave)
            else:
                self._advance(slave)
        self._sent, self._told = np.zeros(self._n_sent, np.int64), np.zeros(self._n_told)
        self.forget()
        self._buffer = np.zeros(self._n_buffer)
        for operation, at in self._buffers:
            operation[5] = self._buffer.ctypes.data + at * self._buffer.itemsize
        self._memory = (
            np.array([operation + [0] * (_WIDTH - len(operation)) for operation in self._operations], np.int64),
            np.array(self._index, np.int64),
            np.concatenate([f for f, _ in self._scales]) if self._scales else np.zeros(0),
            np.concatenate([o for _, o in self._scales]) if self._scales else np.zeros(0),
            self._buffer,
            self._sent,
            self._told,
            inputs,
            inputs.view(np.int64),
            outputs,
        )
        #: 1 once a slave has logged an error.
        self.trouble = np.zeros(1, np.int64)
        for slave in {id(slave): slave for _, slave in sequence}.values():
            slave.trouble = self.trouble

    def run(self, start: float, h: float, k: int, columns: np.ndarray, rows: np.ndarray) -> tuple[int, Callable[[], None]]:
        """Do steps k, k + 1, ... of length h [s], as many as there are rows [n, n_columns], which get the outputs ``columns`` after each.

        Returns the number of steps done, which is less where a slave fails or an output is not finite, and what raises the slave's error.
        """
        done, operation, status = _run(start, h, k, columns, rows, self.trouble, *self._memory)
        t = start + (k + done) * h
        return done, lambda: None if operation == _NONE else self._failures[operation](t, status)

    def forget(self) -> None:
        """Send and read everything anew: the slaves have gone back to another state."""
        self._sent[:] = np.iinfo(np.int64).max  # the bits of a NaN that nobody sends
        self._told[:] = np.nan

    def _at(self, values: np.ndarray, memory: np.ndarray) -> int:
        return (values.ctypes.data - memory.ctypes.data) // memory.itemsize

    def _route(self, runs: list, factor: np.ndarray | None, offset: np.ndarray | None, slave: Slave) -> None:
        for source, target in runs:
            self._operations.append([_COPY, self._at(source, self._outputs), self._at(target, self._inputs), source.size])
        if factor is not None:
            self._operations.append([_SCALE, self._at(slave.u, self._inputs), factor.size, self._n_scales])
            self._scales.append((factor, offset))
            self._n_scales += factor.size

    def _advance(self, slave: Slave) -> None:
        for call in slave.sets:
            self._call(call, slave.u, self._inputs, slave.refused)
        for values, calls in slave.large_sets:
            jump = [_SKIP_IF_SENT, self._at(values, self._inputs), values.size, self._n_sent, 0]
            self._n_sent += values.size
            self._conditional(jump, calls, slave.u, self._inputs, slave.refused)
        self._failures[len(self._operations)] = slave.did_not_step
        self._operations.append([_STEP, slave.address_of("DoStep"), slave.component])
        for call in slave.gets:
            self._call(call, slave.y, self._outputs, slave.did_not_give)
        for at, calls in slave.large_gets:
            jump = [_SKIP_IF_TOLD, self._at(slave.y, self._outputs) + at, self._n_told, 0]
            self._n_told += 1
            self._conditional(jump, calls, slave.y, self._outputs, slave.did_not_give)

    def _conditional(self, jump: list[int], calls: list[Call], values: np.ndarray, memory: np.ndarray, failure: Callable) -> None:
        self._operations.append(jump)
        first = len(self._operations)
        for call in calls:
            self._call(call, values, memory, failure)
        jump[-1] = len(self._operations) - first

    def _call(self, call: Call, values: np.ndarray, memory: np.ndarray, failure: Callable) -> None:
        first = self._at(values, memory)
        operation = [_CALL, call.address, call.component, call.references, call.index.size, call.values]
        if call.buffer is None:
            self._failures[len(self._operations)] = failure
            self._operations.append(operation)
            return
        move = [_SCATTER if memory is self._outputs else _GATHER, len(self._index), call.index.size, self._n_buffer]
        self._index += (first + call.index).tolist()
        self._buffers.append((operation, self._n_buffer))
        self._n_buffer += call.index.size
        ordered = [operation, move] if memory is self._outputs else [move, operation]
        self._failures[len(self._operations) + ordered.index(operation)] = failure
        self._operations += ordered


def can_be_compiled(slaves: Iterable[Slave]) -> bool:
    """Whether all values that are exchanged are reals."""
    return all(call.is_real for slave in slaves for call in slave.all_calls())


_POINTER, _INT, _SIZE, _DOUBLE = ir.IntType(8).as_pointer(), ir.IntType(32), ir.IntType(64), ir.DoubleType()


@intrinsic
def _exchange(typing, function, component, references, n, values):
    """fmi2SetReal or fmi2GetReal at an address."""

    def generate(context, builder, signature, arguments):
        function, component, references, n, values = arguments
        kind = ir.FunctionType(_INT, [_POINTER, _POINTER, _SIZE, _POINTER]).as_pointer()
        component, references, values = (builder.inttoptr(a, _POINTER) for a in (component, references, values))
        return builder.call(builder.inttoptr(function, kind), [component, references, n, values])

    return types.int32(types.int64, types.int64, types.int64, types.int64, types.int64), generate


@intrinsic
def _do_step(typing, function, component, t, h):
    """fmi2DoStep at an address."""

    def generate(context, builder, signature, arguments):
        function, component, t, h = arguments
        kind = ir.FunctionType(_INT, [_POINTER, _DOUBLE, _DOUBLE, _INT]).as_pointer()
        component = builder.inttoptr(component, _POINTER)
        return builder.call(builder.inttoptr(function, kind), [component, t, h, ir.Constant(_INT, 1)])

    return types.int32(types.int64, types.int64, types.float64, types.float64), generate


@kernel
def _run(start, h, k, columns, rows, trouble, operations, index, factors, offsets, buffer, sent, told, inputs, bits, outputs):
    for row in range(len(rows)):
        t = start + (k + row) * h
        i = 0
        while i < len(operations):
            kind, a, b, c = operations[i, 0], operations[i, 1], operations[i, 2], operations[i, 3]
            if kind == _CALL:
                status = _exchange(a, b, c, operations[i, 4], operations[i, 5])
                if status > _WARNING or trouble[0] > 0:
                    return row, i, status
            elif kind == _COPY:
                for j in range(c):
                    inputs[b + j] = outputs[a + j]
            elif kind == _STEP:
                status = _do_step(a, b, t, h)
                if status > _WARNING:
                    return row, i, status
            elif kind == _GATHER:
                for j in range(b):
                    buffer[c + j] = inputs[index[a + j]]
            elif kind == _SCATTER:
                for j in range(b):
                    outputs[index[a + j]] = buffer[c + j]
            elif kind == _SCALE:
                for j in range(b):
                    inputs[a + j] = inputs[a + j] * factors[c + j] + offsets[c + j]
            elif kind == _SKIP_IF_SENT:
                same = True
                for j in range(b):
                    same &= bits[a + j] == sent[c + j]
                    sent[c + j] = bits[a + j]
                if same:
                    i += operations[i, 4]
            elif told[b] == outputs[a]:  # _SKIP_IF_TOLD
                i += c
            else:
                told[b] = outputs[a]
            i += 1
        finite = True
        for j in range(outputs.size):
            finite &= math.isfinite(outputs[j])
        if not finite:
            return row, _NONE, 0
        for j in range(columns.size):
            rows[row, j] = outputs[columns[j]]
    return len(rows), _NONE, 0
