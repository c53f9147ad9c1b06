"""Reading of SSP packages: nested systems flattened, units converted, parameters resolved, everything checked."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path

from .archive import SspError, unpack
from .check import check_arrays, check_same_type
from .system import Component, Connection, System, load_component, variables_of
from .units import Transform, Unit, unit_of, units_of_file, units_of_fmu
from .values import Value, bound_values, fitted, linear_transformation, variable_unit
from .xml import Node, parse_ssp

SSD = "SystemStructure.ssd"
OSP_ANNOTATION = "com.opensimulationplatform"

_PARAMETERS = ("parameter", "calculatedParameter")

# A connector of the flattened system: name of its component or system ("" is the outermost system), own name.
Key = tuple[str, str]


@dataclass(frozen=True)
class _Connector:
    kind: str
    unit: Unit | None
    node: Node


@dataclass(frozen=True)
class _Edge:
    source: Key
    node: Node


def read_system(path: Path | str, cache_dir: Path | str) -> System:
    """Read an SSP 1.0 package of FMI 2.0 co-simulation FMUs; SSP and FMUs are unpacked under ``cache_dir``.

    Raises SspError, naming element, file, line and remedy, for whatever is malformed, unsafe, inconsistent or not supported.
    """
    folder = unpack(path, cache_dir)
    for variant in sorted(folder.glob("*.ssd")):
        if variant.name != SSD:
            raise SspError(f"{path}: system structure variant {variant.name} is not supported; keep {SSD} alone in the package")
    root = parse_ssp(folder / SSD, "SystemStructureDescription")
    system = root.child("System")
    if system is None:
        raise SspError(f"{root.where}: no System; add one")
    start, stop, step = _default_experiment(root)
    reader = _Reader(folder, Path(cache_dir), units_of_file(root))
    reader.add_system(system, "")
    components, connections = reader.flattened()
    return System(root.required("name"), components, connections, start, stop, step)


def _default_experiment(root: Node) -> tuple[float, float | None, float | None]:
    """Start, stop and, from the annotation that libcosim reads too, the communication step."""
    experiment = root.child("DefaultExperiment")
    if experiment is None:
        return 0.0, None, None
    start, stop = experiment.number("startTime", 0.0), experiment.number("stopTime", None)
    if stop is not None and not stop >= start:
        raise SspError(f"{experiment.where}: stopTime = {stop:g} s is before startTime = {start:g} s; correct one of them")
    for annotation in experiment.children("Annotations", "Annotation"):
        algorithm = annotation.find("{*}Algorithm/{*}FixedStepAlgorithm")
        if annotation.get("type") == OSP_ANNOTATION and algorithm is not None:
            return start, stop, algorithm.number("baseStepSize", None)
    return start, stop, None


class _Reader:
    """Collects the flat system element by element."""

    def __init__(self, folder: Path, cache_dir: Path, units: dict[str, Unit]):
        self.folder, self.cache_dir, self.units = folder, cache_dir, units
        self.names: set[str] = set()  # of all elements: components and nested systems
        self.components: dict[str, Component] = {}
        self.variables: dict[str, dict] = {}
        self.fmu_units: dict[str, dict[str, Unit]] = {}
        self.connectors: dict[Key, _Connector] = {}
        self.edges: dict[Key, _Edge] = {}
        self.values: dict[Key, Value] = {}

    def add_system(self, node: Node, path: str) -> None:
        self._add_connectors(node, path)
        for element in node.children("Elements", "*"):
            name = _joined(path, element.required("name"))
            if name in self.names:
                raise SspError(f"{element.where}: two elements are named {name!r}; rename one")
            self.names.add(name)
            if element.local == "System":
                self.add_system(element, name)
            else:
                self._add_component(element, name)
        for connection in node.children("Connections", "Connection"):
            self._add_edge(connection, path)
        # After the bindings of all elements inside: the outer binding counts.
        self._bind(node, path, {"SSD": self.folder})

    def _add_component(self, node: Node, name: str) -> None:
        if (kind := node.get("type", "application/x-fmu-sharedlibrary")) != "application/x-fmu-sharedlibrary":
            raise SspError(
                f"{node.where}: component {name!r} of type {kind!r} is not supported; use an FMU, or a nested System instead of a package"
            )
        if node.get("implementation", "any") == "ModelExchange":
            raise SspError(f"{node.where}: component {name!r} asks for model exchange; only co-simulation is supported")
        component = load_component(name, node.path("source", self.folder), self.cache_dir)
        self.components[name] = component
        self.variables[name] = variables_of(component)
        self.fmu_units[name] = units_of_fmu(component.model_description)
        self._add_connectors(node, name)
        self._bind(node, name, {"SSD": self.folder, "component": component.directory})

    def _add_connectors(self, node: Node, owner: str) -> None:
        for connector in node.children("Connectors", "Connector"):
            key = owner, connector.required("name")
            kind = connector.required("kind")
            if kind == "inout":
                raise SspError(f"{connector.where}: connector {_label(key)} of kind inout is not supported; use input or output")
            if key in self.connectors:
                raise SspError(f"{connector.where}: connector {_label(key)} is declared twice; remove one")
            data = next((child for child in connector if child.local not in ("ConnectorGeometry", "Annotations")), None)
            unit = unit_of(data, self.units) if data is not None else None
            if owner in self.components:
                self._check_connector(connector, key, kind, data)
                own = self._variable_unit(key)
                self._converted(Transform(own), unit, connector, f"connector {_label(key)}, in the FMU")
                unit = unit or own
            self.connectors[key] = _Connector(kind, unit, connector)

    def _check_connector(self, node: Node, key: Key, kind: str, data: Node | None) -> None:
        owner, name = key
        variable = self.variables[owner].get(name)
        if variable is None:
            elements = sum(other.startswith(name + "[") for other in self.variables[owner])
            hint = f"; it is an array of {elements}, declare one connector an element" if elements else _close(name, self.variables[owner])
            raise SspError(f"{node.where}: connector {_label(key)}: the FMU has no such variable{hint}")
        if variable.causality != kind:
            raise SspError(f"{node.where}: connector {_label(key)} is {kind}, in the FMU it is {variable.causality}; correct the kind")
        if data is not None and data.local != variable.type:
            raise SspError(f"{node.where}: connector {_label(key)} is {data.local}, in the FMU it is {variable.type}; correct the type")

    def _add_edge(self, node: Node, path: str) -> None:
        # SSP: the kinds of the connectors, not the words start and end, give the direction.
        start, end = self._end(node, path, "start"), self._end(node, path, "end")
        sources = [self._gives(key, path) for key in (start, end)]
        if sources[0] == sources[1]:
            what = "give" if sources[0] else "take"
            raise SspError(f"{node.where}: {_label(start)} and {_label(end)} both {what} a value; connect an output to an input")
        source, target = (start, end) if sources[0] else (end, start)
        if (self.connectors[source].kind in _PARAMETERS) != (self.connectors[target].kind in _PARAMETERS):
            raise SspError(f"{node.where}: {_label(source)} to {_label(target)} joins a signal and a parameter; connect two of a kind")
        if target in self.edges:
            other = self.edges[target]
            pair = f"{_label(other.source)} (line {other.node.line}) and {_label(source)}"
            raise SspError(f"{node.where}: {_label(target)} has two sources, {pair}; remove one")
        self.edges[target] = _Edge(source, node)

    def _end(self, node: Node, path: str, side: str) -> Key:
        element, name = node.get(f"{side}Element"), node.required(f"{side}Connector")
        owner = path if element is None else _joined(path, element)
        if element is not None and owner not in self.names:
            raise SspError(f"{node.where}: {side}Element = {element!r} is no element of the system{_close(owner, self.names)}")
        if (owner, name) not in self.connectors:
            names = [key[1] for key in self.connectors if key[0] == owner]
            raise SspError(f"{node.where}: {side}Connector = {name!r} is no connector of {owner or 'the system'}{_close(name, names)}")
        return owner, name

    def _gives(self, key: Key, path: str) -> bool:
        """Whether a connector gives its value to the connections of the system ``path``; the system's own ones are seen from inside."""
        return (self.connectors[key].kind in ("output", "calculatedParameter")) != (key[0] == path)

    def _bind(self, node: Node, path: str, folders: dict[str, Path]) -> None:
        for value, mapping in bound_values(node, folders):
            key = self._resolve(path, mapping.target, value)
            unit = self._variable_unit(key) if key[0] in self.components else self.connectors[key].unit
            self.values[key] = value.into(unit, mapping)

    def _resolve(self, path: str, name: str, value: Value) -> Key:
        """Variable or system connector of a hierarchical name within ``path``."""
        candidates = [(path, name)]
        if path not in self.components:
            dots = [i for i, character in enumerate(name) if character == "."]
            candidates += [(_joined(path, name[:i]), name[i + 1 :]) for i in dots]
        for key in candidates:
            if key[1] in self.variables.get(key[0], ()) or (key[0] not in self.components and key in self.connectors):
                return key
        known = [variable for owner, _ in candidates for variable in self.variables.get(owner, ())]
        raise SspError(f"{value.where}: parameter {name!r} does not exist in {path or 'the system'}{_close(candidates[-1][1], known)}")

    def _variable_unit(self, key: Key) -> Unit | None:
        name = variable_unit(self.variables[key[0]][key[1]])
        return self.fmu_units[key[0]].get(name, Unit(name)) if name else None

    def flattened(self) -> tuple[dict[str, Component], list[Connection]]:
        """Components with their start values, and the connections between them."""
        connections = []
        for key, connector in self.connectors.items():
            if key[0] not in self.components or connector.kind not in ("input", "parameter"):
                continue
            chain = self._chain(key)
            if chain[0][0] in self.components and chain[0] != key:
                connections.append(self._connection(chain))
            elif valued := [i for i, passed in enumerate(chain) if passed in self.values]:
                value = self.values[chain[valued[0]]]  # the outermost counts
                self.values[key] = replace(value, transform=self._carried(value.transform, chain[valued[0] :]))
            elif connector.kind == "input":
                raise SspError(
                    f"{connector.node.where}: input {_label(key)} is not connected and has no parameter value; connect it or set a value"
                )
        starts: dict[str, dict] = {name: {} for name in self.components}
        for (owner, name), value in self.values.items():
            if owner in starts:
                variable = self.variables[owner][name]
                if variable.variability == "constant" or variable.initial not in ("exact", "approx"):
                    raise SspError(f"{value.where}: {owner}.{name} is no parameter but {variable.causality}; remove its value")
                starts[owner][name] = fitted(variable, value, f"{owner}.{name}")
        check_arrays(self.components, connections, starts)
        return {name: replace(component, parameters=starts[name]) for name, component in self.components.items()}, connections

    def _chain(self, key: Key) -> list[Key]:
        """Connectors that a value passes to arrive at ``key``, in the order of its flow."""
        chain = [key]
        while chain[-1] in self.edges:
            source = self.edges[chain[-1]].source
            if source in chain:
                raise SspError(f"{self.edges[chain[-1]].node.where}: the connections of {_label(source)} form a ring; remove one")
            chain.append(source)
        return chain[::-1]

    def _carried(self, transform: Transform, chain: list[Key]) -> Transform:
        """What a value undergoes along a chain, to the unit of the FMU variable at its end."""
        for target in chain[1:]:
            node = self.edges[target].node
            what = f"{_label(chain[0])} to {_label(target)}:"
            transform = self._converted(transform, self.connectors[target].unit, node, what, **linear_transformation(node))
        return transform.into(self._variable_unit(chain[-1]))

    def _converted(self, transform: Transform, unit: Unit | None, node: Node, what: str, **linear: float | bool) -> Transform:
        try:
            return transform.into(unit, **linear)
        except ValueError as error:
            raise SspError(
                f"{node.where}: {what} {error}; correct the unit, or set suppressUnitConversion if the numbers fit as they are"
            ) from None

    def _connection(self, chain: list[Key]) -> Connection:
        source, target = chain[0], chain[-1]
        node = self.edges[target].node
        if self.connectors[target].kind == "parameter":
            raise SspError(
                f"{node.where}: {_label(source)} to parameter {_label(target)} is not supported; set the parameter's value instead"
            )
        variables = self.variables[source[0]][source[1]], self.variables[target[0]][target[1]]
        check_same_type(*variables, f"{node.where}: {_label(source)} to {_label(target)}")
        own = Transform(self._variable_unit(source)).into(self.connectors[source].unit)
        transform = self._carried(own, chain)
        if variables[1].type != "Real" and not transform.is_identity:
            raise SspError(f"{node.where}: {_label(target)} is {variables[1].type}; only Real values can be transformed, remove it")
        return Connection(*source, *target, transform.factor, transform.offset)


def _joined(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name


def _label(key: Key) -> str:
    return _joined(*key)


def _close(name: str, known: Iterable[str]) -> str:
    matches = get_close_matches(name, known, n=1)
    return f"; did you mean {matches[0]!r}?" if matches else "; correct the name"
