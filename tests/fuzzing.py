"""Fuzz native FMUs under AddressSanitizer and UBSan: ``python tests/fuzzing.py [FMU]... --seconds 600``.

An FMU is a file, FMI 2.0 or 3.0 for co-simulation with a binary for Linux, or the name of a model, such as cdl_bcm_w2: then its native FMUs
of both versions are built with the sanitizers, too. Default are all that are shipped. The host is ``tests/fuzz/fuzz.c``; with ``--seed``
and ``--threads 1`` a run makes the same calls again.
"""

from __future__ import annotations

import argparse
import math
import os
import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest import mock

import fmpy
import trimesh
from fmpy.model_description import ModelDescription, ModelVariable

from cdl_fmu.slave.model import KernelModel
from cdl_fmu.slave.native import build
from fmus import SHIPPED, model_of

SOURCES = Path(__file__).with_name("fuzz")
HEADERS = Path(fmpy.__file__).parent / "c-code"
SANITIZERS = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]

_TYPES = {"Real": "R", "Float64": "R", "Integer": "I", "Enumeration": "I", "Int64": "I", "String": "S"}
_CAUSALITIES = {"parameter": "p", "input": "u", "output": "y"}
_BINARIES = {"2": "linux64", "3": "x86_64-linux"}


def why_not() -> str:
    """Why FMUs cannot be fuzzed here; "" if they can."""
    if sys.platform != "linux":
        return f"the fuzzing host runs on Linux, not on {sys.platform}"
    compiler = shutil.which("gcc")
    if compiler is None:
        return "there is no gcc: install it with its sanitizers (libasan, libubsan)"
    with TemporaryDirectory() as folder:
        empty = Path(folder, "empty.c")
        empty.write_text("int main(void) { return 0; }\n")
        done = subprocess.run([compiler, *SANITIZERS, empty, "-o", Path(folder, "empty")], capture_output=True, text=True)
    return f"gcc has no sanitizers (libasan, libubsan): {done.stderr}" if done.returncode else ""


def compile_host(folder: Path) -> Path:
    """The fuzzing host, compiled into ``folder``."""
    host = folder / "fuzz"
    flags = ["-std=gnu11", "-g", "-O1", "-Wall", "-Wextra", "-Werror", *SANITIZERS, "-I", HEADERS]
    subprocess.run(["gcc", *flags, *sorted(SOURCES.glob("*.c")), "-o", host, "-ldl", "-lm", "-lpthread"], check=True)
    return host


def sanitised_fmus(model: KernelModel, folder: Path) -> list[Path]:
    """The model's native FMUs of both versions of FMI, their C code compiled with the sanitizers; for Linux alone."""
    paths = {version: folder / f"{model.identifier}_fmi{version[0]}.fmu" for version in ("2.0", "3.0")}
    box = trimesh.creation.box((0.6, 0.6, 0.2), trimesh.transformations.translation_matrix((0.0, 0.0, -0.1)))
    box.export(folder / "box.stl")
    files = {name: folder / "box.stl" for name in model.files if name.startswith(("ground", "body["))}  # no step goes without
    with mock.patch.object(build, "compile_shared", _compile_sanitised):
        build.build_native_fmus(model, paths, files=files)
    return list(paths.values())


def _compile_sanitised(sources, out, *, platform, objects=(), flags=(), libraries=()) -> None:
    if platform != "linux64":
        out.write_bytes(b"")
        return
    options = ["-std=gnu11", "-g", "-O1", "-fPIC", "-shared", *SANITIZERS, *flags]
    subprocess.run(["gcc", *options, *sources, *objects, "-o", out, *(f"-l{name}" for name in libraries)], check=True)


def unpack(fmu: Path, folder: Path) -> Path:
    """Unpack an FMU with the table that the host reads; path of the FMU's library."""
    description = fmpy.read_model_description(str(fmu), validate=False)
    fmpy.extract(str(fmu), str(folder))
    (folder / "fuzz.txt").write_text(_table(description))
    for file in (folder / "resources").glob("*"):
        for i, content in enumerate(_damaged(file.read_bytes())):
            (folder / "damaged" / str(i)).mkdir(parents=True, exist_ok=True)
            (folder / "damaged" / str(i) / file.name).write_bytes(content)
    version, identifier = description.fmiVersion[0], description.coSimulation.modelIdentifier
    return folder / "binaries" / _BINARIES[version] / f"{identifier}.so"


def _damaged(content: bytes) -> list[bytes]:
    """Empty, cut off, a byte too short and too long, and changed here and there."""
    changed = bytearray(content)
    changed[100::97] = b"\xff" * len(changed[100::97])  # behind the GUID with which it begins
    return [b"", content[: len(content) // 2], content[:-1], content + b"x", bytes(changed)]


def _table(description: ModelDescription) -> str:
    """Version, identifier and token, then a line for each variable: what ``read_table`` in ``tests/fuzz/values.c`` reads."""
    token = description.guid or description.instantiationToken
    variables = [v for v in description.modelVariables if v.type in _TYPES and v.causality != "independent"]
    lines = [f"{description.fmiVersion[0]} {description.coSimulation.modelIdentifier} {token}", str(len(variables))]
    for v in variables:
        length = math.prod(int(dimension.start) for dimension in v.dimensions)
        starts = _starts(v, length)
        bounds = [float(bound) if bound is not None else endless for bound, endless in ((v.min, -math.inf), (v.max, math.inf))]
        kind = _CAUSALITIES.get(v.causality, "l"), _TYPES[v.type], v.valueReference, length, *bounds, v.name, *starts
        lines.append(" ".join(map(str, kind)))
    return "\n".join(lines) + "\n"


def _starts(variable: ModelVariable, length: int) -> list[float]:
    if variable.start is None or _TYPES[variable.type] == "S":
        return [0.0] * length
    starts = [float(text) for text in str(variable.start).split()]
    return starts if len(starts) == length else starts[:1] * length


def fuzz(host: Path, library: Path, folder: Path, *, seconds: float, seed: int = 1, threads: int = 2) -> subprocess.CompletedProcess[str]:
    """Fuzz a library for some seconds; return code 0 if nothing was found, else the report is in ``stderr``."""
    environment = os.environ | {"ASAN_OPTIONS": "allocator_may_return_null=1", "UBSAN_OPTIONS": "print_stacktrace=1"}
    command = [host, library.absolute(), folder, str(seconds), str(seed), str(threads)]
    return subprocess.run(command, env=environment, capture_output=True, text=True)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("fmus", nargs="*", metavar="FMU")
    parser.add_argument("--seconds", type=float, default=600.0, help="for all together (default: %(default)g)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--threads", type=int, default=2)
    arguments = parser.parse_args()
    if reason := why_not():
        sys.exit(reason)
    names = arguments.fmus or [model.identifier for model in SHIPPED if isinstance(model, KernelModel) and not model.needs_python]
    share = arguments.seconds / sum(1 if name.endswith(".fmu") else 2 for name in names)
    failed = 0
    with TemporaryDirectory() as folder:
        host = compile_host(Path(folder))
        for name in names:
            for fmu in [Path(name)] if name.endswith(".fmu") else sanitised_fmus(model_of(name), Path(folder)):
                place = Path(folder, fmu.stem)
                library = unpack(fmu, place)
                done = fuzz(host, library, place, seconds=share, seed=arguments.seed, threads=arguments.threads)
                print(f"{fmu.name}: {(done.stdout + done.stderr).strip()}", flush=True)
                failed += done.returncode != 0
    return min(failed, 1)


if __name__ == "__main__":
    sys.exit(main())
