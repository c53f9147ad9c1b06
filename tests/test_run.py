"""Runs: checkpoints, interruptions, failures, and what is refused before the first step."""

import os
import signal
import threading

import numpy as np
import pytest
from systems import rover_on

from cdl_fmu import BCM
from orchestrator.fmu import SlaveError
from orchestrator.results import open_result
from orchestrator.results_soil import Surface
from orchestrator.run import RunError, run


@pytest.fixture
def system(tmp_path):
    return rover_on(tmp_path, BCM(2), start_z=0.104, stop_time=0.2)


def rows(outcome):
    result = open_result(outcome.result)
    return result.time.values, result.series.values


@pytest.mark.parametrize("scheme", ["ij", "gs-mid", "jacobi", "aitken"])
def test_a_resumed_run_gives_the_bits_of_an_uninterrupted_one(scheme, system, tmp_path):
    whole = rows(run(system, tmp_path / "a", scheme=scheme, checkpoint_every=0.08))
    resumed = rows(run(system, tmp_path / "a", scheme=scheme, resume=tmp_path / "a" / "checkpoint_0.080s.npz"))
    for a, b in zip(whole, resumed):
        assert a.tobytes() == b.tobytes()


def test_a_checkpoint_of_another_run_is_refused(system, tmp_path):
    run(system, tmp_path / "a", checkpoint_every=0.1)
    with pytest.raises(RunError, match="written by another run"):
        run(system, tmp_path / "a", scheme="jacobi", resume=tmp_path / "a" / "checkpoint_0.100s.npz")
    with pytest.raises(RunError, match="is no checkpoint, or a damaged one"):
        run(system, tmp_path / "a", resume=tmp_path / "a" / "result.nc")


def test_a_checkpoint_whose_result_was_replaced_is_refused(system, tmp_path):
    checkpoint = run(system, tmp_path / "a", checkpoint_every=0.1).result.with_name("checkpoint_0.100s.npz")
    for other in ({"scheme": "gs-mid"}, {"stop_time": 0.05}):
        run(system, tmp_path / "a", **other)
        with pytest.raises(RunError, match=r"result\.nc is not the result that checkpoint_0\.100s\.npz belongs to: it was replaced"):
            run(system, tmp_path / "a", resume=checkpoint)


def test_a_stop_time_between_steps_is_refused_with_its_neighbours(system, tmp_path):
    with pytest.raises(RunError, match=r"stop time 0\.0105 s is no multiple of the step 0\.001 s; the nearest are 0\.01 s and 0\.011 s"):
        run(system, tmp_path, stop_time=0.0105)
    with pytest.raises(RunError, match=r"step = -0\.001 s: it must be positive"):
        run(system, tmp_path, step=-1e-3)


def test_an_interrupt_leaves_a_readable_result_with_all_steps_so_far(system, tmp_path):
    seen = []

    def progress(t, stop):
        if not seen:
            seen.append(t)
            os.kill(os.getpid(), signal.SIGINT)

    outcome = run(system, tmp_path, stop_time=100.0, progress=progress)
    assert outcome.status == "interrupted" and outcome.simulated_s < 100.0
    result = open_result(outcome.result)
    assert result.attrs["status"] == "interrupted"
    assert result.time.values[-1] == pytest.approx(outcome.simulated_s) and np.isfinite(result.series.values).all()


def test_a_failing_slave_ends_the_run_with_its_name_and_keeps_the_rows(tmp_path):
    # Without gravity's counterpart the rover falls: ground far below, until the wheel meets it too deep in one step.
    system = rover_on(tmp_path, BCM(2), start_z=0.3, stop_time=1.0, c_d=0.0, k_phi=1e3, k_c=0.0)
    with pytest.raises(SlaveError, match=r"contact did not do the step .*wheel 1 is buried.*start it on the ground"):
        run(system, tmp_path / "out")
    result = open_result(tmp_path / "out" / "result.nc")
    assert result.attrs["status"].startswith("failed: contact did not do the step") and 0.1 < result.time.values[-1] < 1.0


def test_runs_work_beside_the_main_thread(system, tmp_path):
    outcomes = []
    worker = threading.Thread(target=lambda: outcomes.append(run(system, tmp_path / "b", stop_time=0.01)))
    worker.start()
    worker.join()
    assert outcomes[0].status == "complete"


def falling_soil(master):
    """Stands for what reads a slave's soil: a plate at the height of the rover's body."""
    z = master.outputs[master.output_index["rover", "body.r_0[3]"]]
    return Surface((0.1, -0.3), 0.1, np.full((3, 2), z))


def bodies_height(outcome):
    result = open_result(outcome.result)
    height = result.cdl["rover.body.r_0[3]"]
    return result.cdl.soil_times, [float(height.sel(time=t, method="nearest")) for t in result.cdl.soil_times], result


def test_soil_is_kept_from_the_start_every_quarter_second_and_at_the_end(system, tmp_path):
    times, heights, result = bodies_height(run(system, tmp_path, stop_time=0.6, soil=falling_soil))
    assert times == pytest.approx([0.0, 0.25, 0.5, 0.6])
    assert [float(result.cdl.soil(t)[0, 0]) for t in times] == pytest.approx(heights, rel=1e-6)


def test_a_run_that_goes_on_from_a_checkpoint_keeps_the_earlier_soil(system, tmp_path):
    _, _, whole = bodies_height(run(system, tmp_path, stop_time=0.6, soil=falling_soil, checkpoint_every=0.3))
    _, _, resumed = bodies_height(
        run(system, tmp_path, stop_time=0.6, soil=falling_soil, resume=tmp_path / "checkpoint_0.300s.npz"),
    )
    assert resumed.drop_attrs().equals(whole.drop_attrs())


def test_a_failing_run_keeps_the_soil_of_its_last_step(tmp_path):
    system = rover_on(tmp_path, BCM(2), start_z=0.3, stop_time=1.0, c_d=0.0, k_phi=1e3, k_c=0.0)
    with pytest.raises(SlaveError):
        run(system, tmp_path / "out", soil=falling_soil)
    result = open_result(tmp_path / "out" / "result.nc")
    assert result.cdl.soil_times[-1] == result.time.values[-1] and result.cdl.soil_times[-1] % 0.25 > 1e-3


def test_soil_that_nothing_touched_yet_is_left_out(system, tmp_path):
    assert open_result(run(system, tmp_path, stop_time=0.01, soil=lambda master: None).result).cdl.soil_times.size == 0
