"""A system of FMUs, ready to be run: all that a master needs to know of an SSP package."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from fmpy.model_description import ModelDescription, ModelVariable
from fmpy.model_description import read_model_description as _read

from .archive import SspError, unpack
from .xml import parse


@dataclass(frozen=True)
class Component:
    """An FMU instance. ``directory`` is the unpacked FMU (named by its content), ``parameters`` its start values in the FMU's own units."""

    name: str
    fmu_path: Path = field(compare=False)
    directory: Path
    model_description: ModelDescription = field(compare=False, repr=False)
    parameters: dict[str, float | int | bool | str] = field(default_factory=dict)


@dataclass(frozen=True)
class Connection:
    """target = factor * source + offset, both in their FMU's own units."""

    source_component: str
    source_variable: str
    target_component: str
    target_variable: str
    factor: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class System:
    """Components by name (those of nested systems as ``system.component``), connections, default times in seconds (None: not stated)."""

    name: str
    components: dict[str, Component]
    connections: list[Connection]
    start_time: float = 0.0
    stop_time: float | None = None
    step_size: float | None = None


def load_component(name: str, fmu_path: Path, cache_dir: Path) -> Component:
    """Unpack an FMU and read its description. Raises SspError if it is no valid FMI 2.0 co-simulation FMU."""
    directory = unpack(fmu_path, cache_dir)
    try:
        root = parse(directory / "modelDescription.xml")
    except SspError as error:
        raise SspError(f"{fmu_path.name} ({name}): {error}") from error
    if (version := root.get("fmiVersion")) != "2.0":
        raise SspError(f"{fmu_path.name} ({name}): FMI version {version} is not supported; export it as FMI 2.0 for co-simulation")
    if root.child("CoSimulation") is None:
        raise SspError(f"{fmu_path.name} ({name}): model exchange is not supported; export it as FMI 2.0 for co-simulation")
    try:
        description = _read(directory)
    except Exception as error:  # FMPy raises bare Exception among others
        raise SspError(f"{fmu_path.name} ({name}): invalid modelDescription.xml ({error}); export the FMU again") from error
    return Component(name, fmu_path, directory, description)


def variables_of(component: Component) -> dict[str, ModelVariable]:
    """Variables by name."""
    return {variable.name: variable for variable in component.model_description.modelVariables}
