"""Parts of a model's block that its kernels take, for models that name them (see ``KernelModel.arguments``)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .records import Record


@dataclass(frozen=True)
class Piece:
    """A part of a model's block that its kernels take.

    Attributes:
        name: Its name as an argument, in capitals if the kernels take the record itself.
        start: Where it begins in the block [floats].
        dtype: Of a record.
        shape: Number of records, and of those that each has in ``inner``.
        inner: Array of records in each record that is taken in place of the record; "" for the record, and where there are none.
    """

    name: str
    start: int
    dtype: np.dtype
    shape: tuple[int, ...]
    inner: str = ""

    def view(self, block: np.ndarray) -> np.ndarray:
        """The records in the block as an array."""
        if 0 in self.shape:
            return np.zeros(self.shape, self.dtype)
        records = block[self.start : self.start + self.shape[0] * self.dtype.itemsize // block.itemsize].view(self.dtype)
        return records[self.inner] if self.inner else records


def piece(argument: str, record: Record, start: int) -> Piece:
    """The part of a record, which begins there in the block [floats], that an argument names: ``"u"``, ``"u.hard"``, ``"u.hard.wheel"``."""
    name = argument.replace(".", "_")
    _, field, inner = (*argument.split("."), "", "")[:3]
    if not field:
        return Piece(name, start, record.head.dtype, (1,))
    array = record.fields[field]
    if array.n:
        start += record.dtype.fields[field][1] // np.float64().itemsize
    if not inner:
        return Piece(name, start, array.record.dtype, (array.n,))
    each = array.record.fields[inner]
    shape = array.n, each.n
    return Piece(name, start, each.record.dtype, shape) if 0 in shape else Piece(name, start, array.record.dtype, shape, inner)
