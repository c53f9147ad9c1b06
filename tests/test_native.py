"""Native FMUs stand alone: what their binaries need, what lies beside them, and what cannot be exported."""

import io
import re
from zipfile import ZipFile

import fmpy
import numpy as np
import pytest
from elftools.elf.dynamic import DynamicSection
from elftools.elf.elffile import ELFFile
from elftools.elf.gnuversions import GNUVerNeedSection
from fmpy.validation import validate_fmu
from linear_spring import LinearSpring
from natives import built
from slabs import files_of

from cdl_fmu.bcm import BCM
from cdl_fmu.dem import DEM
from cdl_fmu.rbc import RBC
from cdl_fmu.scm import SCM
from cdl_fmu.slave.kernel import kernel
from cdl_fmu.slave.model import KernelModel, ModelError
from cdl_fmu.slave.native.kernels import LIBM, MEMORY, ExportError
from cdl_fmu.slave.records import Real, Record
from mbs.driver import Driver

#: What the generic C source calls.
LIBC = {
    *("calloc", "malloc", "realloc", "free", "snprintf", "vsnprintf", "sscanf", "__isoc99_sscanf", "strlen", "strcmp", "strncmp", "strstr"),
    *("strcpy", "bcmp", "fopen", "fread", "fgetc", "fclose"),
}


@pytest.fixture(scope="module", params=[Driver(2), BCM(1, 1), SCM(1, 1), RBC(2, 1)], ids=lambda model: model.identifier)
def fmus(request, tmp_path_factory):
    """A model, and its FMUs by version."""
    model = request.param
    return model, built(model, tmp_path_factory.mktemp(model.identifier), files_of(model))


def binary(fmu, folder: str) -> ELFFile:
    with ZipFile(fmu) as archive:
        name = next(n for n in archive.namelist() if n.startswith(f"binaries/{folder}/"))
        return ELFFile(io.BytesIO(archive.read(name)))


def test_binaries_need_libm_and_libc_alone_of_2012_and_show_fmi_alone(fmus):
    model, paths = fmus
    for version, folder in ("2.0", "linux64"), ("3.0", "x86_64-linux"):
        elf = binary(paths[version], folder)
        symbols = [s for s in elf.get_section_by_name(".dynsym").iter_symbols() if s.name]
        undefined = {s.name for s in symbols if s["st_shndx"] == "SHN_UNDEF" and s["st_info"]["bind"] == "STB_GLOBAL"}
        assert undefined <= LIBM | MEMORY | LIBC
        assert all(re.match("fmi[23][A-Z]", s.name) for s in symbols if s["st_shndx"] != "SHN_UNDEF")
        sections = list(elf.iter_sections())
        needed = {tag.needed for s in sections if isinstance(s, DynamicSection) for tag in s.iter_tags("DT_NEEDED")}
        assert needed <= {"libc.so.6", "libm.so.6"}
        versions = [v.name for s in sections if isinstance(s, GNUVerNeedSection) for _, vs in s.iter_versions() for v in vs]
        assert max(tuple(map(int, v.removeprefix("GLIBC_").split("."))) for v in versions) <= (2, 17)


def test_an_fmu_is_valid_holds_licences_and_binaries_for_windows_too_and_is_the_same_when_built_again(fmus, tmp_path):
    model, paths = fmus
    again = built(model, tmp_path, files_of(model))
    for version, windows in ("2.0", "win64"), ("3.0", "x86_64-windows"):
        assert validate_fmu(str(paths[version])) == []
        assert paths[version].read_bytes() == again[version].read_bytes()
        with ZipFile(paths[version]) as archive:
            assert archive.read(f"binaries/{windows}/{model.identifier}.dll")[:2] == b"MZ"
            licences = [n for n in archive.namelist() if n.startswith("documentation/licenses/")]
            assert "documentation/licenses/license.txt" in licences and all(len(archive.read(n)) > 500 for n in licences)
        assert not fmpy.read_model_description(str(paths[version])).coSimulation.needsExecutionTool


def test_fmi_3_has_arrays_and_runs_as_fmi_2_does(tmp_path):
    paths = built(BCM(1, 1), tmp_path, {})
    description = fmpy.read_model_description(str(paths["3.0"]))
    shapes = {v.name: tuple(int(d.start) for d in v.dimensions) for v in description.modelVariables}
    assert shapes["wheel[1].T"] == (3, 3) and shapes["wheel[1].f_0"] == (3,) and shapes["patch[1].z"] == (13, 9)
    pose = {"wheel[1].r_0": (0.0, 0.0, 0.1), "wheel[1].v_0": (0.1, 0.0, 0.0), "wheel[1].w_0": (0.0, 1.0, 0.0)}
    patch = {"patch[1].spacing": 0.03, "patch[1].origin": (-0.18, -0.12), "patch[1].z": np.full((13, 9), -0.002)}
    flat = {}
    for name, value in (pose | patch).items():
        for index, one in np.ndenumerate(value):
            flat[name + (f"[{','.join(str(i + 1) for i in index)}]" if index else "")] = float(one)
    as_lists = {name: np.ravel(value).tolist() if np.ndim(value) else value for name, value in (pose | patch).items()}
    rows3 = fmpy.simulate_fmu(str(paths["3.0"]), stop_time=0.01, step_size=1e-3, start_values=as_lists, output=["wheel[1].f_0"])
    names = [f"wheel[1].f_0[{k}]" for k in (1, 2, 3)]
    rows2 = fmpy.simulate_fmu(str(paths["2.0"]), stop_time=0.01, step_size=1e-3, start_values=flat, output=names)
    assert rows2[names[2]][-1] > 100.0
    assert rows3["wheel[1].f_0"].tolist() == [list(row) for row in zip(*(rows2[name] for name in names))]


def test_what_an_fmu_holds_is_read_from_its_resources_and_may_not_be_changed(tmp_path):
    model = RBC(2, 1)
    files = files_of(model)
    path = built(model, tmp_path, files)["2.0"]
    heard = []

    def failing(**start_values):
        listen = dict(logger=lambda *a: heard.append(a[-1].decode()))
        with pytest.raises(Exception):  # noqa: B017 - FMPy raises this
            fmpy.simulate_fmu(str(path), stop_time=0.01, step_size=1e-3, start_values=start_values, **listen)
        return heard[-1]

    assert "parameter r_w = 0.2 m: what this FMU holds was made for 0.125; build it with the other value" in failing(r_w=0.2)
    assert "body[1].mesh = 'other.stl': this FMU holds what it needs of" in failing(**{"body[1].mesh": "other.stl"})
    unpacked = fmpy.extract(str(path), str(tmp_path / "unpacked"))
    (tmp_path / "unpacked" / "resources" / "constants.bin").unlink()
    path = unpacked
    assert "constants.bin is missing, in which the FMU keeps its terrain and meshes: unpack the FMU again" in failing()
    (tmp_path / "unpacked" / "resources" / "constants.bin").write_bytes(b"anything")
    assert "constants.bin is damaged or of another FMU: unpack the FMU again" in failing()


class Allocates(KernelModel):
    """Breaks a kernel rule."""

    identifier = "allocates"
    parameters = inputs = state = Record(a=Real(0.0, "1", "Anything"))
    outputs = Record(b=Real(0.0, "1", "Anything"))

    @staticmethod
    @kernel
    def initialise_kernel(t, p, x, y):
        y.b = 0.0

    @staticmethod
    @kernel
    def step_kernel(t, h, p, u, x, y):
        y.b = np.zeros(int(u.a)).sum()
        return 0


def test_kernel_that_allocates_is_refused_with_the_rule(tmp_path):
    with pytest.raises(ExportError, match=r"allocates: the kernels do not compile; use loops and scalars .*CONTRIBUTING.md"):
        built(Allocates(), tmp_path, {})


def test_class_that_cannot_be_imported_is_refused(tmp_path):
    model = LinearSpring(1)
    model.__class__ = type("Scripted", (LinearSpring,), {"__module__": "__main__"})
    with pytest.raises(ExportError, match="Scripted is defined in a script: move it to a module that can be imported"):
        built(model, tmp_path, {})


def test_particles_and_parameters_that_do_not_fit_are_refused_before_anything_is_compiled(tmp_path):
    with pytest.raises(ExportError, match=r"cdl_dem_w1 cannot be a native FMU: between steps Python puts .* 'cdl build cdl_dem_w1'"):
        built(DEM(1), tmp_path, {})
    with pytest.raises(ModelError, match=r"body\[1\].mesh names no file, which a native FMU holds from the start: give --file body"):
        built(RBC(2, 1), tmp_path, {})
    with pytest.raises(ModelError, match=r"body\[1\].mesh = '.*missing.stl': no such file"):
        built(RBC(2, 1), tmp_path, {"body[1].mesh": tmp_path / "missing.stl"})
