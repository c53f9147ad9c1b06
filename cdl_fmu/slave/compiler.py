"""Shared libraries from C sources and object files, for FMUs.

Zig from PyPI is a C compiler for every platform that wants no installation but pip's. It links for old distributions, and gives the same
bytes for the same sources on every system. The system's own compiler is second choice, for the system's own platform.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from importlib.util import find_spec
from pathlib import Path
from typing import Literal

from .kernel import cache_folder

Platform = Literal["linux64", "win64"]

# The oldest glibc that Python's own wheels are built for, too (manylinux2014).
_TARGETS = {"linux64": "x86_64-linux-gnu.2.17", "win64": "x86_64-windows-gnu"}
# No debug information, build id or time stamp; a function that nothing defines is an error now, not when the FMU is loaded.
_LINK = {"linux64": ("-fPIC", "-Wl,--build-id=none", "-Wl,-z,defs"), "win64": ()}
_REMEDY = "install one: pip install ziglang"


class CompilerError(Exception):
    """No compiler for the platform, or one that refused its sources; the message says what it said and the remedy."""


def compiler(platform: Platform) -> list[str]:
    """Command line that begins a C compiler's call for the platform. Raises CompilerError if there is none."""
    if find_spec("ziglang"):
        return [sys.executable, "-m", "ziglang", "cc", "-target", _TARGETS[platform]]
    if platform == "linux64" and sys.platform == "linux":
        for name in ("cc", "gcc", "clang"):
            if path := shutil.which(name):
                return [path]
        raise CompilerError(f"there is no C compiler for linux64: neither ziglang in this Python nor cc, gcc or clang on PATH; {_REMEDY}")
    raise CompilerError(f"there is no C compiler for {platform} on this machine: no ziglang in this Python; {_REMEDY}")


def compile_shared(
    sources: Iterable[Path],
    out: Path,
    *,
    platform: Platform,
    objects: Iterable[Path] = (),
    flags: Iterable[str] = (),
    libraries: Iterable[str] = (),
) -> None:
    """Compile C sources and link them with object files into a shared library, which appears at ``out`` at once or not at all.

    Args:
        sources: C files.
        out: Library to write; Windows keeps its name in it.
        platform: FMI's name of the platform it is for.
        objects: Object files for that platform.
        flags: More arguments for the compiler, such as ``-DNAME=value``.
        libraries: Names of system libraries, such as ``m``.

    Raises:
        CompilerError: No compiler for the platform, or it fails.
    """
    command = compiler(platform)
    # By absolute paths, as the compiler runs elsewhere: in a folder of its own, as on Windows it leaves more than the library.
    inputs = [str(Path(path).absolute()) for path in (*sources, *objects)]
    zig = cache_folder("zig")
    environment = os.environ | {"ZIG_GLOBAL_CACHE_DIR": str(zig), "ZIG_LOCAL_CACHE_DIR": str(zig)}
    with tempfile.TemporaryDirectory(dir=out.parent, prefix=".compile-") as folder:
        command += ["-std=gnu11", "-O2", "-g0", "-s", "-shared", "-fvisibility=hidden", *_LINK[platform], *flags, "-o", out.name]
        command += [*inputs, *(f"-l{name}" for name in libraries)]
        done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, errors="replace")
        if done.returncode:
            raise CompilerError(
                f"{out.name} for {platform} does not compile: '{command[0]}' ended with {done.returncode}:\n{done.stderr.strip()}"
            )
        os.replace(Path(folder, out.name), out)
