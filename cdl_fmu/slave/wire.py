"""Calls of FMI 2.0 over a TCP connection: what a proxy FMU asks of the process in which the FMU itself runs.

A message is its length [bytes] (uint32), a code (uint8) and a content; all little-endian. The code of a question is a ``Call``. Each but
``SET`` gets an answer, with code 0, or 1 if the call or a ``SET`` before it failed: then its content is the reason.
"""

from __future__ import annotations

import json
import socket
import struct
from collections.abc import Sequence
from enum import IntEnum
from itertools import chain

_HEAD = struct.Struct("<IB")
_VALUES = struct.Struct("<BI")
#: Seconds until a machine that does not answer any more is taken for lost: idle time, interval and number of probes.
_KEEP_ALIVE = {"TCP_KEEPIDLE": 10, "TCP_KEEPINTVL": 5, "TCP_KEEPCNT": 4}


class Call(IntEnum):
    """Questions; HELLO: JSON of GUID and instance name; SETUP: start and stop time, the latter NaN if open; STEP: time and step size."""

    HELLO = 1
    SETUP = 2
    ENTER_INITIALIZATION = 3
    EXIT_INITIALIZATION = 4
    SET = 5
    GET = 6
    STEP = 7
    SAVE = 8
    RESTORE = 9
    TERMINATE = 10


class Kind(IntEnum):
    """Types of variables."""

    REAL = 0
    INTEGER = 1
    BOOLEAN = 2
    STRING = 3


class Wire:
    """One end of a connection. Its methods raise OSError if the other end is gone."""

    def __init__(self, connected: socket.socket):
        self._socket = connected
        connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connected.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for option, value in _KEEP_ALIVE.items():
            if hasattr(socket, option):  # not on every system
                connected.setsockopt(socket.IPPROTO_TCP, getattr(socket, option), value)

    def send(self, code: int, content: bytes = b"") -> None:
        """Send a message."""
        self._socket.sendall(_HEAD.pack(len(content), code) + content)

    def receive(self) -> tuple[int, bytes]:
        """Code and content of the next message."""
        length, code = _HEAD.unpack(self._exactly(_HEAD.size))
        return code, self._exactly(length)

    def close(self) -> None:
        """End the connection."""
        self._socket.close()

    def _exactly(self, n: int) -> bytes:
        data = bytearray()
        while len(data) < n:
            part = self._socket.recv(min(n - len(data), 1 << 20))
            if not part:
                raise ConnectionError("the other end closed it")
            data += part
        return bytes(data)


def pack_values(kind: Kind, values: Sequence) -> bytes:
    """Values of one type."""
    return json.dumps(values).encode() if kind == Kind.STRING else struct.pack(f"<{len(values)}{_letter(kind)}", *values)


def unpack_values(kind: Kind, data: bytes) -> list:
    """What ``pack_values`` was given."""
    if kind == Kind.STRING:
        return json.loads(data)
    return list(chain.from_iterable(struct.iter_unpack(f"<{_letter(kind)}", data)))


def pack_references(kind: Kind, references: Sequence[int]) -> bytes:
    """Type and value references of variables."""
    return _VALUES.pack(kind, len(references)) + struct.pack(f"<{len(references)}I", *references)


def unpack_references(data: bytes) -> tuple[Kind, list[int], bytes]:
    """What ``pack_references`` was given, and what follows."""
    kind, n = _VALUES.unpack_from(data)
    return Kind(kind), list(struct.unpack_from(f"<{n}I", data, _VALUES.size)), data[_VALUES.size + 4 * n :]


def _letter(kind: Kind) -> str:
    return "d" if kind == Kind.REAL else "i"
