"""What people look at of particles: stress, VTK files, a still, checkpoints of their slave, and how a slow run comes along."""

import re
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest
from systems import rover_on

from cdl_fmu import BCM, Instance
from cdl_fmu.dem import DEM
from cdl_fmu.dem.bed import BedKey
from cdl_fmu.dem.bed_files import write_bed
from cdl_fmu.dem.material import Material
from cdl_fmu.dem.particles import V_X, M, R, X
from cdl_fmu.dem.pool import GrainPool
from cdl_fmu.dem.settle import settle
from cdl_fmu.dem.simulation import Simulation, Tool
from cdl_fmu.dem.sizes import Uniform
from cdl_fmu.dem.snapshot import of_saved, of_simulation
from cdl_fmu.dem.stress import average, coordination, grid_around, moments, pressure
from cdl_fmu.dem.vtk import COLLECTION, add_simulation
from cdl_fmu.slave.model import ModelError
from cdl_fmu.slave.state import State
from orchestrator import simulate, terminal
from orchestrator.particles import Film, film_of
from orchestrator.particles_picture import particles_picture
from orchestrator.run import RunError, run

D, G = 0.01, 9.81
KEY = BedKey(Material(), Uniform(0.009, 0.011), porosity=0.40, depth=0.1, size=(0.08, 0.08), seed=3)
GUID = "a-guid"


@pytest.fixture(scope="module")
def bed():
    return settle(KEY)


@pytest.fixture(scope="module")
def at_rest(bed):
    simulation = bed.simulation()
    simulation.step(simulation.dt)
    return of_simulation(simulation)


# -- stress


def test_forces_of_pairs_bear_each_particle_at_rest(bed, at_rest):
    n = len(at_rest.bodies)
    left = np.zeros((n, 3))
    np.add.at(left, at_rest.a, at_rest.force)
    np.add.at(left, at_rest.b, -at_rest.force)
    left[:, 2] -= at_rest.bodies[:, M] * G
    above_floor = at_rest.bodies[:, X + 2] - at_rest.bodies[:, R] > bed.floor + 1e-4
    mean = np.linalg.norm(at_rest.force, axis=1).mean()
    assert np.linalg.norm(left[above_floor], axis=1).mean() < 2e-3 * mean
    assert coordination(at_rest)[above_floor].mean() > 4.0


def test_vertical_stress_is_the_weight_above_and_stress_at_rest_is_symmetric(bed, at_rest):
    grid = grid_around(at_rest, 1.6 * D)
    means = average(at_rest, grid)
    area = np.prod(bed.periods)
    layers = means.stress.mean(axis=(0, 1))
    middles = grid.origin[2] + (np.arange(grid.shape[2]) + 0.5) * grid.spacing[2]
    inner = (middles > bed.floor + 2.0 * D) & (middles < -1.5 * D)
    assert inner.sum() >= 3
    for z, stress in zip(middles[inner], layers[inner]):
        weight = G * at_rest.bodies[at_rest.bodies[:, X + 2] > z, M].sum() / area
        assert stress[2, 2] == pytest.approx(weight, rel=0.05)
        assert abs(stress - stress.T).max() < 0.03 * stress[2, 2]
    # Along x and y it is the same but for chance, and without side there is no shear.
    bulk = layers[inner].mean(axis=0)
    assert bulk[0, 0] == pytest.approx(bulk[1, 1], rel=0.15)
    assert max(abs(bulk[0, 1]), abs(bulk[0, 2]), abs(bulk[1, 2])) < 0.12 * bulk[2, 2]
    assert means.solid.mean(axis=(0, 1))[inner] == pytest.approx(1.0 - bed.porosity, rel=0.05)


def test_sums_over_cells_are_those_over_contacts_and_particles_to_rounding(at_rest):
    grid = grid_around(at_rest)
    means = average(at_rest, grid)
    exact = np.einsum("mi,mj->ij", at_rest.force, at_rest.branch)
    assert (means.stress.sum(axis=(0, 1, 2)) * grid.volume).ravel() == pytest.approx(exact.ravel(), abs=1e-12 * abs(exact).max())
    assert moments(at_rest).sum(axis=0).ravel() == pytest.approx(exact.ravel(), abs=1e-12 * abs(exact).max())
    volumes = 4.0 / 3.0 * np.pi * at_rest.bodies[:, R] ** 3
    assert means.solid.sum() * grid.volume == pytest.approx(volumes.sum(), rel=1e-12)
    assert pressure(at_rest) @ volumes == pytest.approx(np.trace(exact) / 3.0, rel=1e-12)


def test_two_spheres_pressed_together_have_their_force_over_their_area():
    material, r, overlap = Material(mu=0.0), 5e-3, 5e-5
    centres = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 2.0 * r - overlap]])
    simulation = Simulation(centres, np.full(2, r), material, gravity=(0.0, 0.0, 0.0))
    simulation.step(1e-9)
    seen = of_simulation(simulation)
    force = 4.0 / 3.0 * material.E / (2.0 * (1.0 - material.nu**2)) * np.sqrt(0.5 * r) * overlap**1.5  # Hertz
    upper = seen.a if seen.bodies[seen.a[0], X + 2] > r else seen.b
    assert abs(seen.force[0, 2]) == pytest.approx(force, rel=1e-4)
    assert moments(seen)[upper[0], 2, 2] == pytest.approx(force * (r - 0.5 * overlap), rel=1e-4)  # positive: compression
    simulation.bodies[:, V_X] = 0.25
    grid = grid_around(of_simulation(simulation), 0.05)
    means = average(of_simulation(simulation), grid)
    filled = means.solid > 0.0
    assert means.velocity[filled][:, 0] == pytest.approx(0.25) and not means.velocity[~filled].any()
    with pytest.raises(ModelError, match=r"spacing = 0\.005 m of cells: at least the diameter of the largest particle is needed, 0\.01 m"):
        grid_around(seen, 0.005)


# -- VTK files


def arrays_in(path):
    """Arrays of a VTK file by name, read as the format says: raw, each after its length in bytes."""
    data = path.read_bytes()
    head, _, raw = data.partition(b'<AppendedData encoding="raw">\n_')
    kinds = {"Float64": "f8", "Int64": "i8", "Int32": "i4", "UInt8": "u1"}
    found = {}
    for tag in re.findall(rb"<DataArray ([^>]*)/>", head):
        said = dict(re.findall(r'(\w+)="([^"]*)"', tag.decode()))
        at = int(said["offset"])
        size = int.from_bytes(raw[at : at + 8], "little")
        values = np.frombuffer(raw[at + 8 : at + 8 + size], kinds[said["type"]])
        found[said["Name"]] = values.reshape(-1, int(said["NumberOfComponents"])) if said["NumberOfComponents"] != "1" else values
    return head.decode(), found


def listed(folder):
    return [(float(e.get("timestep")), e.get("file")) for e in ElementTree.parse(folder / COLLECTION).iter("DataSet")]


def test_a_simulation_becomes_files_that_one_collection_lists_by_time(bed, tmp_path):
    wheel = Tool(KEY.material, wheel=(0.03, 0.04, 6.0, 0.005, 0.002), r_0=np.array([0.04, 0.04, 0.06]))
    simulation = bed.simulation([wheel])
    add_simulation(tmp_path, simulation)  # no contact is known yet
    for _ in range(2):
        simulation.step(1e-3)
        add_simulation(tmp_path, simulation)
    names = ("particles_{}.vtu", "stress_{}.vti", "tools_{}.vtu")
    expected = [(t, name.format(f"{k:04d}")) for k, t in enumerate((0.0, 1e-3, 2e-3)) for name in names]
    assert [name for _, name in listed(tmp_path)] == [name for _, name in expected]
    assert [t for t, _ in listed(tmp_path)] == pytest.approx([t for t, _ in expected])
    seen = of_simulation(simulation)
    head, particles = arrays_in(tmp_path / "particles_0002.vtu")
    assert f'NumberOfPoints="{len(seen.bodies)}"' in head
    assert np.array_equal(particles["points"], seen.bodies[:, X : X + 3]) and np.array_equal(particles["radius"], seen.bodies[:, R])
    assert np.array_equal(particles["ident"], seen.ident) and np.array_equal(particles["velocity"], seen.bodies[:, V_X : V_X + 3])
    assert np.array_equal(particles["pressure"], pressure(seen)) and (particles["free"] == 1).all()
    assert np.array_equal(particles["coordination"], coordination(seen))
    grid = grid_around(seen)
    head, cells = arrays_in(tmp_path / "stress_0002.vti")
    assert f'WholeExtent="0 {grid.shape[0]} 0 {grid.shape[1]} 0 {grid.shape[2]}"' in head and "float64" not in head
    first_x = average(seen, grid).stress[..., 2, 2].ravel(order="F")  # VTK counts along x first
    assert np.array_equal(cells["stress_zz"], first_x)
    _, tools = arrays_in(tmp_path / "tools_0002.vtu")
    away = tools["points"] - wheel.r_0
    assert np.hypot(away[:, 0], away[:, 2]).max() == pytest.approx(0.035, rel=0.01) and abs(away[:, 1]).max() == pytest.approx(0.02)


def test_a_run_that_starts_again_or_goes_on_replaces_what_is_later(bed, tmp_path):
    first, again = bed.simulation(), bed.simulation()
    for _ in range(3):
        first.step(1e-3)
        add_simulation(tmp_path, first)
    again.step(2e-3)
    add_simulation(tmp_path, again)
    assert [t for t, name in listed(tmp_path) if name.startswith("particles")] == pytest.approx([1e-3, 2e-3])
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted([COLLECTION, *(name for _, name in listed(tmp_path))])


# -- the slave: its particles, its checkpoints


@pytest.fixture(scope="module")
def bed_file(bed, tmp_path_factory):
    path = tmp_path_factory.mktemp("bed") / "bed.npz"
    write_bed(bed, path)
    return path


def slave_on(bed_file):
    sizes = dict(r_w=0.03, b_w=0.03, n_g=0.0, box_length=0.06, box_width=0.06, depth=0.1, d=D)
    return Instance(DEM(1), "dem", grains="given", bed=str(bed_file), **sizes)


def drive(slave, first, last):
    """A wheel that is pressed into the soil and then rolls along x."""
    h, wheel = 1e-3, slave.u["wheel"][0]
    for k in range(first, last):
        angle = max(k - 20, 0) * 0.02
        c, s = np.cos(angle), np.sin(angle)
        wheel["r_0"][:] = 0.03 * angle, 0.0, 0.038 - 5e-4 * min(k, 20)
        wheel["T"][:] = [[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]]
        slave.step(k * h, h)


@pytest.fixture(scope="module")
def driven(bed_file):
    slave = slave_on(bed_file)
    slave.initialise()
    drive(slave, 0, 40)
    return slave


@pytest.mark.parametrize("after", [1, 25])
def test_a_slave_goes_on_from_bytes_in_another_process_with_the_same_bits(bed_file, after):
    first = slave_on(bed_file)
    first.initialise()
    drive(first, 0, after)
    data = first.save().to_bytes(GrainPool)
    drive(first, after, after + 15)
    second = slave_on(bed_file)
    second.initialise()
    second.restore(State.from_bytes(data, GrainPool))
    drive(second, after, after + 15)
    assert first.y.tobytes() == second.y.tobytes() and np.array_equal(first.pool.live, second.pool.live)
    assert after == 1 or first.y["wheel"][0]["f_0"][2] > 1.0
    assert len(data) < 400 * len(first.pool.live)  # bytes a particle: what a checkpoint weighs before it is compressed


def test_what_a_slave_saved_has_live_and_stored_particles_with_all_their_contacts(driven):
    saved = driven.pool.save()
    seen = of_saved(saved)
    assert len(seen.bodies) >= len(driven.pool.live) and len(np.unique(seen.ident)) == len(seen.ident)
    pairs = np.sort(seen.ident[np.stack([seen.a, seen.b], axis=1)], axis=1)
    assert len(np.unique(pairs, axis=0)) == len(pairs)
    # Those that are held bear their weight by contacts that no kernel looks at now.
    inside = (abs(seen.bodies[:, X]) < 0.1) & (abs(seen.bodies[:, X + 1]) < 0.06) & (abs(seen.bodies[:, X + 2] + 0.05) < 0.025)
    held = inside & (seen.bodies[:, 11] == 0.0)
    assert held.sum() > 20 and coordination(seen)[held].mean() > 4.0
    # Before the first step nothing is there.
    empty = of_saved(slave_before_its_first_step(driven).pool.save())
    assert len(empty.bodies) == len(empty.a) == 0


def slave_before_its_first_step(like):
    slave = slave_on(like.files["bed"])
    slave.initialise()
    return slave


def system_of(identifier, **parameters):
    starts = dict(r_w=0.125, b_w=0.125, n_g=12.0, h_g=0.01, t_g=0.002, wheel_mesh="")
    variables = [SimpleNamespace(name=name, start=str(start)) for name, start in starts.items()]
    description = SimpleNamespace(modelName=identifier, guid=GUID, modelVariables=variables)
    return SimpleNamespace(components={"dem": SimpleNamespace(name="dem", model_description=description, parameters=parameters)})


def master_of(slave):
    return SimpleNamespace(slaves=[SimpleNamespace(name="dem", to_bytes=lambda: GUID.encode() + slave.save().to_bytes(GrainPool))])


def test_a_film_of_a_slave_writes_its_particles_and_its_wheel(driven, tmp_path):
    film = film_of(system_of("cdl_dem_w1", r_w=0.03, b_w=0.03, n_g=0.0), tmp_path / "particles")
    film(0.0, master_of(slave_before_its_first_step(driven)))
    assert listed(tmp_path / "particles") == [] and film.last is None
    film(0.04, master_of(driven))
    assert {t for t, _ in listed(tmp_path / "particles")} == {0.04}
    _, particles = arrays_in(tmp_path / "particles" / "particles_0000.vtu")
    assert len(particles["radius"]) == len(film.last.radii) and set(particles["free"]) == {0, 1}
    _, tools = arrays_in(tmp_path / "particles" / "tools_0000.vtu")
    wheel = driven.u["wheel"][0]["r_0"]
    assert tools["points"].mean(axis=0) == pytest.approx(wheel, abs=1e-3)
    (seen,) = film.last.wheels
    assert seen.centre == pytest.approx(wheel) and seen.axle == pytest.approx([0.0, 1.0, 0.0])
    # Soil just below the wheel is stressed, and moves.
    upper = film.last.centres[:, 2] > -0.04
    below = upper & (abs(film.last.centres[:, :2] - wheel[:2]) < 0.02).all(axis=1)
    assert film.last.pressures[below].mean() > 2.0 * film.last.pressures[upper & ~below].mean()
    assert film.last.speeds[below].mean() > 2.0 * film.last.speeds[upper & ~below].mean()


def test_a_still_shows_the_particles_behind_the_wheels_middle_plane_true_to_scale(driven):
    film = Film(next(iter(system_of("cdl_dem_w1p1", r_w=0.03, b_w=0.03, n_g=0.0).components.values())), None)
    film(0.04, master_of(driven))
    figure = particles_picture(film.last)
    speeds, stress = (ax for ax in figure.axes if ax.get_ylabel() == "z [m]")
    for ax, values in ((speeds, film.last.speeds / 1e-3), (stress, film.last.pressures / 1e3)):
        wheel, particles = ax.collections
        assert ax.get_aspect() == 1.0 and ax.get_xlim() == pytest.approx((-0.066, 0.066), rel=0.01)
        centre, (along, z) = film.last.wheels[0].centre, particles.get_offsets().T
        away = film.last.centres - centre
        candidates = np.flatnonzero((away[:, 1] >= 0.0) & (away[:, 1] < 2.5 * 0.011))
        rows = [candidates[np.argmin(np.hypot(away[candidates, 0] - s, film.last.centres[candidates, 2] - h))] for s, h in zip(along, z)]
        assert len(set(rows)) == len(rows) > 50 and along == pytest.approx(away[rows, 0], abs=1e-12)
        assert (np.diff(away[rows, 1]) <= 0.0).all()  # the near ones last
        assert np.array_equal(particles.get_array(), values[rows])
    assert figure.get_suptitle() == "particles in the middle plane of the wheel, t = 0.04 s"


# -- runs


def test_a_run_looks_at_its_particles_at_its_start_after_its_first_step_at_intervals_and_at_its_end(tmp_path):
    system, times = rover_on(tmp_path, BCM(2), start_z=0.104, stop_time=0.05), []
    run(system, tmp_path / "a", particles=lambda t, master: times.append(t), particles_every=0.02, checkpoint_every=0.025)
    assert times == pytest.approx([0.0, 0.001, 0.02, 0.04, 0.05])
    times.clear()
    checkpoint = tmp_path / "a" / "checkpoint_0.025s.npz"
    run(system, tmp_path / "a", particles=lambda t, master: times.append(t), particles_every=0.02, resume=checkpoint)
    assert times == pytest.approx([0.025, 0.04, 0.05])
    times.clear()
    run(system, tmp_path / "a", particles=lambda t, master: times.append(t))
    assert times == pytest.approx([0.05])
    with pytest.raises(RunError, match=r"interval of particles 0\.0015 s is no multiple of the step 0\.001 s; the nearest are 0\.001 s"):
        run(system, tmp_path / "a", particles=lambda t, master: None, particles_every=0.0015)


def test_a_system_without_particles_has_no_film_and_refuses_the_option(tmp_path):
    assert film_of(system_of("cdl_bcm_w2"), None) is None
    with pytest.raises(RunError, match=r"--particles-every 0\.1: no wheel is on particles, only on BCM; put one on DEM, or leave"):
        simulate("single_wheel", tmp_path / "out", overrides={"tier": "BCM"}, stop_time=0.1, particles_every=0.1)
    assert not (tmp_path / "out").exists()


# -- progress


@pytest.mark.parametrize(
    "speed, left, said", [(0.00123, 12345.0, "0.0012 x real time, 3 h 26 min left"), (0.5, 600.0, "0.5 x real time, 10 min left")]
)
def test_slow_runs_say_how_slow_they_are_and_when_they_end(speed, left, said, monkeypatch, capsys):
    now = 0.0
    monkeypatch.setattr(terminal.time, "perf_counter", lambda: now)
    display = terminal._lines()
    stop = speed * (left + 6.0)
    display.progress(0.0, stop)
    now = 6.0
    display.progress(6.0 * speed, stop)
    assert capsys.readouterr().err.endswith(f"{said}\n")


def test_stages_are_told_every_few_seconds_with_the_time_left(monkeypatch):
    now, told = 0.0, []
    monkeypatch.setattr(terminal.time, "perf_counter", lambda: now)
    progress = terminal.stages(told.append, "a bed")
    for k in range(1000):
        now = 0.03 * k
        progress("falling", k / 1000 - 1e-3)
    assert len(told) == 6
    assert told[0] == "a bed: falling, 0%" and told[-1] == "a bed: falling, 83%, 5 s left"
