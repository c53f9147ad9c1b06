"""SSP packages as they are written: read back the same, valid, and run by other tools as they are."""

import math
from zipfile import ZipFile

import pytest
from fmpy.ssp.simulation import simulate_ssp
from fmpy.ssp.ssd import read_ssd, read_ssv
from ssp_fmus import PLANT, build_slaves, write_fmu

from orchestrator.ssp import Connection, SspError, read_system, write_system


@pytest.fixture
def plant(tmp_path):
    return write_fmu(tmp_path / "plant.fmu", PLANT)


def test_written_package_reads_back(tmp_path, plant):
    arguments = dict(
        name="demo",
        components={"a": plant, "b": plant},
        connections=[Connection("a", "warm", "b", "t", 1.0, -273.15), Connection("b", "y", "a", "u")],
        parameters={"a": {"mode": 2, "k": 0.1, "on": False, "n": 3.0}, "b": {"count": 4, "file": "x.stl", "k": 1e-3}},
        start_time=1.0,
        stop_time=3.0,
        step_size=1e-3,
        observed=[("b", "angle")],
    )
    first, second = tmp_path / "first.ssp", tmp_path / "second.ssp"
    write_system(first, **arguments)
    system = read_system(first, tmp_path / "cache")
    assert system.name == "demo"
    assert {name: c.parameters for name, c in system.components.items()} == arguments["parameters"]
    assert set(system.connections) == set(arguments["connections"])
    assert (system.start_time, system.stop_time, system.step_size) == (1.0, 3.0, 1e-3)
    with ZipFile(first) as package:
        assert package.namelist() == ["SystemStructure.ssd", "resources/a.ssv", "resources/b.ssv", "resources/plant.fmu"]

    parameters = {name: c.parameters for name, c in system.components.items()}
    fmus = {name: c.fmu_path for name, c in system.components.items()}
    again = {"components": fmus, "connections": system.connections, "parameters": parameters}
    write_system(second, **(arguments | again))
    assert first.read_bytes() == second.read_bytes()
    assert read_system(second, tmp_path / "cache").connections == system.connections


def test_written_package_follows_the_schemas(tmp_path, plant):
    path = tmp_path / "demo.ssp"
    write_system(
        path, "demo", {"a": plant, "b": plant}, [Connection("a", "y", "b", "u")], parameters={"a": {"k": 2.0}}, stop_time=1, step_size=0.1
    )
    description = read_ssd(str(path), validate=True)
    assert [unit.name for unit in description.units] == ["m"]
    (parameter,) = read_ssv(str(path), "resources/a.ssv", validate=True).parameters
    assert (parameter.name, parameter.value, parameter.unit) == ("k", "2.0", "m")


def test_writer_names_what_it_cannot_write(tmp_path, plant):
    def write(components, *pairs, **more):
        with pytest.raises(SspError) as caught:
            write_system(tmp_path / "x.ssp", "x", components, pairs, stop_time=1, step_size=0.1, **more)
        assert not (tmp_path / "x.ssp").exists()
        return str(caught.value)

    assert "c.y: no component 'c'; use one of a" in write({"a": plant}, Connection("c", "y", "a", "u"))
    assert "a.z: the FMU plant.fmu has no such variable" in write({"a": plant}, parameters={"a": {"z": 1.0}})
    assert "libcosim cannot connect an Enumeration" in write({"a": plant}, observed=[("a", "gear")])
    twin = write_fmu(tmp_path / "twin.fmu", PLANT.replace('max="10"', 'max="20"'))
    assert "another FMU has its GUID g (plant.fmu); build it with a GUID of its own" in write({"a": plant, "b": twin})
    other = write_fmu(
        tmp_path / "other.fmu",
        PLANT.replace('guid="g"', 'guid="h"').replace('factor="0.001"', "").replace('<BaseUnit m="1"/>', '<BaseUnit m="2"/>'),
    )
    assert "b.u: unit 'm' is defined otherwise in another FMU" in write({"a": plant, "b": other}, Connection("a", "y", "b", "u"))


@pytest.fixture(scope="module")
def loop(tmp_path_factory):
    """x' = -2 x from x = 1, over two FMUs; the factor is a parameter where the tool takes it, else the gain's start value -1."""
    folder = tmp_path_factory.mktemp("loop")
    pairs = [Connection("gain", "port.y[1]", "integrator", "port.u[1]"), Connection("integrator", "port.y[1]", "gain", "port.u[1]")]
    path = folder / "loop.ssp"
    write_system(path, "loop", build_slaves(folder), pairs, parameters={"gain": {"k": -2.0}}, stop_time=1.0, step_size=1e-3)
    return path


def test_package_runs_in_fmpy(loop):
    result = simulate_ssp(str(loop), stop_time=1.0, step_size=1e-3)
    assert result["integrator.port.y[1]"][-1] == pytest.approx(math.exp(-1.0), rel=5e-3)


def test_package_runs_in_libcosim(loop, capfd):
    execution_module = pytest.importorskip("libcosimpy.CosimExecution")
    observer_module = pytest.importorskip("libcosimpy.CosimObserver")
    execution = execution_module.CosimExecution.from_ssp_file(str(loop))
    observer = observer_module.CosimObserver.create_last_value()
    assert execution.add_observer(observer)
    assert execution.simulate_until(target_time=int(1e9))
    index = next(info.index for info in execution.slave_infos() if info.name == b"integrator")
    assert execution.status().current_time == pytest.approx(1e9)
    assert observer.last_real_values(index, [1])[0] == pytest.approx(math.exp(-2.0), rel=5e-3)
