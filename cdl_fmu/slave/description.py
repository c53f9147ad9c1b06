"""FMI 2.0 model description of a model, from its records alone."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
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
# Record -> causality and attributes of its variables; the state is no variable of the FMU.
_CAUSALITY = {
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
        if part in _CAUSALITY:
            out += [(part, start + s.offset, s) for s in scalars]
        start += len(scalars)
    return out


_NONE: Mapping = MappingProxyType({})


def model_guid(model: Model, starts: Mapping[str, float | str] = _NONE, contents: Mapping[str, str] = _NONE) -> str:
    """Identifies interface, version, start values and files: if they are the same the GUID is the same, else it is another one."""
    digest = hashlib.sha256(tostring(_description(model, guid="", starts=starts)))
    for packed in sorted(contents.items()):
        digest.update(repr(packed).encode())
    return f"{{{UUID(bytes=digest.digest()[:16])}}}"


def model_description(model: Model, starts: Mapping[str, float | str], contents: Mapping[str, str]) -> Element:
    """Root element of modelDescription.xml.

    ``starts`` replaces start values of parameters and inputs, by FMI name; ``contents`` has the hash of each file packed, by its name.
    """
    return _description(model, model_guid(model, starts, contents), starts)


def _description(model: Model, guid: str, starts: Mapping[str, float | str]) -> Element:
    root = Element(
        "fmiModelDescription",
        fmiVersion="2.0",
        modelName=model.identifier,
        guid=guid,
        description=(type(model).__doc__ or "").split("\n")[0],
        version=installed_version(),
        license="BSD-3-Clause",
        generationTool=f"{DISTRIBUTION} {installed_version()}",
        variableNamingConvention="structured",
    )
    SubElement(root, "CoSimulation", _OPTIONS, modelIdentifier=model.identifier)
    variables = value_references(model)
    _units(root, sorted({s.field.unit for _, _, s in variables}))
    _types(root, [s for _, _, s in variables])
    categories = SubElement(root, "LogCategories")
    for status, what in (("Warning", "continue with a doubt"), ("Error", "name what was refused and the remedy")):
        SubElement(categories, "Category", name=f"logStatus{status}", description=f"Messages that {what}")
    SubElement(root, "DefaultExperiment", startTime="0", stepSize="0.001")
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


def _units(root: Element, units: list[str]) -> None:
    definitions = SubElement(root, "UnitDefinitions")
    for unit in units:
        declared = SubElement(definitions, "Unit", name=unit)
        exponents = base_unit(unit)
        if exponents is not None:
            SubElement(declared, "BaseUnit", {base: str(e) for base, e in exponents.items()})


def _types(root: Element, scalars: list[Scalar]) -> None:
    choices = [s for s in scalars if isinstance(s.field, Choice)]
    if choices:
        definitions = SubElement(root, "TypeDefinitions")
        for scalar in choices:
            enumeration = SubElement(SubElement(definitions, "SimpleType", name=_type_name(scalar)), "Enumeration")
            for value, (option, text) in enumerate(scalar.field.options.items(), 1):
                SubElement(enumeration, "Item", name=option, value=str(value), description=text)


def _type_name(scalar: Scalar) -> str:
    return f"Choice_{scalar.name}"


def _attributes(name: str, reference: int, description: str, part: str) -> dict[str, str]:
    return {"name": name, "valueReference": str(reference), "description": description, **_CAUSALITY[part]}


def _variable(listing: Element, part: str, reference: int, scalar: Scalar, start: float) -> None:
    field = scalar.field
    variable = SubElement(listing, "ScalarVariable", _attributes(scalar.name, reference, field.description, part))
    attributes = {} if part == "y" else {"start": f"{start:.17g}"}
    if isinstance(field, Choice):
        SubElement(variable, "Enumeration", attributes, declaredType=_type_name(scalar))
        return
    bounds = {key: f"{bound:.17g}" for key, bound in (("min", field.min), ("max", field.max)) if abs(bound) != float("inf")}
    SubElement(variable, "Real", {"unit": field.unit, **bounds, **attributes})
