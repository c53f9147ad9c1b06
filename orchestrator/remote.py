"""Slaves in other processes: an FMU of a package is served over TCP/IP, and a proxy FMU stands for it in the package that a master runs."""

from __future__ import annotations

import hashlib
import json
import math
import socket
import struct
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, suppress
from pathlib import Path
from uuid import UUID
from xml.etree import ElementTree
from zipfile import ZIP_STORED, ZipFile, ZipInfo

from cdl_fmu.slave.build import pack
from cdl_fmu.slave.remote_slave import DESCRIPTION
from cdl_fmu.slave.wire import Call, Kind, Wire, pack_values, unpack_references, unpack_values

from .fmu import Slave
from .run import RunError
from .ssp import Component, SspError, System
from .ssp.read import SSD

_SCRIPT = '''"""Proxy FMU of {identifier}, which 'cdl serve' runs at {host}:{port}."""

from cdl_fmu.slave.remote_slave import RemoteSlave, Served


class {identifier}_remote(RemoteSlave):
    @staticmethod
    def served():
        return Served("{identifier}", "{guid}", "{host}", {port})
'''


class _Refused(Exception):
    """What the FMU said to a call that failed."""


class _Served(Slave):
    """The FMU, as its proxy asks for it."""

    def __init__(self, component: Component, instance: str):
        self._warned: list[str] = []
        super().__init__(instance, component.model_description, component.directory, self._warned.append)
        fmu = self._fmu
        self._getters = dict(zip(Kind, (fmu.getReal, fmu.getInteger, fmu.getBoolean, self._strings)))
        self._setters = dict(zip(Kind, (fmu.setReal, fmu.setInteger, fmu.setBoolean, fmu.setString)))

    def answer(self, call: Call, content: bytes) -> bytes:
        """Make a call; raises _Refused with what the FMU said."""
        if call == Call.SET:
            kind, references, values = unpack_references(content)
            self._call("set", self._setters[kind], references, unpack_values(kind, values))
        elif call == Call.GET:
            kind, references, _ = unpack_references(content)
            return pack_values(kind, self._call("get", self._getters[kind], references))
        elif call == Call.STEP:
            self.step(*unpack_values(Kind.REAL, content))
        elif call == Call.SAVE:
            return self.to_bytes()
        elif call == Call.RESTORE:
            self.from_bytes(content)
        elif call == Call.SETUP:
            start, stop = unpack_values(Kind.REAL, content)
            self._call("setup", self._fmu.setupExperiment, startTime=start, stopTime=None if math.isnan(stop) else stop)
        elif call == Call.ENTER_INITIALIZATION:
            self._call("initialisation", self._fmu.enterInitializationMode)
        elif call == Call.EXIT_INITIALIZATION:
            self._call("initialisation", self._fmu.exitInitializationMode)
        return b""

    def _strings(self, references: list[int]) -> list[str]:
        return [text.decode() for text in self._fmu.getString(references)]

    def warnings(self) -> list[str]:
        """Those since the last call."""
        warned = self._warned[:]
        self._warned.clear()
        return warned

    def _raise(self, what: str, t: float | None, cause: Exception | None = None, status: int = 0):
        said = "; ".join(dict.fromkeys(self._errors)) or f"{self.name} {what}: {cause or 'it gave no message'}"
        self._errors.clear()
        raise _Refused(said) from cause


def _listening(host: str, port: int) -> socket.socket:
    try:
        return socket.create_server((host, port))
    except OSError as error:
        raise RunError(
            f"nothing can listen at {host}:{port} ({error.strerror}): give another --port, or an address of this machine"
        ) from None


def serve(system: System, name: str, host: str, port: int, tell: Callable[[str], None]) -> None:
    """Run a component of a system for one master after the other, a fresh instance for each, until interrupted.

    ``port`` 0 takes a free one. ``tell`` gets a line when it listens, and when a master comes and goes. There is no password: whoever
    reaches the port can run the FMU. Raises SspError for an unknown component and OSError for a port that is taken.
    """
    component = _component(system, name)
    identifier = component.model_description.coSimulation.modelIdentifier
    while True:
        # It listens between two masters only: a second one is refused at once, and not kept waiting for the first one's end.
        with _listening(host, port) as listener:
            port = listener.getsockname()[1]
            tell(f"serving {name} ({identifier}) at {host}:{port}")
            connected, address = listener.accept()
        tell(f"a master at {address[0]} runs it")
        with closing(Wire(connected)) as wire:
            tell(_attend(wire, component))


def _attend(wire: Wire, component: Component) -> str:
    """Answer one master until it leaves; returns how it ended."""
    slave: _Served | None = None
    late: list[str] = []  # failures of calls that get no answer
    try:
        while True:
            code, content = wire.receive()
            data = b""
            try:
                if slave is None:
                    slave = _welcome(component, code, content)
                elif code != Call.TERMINATE:
                    data = slave.answer(Call(code), content)
            except _Refused as error:
                late.append(str(error))
            if code == Call.SET:
                continue
            if late:
                data = "; ".join(dict.fromkeys(late)).encode()
            _answer(wire, bool(late), slave.warnings() if slave else [], data)
            late.clear()
            if code == Call.TERMINATE:
                return "the master has ended its run"
    except OSError as error:
        return f"the connection to the master is lost ({error})"
    except (ValueError, KeyError, struct.error) as error:
        return f"what is connected is no proxy FMU of this version ({error})"
    finally:
        if slave is not None:
            with suppress(Exception):  # one that has failed may refuse this, too
                slave.close()


def _welcome(component: Component, code: int, content: bytes) -> _Served:
    if code != Call.HELLO:
        raise ValueError(f"it began with call {code}")
    hello, guid = json.loads(content), component.model_description.guid
    if hello["guid"] != guid:
        raise _Refused(
            f"{hello['instance']}: the FMU that is served has GUID {guid}, the proxy stands for {hello['guid']}: "
            "serve the package that the proxy was written from, or write it again with 'cdl remote'"
        )
    return _Served(component, hello["instance"])


def _answer(wire: Wire, failed: bool, warnings: list[str], data: bytes) -> None:
    texts = json.dumps(warnings).encode()
    wire.send(failed, len(texts).to_bytes(4, "little") + texts + data)


def write_remote(package: Path, system: System, served: Mapping[str, tuple[str, int]], out: Path) -> None:
    """Write a package with a proxy in place of each component of ``served``: name -> host and port where 'cdl serve' runs its FMU.

    Only components of the outermost system. Raises SspError for an unknown one.
    """
    with tempfile.TemporaryDirectory() as folder, ZipFile(package) as old:
        root = _parsed(old)
        sources = {}
        for name, (host, port) in served.items():
            proxy = _write_proxy(_component(system, name), host, port, Path(folder, f"{name}_remote.fmu"))
            element = next(e for e in root.iterfind("./{*}System/{*}Elements/{*}Component") if e.get("name") == name)
            element.set("source", f"resources/{proxy.name}")
            sources[f"resources/{proxy.name}"] = proxy.read_bytes()
        used = {e.get("source") for e in root.iterfind(".//{*}Component")}
        with ZipFile(out, "w", ZIP_STORED) as new:
            for entry in old.infolist():
                if entry.filename == SSD:
                    new.writestr(entry, ElementTree.tostring(root, encoding="UTF-8", xml_declaration=True))
                elif entry.filename in used or not entry.filename.endswith(".fmu"):
                    new.writestr(entry, old.read(entry))
            for source, content in sources.items():
                entry = ZipInfo(source)  # without a date, so that the same package is written again
                entry.external_attr = 0o644 << 16
                new.writestr(entry, content)


def _component(system: System, name: str) -> Component:
    if name not in system.components:
        raise SspError(f"the system {system.name} has no component {name!r}; it has {', '.join(system.components)}")
    return system.components[name]


def _parsed(package: ZipFile) -> ElementTree.Element:
    """The system's description; it will be written with the prefixes that it has, as libcosim and Ecos look for those."""
    with package.open(SSD) as file:
        for _, (prefix, uri) in _namespaces(file):
            ElementTree.register_namespace(prefix, uri)
    return ElementTree.fromstring(package.read(SSD))


def _namespaces(file) -> Iterator[tuple[str, tuple[str, str]]]:
    return ElementTree.iterparse(file, events=["start-ns"])


def _write_proxy(component: Component, host: str, port: int, path: Path) -> Path:
    description = component.model_description
    identifier = description.coSimulation.modelIdentifier
    script = _SCRIPT.format(identifier=identifier, guid=description.guid, host=host, port=port)
    root = ElementTree.parse(component.directory / "modelDescription.xml").getroot()
    # In the form of the others' GUIDs, as a state begins with one.
    root.set("guid", f"{{{UUID(hashlib.sha256(script.encode()).hexdigest()[:32])}}}")
    kind = root.find("CoSimulation")
    # A state comes here in bytes, or not at all.
    kind.set("canGetAndSetFMUstate", kind.get("canSerializeFMUstate", "false"))
    kind.set("providesDirectionalDerivative", "false")
    with tempfile.TemporaryDirectory() as folder:
        described = Path(folder, DESCRIPTION)
        ElementTree.ElementTree(root).write(described, encoding="UTF-8", xml_declaration=True)
        return pack(identifier, script, path, [described])
