"""The pythonfmu slave of a proxy FMU: it hands every call on to ``cdl serve`` in another process, on this machine or another."""

from __future__ import annotations

import json
import math
import socket
import time
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

from pythonfmu import Fmi2Slave
from pythonfmu.enums import Fmi2Status

from .pythonfmu_slave import release_at_exit
from .wire import Call, Kind, Wire, pack_references, pack_values, unpack_values

#: File in the proxy's resources: the description of the FMU that it stands for, with a GUID of its own.
DESCRIPTION = "remote.xml"
_PATIENCE = 3.0  # [s] that the other end may take to be ready again after the last master


class RemoteError(Exception):
    """A call that failed at the other end, or an end that is gone; the message says which and what to do."""


class Served(NamedTuple):
    """The FMU that a proxy stands for, and where it is served."""

    identifier: str
    guid: str
    host: str
    port: int


class RemoteSlave(Fmi2Slave):
    """Base of the script of every proxy FMU, which says what it stands for.

    A call that fails is logged at level error. It then raises, which pythonfmu turns into fmi2Fatal, but for a step, which ends with
    fmi2Discard: the other end may be able to go back. The connection is made with the first call.
    """

    @staticmethod
    def served() -> Served:
        """What the proxy stands for.

        A function, as pythonfmu 0.7.0's wrapper gives up the names of the script with each instance, unless a function needs them.
        """
        raise NotImplementedError

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self._served = self.served()
        self.modelName = self._served.identifier
        release_at_exit(Path(self.resources or ".").parent / "binaries" / "linux64" / f"{self.modelName}.so")
        self._wire: Wire | None = None
        self._gone = False  # True once the connection is lost

    def to_xml(self, model_options=None) -> ElementTree.Element:
        root = ElementTree.parse(Path(self.resources, DESCRIPTION)).getroot()
        for element in root.iter():  # pythonfmu indents it
            element.text = element.tail = None
        return root

    # -- values: lists in, lists out

    def get_real(self, vrs: list[int]) -> list[float]:
        return self._get(Kind.REAL, vrs)

    def get_integer(self, vrs: list[int]) -> list[int]:
        return self._get(Kind.INTEGER, vrs)

    def get_boolean(self, vrs: list[int]) -> list[bool]:
        return list(map(bool, self._get(Kind.BOOLEAN, vrs)))

    def get_string(self, vrs: list[int]) -> list[str]:
        return self._get(Kind.STRING, vrs)

    def set_real(self, vrs: list[int], values: list[float]) -> None:
        self._set(Kind.REAL, vrs, values)

    def set_integer(self, vrs: list[int], values: list[int]) -> None:
        self._set(Kind.INTEGER, vrs, values)

    def set_boolean(self, vrs: list[int], values: list[bool]) -> None:
        self._set(Kind.BOOLEAN, vrs, values)

    def set_string(self, vrs: list[int], values: list[str]) -> None:
        self._set(Kind.STRING, vrs, values)

    def _get(self, kind: Kind, vrs: list[int]) -> list:
        return unpack_values(kind, self._ask(Call.GET, pack_references(kind, vrs))) if vrs else []

    def _set(self, kind: Kind, vrs: list[int], values: list) -> None:
        self._tell(Call.SET, pack_references(kind, vrs) + pack_values(kind, values))

    # -- life

    def setup_experiment(self, start_time, stop_time, tolerance) -> None:
        self._ask(Call.SETUP, pack_values(Kind.REAL, [start_time, math.nan if stop_time is None else stop_time]))

    def enter_initialization_mode(self) -> None:
        self._ask(Call.ENTER_INITIALIZATION)

    def exit_initialization_mode(self) -> None:
        self._ask(Call.EXIT_INITIALIZATION)

    def do_step(self, current_time: float, step_size: float) -> bool:
        try:
            self._ask(Call.STEP, pack_values(Kind.REAL, [current_time, step_size]))
        except RemoteError:
            return False
        return True

    def terminate(self) -> None:
        if self._wire is not None and not self._gone:  # after an exception the wrapper crashes when it frees the instance
            self._ask(Call.TERMINATE)
            self._wire.close()

    # -- whole state, which comes here in bytes: it outlives the other end

    def _get_fmu_state(self) -> bytes:
        return self._ask(Call.SAVE)

    def _set_fmu_state(self, state: bytes) -> None:
        self._ask(Call.RESTORE, state)

    @staticmethod
    def _fmu_state_to_bytes(state: bytes) -> bytes:
        return state

    @staticmethod
    def _fmu_state_from_bytes(state: bytes) -> bytes:
        return bytes(state)

    # -- the other end

    def _ask(self, call: Call, content: bytes = b"") -> bytes:
        """Content of the answer, after its warnings have been logged."""
        self._tell(call, content)
        try:
            failed, answer = self._wire.receive()
        except OSError as error:
            self._lost(error)
        n, answer = int.from_bytes(answer[:4], "little"), answer[4:]
        for text in json.loads(answer[:n]):
            self.log(text, Fmi2Status.warning)
        if failed:
            self._fail(answer[n:].decode())
        return answer[n:]

    def _tell(self, call: Call, content: bytes = b"") -> None:
        if self._wire is None:
            self._connect()
        try:
            self._wire.send(call, content)
        except OSError as error:
            self._lost(error)

    def _connect(self) -> None:
        identifier, guid, host, port = self._served
        connected, until = None, time.monotonic() + _PATIENCE
        while connected is None:
            try:
                connected = socket.create_connection((host, port), timeout=10.0)
            except OSError as error:
                if time.monotonic() > until:
                    self._fail(f"{self.instance_name}: nothing serves {identifier} at {host}:{port} ({error}): start 'cdl serve' there")
                time.sleep(0.1)
        connected.settimeout(None)  # a step takes as long as it takes
        self._wire = Wire(connected)
        self._ask(Call.HELLO, json.dumps({"guid": guid, "instance": self.instance_name}).encode())

    def _lost(self, error: OSError) -> None:
        self._gone = True
        identifier, _, host, port = self._served
        self._fail(
            f"{self.instance_name}: lost the connection to {host}:{port}, where {identifier} runs ({error}): "
            "see why it ended and start 'cdl serve' there again"
        )

    def _fail(self, text: str) -> None:
        self.log(text, Fmi2Status.error)
        raise RemoteError(text)
