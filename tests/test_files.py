"""Parameters that name a file: found, packed, fixed during the run, and refused by name where there is none."""

import re
import zipfile

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu
from heaps import Heaps
from typer.testing import CliRunner

from cdl_fmu.bcm import BCM
from cdl_fmu.slave.build import build_fmu, cached_fmu
from cdl_fmu.slave.model import Instance, ModelError
from cdl_fmu.slave.pool import RowPool
from cdl_fmu.slave.state import State
from orchestrator import cli
from orchestrator.fmu import Slave, SlaveError
from orchestrator.results import open_result
from orchestrator.ssp import write_system


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    """A working directory of its own for each test."""
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return folder


@pytest.fixture
def shares(tmp_path):
    """File of shares by which a heap counts twice, in a folder of its own."""
    return write_shares(tmp_path / "data" / "shares.txt", 2.0)


def write_shares(path, share):
    path.parent.mkdir(exist_ok=True)
    np.savetxt(path, np.full(4, share))
    return path


def mass(instance):
    """What the model makes of its file: mass in 1 s, times the share."""
    instance.initialise()
    instance.step(0.0, 1.0)
    return instance.y.mass[1] / 2.0  # two outlets at one place, the second comes last


def test_an_absolute_path_is_taken_as_it_is(shares):
    assert mass(Instance(Heaps(), shares=shares)) == mass(Instance(Heaps(), shares=str(shares))) == 2.0


def test_a_relative_path_is_looked_for_in_the_resources_first(tmp_path, here):
    write_shares(here / "shares.txt", 3.0)
    assert mass(Instance(Heaps(), shares="shares.txt")) == 3.0
    resources = write_shares(tmp_path / "resources" / "shares.txt", 5.0).parent
    assert mass(Instance(Heaps(), resources=resources, shares="shares.txt")) == 5.0
    (resources / "shares.txt").unlink()
    assert mass(Instance(Heaps(), resources=resources, shares="shares.txt")) == 3.0


def test_a_missing_file_is_refused_by_name_with_where_it_was_looked_for(tmp_path, here):
    what = re.escape("(Share of each cell of a heap that counts, one number a line)")
    for resources, where in (None, ""), (tmp_path, "the FMU's resources or in "):
        said = re.escape(f"heaps: shares = 'x.txt': no such file in {where}{here}; put the file there, or give its absolute path ") + what
        with pytest.raises(ModelError, match=said):
            Instance(Heaps(), resources=resources, shares="x.txt").initialise()
    with pytest.raises(ModelError, match=re.escape(f"heaps: shares = '{here}/x.txt': no such file; correct the path ") + what):
        Instance(Heaps(), shares=here / "x.txt").initialise()
    with pytest.raises(ModelError, match=r"no such file"):
        Instance(Heaps(), shares=here).initialise()  # a folder


def test_what_is_no_path_is_refused():
    with pytest.raises(ModelError, match=r"shares = 2\.0: the path of a file is needed \(Share of each cell"):
        Instance(Heaps(), shares=2.0)
    with pytest.raises(ModelError, match=r"heaps has no parameter 'share'; it has rate, limit, shares, hopper\[1\]\.map"):
        Instance(Heaps(), share="x.txt")


def test_array_names_are_parameters_too(shares):
    assert Instance(Heaps(), **{"hopper[1].map": shares}).files == {"shares": "", "hopper[1].map": str(shares)}


def test_a_state_brings_its_file_along(shares):
    one, other = Instance(Heaps(), shares=shares), Instance(Heaps())
    mass(one)
    assert mass(other) == 0.5
    other.restore(State.from_bytes(one.save().to_bytes(RowPool), RowPool))
    for instance in one, other:
        instance.step(1.0, 1.0)
    assert other.y.tobytes() == one.y.tobytes() and other.files == one.files


@pytest.fixture
def slave():
    """Makes slaves of an FMU, not initialised yet."""
    made = []

    def make(path):
        one = Slave("heaps", fmpy.read_model_description(str(path)), fmpy.extract(str(path)), print)
        made.append(one)
        one.connect([], np.zeros(0), ["mass[2]"], np.zeros(1))
        return one

    yield make
    for one in made:
        one.close()


def slave_mass(slave, parameters):
    slave.initialise(0.0, None, parameters)
    slave.step(0.0, 1.0)
    slave.get(1.0)
    return slave.y[0] / 2.0


def test_the_fmu_declares_a_string_parameter(tmp_path):
    path = build_fmu(Heaps(), tmp_path / "heaps.fmu")
    assert validate_fmu(str(path)) == []
    variables = [v for v in fmpy.read_model_description(str(path)).modelVariables if v.type == "String"]
    assert [(v.name, v.start, v.description) for v in variables] == [(name, "", text) for name, text in Heaps.files.items()]
    assert {(v.causality, v.variability) for v in variables} == {("parameter", "fixed")}


def test_files_are_packed_into_the_fmu(tmp_path, here, shares, slave):
    write_shares(here / "shares.txt", 3.0)
    path = build_fmu(Heaps(), tmp_path / "heaps.fmu", files={"shares": shares, "hopper[1].map": shares})
    assert validate_fmu(str(path)) == []
    with zipfile.ZipFile(path) as package:
        assert package.read("resources/shares.txt") == shares.read_bytes()
    assert slave_mass(slave(path), {}) == 2.0
    other = write_shares(tmp_path / "data" / "other.txt", 7.0)
    assert slave_mass(slave(path), {"shares": str(other)}) == 7.0
    assert slave_mass(slave(path), {"shares": ""}) == 0.5
    one = slave(path)
    assert one._fmu.getString([1, 0]) == [b"shares.txt", b"shares.txt"]


def test_a_missing_file_ends_the_initialisation_of_the_fmu(tmp_path, here, slave):
    path = build_fmu(Heaps(), tmp_path / "heaps.fmu", {"shares": "x.txt"})
    with pytest.raises(SlaveError, match=re.escape(f"shares = 'x.txt': no such file in the FMU's resources or in {here}; put the file")):
        slave_mass(slave(path), {})


def test_a_file_is_fixed_during_the_run(tmp_path, shares, slave):
    one = slave(build_fmu(Heaps(), tmp_path / "heaps.fmu"))
    slave_mass(one, {"shares": str(shares)})
    one._fmu.setString([0], ["x.txt"])
    with pytest.raises(SlaveError, match="parameter shares is fixed: set it before initialisation ends"):
        one.step(1.0, 1.0)
    assert one._fmu.getString([0]) == [str(shares).encode()]
    one.step(1.0, 1.0)


def test_same_files_give_the_same_bytes_and_other_contents_another_guid(tmp_path, shares, monkeypatch):
    monkeypatch.setattr("cdl_fmu.slave.build.cache_folder", tmp_path.joinpath)

    def built():
        path = build_fmu(Heaps(), tmp_path / "heaps.fmu", files={"shares": shares})
        return path.read_bytes(), fmpy.read_model_description(str(path)).guid

    cached = cached_fmu(Heaps(), files={"shares": shares})
    first = built()
    assert built() == first and cached.read_bytes() == first[0] and cached_fmu(Heaps(), files={"shares": shares}) == cached
    write_shares(shares, 3.0)
    assert built()[1] != first[1] and cached_fmu(Heaps(), files={"shares": shares}) != cached
    assert fmpy.read_model_description(str(build_fmu(Heaps(), tmp_path / "heaps.fmu"))).guid != first[1]


def test_files_that_cannot_be_packed_are_refused(tmp_path, shares):
    def refused(files, model=None):
        with pytest.raises(ModelError) as caught:
            build_fmu(model or Heaps(), tmp_path / "x.fmu", files=files)
        return str(caught.value)

    assert refused({"mesh": shares}) == "heaps has no file parameter 'mesh'; it has shares, hopper[1].map"
    assert refused({"mesh": shares}, BCM(1)) == "cdl_bcm_w1 has no file parameter 'mesh'; it has none"
    missing = tmp_path / "x.txt"
    assert f"shares = '{missing}': no such file; correct the path (Share of each cell" in refused({"shares": missing})
    other = write_shares(tmp_path / "other" / "Shares.txt", 3.0)
    assert refused({"shares": shares, "hopper[1].map": other}) == (
        f"hopper[1].map = '{other}' and shares = '{shares}' have one name, and lie in one folder of the FMU: rename one"
    )


def test_the_master_runs_a_system_with_files(tmp_path, shares):
    fmus = {
        "packed": build_fmu(Heaps(), tmp_path / "packed.fmu", files={"shares": shares}),
        "given": build_fmu(Heaps(), tmp_path / "given.fmu"),
    }
    other = write_shares(tmp_path / "data" / "other.txt", 7.0)
    package = tmp_path / "x.ssp"
    write_system(package, "x", fmus, [], parameters={"given": {"shares": str(other)}}, stop_time=1.0, step_size=0.125)
    done = CliRunner().invoke(cli.app, ["run", str(package), "--out", str(tmp_path / "out")])
    assert done.exit_code == 0, done.output
    result = open_result(tmp_path / "out").cdl
    assert (result["packed.mass[2]"][-1], result["given.mass[2]"][-1]) == (4.0, 14.0)
    described = CliRunner().invoke(cli.app, ["info", str(fmus["packed"])], env={"COLUMNS": "200"})
    assert "shares.txt" in described.stdout
