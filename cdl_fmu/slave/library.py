"""A C library that kernels call: its functions for numba, and what a native FMU takes along of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import llvmlite.binding as llvm
from numba import types


@dataclass(frozen=True, eq=False)
class Library:
    """A C library whose functions kernels call, with addresses as integers.

    What the library owns lies in the last arrays of the model's pool, the ``foreign`` ones of a ConstantPool. In a native FMU the C file
    ``source`` sets these for each instance, in the functions ``model_open`` and ``model_close`` of ``native/c/model.h``.

    Attributes:
        file: The shared library on this machine. A native FMU ships it beside its binary, so it has one for linux64 alone.
        headers: Folder of the library's headers.
        source: The C file.
        functions: numba's signature of each function that kernels call, by its name.
        licences: Texts that go with the library: the distribution that it comes with, and the file among its licences.
    """

    file: Path
    headers: Path
    source: Path
    functions: Mapping[str, object]
    licences: tuple[tuple[str, str], ...]

    def __post_init__(self):
        llvm.load_library_permanently(str(self.file))

    def function(self, name: str) -> types.ExternalFunction:
        """One of its functions, for kernels."""
        return types.ExternalFunction(name, self.functions[name])
