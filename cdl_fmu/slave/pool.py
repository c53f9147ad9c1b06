"""Large state beside the records, such as the tiles of a soil: it grows between steps, and saving copies only what changed."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import count
from typing import NamedTuple, Protocol

import numpy as np


class Pool(Protocol):
    """Large state of an instance, made by ``Model.make_pool`` and part of the instance's whole state.

    Attributes:
        arrays: What the kernels get after the records. Only ``reserve`` and ``restore`` replace them, by arrays of the same types.
    """

    arrays: tuple[np.ndarray, ...]

    def reserve(self, u: np.recarray) -> None:
        """Make room for what one step with the inputs u may need; called before every step.

        Raises ModelError, in which case nothing has changed.
        """

    def save(self) -> object:
        """The content as it is now, at a cost in proportion to what changed since the last save."""

    def restore(self, saved) -> None:
        """Go back, to the same bits, to what this or another pool of the same model, parameters and files saved at any time."""

    @staticmethod
    def to_bytes(saved) -> bytes:
        """What ``save`` returned, as bytes."""

    @staticmethod
    def from_bytes(data: bytes) -> object:
        """The saved content that ``to_bytes`` wrote."""


class ConstantPool:
    """A pool that holds no state: constant arrays, and memory that means nothing between steps.

    Args:
        arrays: Those, zeros where they are memory.
        foreign: Arrays that follow them and belong to a library (see ``cdl_fmu.slave.library``): what its objects hold.
    """

    def __init__(self, arrays: Iterable[np.ndarray], foreign: Iterable[np.ndarray] = ()):
        own = tuple(arrays)
        self.arrays = (*own, *foreign)
        self.n_foreign = len(self.arrays) - len(own)

    def reserve(self, u: np.recarray) -> None:
        """Nothing grows."""

    def save(self) -> tuple:
        """Nothing is kept."""
        return ()

    def restore(self, saved: tuple) -> None:
        """Nothing is kept."""

    @staticmethod
    def to_bytes(saved: tuple) -> bytes:
        """Nothing is kept."""
        return b""

    @staticmethod
    def from_bytes(data: bytes) -> tuple:
        """Nothing is kept."""
        return ()


class SavedRows(NamedTuple):
    """Content of a :class:`RowPool`: a copy of each used row with its marks, shared with other saves; their numbers; the head."""

    copies: tuple[tuple[np.ndarray, np.ndarray], ...]
    numbers: np.ndarray
    head: np.ndarray


# Copies with the same number are the same copy, in whichever pool they were made.
_numbers = count(1)


class RowPool:
    """Rows of numbers that a kernel takes one after another, each with integers of its own, and a head of integers for all.

    Kernels get ``rows`` (float64), ``marks`` and ``head`` (int64), then the ``extra`` and the ``scratch`` arrays. They keep these rules:

    - ``head[0]`` is the number of rows in use. To take a row, a kernel raises it by one; at ``len(rows)`` there is none left.
      A row taken is all zeros. The rest of the head is the kernel's.
    - Whoever changes anything of row r or of its marks sets ``marks[r, 0] = 1``; what it reads there means nothing, as saving clears it.
      The row's other marks are the kernel's.
    - The ``extra`` arrays are constant; no kernel that writes to them compiles.
    - The ``scratch`` arrays mean nothing when a kernel is called. They are not saved, nor are the ``extra`` ones.

    Args:
        row_shape: Shape of one row.
        marks: Integers of each row, ``marks[r, 0]`` included.
        head: Integers of the head, ``head[0]`` included.
        per_step: Rows that one step may take.
        limit: Most rows there may ever be; near it a step may find less room than ``per_step`` and has to say so by its status.
        extra: Constant arrays for the kernels.
        scratch: Arrays that the kernels work in.
    """

    def __init__(
        self,
        row_shape: tuple[int, ...],
        *,
        marks: int,
        head: int,
        per_step: int,
        limit: int,
        extra: tuple[np.ndarray, ...] = (),
        scratch: tuple[np.ndarray, ...] = (),
    ):
        self.per_step = per_step
        self.limit = limit
        self.head = np.zeros(head, np.int64)
        self._others = *map(_constant, extra), *scratch
        self._copies: list[tuple[np.ndarray, np.ndarray]] = []  # of each row, as it was last saved or restored
        self.rows, self.marks, self._copied = np.zeros((0, *row_shape)), np.zeros((0, marks), np.int64), np.zeros(0, np.int64)
        self._resize(min(limit, per_step))

    def _resize(self, capacity: int) -> None:
        used = int(self.head[0])
        self.rows, self.marks, self._copied = (_resized(a, used, capacity) for a in (self.rows, self.marks, self._copied))
        self.arrays = (self.rows, self.marks, self.head, *self._others)

    def reserve(self, u: np.recarray) -> None:
        """Double the rows if less than ``per_step`` are free, as far as ``limit`` allows."""
        capacity = len(self.rows)
        if capacity - self.head[0] < self.per_step and capacity < self.limit:
            self._resize(min(self.limit, 2 * capacity))

    def save(self) -> SavedRows:
        """The rows in use; those that did not change share their copies with the save before."""
        used = int(self.head[0])
        self.marks[len(self._copies) : used, 0] = 1
        self._copies += [None] * (used - len(self._copies))
        for r in np.flatnonzero(self.marks[:used, 0]).tolist():
            self.marks[r, 0] = 0
            self._copies[r] = self.rows[r].copy(), self.marks[r].copy()
            self._copied[r] = next(_numbers)
        return SavedRows(tuple(self._copies), self._copied[:used].copy(), self.head.copy())

    def restore(self, saved: SavedRows) -> None:
        """Go back to the saved rows; only those that differ are written."""
        used, known = int(self.head[0]), len(saved.copies)
        if known > len(self.rows):
            self._resize(known)
        for r in np.flatnonzero((self._copied[:known] != saved.numbers) | (self.marks[:known, 0] != 0)).tolist():
            self.rows[r], self.marks[r] = saved.copies[r]
        self.rows[known:used] = self.marks[known:used] = self._copied[known:used] = 0
        self._copied[:known] = saved.numbers
        self._copies = list(saved.copies)
        self.head[:] = saved.head

    @staticmethod
    def to_bytes(saved: SavedRows) -> bytes:
        """Numbers of rows, marks, head and the row's shape; then head, marks and rows."""
        shape, marks = (saved.copies[0][0].shape, len(saved.copies[0][1])) if saved.copies else ((), 0)
        sizes = np.array([len(saved.copies), marks, len(saved.head), *shape], np.int64)
        parts = [np.array([len(sizes)]), sizes, saved.head, *(m for _, m in saved.copies), *(row for row, _ in saved.copies)]
        return b"".join(part.tobytes() for part in parts)

    @staticmethod
    def from_bytes(data: bytes) -> SavedRows:
        """The saved rows that ``to_bytes`` wrote."""
        integers = np.frombuffer(data, np.int64)
        n, n_marks, n_head, *shape = integers[1 : 1 + integers[0]].tolist()
        _, head, marks, rows = np.split(integers, np.cumsum([1 + integers[0], n_head, n * n_marks]))
        copies = tuple(zip(rows.view(np.float64).reshape(n, *shape), marks.reshape(n, n_marks)))
        return SavedRows(copies, np.array([next(_numbers) for _ in copies], np.int64), head)


def _resized(array: np.ndarray, used: int, capacity: int) -> np.ndarray:
    grown = np.zeros((capacity, *array.shape[1:]), array.dtype)
    grown[:used] = array[:used]
    return grown


def _constant(array: np.ndarray) -> np.ndarray:
    view = np.ascontiguousarray(array).view()
    view.flags.writeable = False
    return view
