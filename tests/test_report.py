"""Pictures and summaries from a result file alone."""

import re

import numpy as np
import pytest
from matplotlib.image import imread

from orchestrator.report import figure_8_12, plot, summary, wheels_of
from orchestrator.results import Channel, ResultError, ResultWriter, open_result

UNITS = {"sinkage": "m", "drawbar_pull": "N", "lateral_force": "N", "normal_load": "N", "slip": "1", "slip_angle": "rad"}


def drive(path, names=("front", "rear"), stop=2.0, pull=20.0, ground_z=0.05):
    """A made-up drive at 1 m/s: the front wheel is pulled by ``pull`` x t, the rear one pushed; the peak of the start is 500 N."""
    t = np.arange(round(stop / 1e-2) + 1) * 1e-2
    channels, columns = [], []
    for i, (name, sign) in enumerate(zip(names, (1.0, -1.0)), 1):
        start = np.where(t < 0.05, 500.0, 0.0)
        values = {"sinkage": 0.02 * i + 0 * t, "drawbar_pull": start + sign * pull * t, "lateral_force": sign * 5 + 0 * t}
        for field, value in (values | {"normal_load": 80 + 0 * t, "slip": 0.1 * t, "slip_angle": -0.02 * i + 0 * t}).items():
            channels.append(Channel(f"bcm.diagnostics[{i}].{field}", UNITS[field], field))
            columns.append(value)
        for k, value in enumerate((t + 0.6 * (name == "front"), 0.1 * t, ground_z + 0.1 + 0 * t), 1):
            channels.append(Channel(f"rover.wheel[{i}].r_0[{k}]", "m", "Position"))
            columns.append(value)
    wheels = [{"name": n, "tier": "BCM", "instance": "bcm", "index": i, "rover_index": i} for i, n in enumerate(names, 1)]
    with ResultWriter(path, channels, {"wheels": wheels, "ground_z": ground_z}) as writer:
        for time, row in zip(t, np.column_stack(columns)):
            writer.append(time, row)
    return open_result(path)


@pytest.fixture
def result(tmp_path):
    return drive(tmp_path / "result.nc")


def lines(ax):
    """The curves of an axes, without markers."""
    return [line for line in ax.get_lines() if line.get_linestyle() != "None" and len(line.get_xdata()) > 1]


def texts(ax):
    return [text.get_text() for text in ax.texts]


def test_summary_is_the_mean_over_the_last_half_second(result):
    front, rear = summary(result)
    assert (front["name"], front["tier"]) == ("front", "BCM")
    assert rear["sinkage_m"] == pytest.approx(0.04)
    assert front["z_m"] == pytest.approx(0.1)  # above the undeformed ground, which lies at 0.05 m
    assert front["f_long_N"] == pytest.approx(20 * 1.75)
    assert rear["f_long_N"] == pytest.approx(-20 * 1.75)
    assert (rear["f_lat_N"], rear["f_n_N"]) == (-5.0, 80.0)
    assert (rear["slip"], rear["slip_angle_rad"]) == pytest.approx((0.175, -0.04))


def test_summary_of_a_short_run_is_the_mean_of_all_of_it(tmp_path):
    assert summary(drive(tmp_path / "r.nc", stop=0.1, ground_z=0.0))[0]["z_m"] == pytest.approx(0.1)


def test_figure_shows_forces_and_z_over_the_rear_wheels_x_and_the_trajectories(result):
    fx_front, fx_rear, fy_front, _, _, z_rear, trajectories = figure_8_12({"BxB": result}).axes
    front, rear = wheels_of(result)
    for ax in (fx_front, fx_rear, z_rear):
        assert np.array_equal(lines(ax)[0].get_xdata(), rear.centre("x"))
    assert np.array_equal(lines(fx_front)[0].get_ydata(), front.diagnostic("drawbar_pull"))
    assert lines(z_rear)[0].get_ydata() == pytest.approx(100.0)
    assert (fx_front.get_ylabel(), fy_front.get_ylabel(), z_rear.get_xlabel()) == ("$F_x$ [N]", "$F_y$ [N]", "$x$ of the rear wheel [m]")
    assert texts(fx_front) == ["A", "B", "C", "D", "E"]
    assert texts(trajectories) == ["A", "B", "C", "D", "E"]
    assert [line.get_linestyle() for line in lines(trajectories)] == ["-", "--"]
    assert np.array_equal(lines(trajectories)[0].get_xdata(), front.centre("x"))


def test_only_sections_that_the_rear_wheel_reaches_are_marked(tmp_path):
    axes = figure_8_12({"short": drive(tmp_path / "r.nc", stop=1.0)}).axes
    assert texts(axes[0]) == texts(axes[-1]) == ["A", "B", "C"]


def test_runs_are_overlaid_and_normalised_by_one_of_them_without_its_start(tmp_path, result):
    stronger = drive(tmp_path / "b.nc", pull=40.0)
    figure = figure_8_12({"BxB": stronger, "SxS": result}, normalise_by="SxS")
    other, reference = lines(figure.axes[0])
    assert reference.get_ydata()[-1] == pytest.approx(1.0)  # the 500 N of the start do not count
    assert other.get_ydata()[-1] == pytest.approx(2.0)
    assert reference.get_color() != other.get_color()
    assert re.fullmatch(r"\$F_x\$ / [\d.]+ N", figure.axes[0].get_ylabel())
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["BxB", "SxS"]


def test_a_run_that_ends_at_the_start_cannot_normalise(tmp_path):
    with pytest.raises(ResultError, match=r"the rear wheel of run 'SxS' does not reach x = 0.1 m"):
        figure_8_12({"SxS": drive(tmp_path / "r.nc", stop=0.05)}, normalise_by="SxS")


def test_the_picture_is_wide_enough_to_read(tmp_path, result):
    plot(result).savefig(tmp_path / "figure.png")
    assert imread(tmp_path / "figure.png").shape[1] == 1800


def test_rounding_around_a_constant_does_not_fill_a_panel(tmp_path):
    low, high = figure_8_12({"straight": drive(tmp_path / "r.nc", pull=1e-15, stop=0.04)}).axes[4].get_ylim()
    assert high - low >= 1.0


def test_other_rovers_get_their_wheels_over_time(tmp_path):
    axes = plot(drive(tmp_path / "r.nc", names=("left", "right"))).axes
    assert [ax.get_ylabel() for ax in axes] == ["$F_x$ [N]", "$F_y$ [N]", "$F_z$ [N]", "sinkage [mm]"]
    assert axes[-1].get_xlabel() == "$t$ [s]"
    assert lines(axes[3])[1].get_ydata() == pytest.approx(40.0)


def test_results_without_wheels_or_rows_say_so(tmp_path, result):
    with pytest.raises(ResultError, match=r"names no wheels \(attribute 'wheels'\); plot its channels with `result.cdl\[name\].plot\(\)`"):
        plot(result.assign_attrs(wheels="[]"))
    with pytest.raises(ResultError, match=r"the result has no rows: its run was stopped before"):
        summary(result.isel(time=[]))
    with pytest.raises(ResultError, match=r"no channel 'bcm.diagnostics\[1\].sinkage'"):
        summary(result.isel(channel=slice(1, None)))
