"""Every model's kernels stand as object code without Python, and compute the same bits there."""

import ctypes
import io
import shutil
import subprocess

import beds
import numpy as np
import pytest
from elftools.elf.elffile import ELFFile
from heaps import Heaps
from linear_spring import LinearSpring
from slabs import files_of, place_of

from cdl_fmu.dem import DEM
from cdl_fmu.frames import axis_rotation
from cdl_fmu.slave.kernel import kernel
from cdl_fmu.slave.model import Instance, KernelModel
from cdl_fmu.slave.native import LIBM, MEMORY, ExportError, object_code
from cdl_fmu.slave.records import Real, Record
from fmus import SHIPPED

#: Those of particles take a minute to compile, and a tool that jumps into them is refused: they have a test of their own.
MODELS = [*(m for m in SHIPPED if isinstance(m, KernelModel) and not isinstance(m, DEM)), LinearSpring(n_wheels=2), Heaps()]


@pytest.fixture(scope="module", params=MODELS, ids=lambda model: model.identifier)
def exported(request):
    return request.param, object_code(request.param)


def symbols(code: bytes) -> tuple[set[str], set[str]]:
    """Names of the global symbols of an ELF object: defined, undefined."""
    table = ELFFile(io.BytesIO(code)).get_section_by_name(".symtab")
    names = [(s.name, s["st_shndx"] == "SHN_UNDEF") for s in table.iter_symbols() if s["st_info"]["bind"] != "STB_LOCAL"]
    return {name for name, undefined in names if not undefined}, {name for name, undefined in names if undefined}


def test_object_needs_only_libm_and_memory_functions(exported):
    model, code = exported
    defined, undefined = symbols(code)
    assert defined == {f"{model.identifier}_initialise", f"{model.identifier}_step"}
    assert undefined <= LIBM | MEMORY


def linked(code: bytes, folder) -> ctypes.CDLL:
    compiler = shutil.which("gcc")
    if compiler is None:
        pytest.skip("no gcc on this machine to link the object with")
    (folder / "kernels.o").write_bytes(code)
    subprocess.run([compiler, "-shared", "-o", folder / "kernels.so", folder / "kernels.o", "-lm"], check=True)
    return ctypes.CDLL(folder / "kernels.so")


def test_linked_object_computes_the_bits_of_the_python_instance(exported, tmp_path):
    model, code = exported
    library = linked(code, tmp_path)
    files = files_of(model)
    python = Instance(model, **files)
    block = python.block.copy()
    status, exc, pointer = ctypes.c_int32(), ctypes.c_void_p(), block.ctypes.data_as(ctypes.c_void_p)
    pool = model.make_pool(python.p, files)

    def native(name, *times):
        arguments = [*map(ctypes.c_double, times), pointer, *pool_arguments(pool)]
        assert library[f"{model.identifier}_{name}"](ctypes.byref(status), ctypes.byref(exc), *arguments) == 0
        assert status.value == 0

    python.initialise()
    native("initialise", 0.0)
    rng, h = np.random.default_rng(1), 1e-3
    outputs = []
    for k in range(500):
        python.block[python.slices["u"]] = block[python.slices["u"]] = some_inputs(model, rng)
        python.step(k * h, h)
        if pool is not None:
            pool.reserve(python.u)
        native("step", k * h, h)
        assert block.tobytes() == python.block.tobytes()
        outputs.append(block[python.slices["y"]].copy())
    assert np.ptp(outputs, axis=0).any()
    if pool is not None:
        assert pool.to_bytes(pool.save()) == python.pool.to_bytes(python.pool.save())


@pytest.mark.slow
def test_particles_need_no_python_either_and_go_the_same_ways(tmp_path):
    one = beds.dem(1, 1)
    code = object_code(one.model)
    assert symbols(code)[1] <= LIBM | MEMORY
    library = linked(code, tmp_path)
    beds.place(one.u["wheel"][0], (0.0, 0.0, beds.R_W + beds.highest_particle()))
    one.initialise()
    pool = one.model.make_pool(one.p, {"bed": beds.bed_file()})
    block = one.block.copy()
    status, exc, pointer = ctypes.c_int32(), ctypes.c_void_p(), block.ctypes.data_as(ctypes.c_void_p)
    for k in range(40):
        beds.place(one.u["wheel"][0], (0.0, 0.0, beds.R_W + beds.highest_particle() - 2e-4 * k))
        block[one.slices["u"]] = one.block[one.slices["u"]]
        one.step(1e-3 * k, 1e-3)
        pool.reserve(one.u)
        arguments = [ctypes.c_double(1e-3 * k), ctypes.c_double(1e-3), pointer, *pool_arguments(pool)]
        assert library[f"{one.model.identifier}_step"](ctypes.byref(status), ctypes.byref(exc), *arguments) == 0
        assert status.value == 0 and block.tobytes() == one.block.tobytes()
    assert one.y["wheel"]["f_0"][0, 2] > 1.0 and pool.to_bytes(pool.save()) == one.pool.to_bytes(one.pool.save())


def pool_arguments(pool) -> list:
    """What a C host passes for a pool: a pointer to each array, and all their extents."""
    if pool is None:
        return []
    extents = [n for a in pool.arrays for n in a.shape]
    return [(ctypes.c_void_p * len(pool.arrays))(*(a.ctypes.data for a in pool.arrays)), (ctypes.c_int64 * len(extents))(*extents)]


def some_inputs(model, rng) -> np.ndarray:
    """Values near the start values; wheels a little in the ground, turned, rolling and sliding; patches under them."""
    starts = model.inputs.starts()
    block = starts + rng.uniform(-0.5, 0.5, starts.size)
    u = block.view(model.inputs.dtype)[0]
    fields = u.dtype.names
    for wheel in u["wheel"] if "wheel" in fields and "r_0" in u["wheel"].dtype.names else ():
        wheel["r_0"][2] = rng.uniform(0.09, 0.12)
        if "T" in wheel.dtype.names:
            pitch, camber, yaw = rng.uniform([-3, -0.2, -3], [3, 0.2, 3])
            wheel["T"] = axis_rotation(2, pitch) @ axis_rotation(1, camber) @ axis_rotation(3, yaw)
    for patch, wheel in zip(u["patch"], u["wheel"]) if "patch" in fields else ():
        patch["spacing"] = spacing = 0.03
        patch["origin"] = spacing * np.round(wheel["r_0"][:2] / spacing - np.array(patch["z"].shape) // 2)
        patch["z"] = rng.uniform(-0.01, 0.01, patch["z"].shape)
    for j, body in enumerate(u["body"] if "body" in fields else ()):
        body["r_0"], body["T"] = np.array(place_of(j)) - (0.0, 0.0, 0.021), np.eye(3)  # as wheels lean, and no contact may be deep
    scalars = model.inputs.scalars()
    return block.clip([s.field.min for s in scalars], [s.field.max for s in scalars])


def test_object_has_the_same_bytes_again():
    model = LinearSpring(n_wheels=1)
    assert object_code(model) == object_code(model)


def test_object_for_windows():
    machine = object_code(LinearSpring(n_wheels=1), triple="x86_64-pc-windows-gnu")[:2]
    assert int.from_bytes(machine, "little") == 0x8664  # COFF: IMAGE_FILE_MACHINE_AMD64


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


def test_kernel_that_allocates_is_refused_with_the_rule():
    with pytest.raises(ExportError, match=r"allocates: the kernels do not compile; use loops and scalars .*CONTRIBUTING.md"):
        object_code(Allocates())


def test_class_that_cannot_be_imported_is_refused():
    model = Allocates()
    model.__class__ = type("Scripted", (Allocates,), {"__module__": "__main__"})
    with pytest.raises(ExportError, match="Scripted is defined in a script: move it to a module that can be imported"):
        object_code(model)
