"""Native FMUs for tests, built once into the cache, and a slave of one."""

from pathlib import Path

import fmpy
import numpy as np
from slabs import files_of

from cdl_fmu.slave.model import Instance, KernelModel
from cdl_fmu.slave.native.build import build_native_fmus, cached_native_fmu
from fmus import SHIPPED
from orchestrator.fmu import Slave

#: All that ``cdl build --native`` makes of kernels.
MODELS = [model for model in SHIPPED if isinstance(model, KernelModel) and not model.needs_python]


class Twins:
    """A native FMU and the Python instance of the same model, given the same values."""

    def __init__(self, model: KernelModel, folder: Path, name: str = "it", **values):
        files = files_of(model)
        self.python = Instance(model, name, **files)
        self.native, self.warnings = new_slave(model, folder, name, files), []
        self.native._warn = self.warnings.append
        for key, value in values.items():
            self.python.set_parameter(key, value)
        self.values = {s.name: self.python.block[s.offset] for s in model.scalars["p"] if self.python.block[s.offset] != s.start}

    def initialise(self) -> None:
        self.python.initialise()
        self.native.initialise(0.0, None, self.values)

    @property
    def u(self) -> np.ndarray:
        return self.python.block[self.python.slices["u"]]

    def send(self, u: np.ndarray) -> None:
        """Set all inputs."""
        self.u[:] = self.native.u[:] = u
        self.native.set(0.0)

    def step(self, t: float, h: float) -> None:
        self.python.step(t, h)
        self.native.step(t, h)

    def outputs(self) -> tuple[np.ndarray, np.ndarray]:
        """Those of the native FMU and of Python."""
        self.native.get(0.0)
        return self.native.y.copy(), self.python.block[self.python.slices["y"]].copy()


def new_slave(model: KernelModel, folder: Path, name: str, files: dict[str, Path]) -> Slave:
    """A slave of the model's native FMU with all inputs and outputs bound."""
    return slave_of(cached_native_fmu(model, {}, files), folder, name)


def slave_of(fmu: Path, folder: Path, name: str) -> Slave:
    """A slave of an FMU with all inputs and outputs bound."""
    description = fmpy.read_model_description(str(fmu))
    slave = Slave(name, description, fmpy.extract(str(fmu), str(folder / fmu.stem)), lambda text: None)
    names = {c: [v.name for v in description.modelVariables if v.causality == c] for c in ("input", "output")}
    starts = {v.name: float(v.start or 0.0) for v in description.modelVariables if v.causality == "input"}
    slave.connect(names["input"], np.array([starts[n] for n in names["input"]]), names["output"], np.zeros(len(names["output"])))
    return slave


def built(model: KernelModel, folder: Path, files: dict[str, Path]) -> dict[str, Path]:
    """Both FMUs of a model, by FMI version, built anew."""
    paths = {version: folder / version / f"{model.identifier}.fmu" for version in ("2.0", "3.0")}
    build_native_fmus(model, paths, files=files)
    return paths
