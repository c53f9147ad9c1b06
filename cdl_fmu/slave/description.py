"""FMI 2.0 model description of a model, from its records alone."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from functools import cache
from importlib.metadata import version
from types import MappingProxyType
from uuid import UUID
from xml.etree.ElementTree import Element, SubElement, tostring

from .model import Model
from .records import Choice, Scalar
from .units import base_unit

DISTRIBUTION = "cdl-fmu"
_OPTIONS = {
    "needsExecutionTool": "false",
    "canHandleVariableCommunicationStepSize": "true",
    "canBeInstantiatedOnlyOncePerProcess": "false",
    "canNotUseMemoryManagementFunctions": "true",
    "canGetAndSetFMUstate": "true",
    "canSerializeFMUstate": "true",
}
#: Record -> causality and attributes of its variables; the state is no variable of the FMU.
CAUSALITY = {
    "p": {"causality": "parameter", "variability": "fixed"},
    "u": {"causality": "input"},
    "y": {"causality": "output"},
}


@cache
def installed_version() -> str:
    """Version of the installed distribution."""
    return version(DISTRIBUTION)


def value_references(model: Model) -> list[tuple[str, int, Scalar]]:
    """(record, value reference, scalar) of every variable; the reference is the offset in the block ``[p|u|x|y]``."""
    out, start = [], 0
    for part, scalars in model.scalars.items():
        if part in CAUSALITY:
            out += [(part, start + s.offset, s) for s in scalars]
        start += len(scalars)
    return out


_NONE: Mapping = MappingProxyType({})


def model_guid(model: Model, starts: Mapping[str, float | str] = _NONE, contents: Mapping[str, str] = _NONE) -> str:
    """Identifies interface, version, start values and files: if they are the same the GUID is the same, else it is another one.

    Arguments as of :func:`model_description`; ``contents`` has the hash of each file packed, by its name.
    """
    digest = hashlib.sha256(tostring(model_description(model, "", starts)))
    for packed in sorted(contents.items()):
        digest.update(repr(packed).encode())
    return f"{{{UUID(bytes=digest.digest()[:16])}}}"


def model_description(model: Model, guid: str, starts: Mapping[str, float | str]) -> Element:
    """Root element of modelDescription.xml.

    ``starts`` replaces start values of parameters and inputs, by FMI name.
    """
    root = root_element(model, fmiVersion="2.0", guid=guid)
    SubElement(root, "CoSimulation", _OPTIONS, modelIdentifier=model.identifier)
    variables = value_references(model)
    declare_units(root, {s.field.unit for _, _, s in variables})
    _types(root, [s for _, _, s in variables])
    declare_log_and_steps(root)
    listing = SubElement(root, "ModelVariables")
    for part, reference, scalar in variables:
        _variable(listing, part, reference, scalar, starts.get(scalar.name, scalar.start))
    for reference, (name, description) in enumerate(model.files.items()):
        # FMI 2.0 counts the references of each base type for itself.
        file = SubElement(listing, "ScalarVariable", _attributes(name, reference, description, "p"))
        SubElement(file, "String", start=starts.get(name, ""))
    structure = SubElement(root, "ModelStructure")
    indices = [str(i) for i, (part, _, _) in enumerate(variables, 1) if part == "y"]
    dependencies = {} if model.feedthrough else {"dependencies": ""}
    for kind, attributes in (("Outputs", dependencies), ("InitialUnknowns", {})):
        unknowns = SubElement(structure, kind)
        for index in indices:
            SubElement(unknowns, "Unknown", attributes, index=index)
    return root


def root_element(model: Model, **identity: str) -> Element:
    """Root of a description, for FMI 2 and FMI 3 alike but for version and GUID."""
    return Element(
        "fmiModelDescription",
        identity,
        modelName=model.identifier,
        description=(type(model).__doc__ or "").split("\n")[0],
        version=installed_version(),
        license="BSD-3-Clause",
        generationTool=f"{DISTRIBUTION} {installed_version()}",
        variableNamingConvention="structured",
    )


def declare_log_and_steps(root: Element) -> None:
    """Declare the categories of messages, and the step that systems are made for."""
    categories = SubElement(root, "LogCategories")
    for status, what in (("Warning", "continue with a doubt"), ("Error", "name what was refused and the remedy")):
        SubElement(categories, "Category", name=f"logStatus{status}", description=f"Messages that {what}")
    SubElement(root, "DefaultExperiment", startTime="0", stepSize="0.001")


def declare_units(root: Element, units: Iterable[str]) -> None:
    """Declare units with their exponents of base units."""
    definitions = SubElement(root, "UnitDefinitions")
    for unit in sorted(units):
        declared = SubElement(definitions, "Unit", name=unit)
        exponents = base_unit(unit)
        if exponents is not None:
            SubElement(declared, "BaseUnit", {base: str(e) for base, e in exponents.items()})


def _types(root: Element, scalars: list[Scalar]) -> None:
    choices = [s for s in scalars if isinstance(s.field, Choice)]
    if choices:
        definitions = SubElement(root, "TypeDefinitions")
        for scalar in choices:
            enumeration = SubElement(SubElement(definitions, "SimpleType", name=type_name(scalar.name)), "Enumeration")
            for value, (option, text) in enumerate(scalar.field.options.items(), 1):
                SubElement(enumeration, "Item", name=option, value=str(value), description=text)


def type_name(name: str) -> str:
    """Name of the type of a choice."""
    return f"Choice_{name}"


def _attributes(name: str, reference: int, description: str, part: str) -> dict[str, str]:
    return {"name": name, "valueReference": str(reference), "description": description, **CAUSALITY[part]}


def _variable(listing: Element, part: str, reference: int, scalar: Scalar, start: float) -> None:
    field = scalar.field
    variable = SubElement(listing, "ScalarVariable", _attributes(scalar.name, reference, field.description, part))
    attributes = {} if part == "y" else {"start": f"{start:.17g}"}
    if isinstance(field, Choice):
        SubElement(variable, "Enumeration", attributes, declaredType=type_name(scalar.name))
        return
    bounds = {key: f"{bound:.17g}" for key, bound in (("min", field.min), ("max", field.max)) if abs(bound) != float("inf")}
    SubElement(variable, "Real", {"unit": field.unit, **bounds, **attributes})
