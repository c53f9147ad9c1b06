"""One FMI 2.0 co-simulation slave, its variables exchanged in one call each way with preallocated buffers.

FMPy loads the FMU and keeps its life cycle; the calls of every step go straight to the binary, as FMPy's lists cost ten times more.
"""

from __future__ import annotations

import ctypes
import math
import re
import sys
from collections.abc import Callable, Iterator
from ctypes import c_double, c_int, c_uint, c_void_p
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NoReturn
from urllib.parse import unquote

import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Slave, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE, fmi2CoSimulation
from fmpy.model_description import ModelDescription

from .ssp.system import has_feedthrough

_OK, _WARNING, _DISCARD, _FATAL = 0, 1, 2, 4
_PATCH = re.compile(r"patch\[\d+\]\.")  # a port of the contact interface; other FMUs may mean other things by a revision
_STATUS = {2: "fmi2Discard", 3: "fmi2Error", 4: "fmi2Fatal"}
# FMI base type -> (FMI function suffix, NumPy type of its buffer)
_BASE_TYPES = {
    "Real": ("Real", np.float64),
    "Integer": ("Integer", np.int32),
    "Enumeration": ("Integer", np.int32),
    "Boolean": ("Boolean", np.int32),
}


_LARGE = 64  # elements from which an array is sent only when it has changed


class SlaveError(Exception):
    """A slave refused a call; the message names instance, what it said and when."""


@dataclass(frozen=True)
class Call:
    """A call that sets or gets some variables: fmi2SetReal and its like, with all arguments but none of them looked up again.

    Attributes:
        make: Makes the call and returns its status.
        address, component, references, values: Of the function and its arguments.
        index: Places of the variables in the slave's ``u`` or ``y``.
        buffer: Where their values are exchanged; None: in place.
        is_real: Whether they are reals.
    """

    make: Callable[[], int]
    address: int
    component: int
    references: int
    values: int
    index: np.ndarray
    buffer: np.ndarray | None
    is_real: bool


def revision_of(name: str) -> str:
    """Name of the output that says how often a patch has changed: ``patch[1].revision`` for ``patch[1].z[3,4]``; "" if none."""
    patch = _PATCH.match(name)
    return f"{patch[0]}revision" if patch else ""


def _large_arrays(names: list[str]) -> list[list[int]]:
    """Places of the elements of each large array, where they are consecutive."""
    runs: dict[str, list[int]] = {}
    for i, name in enumerate(names):
        if name.endswith("]"):
            runs.setdefault(name[: name.rindex("[")], []).append(i)
    return [run for run in runs.values() if len(run) >= _LARGE and run[-1] - run[0] == len(run) - 1]


class Slave:
    """An instance of an FMU.

    Args:
        name: Instance name.
        description: FMPy's model description of the FMU.
        directory: Where the FMU is unpacked.
        warn: Called with each warning the FMU logs.
    """

    def __init__(self, name: str, description: ModelDescription, directory: Path, warn):
        self.name = name
        self.description = description
        self.variables = {v.name: v for v in description.modelVariables}
        self.has_feedthrough = has_feedthrough(description)
        self.can_save = bool(description.coSimulation.canGetAndSetFMUstate)
        self.can_serialise = bool(description.coSimulation.canSerializeFMUstate)
        self._warn = warn
        self._errors: list[str] = []
        #: What sends inputs: always, and, for each large array, with its values, when these have changed.
        self.sets: list[Call] = []
        self.large_sets: list[tuple[np.ndarray, list[Call]]] = []
        self._sent: list[bytes] = []
        #: What fetches outputs: always, and, for each patch, when the output at the place given has changed.
        self.gets: list[Call] = []
        self.large_gets: list[tuple[int, list[Call]]] = []
        self._got: list[float] = []
        #: Set to 1 when the slave logs an error.
        self.trouble = np.zeros(1, np.int64)
        self._directory = Path(directory)
        identifier = description.coSimulation.modelIdentifier
        folder = self._directory / "binaries" / fmpy.platform
        if not folder.is_dir():
            have = sorted(p.name for p in (self._directory / "binaries").glob("*"))
            raise SlaveError(
                f"{name}: the FMU {description.modelName} has no binary for {fmpy.platform}; it has {', '.join(have) or 'none'}"
            )
        try:
            self._fmu = FMU2Slave(guid=description.guid, unzipDirectory=str(directory), modelIdentifier=identifier, instanceName=name)
        except Exception as error:
            raise SlaveError(f"{name}: the binary of FMU {description.modelName} does not load: {error}") from error
        self._callbacks = fmi2CallbackFunctions()
        self._callbacks.logger = fmi2CallbackLoggerTYPE(self._log)
        self._callbacks.allocateMemory = fmpy.fmi2.fmi2CallbackAllocateMemoryTYPE(fmpy.calloc)
        self._callbacks.freeMemory = fmpy.fmi2.fmi2CallbackFreeMemoryTYPE(fmpy.free)
        self._alive = False
        self._component = self._instantiate()
        self._alive = True
        self._do_step = self._function("DoStep", c_void_p, c_double, c_double, c_int)

    def _instantiate(self) -> c_void_p:
        resources = self._directory.absolute() / "resources"
        location = resources.as_uri()
        if (resources / "slavemodule.txt").is_file():
            # pythonfmu's wrapper decodes no more of the URI than blanks, and crashes on /home/jürgen or /home/me@example.org.
            location = unquote(location)
            if sys.platform == "win32" and not location.isascii():
                raise SlaveError(
                    f"{self.name}: on Windows pythonfmu's wrapper crashes in folders with letters outside ASCII, such as "
                    f"{self._directory}; set WIN_PD_OVERRIDE_LOCAL_APPDATA to a folder without, which then holds the cache"
                )
        texts = [text.encode() for text in (self.name, self.description.guid, location)]
        component = self._fmu.fmi2Instantiate(texts[0], fmi2CoSimulation, *texts[1:], ctypes.byref(self._callbacks), False, True)
        if component is None:
            self._raise("failed in instantiate", None)
        self._fmu.component = component
        return c_void_p(component)

    def initialise(self, start_time: float, stop_time: float | None, parameters: dict, send_inputs: bool = False) -> None:
        """Set parameters and, if asked, the bound inputs, and go through initialisation mode."""
        self._call("setupExperiment", self._fmu.setupExperiment, startTime=start_time, stopTime=stop_time)
        for name, value in parameters.items():
            self._set_parameter(name, value)
        self._call("enterInitializationMode", self._fmu.enterInitializationMode)
        if send_inputs:
            self.set(start_time)
        self._call("exitInitializationMode", self._fmu.exitInitializationMode)

    def _set_parameter(self, name: str, value) -> None:
        variable = self.variables[name]
        reference = [variable.valueReference]
        if variable.type == "String":
            setter, value = self._fmu.setString, str(value)
        elif variable.type == "Real":
            setter, value = self._fmu.setReal, float(value)
        elif variable.type == "Boolean":
            setter, value = self._fmu.setBoolean, bool(value)
        else:
            setter, value = self._fmu.setInteger, int(value)
        self._call(f"setting {name} = {value}", setter, reference, [value])

    def connect(self, inputs: list[str], u: np.ndarray, outputs: list[str], y: np.ndarray) -> None:
        """Bind input names to the slice ``u`` of the master's memory and output names to ``y``; both are float64."""
        self.inputs, self.u, self.outputs, self.y = inputs, u, outputs, y
        large = [np.array(run) for run in _large_arrays(inputs)]
        rest = np.setdiff1d(np.arange(len(inputs)), np.concatenate(large)) if large else np.arange(len(inputs))
        self.sets = self._calls("Set", inputs, u, rest)
        # Large arrays, such as height patches, are the same in most steps: they are sent when they have changed.
        self.large_sets = [(u[run[0] : run[-1] + 1], self._calls("Set", inputs, u, run)) for run in large]
        self._sent = [b""] * len(large)
        # Patches are also read when they have changed, which an output of their FMU tells.
        runs = [(revision_of(outputs[run[0]]), np.array(run)) for run in _large_arrays(outputs)]
        told = [(outputs.index(revision), run) for revision, run in runs if revision in outputs]
        rest = np.setdiff1d(np.arange(len(outputs)), np.concatenate([run for _, run in told])) if told else np.arange(len(outputs))
        self.gets = self._calls("Get", outputs, y, rest)
        self.large_gets = [(at, self._calls("Get", outputs, y, run)) for at, run in told]
        self._got = [math.nan] * len(told)

    def all_calls(self) -> Iterator[Call]:
        """Every call of a step but fmi2DoStep."""
        yield from (*self.sets, *self.gets)
        for _, calls in (*self.large_sets, *self.large_gets):
            yield from calls

    def _calls(self, direction: str, names: list[str], values: np.ndarray, among: np.ndarray) -> list[Call]:
        """A call for the variables of each type among these of ``names``."""
        calls = []
        for suffix, dtype in dict.fromkeys(_BASE_TYPES.values()):
            index = np.array([i for i in among if _BASE_TYPES[self.variables[names[i]].type] == (suffix, dtype)], dtype=int)
            if index.size == 0:
                continue
            references = (c_uint * index.size)(*(self.variables[names[i]].valueReference for i in index))
            # Consecutive Reals are exchanged in place; any other selection goes through a buffer of its own type.
            in_place = index[-1] - index[0] == index.size - 1 and dtype is np.float64
            buffer = values[index[0] : index[-1] + 1] if in_place else np.zeros(index.size, dtype)
            # Arguments of ctypes' own types, made once, need no conversion at a call.
            arguments = (self._component, references, ctypes.c_size_t(index.size), buffer.ctypes.data_as(c_void_p))
            function = self._function(direction + suffix)
            addresses = self.address_of(direction + suffix), self._component.value, ctypes.addressof(references), buffer.ctypes.data
            calls.append(Call(partial(function, *arguments), *addresses, index, None if in_place else buffer, dtype is np.float64))
        return calls

    def set(self, t: float) -> None:
        """Send the bound inputs."""
        self._send(self.sets, t)
        for k, (values, calls) in enumerate(self.large_sets):
            now = values.tobytes()
            if now != self._sent[k]:
                self._send(calls, t)
                self._sent[k] = now

    def _send(self, calls: list[Call], t: float) -> None:
        for call in calls:
            if call.buffer is not None:
                call.buffer[:] = self.u[call.index]
            status = call.make()
            if status > _WARNING or self._errors:
                self.refused(t, status)

    def get(self, t: float) -> None:
        """Fetch the bound outputs."""
        self._fetch(self.gets, t)
        for k, (at, calls) in enumerate(self.large_gets):
            if self.y[at] != self._got[k]:
                self._fetch(calls, t)
                self._got[k] = self.y[at]

    def _fetch(self, calls: list[Call], t: float) -> None:
        for call in calls:
            status = call.make()
            if status > _WARNING:
                self.did_not_give(t, status)
            if call.buffer is not None:
                self.y[call.index] = call.buffer

    def step(self, t: float, h: float) -> None:
        """Advance from t by h [s]."""
        status = self._do_step(self._component, t, h, 1)
        if status > _WARNING:
            self.did_not_step(t, status)

    def refused(self, t: float, status: int) -> NoReturn:
        """Raise SlaveError: it did not take its inputs at t [s]."""
        self._raise("refused its inputs", t, status=status)

    def did_not_give(self, t: float, status: int) -> NoReturn:
        """Raise SlaveError: it did not give its outputs at t [s]."""
        self._raise("did not give its outputs", t, status=status)

    def did_not_step(self, t: float, status: int) -> NoReturn:
        """Raise SlaveError: its step from t [s] ended with this status."""
        self._raise(f"did not do the step ({_STATUS.get(status, status)})", t, status=status)

    def save(self):
        """Handle to a copy of the whole state; give it back to ``restore`` or ``free``."""
        return self._call("getFMUstate", self._fmu.getFMUstate)

    def restore(self, state) -> None:
        """Go back to a saved state."""
        self._call("setFMUstate", self._fmu.setFMUstate, state)
        self._sent = [b""] * len(self._sent)  # the FMU has the inputs of then
        self._got = [math.nan] * len(self._got)

    def free(self, state) -> None:
        """Release a saved state."""
        self._fmu.freeFMUstate(state)

    def to_bytes(self) -> bytes:
        """The whole state, serialised."""
        state = self.save()
        data = self._call("serializeFMUstate", self._fmu.serializeFMUstate, state)
        self.free(state)
        return bytes(data)

    def from_bytes(self, data: bytes) -> None:
        """Go back to a serialised state."""
        state = self._call("deSerializeFMUstate", self._fmu.deSerializeFMUstate, data)
        self.restore(state)
        self.free(state)

    def close(self) -> None:
        """End the instance."""
        if self._alive:
            self._alive = False
            try:
                self._fmu.terminate()
            finally:
                self._fmu.freeInstance()

    def address_of(self, name: str) -> int:
        """Address of the FMU's function of this name, without fmi2."""
        return ctypes.cast(getattr(self._fmu.dll, f"fmi2{name}"), c_void_p).value

    @property
    def component(self) -> int:
        """What its functions take as their first argument."""
        return self._component.value

    def _function(self, name: str, *arguments):
        # A prototype of our own: FMPy's objects for the same functions stay as they are.
        return ctypes.PYFUNCTYPE(c_int, *arguments)(self.address_of(name))

    def _call(self, what: str, function, *args, **kwargs):
        if not self._alive:
            raise SlaveError(f"{self.name} is gone since an earlier error: {what} is not possible any more")
        try:
            return function(*args, **kwargs)
        except Exception as error:
            self._alive = False  # FMI forbids any further call after an error here
            self._raise(f"failed in {what}", None, error)

    def _raise(self, what: str, t: float | None, cause: Exception | None = None, status: int = _OK):
        self._alive = self._alive and status != _FATAL  # after which FMI forbids any further call, and pythonfmu's wrapper crashes
        said = "; ".join(dict.fromkeys(self._errors)) or (str(cause) if cause else "it gave no message")
        self._errors.clear()
        self.trouble[0] = 0
        when = "" if t is None else f" at t = {t:.6g} s"
        raise SlaveError(f"{self.name} {what}{when}: {said}") from cause

    def _log(self, environment, instance, status, category, message) -> None:
        text = (message or b"").decode(errors="replace").replace("%%", "%")  # it is a format as for printf, without arguments
        if status == _WARNING:
            self._warn(text)
        elif status >= _DISCARD and not (self._errors and text.startswith("Fatal py exception")):
            # What the FMU said comes first; the wrapper's own words about the exception that carried it add nothing.
            self._errors.append(text)
            self.trouble[0] = 1
