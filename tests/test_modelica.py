"""The Modelica package: it parses, its interface is that of the FMUs, its adapter's equations hold, and its example runs."""

import re
import textwrap
from itertools import chain
from pathlib import Path

import numpy as np
import pymoca.parser
import pytest
from pymoca import ast

from cdl_fmu.frames import axis_rotation, resolve1, resolve2
from cdl_fmu.slave.interface import wheel_pose, wheel_wrench

ROOT = Path(__file__).parents[1]
LIBRARY = ROOT / "fmus" / "modelica"
FILES = sorted(LIBRARY.rglob("*.mo"))


def parsed(path):
    """The class that a file declares."""
    names = path.relative_to(LIBRARY).with_suffix("").parts
    found = pymoca.parser.parse(path.read_text(encoding="utf-8"), bypass_cache=True)
    for name in names[:-1] if names[-1] == "package" else names:
        found = found.classes[name]
    return found


def modifiers(symbol):
    """Name -> value of what modifies a declaration."""
    arguments = symbol.class_modification.arguments if symbol.class_modification else []
    return {str(argument.value.component): argument.value.modifications[0] for argument in arguments if argument.value.modifications}


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.relative_to(LIBRARY).as_posix())
def test_each_file_declares_one_class_in_which_everything_has_a_meaning_and_each_number_a_unit(path):
    declared = parsed(path)
    assert declared.comment
    for name, symbol in declared.symbols.items():
        assert symbol.comment, name
        kind = str(symbol.type)
        if kind == "Real" or kind.startswith("Modelica.Blocks.Interfaces.Real"):
            assert "unit" in modifiers(symbol), name


@pytest.mark.parametrize("order", sorted(LIBRARY.rglob("package.order")), ids=lambda path: path.parent.name)
def test_each_package_lists_what_it_holds(order):
    files = {path.stem for path in order.parent.glob("*.mo")} - {"package"}
    folders = {path.parent.name for path in order.parent.glob("*/package.mo")}
    assert sorted(order.read_text().split()) == sorted(files | folders)


@pytest.mark.parametrize("name, pose_is", [("WheelFrame", "RealOutput"), ("ContactFMU", "RealInput")])
def test_the_signals_are_those_of_a_wheel_of_a_contact_fmu(name, pose_is):
    symbols = parsed(LIBRARY / "ContactDynamics" / f"{name}.mo").symbols
    signals = {name: symbol for name, symbol in symbols.items() if str(symbol.type).startswith("Modelica.Blocks.Interfaces.Real")}
    pose, wrench = (record.fields["wheel"].record.fields for record in (wheel_pose(1), wheel_wrench(1)))
    assert set(signals) == set(pose) | set(wrench)
    for name, field in chain(pose.items(), wrench.items()):
        signal = signals[name]
        assert tuple(size.value for size in signal.dimensions[0]) == field.shape, name
        assert modifiers(signal)["unit"].value == field.unit, name
        assert str(signal.type).endswith(pose_is) == (name in pose), name


def blocks(page):
    """The blocks of Modelica on a page."""
    return [textwrap.dedent(code) for code in re.findall(r"^ *```modelica\n(.*?)^ *```", page.read_text(encoding="utf-8"), re.M | re.S)]


def value(expression, values):
    """What an expression of the parse tree comes to; ``der(...)`` is looked up."""
    if isinstance(expression, ast.ComponentRef):
        return values[str(expression)]
    operator = str(expression.operator)
    if operator == "der":
        return values[f"der({expression.operands[0]})"]
    operands = [value(operand, values) for operand in expression.operands]
    if operator == "*":
        return operands[0] @ operands[1]
    return {"transpose": np.transpose, "-": np.negative}[operator](*operands)


def test_the_adapter_turns_vectors_as_the_contact_models_do():
    T = axis_rotation(2, 2.1) @ axis_rotation(1, 0.2) @ axis_rotation(3, -0.7)
    rate, f_0, t_0 = 0.8, np.array([3.0, -4.0, 250.0]), np.array([0.5, -9.0, 2.0])
    values = {"frame_a.r_0": np.array([1.0, 2.0, 0.1]), "der(frame_a.r_0)": np.array([0.1, 0.2, -0.3]), "f_0": f_0, "t_0": t_0}
    values |= {"frame_a.R.T": T, "frame_a.R.w": np.array([0.0, rate, 0.0])}
    equations = parsed(LIBRARY / "ContactDynamics" / "WheelFrame.mo").equations
    found = {str(equation.left): value(equation.right, values) for equation in equations}
    assert set(found) == {"r_0", "T", "v_0", "w_0", "frame_a.f", "frame_a.t"}
    assert (found["r_0"] == values["frame_a.r_0"]).all() and (found["T"] == T).all()
    assert (found["v_0"] == values["der(frame_a.r_0)"]).all()
    axle = np.array(resolve1(T, 0.0, 1.0, 0.0))  # in world
    assert found["w_0"] == pytest.approx(rate * axle)
    # What acts on the body is the reaction to the cut force on the adapter.
    assert -found["frame_a.f"] == pytest.approx(np.array(resolve2(T, *f_0)))
    assert -found["frame_a.t"] == pytest.approx(np.array(resolve2(T, *t_0)))


def test_the_handbook_writes_the_adapter_out_as_it_is():
    code = blocks(ROOT / "fmus" / "README.md")[0]
    shown = {line.split("//")[0].strip() for line in code.splitlines()}
    model = (LIBRARY / "ContactDynamics" / "WheelFrame.mo").read_text(encoding="utf-8")
    assert len(shown) == 6 and shown <= {line.strip() for line in model.splitlines()}


@pytest.mark.parametrize("page", ["dymola", "openmodelica"])
def test_the_classes_on_a_tools_page_parse(page):
    classes = [code for code in blocks(ROOT / "fmus" / "tools" / f"{page}.md") if code.startswith(("block", "model"))]
    assert classes
    for code in classes:
        pymoca.parser.parse(code, bypass_cache=True)  # raises ModelicaSyntaxError


def test_the_example_is_connected_all_through():
    example = parsed(LIBRARY / "ContactDynamics" / "Examples" / "WheelOnGround.mo")
    joined = {frozenset((str(equation.left), str(equation.right))) for equation in example.equations}
    assert joined == {
        frozenset(("body.frame_a", "wheelFrame.frame_a")),
        *(frozenset((f"wheelFrame.{name}", f"contact.{name}")) for name in ("r_0", "T", "v_0", "w_0", "f_0", "t_0")),
    }


def test_a_compiler_finds_the_example_balanced_and_its_wheel_comes_to_rest_on_the_ground():
    """On stand-ins for the classes of Modelica's library, which ``tests/modelica_library`` declares."""
    rumoca = pytest.importorskip("rumoca", reason="rumoca, a Modelica compiler, is not installed: pip install rumoca")
    session = rumoca.Session(roots=[str(ROOT / "tests" / "modelica_library"), str(LIBRARY)])
    path = LIBRARY / "ContactDynamics" / "Examples" / "WheelOnGround.mo"
    model = session.load(str(path), model="ContactDynamics.Examples.WheelOnGround")
    structure = model.structure()
    assert structure.is_balanced and structure.is_matched
    result = model.simulate(t=(0.0, 1.0), dt=1e-3)
    last = {name: result[name][-1] for name in ("contact.f_0[3]", "body.r_0[3]", "body.r_0[1]", "wheelFrame.w_0[2]")}
    weight, stiffness, rate = 27.0 * 9.81, 2e4, 0.8
    assert last["contact.f_0[3]"] == pytest.approx(weight, rel=1e-3)
    assert last["body.r_0[3]"] == pytest.approx(0.125 - weight / stiffness, abs=1e-4)
    assert last["body.r_0[1]"] == pytest.approx(0.1, rel=1e-6) and last["wheelFrame.w_0[2]"] == pytest.approx(rate)  # it rolls on
