"""The contract that every model keeps, in process and as an FMU."""

import hashlib
import re
import zipfile

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu
from slabs import files_of, place_of, values_of

from cdl_fmu.slave.build import build_fmu
from cdl_fmu.slave.model import Instance, ModelError
from cdl_fmu.slave.records import Choice
from cdl_fmu.slave.units import base_unit
from fmus import SHIPPED
from mbs.driver import Driver
from orchestrator.fmu import Slave, SlaveError

every_model = pytest.mark.parametrize("model", SHIPPED, ids=lambda m: m.identifier)


@pytest.fixture(scope="module")
def fmu(tmp_path_factory):
    """Build and unpack a model's FMU once; returns (path, directory, description)."""
    folder, built = tmp_path_factory.mktemp("fmus"), {}

    def of(model):
        if model.identifier not in built:
            path = build_fmu(model, folder / f"{model.identifier}.fmu", values_of(model), files_of(model))
            built[model.identifier] = path, fmpy.extract(str(path)), fmpy.read_model_description(str(path))
        return built[model.identifier]

    return of


@pytest.fixture
def slave(fmu):
    """Make initialised slaves of a model's FMU; they are closed at the end."""
    made = []

    def of(model, parameters=(), warn=lambda text: None, connect=True):
        _, directory, description = fmu(model)
        one = Slave("one", description, directory, warn)
        made.append(one)
        if connect:
            names = {c: [v.name for v in description.modelVariables if v.causality == c] for c in ("input", "output")}
            one.connect(names["input"], np.zeros(len(names["input"])), names["output"], np.zeros(len(names["output"])))
            one.u[:] = model.inputs.starts()
        one.initialise(0.0, None, dict(parameters))
        return one

    yield of
    for one in made:
        one.close()


@every_model
def test_every_scalar_says_what_it_is(model):
    for scalars in model.scalars.values():
        for scalar in scalars:
            assert len(scalar.field.description) > 5, scalar.name
            base_unit(scalar.field.unit)
            assert scalar.field.min <= scalar.start <= scalar.field.max, scalar.name


@every_model
def test_the_fmu_is_valid_and_complete(model, fmu):
    path, _, description = fmu(model)
    assert validate_fmu(str(path)) == []
    variables = {v.name: v for v in description.modelVariables}
    for part, causality in (("p", "parameter"), ("u", "input"), ("y", "output")):
        for scalar in model.scalars[part]:
            variable = variables[scalar.name]
            assert variable.causality == causality and variable.description == scalar.field.description
            if not isinstance(scalar.field, Choice):
                assert variable.unit == scalar.field.unit
                assert variable.min is None or float(variable.min) == scalar.field.min
                assert variable.max is None or float(variable.max) == scalar.field.max
    assert len(description.outputs) == len(description.initialUnknowns) == len(model.outputs)


@every_model
def test_the_same_sources_give_the_same_bytes(model, fmu, tmp_path):
    again = build_fmu(model, tmp_path / "again.fmu", values_of(model), files_of(model))
    assert hashlib.sha256(again.read_bytes()).digest() == hashlib.sha256(fmu(model)[0].read_bytes()).digest()


def test_a_model_of_a_script_is_refused(tmp_path):
    """Its FMU would look for the class in its host's own main module."""
    script = type("Script", (Driver,), {"__module__": "__main__"})
    with pytest.raises(ModelError, match="Script is defined in a script: move it to a module that can be imported"):
        build_fmu(script(), tmp_path / "script.fmu")


@every_model
def test_start_values_can_be_baked_in(model, tmp_path):
    own = values_of(model)
    scalar = next(
        s
        for s in model.scalars["p"]
        if np.isfinite(s.field.max) and s.start != s.field.max and not isinstance(s.field, Choice) and s.name not in own
    )
    value = 0.5 * (scalar.start + min(scalar.field.max, scalar.start + 1.0))
    path = build_fmu(model, tmp_path / "baked.fmu", {**own, scalar.name: value}, files_of(model))
    description = fmpy.read_model_description(str(path))
    assert validate_fmu(str(path)) == []
    assert float(next(v.start for v in description.modelVariables if v.name == scalar.name)) == value
    one = Slave("one", description, fmpy.extract(str(path)), print)
    one.connect([], np.zeros(0), [scalar.name], np.zeros(1))
    one.initialise(0.0, None, {})
    one.get(0.0)
    one.close()
    assert one.y[0] == value


def _advance(slave, steps, start=0):
    rows = []
    for k in range(start, start + steps):
        _excite(slave, k)
        slave.set(1e-3 * k)
        slave.step(1e-3 * k, 1e-3)
        slave.get(1e-3 * (k + 1))
        rows.append(slave.y.copy())
    return np.array(rows)


def _excite(slave, k):
    """Inputs that make every model do something: wheels near the ground that move, small forces, slow commands."""
    for i, name in enumerate(slave.inputs):
        quantity = name.split(".")[-1].split("[")[0]
        if name.startswith("body["):
            if quantity == "r_0":
                slave.u[i] = place_of(int(name[5 : name.index("]")]) - 1)[int(name[-2]) - 1]
        elif quantity == "r_0":
            slave.u[i] = {"1": 0.1, "2": 0.0, "3": 0.1}[name[-2]] + 1e-4 * k
        elif quantity == "v_0":
            slave.u[i] = 0.1 if name.endswith("[1]") else 0.0
        elif quantity == "f_0":
            slave.u[i] = 250.0 if name.endswith("[3]") else 1.0
        elif quantity == "wheel_rate":
            slave.u[i] = 0.5


@every_model
def test_a_slave_gives_the_bits_of_the_model_in_process(model, slave):
    one, instance = slave(model), Instance(model, **files_of(model))
    instance.set_starts(values_of(model))
    instance.initialise(0.0)
    for k in range(5):
        _excite(one, k)
        one.set(1e-3 * k)
        one.step(1e-3 * k, 1e-3)
        one.get(1e-3 * (k + 1))
        instance.block[instance.slices["u"]] = one.u
        instance.step(1e-3 * k, 1e-3)
        assert one.y.tobytes() == instance.block[instance.slices["y"]].tobytes()


@every_model
def test_a_step_undone_and_retaken_gives_the_same_bits(model, slave):
    one = slave(model)
    _advance(one, 5)
    saved, serialised = one.save(), one.to_bytes()
    first = _advance(one, 10, start=5)
    one.restore(saved)
    assert _advance(one, 10, start=5).tobytes() == first.tobytes()
    other = slave(model)
    other.from_bytes(serialised)
    assert _advance(other, 10, start=5).tobytes() == first.tobytes()


@every_model
def test_nan_is_refused_by_name_and_the_slave_stays_callable(model, slave):
    one = slave(model)
    before = _advance(one, 3)
    saved = one.save()
    given, one.u[0] = one.u[0], np.nan
    one.set(0.003)
    with pytest.raises(SlaveError, match=rf"one did not do the step .* input {_re(one.inputs[0])} = nan.*: it must be finite"):
        one.step(0.003, 1e-3)
    one.restore(saved)
    one.u[0] = given
    assert np.isfinite(_advance(one, 3, start=3)).all() and np.isfinite(before).all()


@every_model
def test_a_parameter_out_of_bounds_is_refused_with_bound_and_unit(model, slave):
    scalar = next(s for s in model.scalars["p"] if np.isfinite(s.field.max) and not isinstance(s.field, Choice))
    with pytest.raises(SlaveError, match=rf"{_re(scalar.name)} = .*: it must be at most {_re(f'{scalar.field.max:g}')}"):
        slave(model, {scalar.name: 2.0 * scalar.field.max + 1.0})
    with pytest.raises(SlaveError, match="it must be finite"):
        slave(model, {scalar.name: np.nan})
    with pytest.raises(ModelError, match="a number"):
        Instance(model, **{scalar.name: "much"})
    with pytest.raises(ModelError, match="has no parameter 'colour'"):
        Instance(model, colour=1.0)


@every_model
def test_a_parameter_is_fixed_during_the_run(model, slave, fmu):
    one = slave(model)
    name = model.scalars["p"][0].name
    reference = next(v.valueReference for v in fmu(model)[2].modelVariables if v.name == name)
    one._fmu.setReal([reference], [1.0])
    with pytest.raises(SlaveError, match=rf"parameter {_re(name)} is fixed: set it before initialisation ends"):
        one.step(0.0, 1e-3)
    _advance(one, 2)


def test_an_fmu_of_another_version_says_so(fmu, tmp_path):
    path, _, description = fmu(SHIPPED[0])
    other = tmp_path / "other.fmu"
    with zipfile.ZipFile(path) as old, zipfile.ZipFile(other, "w") as new:
        module = old.read("resources/slavemodule.txt").decode()
        for name in old.namelist():
            data = old.read(name)
            if name.endswith(f"{module}.py"):
                data = re.sub(rb'built_version = ".*"', b'built_version = "99.0"', data)
            new.writestr(name.replace(module, "of_another_version"), data.replace(module.encode(), b"of_another_version"))
    with pytest.raises(SlaveError, match=r"was built by cdl-fmu 99\.0, but cdl-fmu .* is installed .*cdl build"):
        Slave("one", description, fmpy.extract(str(other)), print)


def _re(text):
    return re.escape(text)
