"""A system as folders and a plain text table, for hosts that read neither ZIP archives nor XML (``examples/c_host/host.c``)."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from .master import is_recorded
from .ssp import Component, SspError, System, read_system

#: The table's name in its folder.
TABLE = "system.txt"

_FORMAT = """\
# {name}: a system of FMI 2.0 co-simulation FMUs, each unpacked in the folder of its instance's name beside this file.
#
# start S, step S, stop S: start time, communication step and stop time [s].
# instances N: N lines 'name model-identifier guid'. They are numbered from 0, in the order in which they are initialised: an instance
#   gets its inputs in initialisation mode if all of them come from instances above it. All other values start as the FMU has them.
# connections N: N lines 'from vr to vr', numbers of instances and value references of Real variables, sorted by 'to' and its reference.
# signals N: N lines 'instance vr name' of Real outputs to record.
"""


def write_unpacked(package: Path, folder: Path) -> None:
    """Unpack an SSP package whose FMUs hold their start values, as those of experiments do, into a new or empty folder.

    The folder gets an unpacked FMU for each instance, in ``<instance>/``, and ``system.txt``. That is read line by line with ``fscanf``;
    lines which begin with ``#`` say what the others hold: times [s], instances with model identifier and GUID, connections
    by value references, and the signals to record. Names of signals are those of ``cdl export --csv``.

    Raises SspError for a folder that holds something, for a package without step or stop time, and for a connection the table cannot hold.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise SspError(f"{folder} holds something already: name a new or an empty folder")
    with TemporaryDirectory() as cache:
        system = read_system(package, cache)
        lines = list(_lines(system))
        for name, component in system.components.items():
            shutil.copytree(component.directory, folder / name)
    (folder / TABLE).write_text(_FORMAT.format(name=system.name) + "\n".join(lines) + "\n", encoding="utf-8", newline="\n")


def _lines(system: System) -> Iterator[str]:
    if system.step_size is None or system.stop_time is None:
        raise SspError(f"{system.name}: the table needs a step and a stop time; give the package a DefaultExperiment with both")
    components = [system.components[name] for name in system.initialising_order()]
    number = {component.name: i for i, component in enumerate(components)}
    reals = {component.name: _reals(component) for component in components}
    yield f"start {system.start_time!r}"
    yield f"step {system.step_size!r}"
    yield f"stop {system.stop_time!r}"
    yield f"instances {len(components)}"
    for component in components:
        description = component.model_description
        yield f"{component.name} {description.coSimulation.modelIdentifier} {description.guid}"
    connections = []
    for c in system.connections:
        source, target = reals[c.source_component].get(c.source_variable), reals[c.target_component].get(c.target_variable)
        if source is None or target is None or (c.factor, c.offset) != (1.0, 0.0):
            raise SspError(f"{c.target_component}.{c.target_variable}: the table holds connections of Reals in one unit only; use the .ssp")
        connections.append((number[c.target_component], target, number[c.source_component], source))
    yield f"connections {len(connections)}"
    for to, target, of, source in sorted(connections):
        yield f"{of} {source} {to} {target}"
    outputs = {
        component.name: {v.name for v in component.model_description.modelVariables if v.causality == "output"} for component in components
    }
    signals = [
        (c.name, name, vr) for c in components for name, vr in reals[c.name].items() if name in outputs[c.name] and is_recorded(name)
    ]
    yield f"signals {len(signals)}"
    for component, name, vr in signals:
        yield f"{number[component]} {vr} {component}.{name.replace(',', '][')}"


def _reals(component: Component) -> dict[str, int]:
    """Value references of the Real variables by name."""
    return {v.name: v.valueReference for v in component.model_description.modelVariables if v.type == "Real"}
