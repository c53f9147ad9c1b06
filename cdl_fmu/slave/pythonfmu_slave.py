"""The one pythonfmu slave: any model behind FMI 2.0 co-simulation, get and set as slices of the instance's block."""

from __future__ import annotations

import atexit
import ctypes
import struct
import sys
from functools import cache
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from pythonfmu import Fmi2Slave
from pythonfmu.enums import Fmi2Status

from .description import DISTRIBUTION, installed_version, model_description, model_guid
from .model import Instance, Model, ModelError
from .state import State


class _Access:
    """Get and set of some references (offsets) in a block: in one piece where they are consecutive."""

    def __init__(self, block: np.ndarray, references: list[int]):
        self.references = references
        self.first = min(references)
        n = len(references)
        if references == list(range(self.first, self.first + n)):
            self.get = block[self.first : self.first + n].tolist
            pack, memory, offset = struct.Struct(f"{n}d").pack_into, memoryview(block).cast("B"), 8 * self.first
            # Four times faster than NumPy's assignment of a list.
            self.set = lambda values: pack(memory, offset, *values)
        else:
            index = np.array(references)
            self.get = lambda: block[index].tolist()
            self.set = lambda values: block.__setitem__(index, values)


class RecordSlave(Fmi2Slave):
    """Base of every FMU's script, which sets ``make_model`` and what it was built from.

    pythonfmu turns an exception into fmi2Fatal, after which the instance is lost, and a False from ``do_step`` into fmi2Discard.
    So only instantiation and initialisation raise; later failures are logged at level error and end the next step with a Discard.
    """

    built_version: str
    built_guid: str
    starts: dict[str, float | str]
    contents: dict[str, str]

    @staticmethod
    def make_model() -> Model:
        """The model, built from its sizes."""
        raise NotImplementedError

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        model = self.make_model()
        self.modelName = model.identifier
        if (self.built_version, self.built_guid) != (installed_version(), model_guid(model, contents=self.contents)):
            raise ModelError(
                f"{self.instance_name}: this FMU {model.identifier} was built by {DISTRIBUTION} {self.built_version}, but "
                f"{DISTRIBUTION} {installed_version()} is installed with another declaration of it; "
                f"build it again with 'cdl build', or install {DISTRIBUTION} {self.built_version}"
            )
        release_at_exit(Path(self.resources or ".").parent / "binaries" / "linux64" / f"{model.identifier}.so")
        self.instance = Instance(model, self.instance_name, Path(self.resources) if self.resources else None)
        self.instance.set_starts(self.starts)
        self._block = self.instance.block
        self._files = list(model.files)
        self._n_parameters = self.instance.slices["p"].stop
        self._accesses: dict[tuple[int, int], _Access] = {}
        self._start_time = 0.0
        self._initialised = False  # False again after each set, until initialisation mode ends
        self._stepping = False
        self._failure = ""

    def to_xml(self, model_options=None) -> Element:
        model = self.instance.model
        return model_description(model, model_guid(model, self.starts, self.contents), self.starts)

    # -- values: lists in, lists out

    def _access(self, vrs: list[int]) -> _Access:
        """Access to these references; masters repeat their lists."""
        key = vrs[0], len(vrs)
        known = self._accesses.get(key)
        if known is None or vrs != known.references:
            known = self._accesses[key] = _Access(self._block, vrs)
        return known

    def get_real(self, vrs: list[int]) -> list[float]:
        if not vrs:
            return []
        if not self._initialised:
            self._initialise()
        return self._access(vrs).get()

    def set_real(self, vrs: list[int], values: list[float]) -> None:
        if not vrs:
            return
        access = self._access(vrs)
        if not self._stepping:
            self._initialised = False
        elif access.first < self._n_parameters:
            self._refuse_parameter(self.instance.model.scalars["p"][access.first].name)
            return
        access.set(values)

    def get_integer(self, vrs: list[int]) -> list[int]:
        return [int(v) for v in self.get_real(vrs)]

    set_integer = set_real

    def get_string(self, vrs: list[int]) -> list[str]:
        return [self.instance.files[self._files[reference]] for reference in vrs]

    def set_string(self, vrs: list[int], values: list[str]) -> None:
        for reference, value in zip(vrs, values):
            if self._stepping:
                self._refuse_parameter(self._files[reference])
                return
            self._initialised = False
            self.instance.files[self._files[reference]] = value

    def _refuse_parameter(self, name: str) -> None:
        self._fail(f"{self.instance_name}: parameter {name} is fixed: set it before initialisation ends, not during the run")

    # -- life

    def setup_experiment(self, start_time, stop_time, tolerance) -> None:
        self._start_time = start_time

    def exit_initialization_mode(self) -> None:
        if not self._initialised:
            self._initialise()
        self._stepping = True

    def _initialise(self) -> None:
        try:
            self.instance.initialise(self._start_time)
        except ModelError as error:
            self.log(str(error), Fmi2Status.error)
            raise
        self._initialised = True

    def do_step(self, current_time: float, step_size: float) -> bool:
        if self._failure:
            self._failure = ""
            return False
        try:
            self.instance.step(current_time, step_size)
        except ModelError as error:
            self._fail(str(error))
        except Exception as error:  # anything else must not become fmi2Fatal either: the state can still be restored
            self._fail(f"{self.instance_name}: {type(error).__name__}: {error} (t = {current_time:.6g} s)")
        if self.instance.warnings:
            for text in self.instance.warnings:
                self.log(text, Fmi2Status.warning)
            self.instance.warnings.clear()
        failed, self._failure = self._failure, ""
        return not failed

    def _fail(self, text: str) -> None:
        self._failure = text
        self.log(text, Fmi2Status.error)

    # -- whole state

    def _get_fmu_state(self) -> State:
        return self.instance.save()

    def _set_fmu_state(self, state: State) -> None:
        self.instance.restore(state)
        self._failure = ""

    # The wrapper calls these two on the class.

    @classmethod
    def _fmu_state_to_bytes(cls, state: State) -> bytes:
        return cls.built_guid.encode() + state.to_bytes(cls.make_model().pool_class)

    @classmethod
    def _fmu_state_from_bytes(cls, data: bytes) -> State:
        guid = cls.built_guid.encode()
        if data[: len(guid)] != guid:
            raise ModelError(f"this state was saved by another build of {cls.__name__}; restore it with the FMU that saved it")
        return State.from_bytes(data[len(guid) :], cls.make_model().pool_class)


@cache
def release_at_exit(wrapper: Path) -> None:
    """Have pythonfmu's Linux wrapper release its interpreter state while that still exists.

    Left alone, pythonfmu 0.7.0 releases it when the process ends, and then once more where it was: the heap is corrupted, and one run
    in ten of a host in Python ends with an abort.
    """
    if sys.platform == "linux" and wrapper.exists():  # the latter not while an FMU is being built
        atexit.register(ctypes.CDLL(str(wrapper)).finalizePythonInterpreter)
