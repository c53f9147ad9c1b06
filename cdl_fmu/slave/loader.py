"""The library that lets FMUs in Python load in hosts that are not Python, compiled once a machine."""

from __future__ import annotations

import hashlib
import json
import tempfile
from functools import cache
from pathlib import Path

from .compiler import compile_shared, compiler
from .description import DISTRIBUTION, installed_version
from .kernel import cache_folder

#: Name of pythonfmu's wrapper beside the loader, which takes the wrapper's own.
WRAPPER = "libpythonfmu-export.so"

_HERE = Path(__file__).parent


@cache
def python_loader() -> bytes:
    """The Linux binary that brings Python into the host and hands calls on to ``WRAPPER`` beside it.

    It is the same for all FMUs. Raises CompilerError where it cannot be compiled.
    """
    source = _HERE / "python_loader.c"
    # As a source of its own: a command line of that length is quoted in as many ways as there are systems.
    probe = (_HERE / "embedding.py").read_text(encoding="utf-8")
    texts = {"cdl_probe": probe, "cdl_needs": f"{DISTRIBUTION} {installed_version()}", "cdl_wrapper": WRAPPER}
    strings = "".join(f"const char {name}[] = {json.dumps(text)};\n" for name, text in texts.items())
    made_from = json.dumps([source.read_text(encoding="utf-8"), strings, compiler("linux64")])
    path = cache_folder("loader") / f"{hashlib.sha256(made_from.encode()).hexdigest()[:16]}.so"
    if not path.exists():
        with tempfile.TemporaryDirectory() as folder:
            written = Path(folder, "strings.c")
            written.write_text(strings, encoding="utf-8")
            compile_shared([source, written], path, platform="linux64", libraries=["dl", "pthread"])
    return path.read_bytes()
