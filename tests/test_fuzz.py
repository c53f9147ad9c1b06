"""Native FMUs under random calls with random values: nothing a host does may crash it, hang it or be answered with what FMI forbids."""

import pytest
from fuzzing import compile_host, fuzz, sanitised_fmus, unpack, why_not

from fmus import model_of


@pytest.fixture(scope="module")
def host(tmp_path_factory):
    """The fuzzing host."""
    if reason := why_not():
        pytest.skip(reason)
    return compile_host(tmp_path_factory.mktemp("fuzz"))


# Together 20 s; all shipped FMUs, ten minutes each, are the nightly job's: python tests/fuzzing.py.
@pytest.mark.parametrize("name", ["cdl_bcm_w1p1", "cdl_scm_w1p1"])
def test_nothing_is_found_in_a_native_fmu(name, host, tmp_path):
    for fmu in sanitised_fmus(model_of(name), tmp_path):
        library = unpack(fmu, tmp_path / fmu.stem)
        done = fuzz(host, library, tmp_path / fmu.stem, seconds=5.0)
        assert done.returncode == 0, f"{fmu.name}: {done.stdout}{done.stderr}"
        assert "nothing found" in done.stdout
