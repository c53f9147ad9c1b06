"""XML of foreign packages: parsed without DTD and entities, every element knows its file and line."""

from __future__ import annotations

import math
from pathlib import Path
from urllib.parse import unquote, urlsplit
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from .archive import SspError

MAX_BYTES = 64 * 2**20
MAX_DEPTH = 64


class Node(Element):
    """An element with its place: ``file`` (name) and ``line`` (from 1)."""

    file = ""
    line = 0

    @property
    def where(self) -> str:
        return f"{self.file}, line {self.line}"

    @property
    def local(self) -> str:
        """Tag without its namespace."""
        return self.tag.rpartition("}")[2]

    def children(self, *names: str) -> list[Node]:
        """Elements down the given local names: ``children("Connectors", "Connector")``."""
        return self.findall("/".join("{*}" + name for name in names))

    def child(self, name: str) -> Node | None:
        return self.find("{*}" + name)

    def required(self, attribute: str) -> str:
        value = self.get(attribute)
        if value is None:
            raise SspError(f"{self.where}: {self.local} has no attribute {attribute!r}; add it")
        return value

    def number(self, attribute: str, default: float | None) -> float | None:
        text = self.get(attribute)
        if text is None:
            return default
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        if not math.isfinite(number):
            raise SspError(f"{self.where}: {self.local} {attribute} = {text!r} is no finite number; write one")
        return number

    def flag(self, attribute: str) -> bool:
        return self.get(attribute) in ("true", "1")

    def path(self, attribute: str, folder: Path) -> Path:
        """File inside ``folder`` that a relative URI names. Raises SspError for any other URI and for a missing file."""
        uri = self.required(attribute)
        path = _inside(folder, uri)
        if path is None:
            raise SspError(
                f"{self.where}: {attribute} = {uri!r} is no file of the package; put it into resources/ and name it by a relative path"
            )
        if not path.is_file():
            raise SspError(f"{self.where}: {attribute} = {uri!r} is missing from the package; add the file or correct the name")
        return path


def _inside(folder: Path, uri: str) -> Path | None:
    """Path that a relative URI names inside a folder, None for any other URI."""
    try:
        parts = urlsplit(uri)
        path = (folder / unquote(parts.path)).resolve()
    except ValueError:  # brackets that are no address, NUL
        return None
    beyond = parts.scheme or parts.netloc or parts.query or parts.fragment
    return None if beyond or not path.is_relative_to(folder.resolve()) else path


def parse(path: Path) -> Node:
    """Root element of an XML file. Raises SspError if it is missing, malformed, too large, too deep, or has a DTD."""
    if not path.is_file():
        raise SspError(f"{path.name} is missing from the package; export it again")
    if path.stat().st_size > MAX_BYTES:
        raise SspError(f"{path.name}: {path.stat().st_size} bytes of XML, more than {MAX_BYTES}; get it from a source you trust")
    builder = TreeBuilder(element_factory=Node)
    parser = expat.ParserCreate(namespace_separator="}")
    depth = 0

    def qualified(name: str) -> str:
        return "{" + name if "}" in name else name

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > MAX_DEPTH:
            raise SspError(
                f"{path.name}, line {parser.CurrentLineNumber}: elements nested deeper than {MAX_DEPTH}; get it from a source you trust"
            )
        node = builder.start(qualified(tag), {qualified(name): value for name, value in attributes.items()})
        node.file, node.line = path.name, parser.CurrentLineNumber

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(qualified(tag))

    def doctype(*_: object) -> None:
        # Refused before any entity is declared, let alone expanded.
        raise SspError(
            f"{path.name}, line {parser.CurrentLineNumber}: a document type declaration (DTD, entities) is not allowed; remove it"
        )

    parser.StartElementHandler, parser.EndElementHandler, parser.StartDoctypeDeclHandler = start, end, doctype
    try:
        parser.Parse(path.read_bytes(), True)
    except (expat.ExpatError, LookupError, ValueError) as error:  # also an unknown encoding
        raise SspError(f"{path.name}: malformed XML ({error}); export it again") from error
    return builder.close()


_ELEMENT = {"Connectors", "ElementGeometry", "ParameterBindings", "Annotations"}
_TYPES = {"Real", "Integer", "Boolean", "String", "Enumeration"}
# What is read, element by element; an element that is not a key here is taken as a whole or means nothing to a simulation.
_SUPPORTED = {
    "SystemStructureDescription": {"System", "Enumerations", "Units", "DefaultExperiment", "Annotations"},
    "System": _ELEMENT | {"Elements", "Connections", "SystemGeometry", "GraphicalElements"},
    "Elements": {"Component", "System"},
    "Component": _ELEMENT,
    "Connectors": {"Connector"},
    "Connector": _TYPES | {"ConnectorGeometry", "Annotations"},
    "Connections": {"Connection"},
    "Connection": {"LinearTransformation", "ConnectionGeometry", "Annotations"},
    "ParameterBindings": {"ParameterBinding"},
    "ParameterBinding": {"ParameterValues", "ParameterMapping", "Annotations"},
    "ParameterValues": {"ParameterSet"},
    "ParameterMapping": {"ParameterMapping", "MappingEntry", "Annotations"},
    "MappingEntry": {"LinearTransformation", "Annotations"},
    "ParameterSet": {"Parameters", "Enumerations", "Units", "Annotations"},
    "Parameters": {"Parameter"},
    "Parameter": _TYPES | {"Annotations"},
}
_REMEDY = {
    "SignalDictionaries": "connect the elements directly",
    "SignalDictionaryReference": "connect the elements directly",
    "Binary": "leave binary variables to the FMU",
    "BooleanMappingTransformation": "let the FMU map the values",
    "IntegerMappingTransformation": "let the FMU map the values",
    "EnumerationMappingTransformation": "let the FMU map the values",
}
_NAMESPACE = "{http://ssp-standard.org/SSP1/"


def parse_ssp(path: Path, root: str) -> Node:
    """Root element of an SSP 1.0 file of the kind ``root``. Raises SspError for another kind or version and for unsupported elements."""
    node = parse(path)
    if node.local != root:
        raise SspError(f"{node.where}: root element {node.local}, not {root}; name a file of the right kind")
    version = node.required("version")
    if not version.startswith("1."):
        raise SspError(f"{node.where}: SSP version {version}; only SSP 1.0 is supported, export as SSP 1.0")
    _refuse_unsupported(node)
    return node


def _refuse_unsupported(node: Node) -> None:
    for child in node if node.local in _SUPPORTED else ():
        if child.local not in _SUPPORTED[node.local] or not child.tag.startswith(_NAMESPACE):
            remedy = _REMEDY.get(child.local, "export the system without it")
            raise SspError(f"{child.where}: element {child.local} in {node.local} is not supported; {remedy}")
        _refuse_unsupported(child)
