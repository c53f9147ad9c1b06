"""Native FMUs do what the model does in Python: to the same bits, and with the same words where they refuse."""

import numpy as np
import pytest
from heaps import Heaps
from linear_spring import LinearSpring
from native_inputs import some_inputs
from natives import MODELS, Twins

from cdl_fmu.bcm import BCM
from cdl_fmu.rbc import RBC
from cdl_fmu.scm import SCM
from cdl_fmu.slave.model import ModelError
from orchestrator.fmu import SlaveError

H = 1e-3


#: Whose kernels others share but for sizes: slow tests, as each takes a quarter of a minute to compile. The rover has its own.
OTHER_SIZES = {"cdl_scm_w1", "cdl_scm_w2", "cdl_scm_w1p1", "cdl_bcm_w2", "cdl_bcm_w1p1", "cdl_bcm_w2p2", "cdl_vem_w2", "cdl_rover_w2"}


def cases():
    for model in (*MODELS, LinearSpring(n_wheels=2), Heaps()):
        yield pytest.param(model, id=model.identifier, marks=[pytest.mark.slow] if model.identifier in OTHER_SIZES else [])


@pytest.fixture(params=cases())
def twins(request, tmp_path):
    pair = Twins(request.param, tmp_path)
    yield pair
    pair.native.close()


def same(pair) -> np.ndarray:
    native, python = pair.outputs()
    assert native.tobytes() == python.tobytes()
    return native


def test_it_computes_the_bits_of_the_python_instance_goes_back_to_a_state_and_takes_one_from_bytes(twins):
    twins.initialise()
    model, rng, outputs = twins.python.model, np.random.default_rng(1), [same(twins)]
    inputs = [some_inputs(model, rng) for _ in range(300)]

    def run(steps):
        for k in steps:
            twins.send(inputs[k])
            twins.step(k * H, H)
            outputs.append(same(twins))

    run(range(100))
    saved, python = twins.native.save(), twins.python.save()
    data = twins.native.to_bytes()
    run(range(100, 200))
    reached = outputs[-1]
    twins.native.restore(saved)
    twins.python.restore(python)
    run(range(100, 200))
    assert outputs[-1].tobytes() == reached.tobytes()
    twins.native.free(saved)
    twins.native.from_bytes(data)
    twins.python.restore(python)
    run(range(100, 300))
    assert np.ptp(outputs, axis=0).any()


def refusals(pair, act) -> tuple[str, str]:
    """What Python and the native FMU say."""
    with pytest.raises(ModelError) as python:
        act(pair.python)
    with pytest.raises(SlaveError) as native:
        act(pair.native)
    return str(python.value), str(native.value)


@pytest.mark.parametrize(
    "model, values",
    [
        (BCM(1), dict(r_w=-1.0)),
        (BCM(1), dict(k_c=-2.86e6, b_w=0.01)),
        (BCM(1), dict(k_c=-2.86e6, k_phi=0.0)),
        (BCM(1), dict(n_g=2.5)),
        (BCM(1), dict(n_g=500.0)),
        (BCM(1), dict(rho=1.6)),
        (BCM(1), dict(gravity=float("nan"))),
        (BCM(1), dict(phi=float("inf"))),
        (BCM(1), dict(slope=0.65)),
        (SCM(1), dict(cell=0.05)),
        (SCM(1), dict(erosion_sweeps=2.5)),
        (SCM(1), dict(map_min=(0.0, 2.0), map_max=(1.0, 1.0))),
        (SCM(1), dict(compressible="on", e_min=0.4, rho_s=2650.0, rho=1896.0)),
        (SCM(1, 1), dict(patch_spacing=0.005)),
        (Heaps(), dict(limit=2.5)),
    ],
    ids=lambda value: value.identifier if hasattr(value, "identifier") else ",".join(value),
)
def test_parameters_are_refused_with_the_same_words(model, values, tmp_path):
    pair = Twins(model, tmp_path, **values)
    with pytest.raises(ModelError) as python:
        pair.python.initialise()
    with pytest.raises(SlaveError) as native:
        pair.native.initialise(0.0, None, pair.values)
    assert str(python.value) in str(native.value)


@pytest.mark.parametrize(
    "name, value",
    [
        ("wheel[1].r_0[3]", float("nan")),
        ("wheel[1].v_0[1]", float("-inf")),
        ("wheel[1].w_0[2]", 2e6),
        ("wheel[1].r_0[3]", -0.2),
        ("wheel[1].active", 1.5),
    ],
)
def test_inputs_are_refused_with_the_same_words_and_the_state_stays(name, value, tmp_path):
    pair = Twins(SCM(1), tmp_path)
    pair.initialise()
    rng, model = np.random.default_rng(2), pair.python.model
    for k in range(20):
        pair.send(some_inputs(model, rng))
        pair.step(k * H, H)
    good, bad = some_inputs(model, rng), some_inputs(model, rng)
    bad[[s.name for s in model.scalars["u"]].index(name)] = value
    saved = pair.native.save()
    pair.send(bad)
    python, native = refusals(pair, lambda one: one.step(0.02, H))
    assert python in native
    pair.native.restore(saved)
    pair.send(good)
    pair.step(0.02, H)
    same(pair)


def test_a_full_pool_says_so_and_a_wheel_without_a_pose_is_warned_of(tmp_path):
    heaps = Twins(Heaps(), tmp_path, limit=3.0)
    heaps.initialise()
    for k, places in enumerate([(1.0, 2.0), (3.0, 1.0)]):
        heaps.send(np.array(places))
        heaps.step(k * H, H)
    heaps.send(np.array((4.0, 1.0)))
    python, native = refusals(heaps, lambda one: one.step(0.01, H))
    assert "outlet 1: no heap is left for its place; raise limit = 3 (t = 0.01 s)" in python and python in native
    bcm = Twins(BCM(2), tmp_path)
    bcm.initialise()
    for k in range(2):
        bcm.step(k * H, H)
    assert bcm.warnings == bcm.python.warnings and "wheel 2 has no pose yet" in bcm.warnings[0]


def test_sizes_that_hang_on_parameters_may_change_after_the_build(tmp_path):
    pair = Twins(SCM(1), tmp_path, cell=0.02, r_w=0.3, b_w=0.2, max_tiles=5000.0)
    pair.initialise()
    rng, model = np.random.default_rng(3), pair.python.model
    for k in range(50):
        u = some_inputs(model, rng)
        u[2] += 0.17
        pair.send(u)
        pair.step(k * H, H)
        same(pair)
    assert pair.python.y["wheel"]["f_0"][0, 2] > 1.0


def test_parameters_are_fixed_during_a_run_and_unknown_references_are_refused(tmp_path):
    pair = Twins(BCM(1), tmp_path)
    pair.initialise()
    with pytest.raises(SlaveError, match="parameter r_w is fixed: set it before initialisation ends, not during the run"):
        pair.native._set_parameter("r_w", 0.2)
    with pytest.raises(SlaveError, match="step length h = nan s at t = 0 s: it must be finite and not negative"):
        pair.native.step(0.0, float("nan"))


def test_a_restore_that_fails_ends_the_instance_and_not_the_process(tmp_path):
    pair = Twins(RBC(2, 1), tmp_path)
    pair.initialise()
    pair.native.step(0.0, H)
    saved = pair.native.save()
    pair.native._fmu.reset()
    (pair.native._directory / "resources" / "constants.bin").unlink()
    with pytest.raises(SlaveError, match=r"constants.bin is missing"):
        pair.native.restore(saved)
    assert pair.native._do_step(pair.native._component, H, H, 1) == 3  # fmi2Error
    assert "is not allowed after it was terminated" in pair.native._errors[-1]
