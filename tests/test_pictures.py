"""The chapter's pictures, from made-up results of its three runs."""

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import imread
from systems import rover_on

from cdl_fmu import BCM
from cdl_fmu.frames import axis_rotation
from orchestrator.moment import moment_at, moment_in_row
from orchestrator.pictures import write
from orchestrator.plane_picture import figure_8_4, fit_plane, plane_under
from orchestrator.results import Channel, ResultError, ResultWriter, open_result
from orchestrator.results_soil import Surface
from orchestrator.scene import Scene, direction, lit
from orchestrator.wheels import dimensions_of

SIZE = {"r_w": 0.125, "b_w": 0.125, "n_g": 12.0, "h_g": 0.01, "mass_height": 0.1}
DEPTH, Z = 0.03, 0.1  # [m] of the rut, of the wheels' centres above the undeformed ground
GROUND = 0.5


def rut(x_front):
    """A rut along y = 0 from x = 0.5 m up to the front wheel."""
    x, y = 0.01 * np.arange(32, 240), 0.01 * np.arange(-32, 32)
    inside = (x[:, None] > 0.5) & (x[:, None] < x_front) & (np.abs(y) < 0.08)
    z = np.where((x[:, None] > x_front + 0.3) & (y < -0.1), np.nan, GROUND - DEPTH * inside)  # part of it not known yet
    return Surface((x[0], y[0]), 0.01, z)


def drive(path, tiers, stop=16.0, **attributes):
    """Straight on at 0.125 m/s, a row every 0.05 s, soil every 0.25 s if a wheel is on SCM; a wheel in the rut is lower by its depth."""
    t = 0.05 * np.arange(round(stop / 0.05) + 1)
    x = 0.125 * t
    columns = {"rover.body.yaw": 0 * t, "rover.body.pitch": 0 * t}
    centres = {"body": (x + 0.3, 0.01 * t, GROUND + Z + 0 * t)}
    for i, ahead in ((1, 0.6), (2, 0.0)):
        in_rut = DEPTH * ((x > 0.6) & (i == 2) & ("SCM" in tiers))
        centres[f"wheel[{i}]"] = (x + ahead, 0 * t, GROUND + Z - in_rut)
        for angle, row in zip(t, (T := np.empty((t.size, 3, 3)))):
            row[:] = axis_rotation(2, angle)
        columns |= {f"rover.wheel[{i}].T[{a + 1},{b + 1}]": T[:, a, b] for a in range(3) for b in range(3)}
        for name in ("drawbar_pull", "lateral_force", "sinkage", "normal_load"):
            columns[f"ground.diagnostics[{i}].{name}"] = i + t
    columns |= {f"rover.{part}.r_0[{k + 1}]": values[k] for part, values in centres.items() for k in range(3)}
    wheels = [
        {"name": name, "tier": tier, "instance": "ground", "index": i, "rover_index": i}
        for i, (name, tier) in enumerate(zip(("front", "rear"), tiers), 1)
    ]
    facts = {"wheels": wheels, "ground_z": GROUND, "dimensions": SIZE} | attributes
    with ResultWriter(path, [Channel(name, "1", "") for name in columns], facts) as writer:
        for k, row in enumerate(np.column_stack(list(columns.values()))):
            writer.append(t[k], row)
            if "SCM" in tiers and k % 5 == 0:
                writer.append_soil(t[k], rut(x[k] + 0.6))
    return open_result(path)


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    tiers = {"BxB": ("BCM", "BCM"), "SxB": ("SCM", "BCM"), "SxS": ("SCM", "SCM")}
    return {name: drive(folder / f"{name}.nc", pair) for name, pair in tiers.items()}


NAMES = [f"fig_8_{n}.png" for n in (4, 5, 8, 9, 10, 11, 12)]


def test_seven_pictures_are_written_all_wide_enough_to_read(runs, tmp_path):
    paths = write(runs, tmp_path)
    assert paths == [tmp_path / name for name in NAMES]
    assert {imread(path).shape[1] for path in paths} == {1800}


@pytest.mark.slow
def test_runs_cut_short_are_drawn_as_far_as_they_went(tmp_path):
    short = {name: drive(tmp_path / f"{name}.nc", pair, stop=0.5) for name, pair in (("BxB", ("BCM",) * 2), ("SxB", ("SCM", "BCM")))}
    assert len(write(short | {"SxS": short["SxB"]}, tmp_path)) == len(NAMES)


class TestMoment:
    def test_it_is_the_snapshot_of_the_soil_nearest_to_the_place(self, runs):
        moment = moment_at(runs["SxB"], 0.74)
        assert moment.t == pytest.approx(6.0)  # the next ones are 5.75 s and 6.25 s, at 0.719 m and 0.781 m
        assert moment.wheels["rear"].r_0 == pytest.approx([0.75, 0.0, GROUND + Z - DEPTH])
        assert moment.wheels["front"].tier == "SCM" and moment.wheels["rear"].tier == "BCM"
        assert moment.wheels["rear"].heading == pytest.approx([1.0, 0.0, 0.0])
        assert moment.mass == pytest.approx([1.05, 0.06, GROUND + Z + 0.1])

    def test_without_soil_it_is_the_nearest_row_and_the_ground_is_flat(self, runs):
        moment = moment_at(runs["BxB"], 0.7437)
        assert moment.t == pytest.approx(5.95)
        z = moment.surface((-0.1, 0.2), (0.0, 0.1))
        assert (z.x[0], z.x[-1], z.y[-1]) == pytest.approx((-0.1, 0.2, 0.1)) and (z == GROUND).all()

    def test_infinity_is_the_end(self, runs):
        for run in runs.values():
            assert moment_at(run, np.inf).t == pytest.approx(16.0)

    def test_the_first_row_is_the_start(self, runs):
        assert moment_in_row(runs["SxS"], 0).wheels["rear"].r_0 == pytest.approx([0.0, 0.0, GROUND + Z])

    def test_the_surface_goes_on_beyond_the_map_as_at_its_edge(self, runs):
        z = moment_at(runs["SxS"], 1.2).surface((0.0, 3.0), (-1.0, 1.0))
        assert z.sel(x=1.0, y=0.0, method="nearest") == pytest.approx(GROUND - DEPTH)
        assert (z[0] == GROUND).all() and (z[-1] == GROUND).all() and not z.isnull().any()

    def test_results_that_lack_what_is_drawn_say_what(self, runs, tmp_path):
        with pytest.raises(
            ResultError, match=r"does not tell b_w, h_g, mass_height, n_g, r_w \(attribute 'dimensions'\): run the experiment"
        ):
            moment_at(runs["BxB"].assign_attrs(dimensions="{}"), 0.0)
        other = runs["BxB"].attrs["wheels"].replace("front", "left")
        with pytest.raises(ResultError, match=r"need the wheels front and rear; this result names left, rear"):
            moment_at(runs["BxB"].assign_attrs(wheels=other), 0.0)


def test_dimensions_are_those_of_the_systems_fmus(tmp_path):
    system = rover_on(tmp_path, BCM(2), start_z=0.1, h_g=0.02, rover={"mass_height": 0.3})
    assert dimensions_of(system) == {"r_w": 0.125, "b_w": 0.125, "n_g": 12.0, "h_g": 0.02, "mass_height": 0.3}


class TestPlane:
    def test_in_the_rut_it_is_the_floor(self, runs):
        moment = moment_at(runs["SxB"], 0.75)
        fit = plane_under(moment, moment.wheels["rear"])
        assert fit.found and np.count_nonzero(fit.rays[:, 0]) > 20
        assert fit.normal == pytest.approx([0, 0, 1], abs=1e-6)
        assert fit.foot == pytest.approx([0.75, 0.0, GROUND - DEPTH], abs=1e-6)

    def test_on_a_slope_it_is_the_slope(self):
        x, y = 0.03 * np.arange(-6, 7), 0.03 * np.arange(-4, 5)
        normal = np.array([-0.2, 0.1, 1.0]) / np.linalg.norm([-0.2, 0.1, 1.0])
        z = 0.2 * x[:, None] - 0.1 * y[None, :]
        fit = fit_plane(x, y, z, 0.1 * normal, np.eye(3), SIZE)
        assert fit.normal == pytest.approx(normal)
        assert fit.foot == pytest.approx(np.zeros(3), abs=1e-9)
        assert (fit.sheet @ normal) == pytest.approx(np.zeros(fit.sheet.shape[:2]), abs=1e-9)

    def test_a_wheel_in_the_air_has_none_and_its_picture_says_so(self, tmp_path):
        x, y = 0.03 * np.arange(-6, 7), 0.03 * np.arange(-4, 5)
        fit = fit_plane(x, y, np.zeros((13, 9)), np.array([0.0, 0.0, 0.2]), np.eye(3), SIZE)
        assert not fit.found
        figure = figure_8_4(fit, "lifted")
        assert figure.get_suptitle() == "lifted: 0 of 63 rays hit, no plane"
        figure.savefig(tmp_path / "lifted.png")


class TestScene:
    @staticmethod
    def colour_in_the_middle(scene):
        figure = Figure(figsize=(2, 2), dpi=50)
        canvas = FigureCanvasAgg(figure)
        ax = figure.add_axes((0, 0, 1, 1), projection="3d", computed_zorder=False)
        scene.draw(ax)
        ax.set_axis_off()
        canvas.draw()
        return np.asarray(canvas.buffer_rgba())[50, 50, :3] / 255

    @staticmethod
    def sheet(z):
        x = np.linspace(-1, 1, 11)
        return np.stack([*np.meshgrid(x, x, indexing="ij"), np.full((11, 11), z)], axis=2)

    @pytest.mark.parametrize("order", [(0.5, -0.5), (-0.5, 0.5)])
    def test_the_near_hides_the_far_in_whatever_order_they_come(self, order):
        scene = Scene(60.0, -60.0, [(-1, 1)] * 3)
        for z in order:
            scene.add(self.sheet(z), "#00ff00" if z > 0 else "#ff0000")
        assert self.colour_in_the_middle(scene) == pytest.approx([0, 1, 0], abs=0.02)

    def test_through_what_is_translucent_the_far_is_seen(self):
        scene = Scene(60.0, -60.0, [(-1, 1)] * 3)
        scene.add(self.sheet(-0.5), "#ff0000")
        scene.add(self.sheet(0.5), "#00ff00", opacity=0.5)
        assert self.colour_in_the_middle(scene) == pytest.approx([0.5, 0.5, 0], abs=0.02)

    def test_level_ground_keeps_its_colour_and_flanks_away_from_the_sun_are_darker(self):
        colour, sun = np.array([0.4, 0.5, 0.6]), direction(40.0, 180.0)
        assert lit(colour, np.array([0.0, 0.0, 1.0]), sun) == pytest.approx(colour)
        assert (lit(colour, np.array([0.6, 0.0, 0.8]), sun) < colour).all()
        assert (lit(colour, np.array([-0.6, 0.0, 0.8]), sun) > colour).all()
