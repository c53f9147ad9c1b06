"""Writing of SSP packages that FMPy, libcosim and other tools run as they are."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement, indent, tostring
from zipfile import ZIP_DEFLATED, ZIP_STORED, ZipFile, ZipInfo

from fmpy.model_description import ModelDescription, ModelVariable, read_model_description

from .archive import SspError
from .read import OSP_ANNOTATION, SSD
from .system import Connection
from .units import BASE_UNITS, Unit, units_of_fmu
from .values import variable_unit

# libcosim reads the prefixes, not the namespaces, so tags are written with theirs.
_NAMESPACES = {
    "ssd": "http://ssp-standard.org/SSP1/SystemStructureDescription",
    "ssc": "http://ssp-standard.org/SSP1/SystemStructureCommon",
    "ssv": "http://ssp-standard.org/SSP1/SystemStructureParameterValues",
    "osp": "http://opensimulationplatform.com/SSP/OSPAnnotations",
    "oms": "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd",
}
_URI_SAFE = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9_.-]*")  # libcosim takes a URI for a path as it is
_TOLERANCES = {"absoluteTolerance": "0.0001", "relativeTolerance": "0.0001"}  # OMSimulator's own; its fixed step heeds none
_EPOCH = (1980, 1, 1, 0, 0, 0)  # the earliest time a ZIP entry can have


@dataclass(frozen=True)
class _Fmu:
    content: bytes
    resource: str
    description: ModelDescription
    variables: dict[str, ModelVariable]
    units: dict[str, Unit]


def write_system(
    path: Path | str,
    name: str,
    components: Mapping[str, Path | str],
    connections: Iterable[Connection],
    *,
    parameters: Mapping[str, Mapping[str, float | int | bool | str]] | None = None,
    start_time: float = 0.0,
    stop_time: float | None = None,
    step_size: float,
    observed: Iterable[tuple[str, str]] = (),
) -> None:
    """Write an SSP 1.0 package; the same arguments give the same bytes.

    ``components``: name -> FMU file. ``parameters``: component -> variable -> value in the variable's unit. ``observed``: further outputs,
    as (component, variable), that get a connector so that tools which record connectors record them. Times in seconds. A connection without
    factor and offset gets the conversion between the units of its variables, if they differ. Raises SspError for
    an unknown component or variable, and where a tool would silently do something else.

    Known differences: FMPy's ``simulate_ssp`` ignores parameters (build them into the FMUs' start values) and transformations of
    connections; it takes the step and the stop time as arguments.
    """
    parameters = parameters or {}
    connections = list(connections)
    fmus = _load(components)
    connected: dict[str, set[str]] = {component: set() for component in components}
    ends = [end for c in connections for end in ((c.source_component, c.source_variable), (c.target_component, c.target_variable))]
    for component, variable in [*ends, *observed]:
        _variable(fmus, component, variable)
        connected[component].add(variable)

    files = {f"resources/{fmu.resource}": fmu.content for fmu in fmus.values()}
    root = _root("ssd:SystemStructureDescription", "ssd", "ssc", "osp", "oms", name=name)
    system = SubElement(root, "ssd:System", name=name)
    elements = SubElement(system, "ssd:Elements")
    units: dict[str, Unit] = {}
    for component, fmu in fmus.items():
        element = SubElement(
            elements, "ssd:Component", name=component, type="application/x-fmu-sharedlibrary", source=f"resources/{fmu.resource}"
        )
        _connectors(element, component, fmu, connected[component], units)
        if values := parameters.get(component):
            # Files, not inline sets; at the component, not at the system: libcosim reads parameters nowhere else.
            source = f"resources/{component}.ssv"
            SubElement(SubElement(element, "ssd:ParameterBindings"), "ssd:ParameterBinding", source=source)
            files[source] = _parameter_set(component, fmus, values)
    if connections:
        _connections(SubElement(system, "ssd:Connections"), connections, fmus)
    # OMSimulator takes a system without its own annotation for none that it could run.
    annotation = SubElement(SubElement(system, "ssd:Annotations"), "ssc:Annotation", type="org.openmodelica")
    information = SubElement(SubElement(annotation, "oms:Annotations"), "oms:SimulationInformation")
    SubElement(information, "oms:FixedStepMaster", description="oms-ma", stepSize=repr(float(step_size)), **_TOLERANCES)
    _units(root, "ssd:Units", units)
    experiment = SubElement(root, "ssd:DefaultExperiment", startTime=repr(float(start_time)))
    if stop_time is not None:
        experiment.set("stopTime", repr(float(stop_time)))
    # SSP 1.0 has no communication step; libcosim reads it, and refuses to start without, from its own annotation.
    annotation = SubElement(SubElement(experiment, "ssd:Annotations"), "ssc:Annotation", type=OSP_ANNOTATION)
    SubElement(SubElement(annotation, "osp:Algorithm"), "osp:FixedStepAlgorithm", baseStepSize=repr(float(step_size)))
    files[SSD] = _document(root)
    _write_archive(Path(path), files)


def _load(components: Mapping[str, Path | str]) -> dict[str, _Fmu]:
    by_content: dict[bytes, _Fmu] = {}
    fmus: dict[str, _Fmu] = {}
    for component, file in components.items():
        if not _URI_SAFE.fullmatch(component):
            raise SspError(f"component {component!r}: its name becomes a file's; use letters, digits, '_', '.', '-'")
        content = Path(file).read_bytes()
        if content not in by_content:
            description = read_model_description(file)
            # libcosim takes FMUs of one GUID for the same FMU and would run the first in place of both.
            if twin := next((fmu for fmu in by_content.values() if fmu.description.guid == description.guid), None):
                raise SspError(
                    f"{file}: another FMU has its GUID {twin.description.guid} ({twin.resource}); build it with a GUID of its own"
                )
            stem, taken = re.sub(r"[^A-Za-z0-9_.-]", "_", Path(file).stem), {fmu.resource for fmu in by_content.values()}
            resource = f"{stem}.fmu" if f"{stem}.fmu" not in taken else f"{stem}_{len(by_content) + 1}.fmu"
            variables = {variable.name: variable for variable in description.modelVariables}
            by_content[content] = _Fmu(content, resource, description, variables, units_of_fmu(description))
        fmus[component] = by_content[content]
    return fmus


def _variable(fmus: Mapping[str, _Fmu], component: str, variable: str) -> ModelVariable:
    if component not in fmus:
        raise SspError(f"{component}.{variable}: no component {component!r}; use one of {', '.join(fmus)}")
    if variable not in fmus[component].variables:
        raise SspError(f"{component}.{variable}: the FMU {fmus[component].resource} has no such variable; correct the name")
    return fmus[component].variables[variable]


def _connectors(element: Element, component: str, fmu: _Fmu, names: set[str], units: dict[str, Unit]) -> None:
    """One scalar connector for each connected variable, in the order of the FMU: FMPy invents sources for unconnected inputs."""
    if not names:
        return
    listing = SubElement(element, "ssd:Connectors")
    for name, variable in fmu.variables.items():
        if name in names:
            if variable.type == "Enumeration":
                raise SspError(f"{component}.{name}: libcosim cannot connect an Enumeration; connect an Integer")
            connector = SubElement(listing, "ssd:Connector", name=name, kind=variable.causality)
            SubElement(connector, f"ssc:{variable.type}", _unit_attribute(f"{component}.{name}", variable, fmu, units))


def _unit_attribute(label: str, variable: ModelVariable, fmu: _Fmu, units: dict[str, Unit]) -> dict[str, str]:
    """The attribute that names a variable's unit, noting its definition in ``units``; none for a unit without base units."""
    unit = fmu.units.get(variable_unit(variable))
    if unit is None or unit.exponents is None:
        return {}
    if units.setdefault(unit.name, unit) != unit:
        raise SspError(f"{label}: unit {unit.name!r} is defined otherwise in another FMU; use one definition")
    return {"unit": unit.name}


def _connections(parent: Element, connections: list[Connection], fmus: Mapping[str, _Fmu]) -> None:
    """Sorted by the target, in the order of components and of their variables; from output to input, which libcosim needs."""
    order = {(c, v): i for i, (c, v) in enumerate((c, v) for c, fmu in fmus.items() for v in fmu.variables)}
    for c in sorted(connections, key=lambda c: order[c.target_component, c.target_variable]):
        # The factor is for the FMUs' units, so it stands in place of a unit conversion.
        linear = (c.factor, c.offset) != (1.0, 0.0)
        element = SubElement(
            parent,
            "ssd:Connection",
            startElement=c.source_component,
            startConnector=c.source_variable,
            endElement=c.target_component,
            endConnector=c.target_variable,
            **({"suppressUnitConversion": "true"} if linear else {}),
        )
        if linear:
            SubElement(element, "ssc:LinearTransformation", factor=repr(c.factor), offset=repr(c.offset))


def _parameter_set(component: str, fmus: Mapping[str, _Fmu], values: Mapping[str, float | int | bool | str]) -> bytes:
    root = _root("ssv:ParameterSet", "ssv", "ssc", name=component)
    listing = SubElement(root, "ssv:Parameters")
    units: dict[str, Unit] = {}
    for name in sorted(values):
        variable = _variable(fmus, component, name)
        # An Enumeration by its number: libcosim ends the process at ssv:Enumeration.
        kind = "Integer" if variable.type == "Enumeration" else variable.type
        text = str(values[name]).lower() if kind == "Boolean" else repr(float(values[name])) if kind == "Real" else str(values[name])
        unit = _unit_attribute(f"{component}.{name}", variable, fmus[component], units) if kind == "Real" else {}
        SubElement(SubElement(listing, "ssv:Parameter", name=name), f"ssv:{kind}", value=text, **unit)
    _units(root, "ssv:Units", units)
    return _document(root)


def _units(root: Element, tag: str, units: Mapping[str, Unit]) -> None:
    if not units:
        return
    listing = SubElement(root, tag)
    for name in sorted(units):
        unit = units[name]
        base = {key: f"{n:g}" for key, n in zip(BASE_UNITS, unit.exponents) if n}
        base |= {
            key: repr(value) for key, value, default in (("factor", unit.factor, 1.0), ("offset", unit.offset, 0.0)) if value != default
        }
        SubElement(SubElement(listing, "ssc:Unit", name=name), "ssc:BaseUnit", base)


def _root(tag: str, *prefixes: str, name: str) -> Element:
    return Element(tag, {f"xmlns:{prefix}": _NAMESPACES[prefix] for prefix in prefixes} | {"version": "1.0", "name": name})


def _document(root: Element) -> bytes:
    indent(root)
    return tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n"


def _write_archive(path: Path, files: Mapping[str, bytes]) -> None:
    staging = path.with_name(path.name + ".part")
    with ZipFile(staging, "w") as package:
        for name in sorted(files):
            entry = ZipInfo(name, _EPOCH)
            entry.create_system, entry.external_attr = 3, 0o644 << 16
            entry.compress_type = ZIP_STORED if name.endswith(".fmu") else ZIP_DEFLATED
            package.writestr(entry, files[name])
    os.replace(staging, path)
