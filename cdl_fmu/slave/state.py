"""The whole state of an instance, and its form as bytes."""

from __future__ import annotations

import json
import struct
from typing import NamedTuple

import numpy as np

from .pool import Pool

_LENGTH = struct.Struct("<q")


class State(NamedTuple):
    """A copy of the block ``[p|u|x|y]``, the names of the files, and what the pool saved (None: the instance had no pool)."""

    block: np.ndarray
    files: dict[str, str]
    pool: object | None

    def to_bytes(self, pool_class: type[Pool] | None) -> bytes:
        """The state as bytes: a header in JSON with its length before it, the block, the pool's bytes."""
        header = json.dumps({"block": self.block.nbytes, "files": self.files, "has_pool": self.pool is not None}).encode()
        pool = b"" if self.pool is None else pool_class.to_bytes(self.pool)
        return b"".join((_LENGTH.pack(len(header)), header, self.block.tobytes(), pool))

    @staticmethod
    def from_bytes(data: bytes, pool_class: type[Pool] | None) -> State:
        """The state that ``to_bytes`` wrote."""
        start = _LENGTH.size + _LENGTH.unpack_from(data)[0]
        header = json.loads(data[_LENGTH.size : start])
        end = start + header["block"]
        pool = pool_class.from_bytes(data[end:]) if header["has_pool"] else None
        return State(np.frombuffer(data[start:end]), header["files"], pool)
