"""Build native FMUs, which need neither Python nor this package: kernels, one table and the C files beside this one, linked."""

from __future__ import annotations

import hashlib
import os
import sys
import tempfile
from collections.abc import Iterable, Mapping
from copy import copy
from dataclasses import replace
from functools import cache
from importlib.metadata import distributions
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType
from xml.etree.ElementTree import Element, tostring

import numpy as np

from ..archive import checked_files, digest, write_archive
from ..compiler import Platform, compile_shared
from ..description import DISTRIBUTION, installed_version, model_description, model_guid
from ..kernel import cache_folder, kernel, sources_hash
from ..library import Library
from ..model import LATEST, STATUS_SPAN, Instance, KernelModel, ModelError
from ..records import Record
from .description3 import model_description3
from .kernels import ExportError, object_code
from .table import content_of, table_object

_C = Path(__file__).parent / "c"
#: Platform -> LLVM's target triple, the folder of its binary in FMI 2 and in FMI 3, and the suffix.
_PLATFORMS: dict[Platform, tuple[str, str, str, str]] = {
    "linux64": ("x86_64-unknown-linux-gnu", "linux64", "x86_64-linux", ".so"),
    "win64": ("x86_64-w64-windows-gnu", "win64", "x86_64-windows", ".dll"),
}
#: What the binaries hold code of, and where each has its licence: kernels call functions of numba, and compilers add their run-time.
_LICENCES = (
    (DISTRIBUTION, "LICENSE"),
    ("numba", "LICENSE"),
    ("ziglang", "ziglang/LICENSE"),
    ("ziglang", "ziglang/lib/libc/mingw/COPYING"),
)
_NONE: Mapping = MappingProxyType({})


def cached_native_fmu(model: KernelModel, starts: Mapping[str, float | str] = _NONE, files: Mapping[str, Path] = _NONE) -> Path:
    """Path of the model's native FMU of FMI 2 with these start values and files in the user's cache, built there if it is new."""
    packed = sorted((name, path.name, digest(path)) for name, path in checked_files(model, files).items())
    key = hashlib.sha256(
        f"native {_sources(model.library)} {installed_version()} {sorted(starts.items())} {packed} {type(model)}".encode()
    ).hexdigest()
    path = cache_folder("fmus", key[:16]) / f"{model.identifier}.fmu"
    if not path.exists():
        build_native_fmus(model, {"2.0": path}, starts, files)
    return path


def build_native_fmus(
    model: KernelModel, paths: Mapping[str, Path], starts: Mapping[str, float | str] = _NONE, files: Mapping[str, Path] = _NONE
) -> None:
    """Write a model's native FMUs, with binaries for linux64 and win64, or for linux64 alone if its kernels call a library.

    Args:
        model: The model, of a class that can be imported by name.
        paths: File to write, by FMI version: "2.0", "3.0" or both.
        starts: Start values of parameters and inputs in place of the records', by FMI name.
        files: Files whose content the FMU holds, by the name of the file parameter.

    Raises:
        ModelError: No such file parameter, a file that is missing or that the model refuses, or parameters that do not fit together.
        ExportError: The kernels cannot stand without Python.
        CompilerError: There is no C compiler for both platforms.
    """
    _refuse_python(model)
    library = model.library
    if library and sys.platform != "linux":
        raise ExportError(f"{model.identifier}: its native FMU ships {library.file.stem} for linux64: build it on Linux")
    model = _serial(model)
    files = checked_files(model, files)
    instance = Instance(model)
    instance.set_starts(starts)
    instance.check()
    for name in model.needed_files:
        if name not in files:
            raise ModelError(
                f"{name} names no file, which a native FMU holds from the start: give --file {name}=PATH ({model.files[name]})"
            )
    names = {name: files[name].name if name in files else "" for name in model.files}
    given = instance.block.copy()
    pool = model.make_pool(instance.p, files)
    contents = {path.name: digest(path) for path in files.values()} | {"sources": _sources(library)}
    guid = model_guid(model, starts, contents)
    compile_kernels([model])
    with tempfile.TemporaryDirectory(prefix="cdl-native-") as folder:
        binaries = {}
        for platform, code in _kernels(model).items():
            triple, _, _, suffix = _PLATFORMS[platform]
            table = Path(folder, f"{platform}.o")
            table.write_bytes(table_object(model, guid, given, names, pool, model.built_in(files), triple))
            binaries[platform] = Path(folder, platform, f"{model.identifier}{suffix}")
            binaries[platform].parent.mkdir()
            compile_shared(
                [*sorted(_C.glob("*.c")), *([library.source] if library else [])],
                binaries[platform],
                platform=platform,
                objects=[table, code, *([library.file] if library else [])],
                flags=_flags(library),
                libraries=["m"],
            )
        arrays = content_of(pool)
        data = b"".join(a.tobytes() for a in arrays)
        content = guid.encode() + _sum(data) + data if arrays else b""
        for version, path in paths.items():
            if version == "2.0":
                description = model_description(model, guid, {**starts, **{name: text for name, text in names.items() if text}})
            else:
                description = model_description3(model, guid, given, names)
            _write(path, version, description, binaries, _resources(content, files), library)


def _sum(data: bytes) -> bytes:
    """FNV-1a of bytes, as ``c/memory.c`` works it out."""
    return int(_fnv1a(np.frombuffer(data, np.uint8))).to_bytes(8, "little")


@kernel
def _fnv1a(data):
    total = np.uint64(0xCBF29CE484222325)
    for byte in data:
        total = (total ^ np.uint64(byte)) * np.uint64(0x100000001B3)
    return total


@cache
def _sources(library: Library | None) -> str:
    """Hash [hex] of all that binaries are made of."""
    paths = [*sorted(_C.iterdir()), *([library.source, library.file] if library else [])]
    return hashlib.sha256(sources_hash().encode() + b"".join(path.read_bytes() for path in paths)).hexdigest()


def _flags(library: Library | None) -> list[str]:
    """For the compiler: FMI's own headers, what C and Python agree on, and a library that lies beside the binary."""
    flags = [f"-I{Path(find_spec('fmpy').origin).parent / 'c-code'}", f"-DSTATUS_SPAN={STATUS_SPAN}", f"-DLATEST={LATEST!r}"]
    return flags + (["-DMODEL_OPENS", f"-I{_C}", f"-I{library.headers}", "-Wl,-rpath,$ORIGIN"] if library else [])


def _serial(model: KernelModel) -> KernelModel:
    """The model as it is exported: with one thread."""
    if "threads" not in model.parameters.fields:
        return model
    serial = copy(model)
    serial.__dict__.pop("scalars", None)
    threads = replace(model.parameters.fields["threads"], start=1.0, max=1.0, description="Threads; a native FMU has one")
    serial.parameters = Record(**{**model.parameters.fields, "threads": threads})
    return serial


def compile_kernels(models: Iterable[KernelModel]) -> None:
    """Compile the kernels of these models, what they share once; the FMUs are built from them in no time.

    Raises:
        ExportError: The kernels cannot stand without Python.
    """
    missing = []
    for model in models:
        _refuse_python(model)
        paths = _kernels(model)
        if not all(path.exists() for path in paths.values()):
            missing.append((model, paths))
    wanted = [(model, [_PLATFORMS[platform][0] for platform in paths]) for model, paths in missing]
    for (_, paths), codes in zip(missing, object_code(wanted)):
        for path, code in zip(paths.values(), codes):
            # Beside the target: the finished file takes its name in one step.
            with tempfile.NamedTemporaryFile(dir=path.parent, delete=False) as file:
                file.write(code)
            os.replace(file.name, path)


def _refuse_python(model: KernelModel) -> None:
    if model.needs_python:
        raise ExportError(
            f"{model.identifier} cannot be a native FMU: {model.needs_python}; take the FMU that 'cdl build {model.identifier}' makes"
        )


def _kernels(model: KernelModel) -> dict[Platform, Path]:
    """Object files of the model's kernels in the user's cache, once they are compiled."""
    folder = cache_folder("native", sources_hash()[:16])
    platforms = ("linux64",) if model.library else tuple(_PLATFORMS)
    return {platform: folder / f"{model.identifier}-{type(model).__module__}.{platform}.o" for platform in platforms}


def _write(
    path: Path,
    version: str,
    description: Element,
    binaries: Mapping[Platform, Path],
    resources: Mapping[str, bytes],
    library: Library | None,
) -> None:
    """Write the archive, which appears at once or not at all."""
    column = {"2.0": 1, "3.0": 2}[version]
    members = {"modelDescription.xml": b'<?xml version="1.0" encoding="UTF-8"?>\n' + tostring(description)}
    members |= {f"binaries/{_PLATFORMS[platform][column]}/{file.name}": file.read_bytes() for platform, file in binaries.items()}
    if library:
        members[f"binaries/{_PLATFORMS['linux64'][column]}/{library.file.name}"] = library.file.read_bytes()
    licences = (*_LICENCES, *(library.licences if library else ()))
    members |= {f"documentation/licenses/{name}": text for name, text in _licences(licences).items()}
    members |= {f"resources/{name}": content for name, content in resources.items()}
    write_archive(path, members)


def _resources(content: bytes, files: Mapping[str, Path]) -> dict[str, bytes]:
    """What the binary reads, and the files that it comes from, for those who want to draw them."""
    return ({"constants.bin": content} if content else {}) | {path.name: path.read_bytes() for path in files.values()}


def _licences(licences: Iterable[tuple[str, str]]) -> dict[str, bytes]:
    """Texts by file name; FMI wants that of the FMU itself under the name license.txt."""
    texts = {}
    for package, file in licences:
        # A checkout may hold a second record of the package, without licences.
        found = (d.read_text(f"licenses/{file}") for d in distributions(name=package))
        text = next(filter(None, found), None)
        if text is None:
            raise ExportError(f"the licence of {package}, {file}, is not among its installed files: install {package} again with pip")
        name = "license.txt" if package == DISTRIBUTION else f"{package}-{file.replace('/', '-')}.txt"
        texts[name] = text.encode()
    return texts
