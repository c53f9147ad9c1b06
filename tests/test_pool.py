"""Large state beside the records: grown between steps, saved by what changed, restored to the same bits."""

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu
from heaps import Heaps

from cdl_fmu.slave.build import build_fmu
from cdl_fmu.slave.model import Instance, ModelError
from cdl_fmu.slave.pool import RowPool
from cdl_fmu.slave.state import State
from orchestrator.fmu import Slave

H = 0.01


@pytest.fixture
def heaps():
    instance = Instance(Heaps(), rate=3.7)
    instance.initialise()
    return instance


def content(instance) -> bytes:
    """Everything there is, as bytes: what two instances in one state have in common."""
    return instance.save().to_bytes(RowPool)


def advance(instance, steps) -> list[bytes]:
    """Outputs of steps during which one outlet moves on, past a new heap every third step, and one stays."""
    out = []
    for k in steps:
        instance.u.place[:] = k / 3, -1.0
        instance.step(k * H, H)
        out.append(instance.y.tobytes())
    return out


def test_rows_appear_where_they_are_needed_and_keep_their_content(heaps):
    advance(heaps, range(30))
    assert heaps.y.heaps == 11
    rows = heaps.pool.rows[: int(heaps.y.heaps)]
    assert rows.sum() == pytest.approx(2 * 30 * H * 3.7)
    assert len(heaps.pool.rows) == 16  # 2 for a step, doubled as often as needed


def test_a_step_undone_and_retaken_gives_the_same_bits(heaps):
    advance(heaps, range(5))
    saved = heaps.save()
    first, after = advance(heaps, range(5, 40)), content(heaps)
    heaps.restore(saved)
    assert advance(heaps, range(5, 40)) == first and content(heaps) == after


def test_every_older_state_can_be_restored_in_any_order(heaps):
    states = {}
    for k in range(24):
        states[k] = heaps.save(), content(heaps)
        advance(heaps, [k])
    for k in np.random.default_rng(0).permutation(24).tolist() * 2:
        saved, before = states[k]
        heaps.restore(saved)
        assert content(heaps) == before
        advance(heaps, [k, 100 + k])  # away from what was saved


def test_saving_has_no_effect(heaps):
    other = Instance(Heaps(), rate=3.7)
    other.initialise()
    for k in range(12):
        advance(heaps, [k])
        heaps.save()
        advance(other, [k])
    assert content(heaps) == content(other)


def test_rows_that_did_not_change_are_not_copied_again(heaps):
    advance(heaps, range(9))
    first = heaps.save()
    advance(heaps, [9])
    second = heaps.save()
    copied = [r for r, (old, new) in enumerate(zip(first.pool.copies, second.pool.copies)) if old is not new]
    assert len(first.pool.copies) == 4 and len(second.pool.copies) == 5 and copied == [1]  # the heap of the outlet that stays
    heaps.restore(first)
    assert all(a is b for a, b in zip(heaps.save().pool.copies, first.pool.copies))


def test_rows_taken_after_a_restore_are_empty(heaps):
    saved = heaps.save()
    advance(heaps, range(20))
    heaps.restore(saved)
    assert not heaps.pool.rows.any() and not heaps.pool.marks.any()


@pytest.mark.parametrize("steps", [0, 20])
def test_a_state_goes_as_bytes_into_another_instance(heaps, steps):
    advance(heaps, range(steps))
    saved = State.from_bytes(content(heaps), Heaps.pool_class)
    expected = advance(heaps, range(steps, steps + 20))
    for other in Instance(Heaps()), Instance(Heaps(), limit=32):
        other.initialise()
        advance(other, range(70, 80))
        other.restore(saved)
        assert advance(other, range(steps, steps + 20)) == expected
        assert content(other) == content(heaps)


def test_a_state_without_a_pool_goes_as_bytes():
    before = Instance(Heaps(), rate=2.0).save()
    after = State.from_bytes(before.to_bytes(RowPool), RowPool)
    assert after.pool is None and after.block.tobytes() == before.block.tobytes()


def test_initialising_leaves_no_trace_of_the_outputs_evaluation(heaps):
    assert heaps.y.heaps == 1  # both outlets stand at one place
    assert heaps.pool.head.tolist() == [0, 1000]  # as initialise_kernel left it
    assert not heaps.pool.rows.any()


def test_initialising_again_begins_anew_with_the_parameters_as_they_are(heaps):
    advance(heaps, range(20))
    heaps.p.limit = 32
    heaps.initialise()
    assert heaps.pool.limit == 32 and not heaps.pool.rows.any()


def test_a_full_pool_is_the_steps_own_error():
    heaps = Instance(Heaps(), limit=5)
    heaps.initialise()
    with pytest.raises(ModelError, match=r"heaps: outlet 1: no heap is left for its place; raise limit = \d+ \(t = 0\.12 s\)"):
        advance(heaps, range(20))
    assert len(heaps.pool.rows) == 5


def test_constant_arrays_cannot_be_written():
    pool = RowPool((3,), marks=1, head=1, per_step=1, limit=1, extra=(np.ones(2),))
    with pytest.raises(ValueError, match="read-only"):
        pool.arrays[3][0] = 2.0


@pytest.fixture
def slave(tmp_path):
    """Makes initialised slaves of the model's FMU."""
    path = build_fmu(Heaps(), tmp_path / "heaps.fmu", {"rate": 3.7})
    assert validate_fmu(str(path)) == []
    description, folder, made = fmpy.read_model_description(str(path)), fmpy.extract(str(path)), []

    def make():
        one = Slave("heaps", description, folder, print)
        made.append(one)
        one.connect(["place[1]", "place[2]"], np.zeros(2), ["heaps", "mass[1]", "mass[2]"], np.zeros(3))
        one.initialise(0.0, None, {})
        return one

    yield make
    for one in made:
        one.close()


def advance_slave(slave, steps) -> list[bytes]:
    out = []
    for k in steps:
        slave.u[:] = k / 3, -1.0
        slave.set(k * H)
        slave.step(k * H, H)
        slave.get((k + 1) * H)
        out.append(slave.y.tobytes())
    return out


def test_the_fmu_gives_the_bits_of_the_model_and_saves_and_serialises_its_pool(slave, heaps):
    one = slave()
    assert advance_slave(one, range(10)) == advance(heaps, range(10))
    saved, serialised = one.save(), one.to_bytes()
    expected = advance(heaps, range(10, 40))
    assert advance_slave(one, range(10, 40)) == expected
    one.restore(saved)
    assert advance_slave(one, range(10, 40)) == expected
    one.free(saved)
    other = slave()
    other.from_bytes(serialised)
    assert advance_slave(other, range(10, 40)) == expected
