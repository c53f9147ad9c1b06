"""Result files: what is read is what was written, whenever and however the run stopped; their difference; their exports."""

import subprocess
import sys

import numpy as np
import pytest
import xarray as xr
from fmpy.util import read_csv
from scipy.io import loadmat

from orchestrator.export import to_csv, to_mat
from orchestrator.results import BLOCK, Channel, ResultError, ResultWriter, open_result
from orchestrator.results_diff import diff_results
from orchestrator.results_soil import Surface

CHANNELS = [
    Channel("front.f_0[3]", "N", "Contact force on the wheel"),
    Channel("front.T[1,2]", "1", "Rotation, µ"),
    Channel("rover.wheel[1].r_0[1]", "m", "Position of the wheel's centre"),
]


def rows(n):
    """n rows with values that only survive in float64."""
    t = np.arange(n) * 1e-3
    return t, np.column_stack([80 + np.sin(t) / 3, np.full(n, 1 / 3), 0.12 * t])


def write(path, n=2 * BLOCK + 500, **attributes):
    with ResultWriter(path, CHANNELS, attributes) as writer:
        for t, row in zip(*rows(n)):
            writer.append(t, row)
    return open_result(path)


@pytest.fixture
def result(tmp_path):
    return write(tmp_path / "result.nc")


def test_reads_back_the_same_bits_by_name_and_by_any_netcdf_tool(tmp_path, result):
    t, values = rows(2 * BLOCK + 500)
    assert np.array_equal(result.time, t)
    assert np.array_equal(result.cdl["front.f_0[3]"], values[:, 0])
    assert result.cdl["front.f_0[3]"].attrs == {"units": "N", "long_name": "Contact force on the wheel"}
    assert list(result.cdl) == [c.name for c in CHANNELS]
    with xr.open_dataset(tmp_path / "result.nc") as plain:  # no decoding of seconds to dates
        assert plain.time.dtype == float
        assert plain.series.sel(channel="front.T[1,2]").unit.item() == "1"
    assert open_result(tmp_path).equals(result)  # a run's folder stands for the result in it


def test_attributes_keep_text_of_any_length_and_structure(tmp_path):
    experiment = "[rover]\nname = 'Rö'\n" * 10_000
    attrs = write(tmp_path / "a.nc", experiment=experiment, step=1e-3, wheels=[{"name": "front"}]).attrs
    assert attrs["experiment"] == experiment
    assert attrs["step"] == 1e-3
    assert attrs["wheels"] == '[{"name": "front"}]'
    assert attrs["status"] == "complete"


@pytest.mark.parametrize(
    ("error", "status"), [(KeyboardInterrupt(), "interrupted"), (ValueError("bcm: NaN at t = 0.1 s"), "failed: bcm: NaN at t = 0.1 s")]
)
def test_a_stopped_run_keeps_every_step_and_says_how_it_ended(tmp_path, error, status):
    with pytest.raises(type(error)), ResultWriter(tmp_path / "r.nc", CHANNELS, {}) as writer:
        for t, row in zip(*rows(BLOCK + 7)):
            writer.append(t, row)
        raise error
    result = open_result(tmp_path / "r.nc")
    assert result.sizes["time"] == BLOCK + 7
    assert result.attrs["status"] == status


KILLED = """
import sys
import numpy as np
from orchestrator.results import Channel, ResultWriter
writer = ResultWriter(sys.argv[1], [Channel(f"x[{i}]", "N", "") for i in range(50)], {})
for k in range(10**9):
    writer.append(k * 1e-3, np.full(50, float(k)))
    if k == 3500:
        print("on the way", flush=True)
"""


def test_a_killed_run_leaves_all_blocks_written_so_far(tmp_path):
    path = tmp_path / "killed.nc"
    process = subprocess.Popen([sys.executable, "-c", KILLED, str(path)], stdout=subprocess.PIPE)
    process.stdout.readline()
    with pytest.raises(ResultError, match=r"killed.nc is still being written by a run; read it when the run has ended"):
        open_result(path)
    with pytest.raises(ResultError, match=r"killed.nc is being written by another run; wait for its end or choose another folder"):
        ResultWriter(path, CHANNELS, {})
    process.kill()
    process.wait()
    process.stdout.close()
    result = open_result(path)
    n = result.sizes["time"]
    assert n >= 3 * BLOCK
    assert n % BLOCK == 0
    assert np.array_equal(result.cdl["x[49]"], np.arange(n))
    assert result.attrs["status"] == "running"


KILLED_ON_SOIL = """
import os, sys
import numpy as np
from orchestrator.results import BLOCK, Channel, ResultWriter
from orchestrator.results_soil import Surface
writer = ResultWriter(sys.argv[1], [Channel("x", "N", "")], {})
for k in range(3 * BLOCK + 400):
    writer.append(k * 1e-3, np.zeros(1))
    if k % 500 == 0:
        writer.append_soil(k * 1e-3, Surface((0.0, 0.0), 0.01, np.full((50, 40), k * 1e-3)))
os._exit(9)
"""


def test_a_wrong_name_is_answered_with_the_nearest(result):
    with pytest.raises(ResultError, match=r"no channel 'front.f_0\[4\]'; the nearest of its 3 are front.f_0\[3\], front.T\[1,2\]"):
        result.cdl["front.f_0[4]"]


def test_what_is_no_result_is_refused_by_name(tmp_path):
    with pytest.raises(ResultError, match=r"gone.nc does not exist; `cdl run` writes one"):
        open_result(tmp_path / "gone.nc")
    (tmp_path / "text.nc").write_text("no netCDF")
    with pytest.raises(ResultError, match=r"text.nc cannot be read as netCDF-4"):
        open_result(tmp_path / "text.nc")
    xr.Dataset({"height": ("x", [0.0])}).to_netcdf(tmp_path / "other.nc", engine="h5netcdf")
    with pytest.raises(ResultError, match=r"other.nc is no result of `cdl run`: it has no variable 'series'; it has \['height'\]"):
        open_result(tmp_path / "other.nc")


SPACING = 0.01


def surface(i0, j0, z):
    """Heights on nodes from (i0, j0) on."""
    return Surface((SPACING * i0, SPACING * j0), SPACING, z)


def rut(n):
    """Surfaces at 0, 0.25, ... s: a map on negative nodes too that grows on all sides while its heights change here and there."""
    surfaces = []
    for k in range(n):
        x, y = np.meshgrid(np.arange(-16 - 4 * k, 32 + 16 * k), np.arange(-16 - 2 * k, 16 + 3 * k), indexing="ij")
        z = np.where((x < 16 * k) & (np.abs(y) < 6), -0.02 - 1e-4 * x, 1e-3 * np.sin(0.3 * x))
        z[x > 40 + 4 * k] = np.nan  # not known yet
        surfaces.append(surface(x[0, 0], y[0, 0], z))
    return {0.25 * k: z for k, z in enumerate(surfaces)}


class TestSoil:
    @staticmethod
    def write(path, surfaces):
        with ResultWriter(path, CHANNELS, {}) as writer:
            for t, z in surfaces.items():
                writer.append(t, np.zeros(3))
                writer.append_soil(t, z)
                if t % 0.5:
                    writer.flush()
        return open_result(path)

    @pytest.fixture
    def result(self, tmp_path):
        return self.write(tmp_path / "result.nc", rut(5))

    def test_every_snapshot_reads_back_as_a_map_in_world_coordinates(self, result):
        assert result.cdl.soil_times.tolist() == [0.0, 0.25, 0.5, 0.75, 1.0]
        for t, (origin, spacing, z) in rut(5).items():
            read = result.cdl.soil(t)
            assert read.dims == ("x", "y")
            assert read.x.values == pytest.approx(origin[0] + spacing * np.arange(z.shape[0]), abs=1e-12)
            assert read.y.values == pytest.approx(origin[1] + spacing * np.arange(z.shape[1]), abs=1e-12)
            assert read.values == pytest.approx(z, abs=1e-8, nan_ok=True)
            assert read.attrs == {"units": "m", "long_name": "soil surface", "time": t}

    def test_between_two_snapshots_the_earlier_one_holds(self, result):
        assert result.cdl.soil(0.7499).equals(result.cdl.soil(0.5))
        assert result.cdl.soil(100.0).equals(result.cdl.soil(1.0))
        assert result.cdl.soil(0.25 * (1 - 1e-12)).attrs["time"] == 0.25  # a time is a sum of steps

    def test_a_map_that_moves_on_and_comes_back_has_its_latest_heights(self, tmp_path):
        places = {0.0: (0, 1.0), 1.0: (100, 2.0), 2.0: (0, 1.5)}
        result = self.write(tmp_path / "r.nc", {t: surface(i, 0, np.full((4, 4), z)) for t, (i, z) in places.items()})
        assert (result.cdl.soil(0.0) == 1.0).all() and (result.cdl.soil(1.0) == 2.0).all() and (result.cdl.soil(2.0) == 1.5).all()

    def test_only_what_changed_takes_space(self, tmp_path):
        flat = np.zeros((300, 100))
        flat[:, 50:] = np.nan
        dented = flat.copy()
        dented[7, 9] = -0.01
        result = self.write(tmp_path / "r.nc", {t: surface(0, 0, z) for t, z in ((0.0, flat), (0.25, flat), (0.5, dented))})
        assert result.sizes["node"] == 300 * 50 + 1
        assert result.cdl.soil(0.5)[7, 9] == pytest.approx(-0.01)

    def test_a_time_that_has_a_snapshot_keeps_it(self, tmp_path):
        with ResultWriter(tmp_path / "r.nc", CHANNELS, {}) as writer:
            writer.append_soil(0.0, surface(0, 0, np.zeros((2, 2))))
            writer.append_soil(0.0, surface(0, 0, np.ones((2, 2))))
        result = open_result(tmp_path / "r.nc")
        assert result.cdl.soil_times.tolist() == [0.0] and (result.cdl.soil(0.0) == 0.0).all()

    def test_a_killed_run_leaves_the_snapshots_of_all_blocks_written_so_far(self, tmp_path):
        process = subprocess.run([sys.executable, "-c", KILLED_ON_SOIL, str(tmp_path / "killed.nc")])
        assert process.returncode == 9
        result = open_result(tmp_path / "killed.nc")
        assert result.cdl.soil_times.tolist() == [0.0, 0.5, 1.0, 1.5, 2.0, 2.5]
        assert np.array_equal(result.cdl.soil(2.5), np.full((50, 40), 2.5))

    def test_results_without_soil_and_times_before_the_first_map_say_so(self, result, tmp_path):
        flat = write(tmp_path / "flat.nc", n=3)
        assert flat.cdl.soil_times.size == 0
        with pytest.raises(
            ResultError, match=r"the result has no soil map: none of its wheels ran on soil that deforms; run it with tier SCM"
        ):
            flat.cdl.soil(0.0)
        with pytest.raises(ResultError, match=r"no soil map at t = -1 s: the result's first is of t = 0 s; ask for a later time"):
            result.cdl.soil(-1.0)

    def test_diff_and_exports_take_results_with_soil(self, result, tmp_path):
        assert diff_results(result, result.copy(deep=True), rtol=0.0) is None
        to_csv(result, tmp_path / "r.csv")
        to_mat(result, tmp_path / "r.mat")
        assert len(read_csv(tmp_path / "r.csv")) == loadmat(tmp_path / "r.mat")["data_2"].shape[1] == 5


class TestDiff:
    def test_equal_results_do_not_differ_and_nan_equals_nan(self, result):
        for value in (np.nan, np.inf):
            result.series[7, 0] = value
            assert diff_results(result.copy(deep=True), result, rtol=0.0) is None

    def test_names_the_earliest_signal_time_values_and_unit(self, result):
        other = result.copy(deep=True)
        other.series[1200, 2] += 1e-3
        other.series[900, 0] = 90.0
        difference = diff_results(other, result, rtol=1e-6)
        assert (difference.signal, difference.time) == ("front.f_0[3]", 0.9)
        assert str(difference).startswith("front.f_0[3] at t = 0.9 s: 90 N in the result, 80.26110896")
        assert "the relative difference is 0.121 of the signal's largest magnitude, 80.3333 N (allowed: rtol 1e-06, atol 0 N)" in str(
            difference
        )

    def test_at_one_time_the_baselines_first_channel_counts(self, result):
        other = result.copy(deep=True)
        other.series[900] += 1.0
        assert diff_results(other.isel(channel=[2, 1, 0]), result, rtol=1e-6).signal == "front.f_0[3]"

    def test_relative_to_the_signals_largest_magnitude_so_that_zero_crossings_pass(self, result):
        other = result.copy(deep=True)
        largest = float(result.cdl["rover.wheel[1].r_0[1]"][-1])
        other.series[0, 2] += 0.9e-6 * largest  # the signal is zero here
        assert diff_results(other, result, rtol=1e-6) is None
        assert diff_results(other, result, rtol=0.8e-6).time == 0.0
        assert diff_results(other, result, rtol=0.0, atol=1e-6 * largest) is None

    def test_zero_tolerance_sees_the_last_bit_and_nan_is_near_nothing(self, result):
        other = result.copy(deep=True)
        other.series[3, 0] = np.nextafter(other.series[3, 0], np.inf)
        assert diff_results(other, result, rtol=0.0).time == 0.003
        other.series[1, 0] = np.nan
        assert "nan N in the result" in str(diff_results(other, result, rtol=1.0))

    def test_a_baseline_of_zeros_is_said_to_be_one(self, result):
        result.series[:, 1] = 0.0
        other = result.copy(deep=True)
        other.series[5, 1] = 0.5
        assert str(diff_results(other, result, rtol=1e-6)) == (
            "front.T[1,2] at t = 0.005 s: 0.5 in the result, 0 in the baseline, zero throughout (allowed: rtol 1e-06, atol 0)"
        )

    def test_missing_signals_and_units(self, result):
        assert diff_results(result, result.isel(channel=[0, 2]), rtol=0.0) is None
        missing = diff_results(result.isel(channel=[0, 2]), result, rtol=1.0)
        assert str(missing) == "front.T[1,2]: missing in the result, present in the baseline"
        other = result.assign_coords(unit=("channel", ["kN", "1", "m"]))
        assert str(diff_results(other, result, rtol=1.0)) == "front.f_0[3]: unit 'kN' in the result, 'N' in the baseline"

    def test_grids_that_part(self, result):
        short = result.isel(time=slice(0, 2000))
        assert str(diff_results(short, result, rtol=0.0)) == (
            "time: the grids differ after t = 1.999 s: in the result it ends there, in the baseline the next time is 2 s"
        )
        assert diff_results(result.isel(time=slice(None, None, 2)), result, rtol=0.0).time == 0.001
        assert diff_results(result.assign_coords(time=result.time + 1e-12), result, rtol=0.0) is None
        short = short.copy(deep=True)
        short.series[1000, 0] += 1.0
        assert diff_results(short, result, rtol=1e-6).time == 1.0  # what differs first is told, not how the run ended


class TestExport:
    def test_csv_reads_back_in_fmpy_to_the_same_bits(self, tmp_path, result):
        to_csv(result, tmp_path / "r.csv")
        assert (tmp_path / "r.csv").read_text().splitlines()[0] == '"time","front.f_0[3]","front.T[1][2]","rover.wheel[1].r_0[1]"'
        table = read_csv(tmp_path / "r.csv")
        assert table.dtype.names == ("time", "front.f_0[3]", "front.T[1][2]", "rover.wheel[1].r_0[1]")
        assert np.array_equal(table["time"], result.time)
        assert np.array_equal(table["front.T[1][2]"], result.cdl["front.T[1,2]"])

    def test_mat_is_a_transposed_trajectory_as_dymola_and_openmodelica_read_it(self, tmp_path, result):
        to_mat(result, tmp_path / "r.mat")
        mat = loadmat(tmp_path / "r.mat", chars_as_strings=False)
        kind = ["".join(line).rstrip() for line in mat["Aclass"]]
        assert kind == ["Atrajectory", "1.1", "", "binTrans"]
        assert mat["Aclass"].shape == (4, 11)
        # binTrans: a variable is a column of name, description and dataInfo, and a row of data_2.
        names = ["".join(column).rstrip() for column in mat["name"].T]
        descriptions = [bytes(map(ord, column)).decode().rstrip() for column in mat["description"].T]
        assert names == ["time", *result.cdl]
        assert descriptions[1:3] == ["Contact force on the wheel [N]", "Rotation, µ [1]"]
        for name in result.cdl:
            matrix, row, _, _ = mat["dataInfo"][:, names.index(name)]
            assert matrix == 2
            assert np.array_equal(mat["data_2"][row - 1], result.cdl[name])
        assert list(mat["dataInfo"][:, 0]) == [0, 1, 0, -1]
        assert np.array_equal(mat["data_2"][0], result.time)
        assert np.array_equal(mat["data_1"], [[result.time[0], result.time[-1]]])

    def test_mat_has_the_matrices_in_the_order_and_types_that_openmodelica_demands(self, tmp_path, result):
        to_mat(result, tmp_path / "r.mat")
        data = (tmp_path / "r.mat").read_bytes()
        found, at = [], 0
        while at < len(data):
            kind, n_rows, n_columns, imaginary, length = np.frombuffer(data, "<i4", 5, at)
            found.append((data[at + 20 : at + 20 + length].rstrip(b"\0").decode(), int(kind), int(imaginary)))
            at += 20 + length + n_rows * n_columns * {51: 1, 20: 4, 0: 8}[kind]
        assert found == [
            ("Aclass", 51, 0),
            ("name", 51, 0),
            ("description", 51, 0),
            ("dataInfo", 20, 0),
            ("data_1", 0, 0),
            ("data_2", 0, 0),
        ]
