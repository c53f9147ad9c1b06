"""Small FMUs and packages for the tests of SSP: descriptions without a binary to be read, pythonfmu slaves to be run."""

from __future__ import annotations

from pathlib import Path
from zipfile import ZipFile

import pytest
from pythonfmu import FmuBuilder

from orchestrator.ssp import SspError, read_system

UNITS = {
    "m": '<BaseUnit m="1"/>',
    "mm": '<BaseUnit m="1" factor="0.001"/>',
    "rad": '<BaseUnit rad="1"/>',
    "K": '<BaseUnit K="1"/>',
    "degC": '<BaseUnit K="1" offset="273.15"/>',
    "N/m^1.5": "",
}


def real(name: str, causality: str, unit: str = "m", **attributes: object) -> str:
    """A Real ScalarVariable; its value reference is filled in by ``describe``."""
    start = ' start="0"' if causality in ("input", "parameter") else ""
    more = "".join(f' {key}="{value}"' for key, value in attributes.items())
    return variable(name, causality, f'<Real unit="{unit}"{start}{more}/>')


def variable(name: str, causality: str, data: str) -> str:
    variability = {"parameter": "fixed", "calculatedParameter": "fixed"}.get(
        causality, "continuous" if data.startswith("<Real") else "discrete"
    )
    return f'<ScalarVariable name="{name}" valueReference="%d" causality="{causality}" variability="{variability}">{data}</ScalarVariable>'


def describe(
    *variables: str, version: str = "2.0", kind: str = "CoSimulation", prolog: str = "", guid: str = "g", convention: str = "structured"
) -> str:
    """A modelDescription.xml."""
    units = "".join(f'<Unit name="{name}">{base}</Unit>' for name, base in UNITS.items())
    listing = "".join(text % i for i, text in enumerate(variables))
    outputs = "".join(f'<Unknown index="{i + 1}"/>' for i, text in enumerate(variables) if 'causality="output"' in text)
    outputs = f"<Outputs>{outputs}</Outputs>" if outputs else ""
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>{prolog}'
        f'<fmiModelDescription fmiVersion="{version}" modelName="test" guid="{guid}" variableNamingConvention="{convention}">'
        f'<{kind} modelIdentifier="test"/><UnitDefinitions>{units}</UnitDefinitions>'
        f"<TypeDefinitions>{_enumeration('Mode', 'slow', 'fast')}{_enumeration('Gear', 'low')}</TypeDefinitions>"
        f"<ModelVariables>{listing}</ModelVariables><ModelStructure>{outputs}</ModelStructure></fmiModelDescription>"
    )


def _enumeration(name: str, *items: str) -> str:
    listing = "".join(f'<Item name="{item}" value="{i + 1}"/>' for i, item in enumerate(items))
    return f'<SimpleType name="{name}"><Enumeration>{listing}</Enumeration></SimpleType>'


def write_fmu(path: Path, description: str) -> Path:
    """An FMU that can be described but not run."""
    with ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", description)
    return path


NAMESPACES = " ".join(
    f'xmlns:{prefix}="http://ssp-standard.org/SSP1/SystemStructure{name}"'
    for prefix, name in (("ssd", "Description"), ("ssc", "Common"), ("ssv", "ParameterValues"), ("ssm", "ParameterMapping"))
)


def structure(system: str, after: str = "", version: str = "1.0") -> str:
    """A SystemStructure.ssd around the content of its outermost system."""
    head = f'<ssd:SystemStructureDescription {NAMESPACES} version="{version}" name="test">'
    return f'{head}\n<ssd:System name="root">\n{system}\n</ssd:System>{after}</ssd:SystemStructureDescription>'


def component(name: str, fmu: str, connectors: str = "", bindings: str = "", **attributes: str) -> str:
    """A Component; ``connectors`` are ``name:kind`` words, with a unit as ``name:kind:unit``."""
    more = "".join(f' {key}="{value}"' for key, value in attributes.items())
    listing = connector_list(connectors)
    return f'<ssd:Component name="{name}" source="resources/{fmu}.fmu"{more}>{listing}{bindings}</ssd:Component>'


def connector_list(words: str) -> str:
    out = ""
    for word in words.split():
        name, kind, *unit = word.split(":")
        out += f'<ssd:Connector name="{name}" kind="{kind}">' + "".join(f'<ssc:Real unit="{u}"/>' for u in unit) + "</ssd:Connector>\n"
    return f"<ssd:Connectors>{out}</ssd:Connectors>" if out else ""


def connections(*pairs: str) -> str:
    """Connections ``a.y -> b.u``, each at the last dot of its ends (no dot: a connector of the system); ``|`` before what stands inside."""
    out = ""
    for pair in pairs:
        ends, _, inside = pair.partition("|")
        start, _, end = ends.partition(" -> ")
        out += "<ssd:Connection"
        for side, text in (("start", start.strip()), ("end", end.strip())):
            element, _, name = text.rpartition(".")
            out += (f' {side}Element="{element}"' if element else "") + f' {side}Connector="{name}"'
        out += f">{inside}</ssd:Connection>\n"
    return f"<ssd:Connections>{out}</ssd:Connections>"


def parameter_set(*values: str, units: str = "") -> str:
    """An ssv:ParameterSet of ``name=<ssv:...>`` texts."""
    listing = "".join('<ssv:Parameter name="{}">{}</ssv:Parameter>'.format(*value.split("=", 1)) for value in values)
    return f'<ssv:ParameterSet {NAMESPACES} version="1.0" name="set"><ssv:Parameters>{listing}</ssv:Parameters>{units}</ssv:ParameterSet>'


def mapping(*entries: str) -> str:
    return f'<ssm:ParameterMapping {NAMESPACES} version="1.0">{"".join(entries)}</ssm:ParameterMapping>'


def binding(inline: str = "", mapped: str = "", **attributes: str) -> str:
    more = "".join(f' {key}="{value}"' for key, value in attributes.items())
    inline = f"<ssd:ParameterValues>{inline}</ssd:ParameterValues>" if inline else ""
    return f"<ssd:ParameterBindings><ssd:ParameterBinding{more}>{inline}{mapped}</ssd:ParameterBinding></ssd:ParameterBindings>"


def write_ssp(path: Path, ssd: str, fmus: dict[str, Path], **more: str) -> Path:
    """A package of a structure, FMUs in resources/, and further files by name."""
    with ZipFile(path, "w") as archive:
        archive.writestr("SystemStructure.ssd", ssd)
        for name, fmu in fmus.items():
            archive.write(fmu, f"resources/{name}.fmu")
        for name, text in more.items():
            archive.writestr(name, text)
    return path


PLANT = describe(
    real("u", "input"),
    real("y", "output"),
    real("k", "parameter", min=0, max=10),
    real("angle", "output", unit="rad"),
    real("t", "input", unit="degC"),
    real("warm", "output", unit="K"),
    real("n", "parameter", unit="N/m^1.5"),
    variable("mode", "parameter", '<Enumeration declaredType="Mode" start="1"/>'),
    variable("selected", "input", '<Enumeration declaredType="Mode" start="1"/>'),
    variable("gear", "output", '<Enumeration declaredType="Gear"/>'),
    variable("count", "parameter", '<Integer start="3"/>'),
    variable("on", "parameter", '<Boolean start="true"/>'),
    variable("file", "parameter", '<String start=""/>'),
    *(real(f"v[{i}]", "input") for i in (1, 2, 3)),
    *(real(f"w[{i}]", "output") for i in (1, 2, 3)),
    *(real(f"pair[{i}]", "input") for i in (1, 2)),
    *(real(f"wide[{i}]", "output") for i in (1, 2, 3)),
)


def two(*pairs, a="y:output", b="u:input", values=""):
    """Two plants a and b, connected."""
    return structure(f"<ssd:Elements>{component('a', 'plant', a)}{component('b', 'plant', b, values)}</ssd:Elements>{connections(*pairs)}")


def one(connectors="", bindings="", **attributes):
    """One plant a."""
    return structure(f"<ssd:Elements>{component('a', 'plant', connectors, bindings, **attributes)}</ssd:Elements>")


def reader(tmp_path: Path, plant: Path):
    """Reads a package of the given structure; every component is a plant unless other FMUs are given."""

    def read(ssd, fmus=None, **more):
        return read_system(write_ssp(tmp_path / "x.ssp", ssd, fmus or {"plant": plant}, **more), tmp_path / "cache")

    return read


def message(read, *args, **more) -> str:
    """What a refusal says."""
    with pytest.raises(SspError) as caught:
        read(*args, **more)
    return str(caught.value)


_SLAVE = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class {name}(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.u = 0.0
        self.y = 1.0
        self.k = {k}
        u = Real("port.u[1]", causality=Fmi2Causality.input, start=0.0, getter=lambda: self.u, setter=self.set_u)
        y = Real("port.y[1]", causality=Fmi2Causality.output, getter=lambda: self.y)
        self.register_variable(u, nested=False)
        self.register_variable(y, nested=False)
        self.register_variable(Real("k", causality=Fmi2Causality.parameter, variability=Fmi2Variability.fixed, start={k}))

    def set_u(self, value):
        self.u = value

    def do_step(self, t, h):
        self.y = {step}
        return True
"""


def build_slaves(folder: Path) -> dict[str, Path]:
    """Runnable FMUs: ``gain`` (y = k u) and ``integrator`` (y' = k u from y = 1), with ``port.u[1]``, ``port.y[1]`` and ``k``."""
    fmus = {}
    for name, k, step in (("SspTestGain", -1.0, "self.k * self.u"), ("SspTestIntegrator", 1.0, "self.y + h * self.k * self.u")):
        script = folder / f"{name.lower()}.py"
        script.write_text(_SLAVE.format(name=name, k=k, step=step))
        fmus[name.removeprefix("SspTest").lower()] = FmuBuilder.build_FMU(script, dest=folder, needsExecutionTool="false")
    return fmus
