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

    def stepping_order(self) -> list[str]:
        """Dependency order: a component with feedthrough before those it feeds; where a cycle remains, the system's own order."""
        direct = {name: has_feedthrough(component.model_description) for name, component in self.components.items()}
        waits_for = {name: set() for name in self.components}
        for connection in self.connections:
            if direct[connection.source_component] and connection.source_component != connection.target_component:
                waits_for[connection.target_component].add(connection.source_component)
        order: list[str] = []
        while len(order) < len(self.components):
            left = [name for name in self.components if name not in order]
            ready = [name for name in left if waits_for[name] <= set(order)]
            order.append((ready or left)[0])
        # Those without feedthrough step last: the others need their outputs of t, not of t + H.
        return sorted(order, key=lambda name: not direct[name])

    def initialising_order(self) -> list[str]:
        """Components without feedthrough first: the others evaluate their first outputs from what these send."""
        return sorted(self.stepping_order(), key=lambda name: has_feedthrough(self.components[name].model_description))


def has_feedthrough(description: ModelDescription) -> bool:
    """False if the FMU says that no output depends on an input at the same time."""
    return any(o.dependencies is None or len(o.dependencies) > 0 for o in description.outputs)


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
