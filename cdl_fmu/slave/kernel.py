"""Compiled kernels: numba options that every kernel shares, and a cache that knows what it was compiled from.

numba's own file cache looks at the file of the outermost function alone: a change in a kernel that it calls would go unnoticed.
The cache folder is therefore named by a hash of all sources that hold kernels, and lies in the user's cache, so that a
read-only installation works too.
"""

from __future__ import annotations

import hashlib
import re
import tempfile
import warnings
from functools import cache
from pathlib import Path

import numba
import platformdirs

#: Folder for everything that is built on this machine: compiled kernels and FMUs.
CACHE = platformdirs.user_cache_path("cdl-fmu", appauthor=False)

_ROOT = Path(__file__).resolve().parents[2]
# A record that begins with another one's fields can stand for it: a model with patches takes the code of the one without.
warnings.filterwarnings("ignore", category=numba.NumbaExperimentalFeatureWarning, message=".*considered a subtype")

#: How numba compiles every kernel, here and for export: without its run-time, as kernels allocate nothing and count no references, and
#: without wrappers for callers in C, of which there are none.
OPTIONS = dict(error_model="numpy", boundscheck=False, _nrt=False, no_cfunc_wrapper=True)

# OpenMP's threads meet quicker than TBB's: particles go 1.2 times as fast on two of them. Where it is missing numba takes the next.
numba.config.THREADING_LAYER_PRIORITY = ["omp", "tbb", "workqueue"]

#: Threads that numba may use on this machine.
MOST_THREADS: int = numba.config.NUMBA_NUM_THREADS


class CacheError(Exception):
    """A cache folder that cannot be written; the message names it and the remedy."""


@cache
def cache_folder(*parts: str) -> Path:
    """A folder in the cache, made if it is missing. Raises CacheError if it cannot be written."""
    folder = CACHE.joinpath(*parts)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise CacheError(
            f"the cache folder {folder}, for compiled kernels and FMUs, cannot be written ({error.strerror}): "
            "make it writable, or on Linux set XDG_CACHE_HOME to a folder that is"
        ) from error
    return folder


@cache
def sources_hash() -> str:
    """Hash [hex] of every Python source of the packages that hold models."""
    digest = hashlib.sha256(numba.__version__.encode())
    for package in ("cdl_fmu", "mbs"):
        for path in sorted((_ROOT / package).rglob("*.py")):
            digest.update(path.relative_to(_ROOT).as_posix().encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()


def kernel(function=None, *, inline: bool = False, parallel: bool = False):
    """Compile a function as a kernel: plain numba, no Python objects, no allocation (see CONTRIBUTING.md for the rules).

    ``inline`` puts the code into every caller: for small functions of arrays, whose arguments cost more than their work. ``parallel`` runs
    loops over ``numba.prange`` with several threads: for twins of kernels, as such code needs numba's run-time and cannot be exported.
    """
    if function is None:
        return lambda function: kernel(function, inline=inline, parallel=parallel)
    saved, numba.config.CACHE_DIR = numba.config.CACHE_DIR, str(cache_folder("kernels", sources_hash()[:16]))
    try:
        return numba.njit(cache=True, forceinline=inline, **OPTIONS, **(dict(parallel=True) if parallel else {}))(function)
    finally:
        numba.config.CACHE_DIR = saved


@cache
def array_entry(function, arguments: str):
    """Entry to a kernel that takes each record as an array of length one: numba dispatches those 4 times faster than records.

    Args:
        function: The kernel.
        arguments: Its arguments, records in capitals, numbers and arrays in lower case: ``"t, h, P, U, X, Y"``.
    """
    names = arguments.split(", ")
    call = ", ".join(f"{n}[0]" if n.isupper() else n for n in names)
    # numba's cache tells the entries of one file apart by their names alone.
    name = re.sub(r"\W+", "_", f"{function.py_func.__qualname__}_entry")
    source = f"def {name}({', '.join(names)}):\n    return target({call})\n"
    scope = {"target": function, "__name__": function.__module__}
    # Compiled under the kernel's own file name, so that numba can cache it beside the kernel.
    exec(compile(source, function.py_func.__code__.co_filename, "exec"), scope)
    return kernel(scope[name])


def compiled(function, *arguments):
    """A kernel compiled now for the types of these arguments, to be called with such arguments only.

    Half the cost of a call of numba's dispatcher is finding out the types.
    """
    signature = tuple(map(numba.typeof, arguments))
    function.compile(signature)
    return function.overloads[signature].entry_point
