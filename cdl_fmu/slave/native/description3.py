"""FMI 3.0 model description of a model, from its records alone: what is an array there is an array here."""

from __future__ import annotations

from collections.abc import Mapping
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from ..description import CAUSALITY, declare_log_and_steps, declare_units, root_element, type_name
from ..model import Model
from ..records import Choice, Variable

_CAPABILITIES = {
    "canHandleVariableCommunicationStepSize": "true",
    "canBeInstantiatedOnlyOncePerProcess": "false",
    "canGetAndSetFMUState": "true",
    "canSerializeFMUState": "true",
    "needsExecutionTool": "false",
}


def model_description3(model: Model, token: str, starts: np.ndarray, files: Mapping[str, str]) -> Element:
    """Root element of modelDescription.xml.

    Args:
        model: The model.
        token: Instantiation token.
        starts: Of the whole block ``[p|u|x|y]``; a variable's value reference is the offset in it at which it begins.
        files: Start value of each file parameter.
    """
    root = root_element(model, fmiVersion="3.0", instantiationToken=token)
    SubElement(root, "CoSimulation", _CAPABILITIES, modelIdentifier=model.identifier)
    records = {"p": model.parameters, "u": model.inputs, "x": model.state, "y": model.outputs}
    first = dict(zip(records, np.cumsum([0, *map(len, records.values())]).tolist()))
    variables = [(part, first[part], v) for part, record in records.items() if part in CAUSALITY for v in record.variables()]
    declare_units(root, {"s", *(v.field.unit for _, _, v in variables)})
    _types(root, [v for _, _, v in variables if isinstance(v.field, Choice)])
    declare_log_and_steps(root)
    listing = SubElement(root, "ModelVariables")
    for part, start, variable in variables:
        _variable(listing, part, start + variable.offset, variable, starts)
    n_block = sum(map(len, records.values()))
    SubElement(
        listing,
        "Float64",
        name="time",
        valueReference=str(n_block),
        causality="independent",
        variability="continuous",
        unit="s",
        description="Simulation time",
    )
    for i, (name, description) in enumerate(model.files.items(), n_block + 1):
        file = SubElement(listing, "String", CAUSALITY["p"], name=name, valueReference=str(i), description=description)
        SubElement(file, "Start", value=files[name])
    structure = SubElement(root, "ModelStructure")
    outputs = [str(start + v.offset) for part, start, v in variables if part == "y"]
    dependencies = {} if model.feedthrough else {"dependencies": ""}
    for kind, attributes in (("Output", dependencies), ("InitialUnknown", {})):
        for reference in outputs:
            SubElement(structure, kind, attributes, valueReference=reference)
    return root


def _types(root: Element, choices: list[Variable]) -> None:
    if not choices:
        return
    definitions = SubElement(root, "TypeDefinitions")
    for choice in choices:
        enumeration = SubElement(definitions, "EnumerationType", name=type_name(choice.name))
        for value, (option, text) in enumerate(choice.field.options.items(), 1):
            SubElement(enumeration, "Item", name=option, value=str(value), description=text)


def _variable(listing: Element, part: str, reference: int, variable: Variable, starts: np.ndarray) -> None:
    field = variable.field
    attributes = {"name": variable.name, "valueReference": str(reference), "description": field.description, **CAUSALITY[part]}
    if isinstance(field, Choice):
        SubElement(listing, "Enumeration", attributes, declaredType=type_name(variable.name), start=f"{starts[reference]:.0f}")
        return
    if part != "p":
        attributes["variability"] = "continuous"
    bounds = {key: f"{bound:.17g}" for key, bound in (("min", field.min), ("max", field.max)) if abs(bound) != float("inf")}
    values = starts[reference : reference + variable.length]
    shown = {} if part == "y" else {"start": " ".join(f"{value:.17g}" for value in values)}
    element = SubElement(listing, "Float64", attributes | {"unit": field.unit} | bounds | shown)
    for extent in field.shape:
        SubElement(element, "Dimension", start=str(extent))
