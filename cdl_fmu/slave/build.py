"""Build FMUs: a script of a few lines around an installed model, packed by pythonfmu, with the same bytes for the same sources."""

from __future__ import annotations

import hashlib
import sys
import tempfile
import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import MappingProxyType

from pythonfmu import FmuBuilder

from .archive import checked_files, digest, write_archive
from .compiler import CompilerError
from .description import DISTRIBUTION, installed_version, model_guid
from .kernel import cache_folder, sources_hash
from .loader import WRAPPER, python_loader
from .model import Instance, Model, ModelError

_SCRIPT = '''"""FMU {identifier} of {distribution} {version}; the model itself is in the installed package."""

try:
    from {module} import {cls}
    from cdl_fmu.slave.pythonfmu_slave import RecordSlave
except ImportError as error:
    raise ImportError(
        "FMU {identifier} needs {distribution} {version} in the Python that runs it: "
        "pip install {distribution}=={version} (" + str(error) + ")"
    ) from error


class {identifier}_slave(RecordSlave):
    built_version = "{version}"
    built_guid = "{guid}"
    starts = {starts!r}
    contents = {contents!r}

    @staticmethod
    def make_model():
        return {cls}({sizes})
'''


_NONE: Mapping = MappingProxyType({})


def cached_fmu(model: Model, starts: Mapping[str, float | str] = _NONE, files: Mapping[str, Path] = _NONE) -> Path:
    """Path of the model's FMU with these start values and files in the user's cache, built there if it or its sources are new."""
    packed = sorted((name, path.name, digest(path)) for name, path in checked_files(model, files).items())
    loader = hashlib.sha256(_loader() or b"").hexdigest()
    key = hashlib.sha256(f"{sources_hash()} {installed_version()} {sorted(starts.items())} {packed} {loader}".encode()).hexdigest()
    path = cache_folder("fmus", key[:16]) / f"{model.identifier}.fmu"
    if not path.exists():
        build_fmu(model, path, starts, files)
    return path


def build_fmu(model: Model, path: Path, starts: Mapping[str, float | str] = _NONE, files: Mapping[str, Path] = _NONE) -> Path:
    """Write the model's pythonfmu FMU (linux64 and win64 binaries) to ``path``.

    Where no C compiler is at hand, its Linux binary is pythonfmu's wrapper alone, for hosts in Python (see ``python_loader``).
    ``starts`` replaces start values of parameters and inputs, by FMI name; ``files`` are packed into the FMU, by the name of the file
    parameter whose start value each becomes. Raises ModelError for a class that cannot be imported by name, for no such file parameter,
    for a file that is missing or that the model refuses, and for two files of one name.
    """
    cls = type(model)
    if cls.__module__ == "__main__":
        raise ModelError(f"{cls.__qualname__} is defined in a script: move it to a module that can be imported, to build an FMU of it")
    files = checked_files(model, files)
    if files:  # a file that is refused at the start of a run is refused here
        instance = Instance(model)
        instance.set_starts(starts)
        model.make_pool(instance.p, files)
    contents = {packed.name: digest(packed) for packed in files.values()}
    script = _SCRIPT.format(
        identifier=model.identifier,
        distribution=DISTRIBUTION,
        version=installed_version(),
        module=cls.__module__,
        cls=cls.__qualname__,
        guid=model_guid(model, contents=contents),
        starts=dict(sorted({**starts, **{name: packed.name for name, packed in files.items()}}.items())),
        contents=dict(sorted(contents.items())),
        sizes=", ".join(f"{name}={size!r}" for name, size in model.sizes.items()),
    )
    return pack(model.identifier, script, path, files.values())


def pack(identifier: str, script: str, path: Path, files: Iterable[Path] = ()) -> Path:
    """Write an FMU whose slave is this script, with files in its resources, to ``path``."""
    with tempfile.TemporaryDirectory(prefix="cdl-build-") as folder:
        # All FMUs of a process share one table of modules: a name of its own for each content.
        module = f"{identifier}_{hashlib.sha256(script.encode()).hexdigest()[:12]}"
        script_file = Path(folder, f"{module}.py")
        script_file.write_text(script, encoding="utf-8", newline="\n")
        known_path = list(sys.path)
        try:
            packed = FmuBuilder.build_FMU(script_file, dest=folder, project_files=files)
        finally:
            # The builder imports the script by name; an FMU of the same name must not find that module later.
            sys.path[:] = known_path
            sys.modules.pop(module, None)
        with zipfile.ZipFile(packed) as archive:
            members = {name: archive.read(name) for name in archive.namelist()}
        if loader := _loader():  # it takes the place of pythonfmu's Linux wrapper, which moves beside it
            binary = f"binaries/linux64/{identifier}.so"
            members[f"binaries/linux64/{WRAPPER}"], members[binary] = members[binary], loader
        write_archive(path, members)
    return path


def _loader() -> bytes | None:
    """The library that starts Python in other hosts, or None without a compiler: 'cdl build' and 'cdl doctor' tell."""
    try:
        return python_loader()
    except CompilerError:
        return None
