"""The rover as a native FMU, which ships MuJoCo's library: what it does and says is what it does and says in Python."""

import sys
from concurrent.futures import ThreadPoolExecutor
from zipfile import ZipFile

import numpy as np
import pytest
from natives import Twins, built

from cdl_fmu.slave.model import Instance, ModelError
from mbs.rover import Rover
from orchestrator.drive import simulate
from orchestrator.fmu import SlaveError
from orchestrator.results import open_result

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the rover's native FMU holds a library for Linux, and is built there")

H = 1e-3
#: Other than the FMU's own in all that MuJoCo's model holds, and with the outputs that rigid contacts ask for.
CHANGED = {
    "slope": 0.2,
    "uphill": 1.0,
    "wheel_base": 0.8,
    "mass": 30.0,
    "mass_height": 0.0,
    "wheel_mass": 1.5,
    "wheel_inertia_axle": 0.012,
    "start.yaw": 0.4,
    "with_inverse_inertia": "on",
}
ROCK = {
    "rock[1].mass": 3.0,
    "rock[1].inertia": (0.03, 0.02, 0.025, 0.001, 0.002, -0.003),
    "rock[1].center": (0.01, 0.02, 0.03),
    "rock[1].x": 1.0,
    "rock[1].yaw": 0.3,
    "rock[1].pitch": -0.4,
    "rock[1].roll": 1.1,
}
CASES = {
    "bare": (Rover(2), {}),
    "changed": (Rover(2), CHANGED),
    "rock": (Rover(2, 1, 1), ROCK),
    "rocks, changed": (Rover(2, 2, 1), CHANGED | ROCK | {"rock[2].fixed": "on"}),
    "hard ground": (Rover(2, 0, 1), CHANGED),
}


#: Largest change of an input from its start value, by the last part of its name.
SPANS = {"K": 2e4, "D": 100.0, "F": 100.0, "f_0": 50.0, "t_0": 5.0, "K_r": 100.0, "D_r": 1.0}


def pushes(model, rng, n: int) -> list[np.ndarray]:
    """Inputs of n steps: wrenches, soft and stiff contacts that come and go, pairs of wheels, rocks and ground, rates of the drives."""
    scalars = model.inputs.scalars()
    starts, least, most = np.array([(s.start, s.field.min, s.field.max) for s in scalars]).T
    spans = np.array([SPANS.get(s.name.rpartition(".")[2].split("[")[0], 0.1) for s in scalars])
    numbers = [s.offset for s in scalars if s.name.endswith((".on", ".against", ".in_contact"))]
    inputs = []
    for _ in range(n):
        u = starts + spans * rng.uniform(-1.0, 1.0, starts.size)
        u[numbers] = rng.integers(0, 4, len(numbers))
        inputs.append(u.clip(least, most))
    return inputs


def run(pair, inputs, first=0) -> np.ndarray:
    """Outputs after each step, the same bits from both."""
    outputs = []
    for k, u in enumerate(inputs, first):
        pair.send(u)
        pair.step(k * H, H)
        native, python = pair.outputs()
        assert native.tobytes() == python.tobytes(), f"step {k}: they differ by up to {np.abs(native - python).max():g}"
        outputs.append(native)
    return np.array(outputs)


@pytest.mark.parametrize("case", CASES)
def test_it_computes_the_bits_of_the_python_rover_and_goes_back_to_a_state(case, tmp_path):
    model, values = CASES[case]
    pair = Twins(model, tmp_path, **values)
    pair.initialise()
    native, python = pair.outputs()
    assert native.tobytes() == python.tobytes()
    inputs = pushes(model, np.random.default_rng(1), 150)
    run(pair, inputs[:50])
    saved, at = pair.native.save(), pair.python.save()
    once = run(pair, inputs[50:], 50)
    assert np.ptp(once, axis=0).max() > 1.0
    pair.native.restore(saved)
    pair.python.restore(at)
    assert run(pair, inputs[50:], 50).tobytes() == once.tobytes()
    pair.native.close()


def test_a_state_goes_on_in_another_instance_that_has_other_parameters(tmp_path):
    model, values = CASES["rocks, changed"]
    pair, other = Twins(model, tmp_path / "a", **values), Twins(model, tmp_path / "b", wheel_base=1.0, slope=0.1)
    inputs = pushes(model, np.random.default_rng(2), 60)
    for one in (pair, other):
        one.initialise()
        run(one, inputs[:30])
    data, at = pair.native.to_bytes(), pair.python.save()
    once = run(pair, inputs[30:], 30)
    other.native.from_bytes(data)
    other.python.restore(at)
    assert run(other, inputs[30:], 30).tobytes() == once.tobytes()


def test_instances_in_several_threads_do_not_disturb_each_other(tmp_path):
    model, values = CASES["rock"]
    inputs = pushes(model, np.random.default_rng(3), 200)
    pairs = [Twins(model, tmp_path / str(k), **values | {"rock[1].mass": 2.0 + k}) for k in range(4)]

    def go(pair):
        pair.initialise()
        for k, u in enumerate(inputs):
            pair.native.u[:] = u
            pair.native.set(k * H)
            pair.native.step(k * H, H)
        pair.native.get(0.0)
        return pair.native.y.copy()

    with ThreadPoolExecutor(4) as pool:
        reached = list(pool.map(go, pairs))
    for pair, y in zip(pairs, reached):
        for k, u in enumerate(inputs):
            pair.u[:] = u
            pair.python.step(k * H, H)
        assert y.tobytes() == pair.outputs()[1].tobytes()


def test_a_lost_state_is_refused_with_the_same_words_and_stays(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    pair = Twins(Rover(2), tmp_path / "fmu")
    pair.initialise()
    good = pushes(pair.python.model, np.random.default_rng(4), 20)
    run(pair, good[:10])
    bad = good[10].copy()
    bad[[s.name for s in pair.python.model.scalars["u"]].index("wheel[1].f_0[2]")] = 1e300
    before = pair.native.save()
    pair.send(bad)
    with pytest.raises(ModelError, match="the rover's motion left all bounds") as python:
        pair.python.step(0.01, H)
    with pytest.raises(SlaveError) as native:
        pair.native.step(0.01, H)
    assert str(python.value) in str(native.value)
    pair.native.restore(before)
    run(pair, good[10:], 10)
    assert not (tmp_path / "MUJOCO_LOG.TXT").exists()


@pytest.mark.parametrize(
    "values",
    [
        {"wheel_inertia_axle": 1.0},
        {"rock[1].inertia": (0.02, 0.02, 0.05, 0.0, 0.0, 0.0)},
        {"rock[1].inertia": (0.02, 0.02, 0.02, 0.03, 0.0, 0.0)},
        {"rock[1].inertia": (-0.02, 0.02, 0.02, 0.0, 0.0, 0.0)},
        {"rock[1].mass": 0.0},
    ],
)
def test_parameters_are_refused_with_the_same_words(values, tmp_path):
    pair = Twins(Rover(2, 1, 1), tmp_path, **values)
    with pytest.raises(ModelError) as python:
        pair.python.initialise()
    with pytest.raises(SlaveError) as native:
        pair.native.initialise(0.0, None, pair.values)
    assert str(python.value) in str(native.value)


def principal(*values) -> np.ndarray:
    """xx, yy, zz, xy, xz, yz of a body with these principal inertias, its axes turned at random."""
    axes, _ = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))
    a = axes @ np.diag(values) @ axes.T
    return a[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]


@pytest.mark.parametrize("values, is_body", [
    ((0.01, 0.02, 0.03), True),  # a plate
    ((0.01, 0.02, 0.03 * (1 + 1e-8)), False),
    ((1e-7, 0.02, 0.02), True),  # a rod
    ((-1e-7, 0.02, 0.02), False),
    ((1e-5, 1e-5, 1e-5), True),
])  # fmt: skip
def test_inertia_of_a_rock_is_one_that_a_body_can_have(values, is_body):
    rover = Instance(Rover(2, 1), **{"rock[1].inertia": principal(*values)})
    if is_body:
        rover.initialise()
    else:
        with pytest.raises(ModelError, match=r"rock\[1\]\.inertia = .* no body has these"):
            rover.initialise()


def test_fmus_hold_the_library_and_its_licences_and_are_for_linux_alone(tmp_path):
    for version, path in built(Rover(2), tmp_path, {}).items():
        with ZipFile(path) as archive:
            names = archive.namelist()
            library = archive.read(next(name for name in names if "libmujoco" in name))
        folder = {"2.0": "linux64", "3.0": "x86_64-linux"}[version]
        assert {name.split("/")[1] for name in names if name.startswith("binaries/")} == {folder}
        assert f"binaries/{folder}/{Rover.library.file.name}" in names and library == Rover.library.file.read_bytes()
        assert "documentation/licenses/mujoco-core-LICENSE.txt" in names


@pytest.mark.slow
def test_experiments_with_it_are_those_of_python(tmp_path):
    results = []
    for native in (False, True):
        outcome = simulate("two_wheel", tmp_path / str(native), tiers=("BCM", "BCM"), stop_time=1.0, native=native, picture=False)
        assert outcome.status == "complete" and not outcome.warnings
        results.append(open_result(outcome.result).cdl)
    python, native = results
    for name in python:
        np.testing.assert_allclose(native[name].values, python[name].values, rtol=1e-10, atol=1e-10, err_msg=name)
