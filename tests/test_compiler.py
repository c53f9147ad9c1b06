"""Shared libraries from C: what they do, the same bytes each time, and what is said where it fails."""

import ctypes
import sys
from pathlib import Path

import pytest

from cdl_fmu.slave import compiler
from cdl_fmu.slave.compiler import CompilerError, compile_shared

EXPORT = '__attribute__((visibility("default")))'


@pytest.fixture
def source(tmp_path):
    try:
        compiler.compiler("linux64")
    except CompilerError as error:
        pytest.skip(str(error))
    path = tmp_path / "cube.c"
    path.write_text(f"#include <math.h>\n{EXPORT} double root(double x) {{ return cbrt(x) * FACTOR; }}\n")
    return path


@pytest.mark.skipif(sys.platform != "linux", reason="the library is for Linux")
def test_a_library_computes_and_has_the_same_bytes_from_any_folder(source, tmp_path):
    libraries = [tmp_path / name / "cube.so" for name in ("one", "another")]
    for library in libraries:
        library.parent.mkdir()
        compile_shared([source], library, platform="linux64", flags=["-DFACTOR=2"], libraries=["m"])
        assert list(library.parent.iterdir()) == [library]
        source = source.rename(library.parent.parent / f"{library.parent.name}.c")
    root = ctypes.CDLL(str(libraries[0])).root
    root.restype, root.argtypes = ctypes.c_double, [ctypes.c_double]
    assert root(27.0) == pytest.approx(6.0)
    assert libraries[0].read_bytes() == libraries[1].read_bytes()


def test_a_source_that_does_not_compile_shows_what_the_compiler_says(source, tmp_path):
    with pytest.raises(CompilerError, match=r"(?s)^cube.so for linux64 does not compile: '.*' ended with \d+:\n.*FACTOR"):
        compile_shared([source], tmp_path / "cube.so", platform="linux64", libraries=["m"])
    assert not (tmp_path / "cube.so").exists()


def test_a_function_that_nothing_defines_is_an_error_now(source, tmp_path):
    source.write_text(f"double missing(void); {EXPORT} double root(void) {{ return missing(); }}\n")
    with pytest.raises(CompilerError, match="missing"):
        compile_shared([source], tmp_path / "cube.so", platform="linux64")


@pytest.mark.parametrize("platform", ["linux64", "win64"])
def test_no_compiler(monkeypatch, platform):
    monkeypatch.setattr(compiler, "find_spec", lambda name: None)
    monkeypatch.setattr(compiler.shutil, "which", lambda name: None)
    with pytest.raises(CompilerError, match=rf"^there is no C compiler for {platform}.*; install one: pip install ziglang$"):
        compile_shared([Path("x.c")], Path("x.so"), platform=platform)
