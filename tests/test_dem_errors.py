"""What the DEM slave is given wrongly: refused or warned of by name, value, unit, bound and remedy."""

import beds
import numpy as np
import pytest
import trimesh
from beds import R_W, dem, place

from cdl_fmu.dem import memory
from cdl_fmu.dem.material import Material
from cdl_fmu.dem.simulation import Simulation
from cdl_fmu.slave.model import ModelError
from orchestrator.experiment import ExperimentError, load_experiment


def refused(message: str, **parameters) -> None:
    with pytest.raises(ModelError, match=message):
        dem(**parameters).initialise()


def above() -> float:
    return R_W + beds.highest_particle() + 1e-4


def test_parameters_that_do_not_fit_together_are_refused_with_the_remedy():
    refused(r"h_g = 0.015 m is 1.5 mean diameters of the particles \(.*\), at least 2 are needed: take .* 0.0075 m", n_g=8, h_g=0.015)
    refused(r"box_width = 0.09 m: for this tool it must be at least 0.1 m \(2 widths of 0.05 m\); make the box larger", box_width=0.09)
    refused(r"depth = 0.055 m: for this tool it must be at least 0.06 m \(1.2 radii of 0.05 m\)", depth=0.055)
    refused(r"box_length = 0.08 m: shorter than the wheel of 0.1 m; use 3 radii or more", box_length=0.08)
    refused(r"dt = 0.001 s: above the stability limit of particles of 9 mm and E = 1e\+07 Pa; use at most 7.9\de-05 s, or 0 for", dt=1e-3)
    refused(r"rho = 1.9 kg/m3: lighter than any soil; use at least 100 kg/m3 \(1 g/cm3 is 1000 kg/m3\)", rho=1.9)
    refused(r"grain.mu = 0.6: grains are made from the soil; set grains = given, or leave it out", grains="soil", **{"grain.mu": 0.6})
    refused(r"seed = 1.5: it must be a whole number", seed=1.5)
    refused(r"threads = 250: on this machine at most \d+; numba's variable", threads=250)


def test_a_bed_that_is_another_one_is_refused(tmp_path):
    refused(r"d = 0.005 m: the bed has 0.01 m; give it that value, or another bed", d=0.005)
    refused(r"depth = 0.08 m: the bed has 0.0625 m", depth=0.08)
    refused(r"gravity = 1.62 m/s2: the bed has 9.81 m/s2", gravity=1.62)
    refused(r"slope = 0.1 rad, uphill = 0 rad: the bed settled under a gravity of \(.*\) m/s2; give it that slope", slope=0.1)
    refused(r"bed = 'none.npz': no such file in .*; put the file there, or give its absolute path \(Bed of particles", bed="none.npz")
    with np.load(beds.bed_file()) as stored:
        arrays = dict(stored)
    arrays["positions"][1] = arrays["positions"][0] + 1e-3
    np.savez(tmp_path / "bed.npz", **arrays)
    refused(
        r"bed.npz: particles 0 and 1 .* overlap by .* at most 5 % are possible: move",
        bed=tmp_path / "bed.npz",
    )


def test_more_particles_than_memory_are_refused_before_any_is_made(monkeypatch):
    monkeypatch.setattr(memory, "available_memory", lambda: 2_000_000_000)
    refused(
        r"box_length = 100 m by box_width = 50 m: \d+ particles need [\d.e+]+ GB of memory, 2 GB are available: take coarser grains",
        box_length=100.0,
        box_width=50.0,
    )


def test_what_is_doubtful_is_warned_of_once():
    one = dem(n_g=8, h_g=0.02, r_w=0.03, b_w=0.05, porosity=0.45)
    for _ in range(2):
        one.initialise()
    assert len(one.warnings) == 2
    assert "h_g = 0.02 m is 2 mean diameters of the particles (0.01 m), below 5 its forces depend on single particles" in one.warnings[0]
    assert "porosity = 0.45: the bed has 0.42" in one.warnings[1]


@pytest.mark.parametrize("deep", (0.006, 0.02, 0.05))
def test_a_wheel_inside_the_bed_is_refused(deep):
    one = dem()
    place(one.u["wheel"][0], (0.01, 0.02, above() - deep))
    one.initialise()
    with pytest.raises(ModelError, match=r"wheel 1, at z = .* m, overlaps a particle by more than 0.3 of its radius: it begins inside the"):
        one.step(0.0, 1e-3)


def test_a_wheel_that_jumps_is_refused_and_the_step_can_be_retaken():
    one = dem()
    place(one.u["wheel"][0], (0.01, 0.02, above()))
    one.initialise()
    one.step(0.0, 1e-3)
    saved = one.save()
    place(one.u["wheel"][0], (0.31, 0.02, above() - 0.02))
    with pytest.raises(ModelError, match=r"overlaps a particle .* or jumped into it; start it above .* by r_w \+ h_g and a particle"):
        one.step(1e-3, 1e-3)
    one.restore(saved)
    place(one.u["wheel"][0], (0.01, 0.02, above()))
    one.step(1e-3, 1e-3)
    place(one.u["wheel"][0], (1e5, 0.02, above()))
    with pytest.raises(ModelError, match=r"wheel\[1\] is at \(100000, 0.02\) m, but a bed of these particles goes .* m from the origin"):
        one.step(2e-3, 1e-3)
    place(one.u["wheel"][0], (0.01, 0.02, -R_W - 0.01))
    with pytest.raises(ModelError, match=r"wheel 1 is buried"):
        one.step(2e-3, 1e-3)


def test_poses_and_meshes_that_are_missing_are_named(tmp_path):
    one = dem()
    one.initialise()
    for k in range(2):
        one.step(k * 1e-3, 1e-3)
        assert not one.y["wheel"]["f_0"].any()
    assert len(one.warnings) == 1 and "wheel 1 has no pose yet" in one.warnings[0]
    with pytest.raises(ModelError, match=r"wheel\[1\] still has no pose after 2 steps"):
        one.step(2e-3, 1e-3)
    one = dem(1, 0, 1)
    place(one.u["wheel"][0], (0.01, 0.02, above()))
    one.initialise()
    with pytest.raises(ModelError, match=r"body\[1\].mesh names no file: give the path of a closed mesh \(.stl, .obj or .ply, in metres\)"):
        one.step(0.0, 1e-3)
    mesh = trimesh.creation.box((0.04, 0.04, 0.02))
    mesh.faces = mesh.faces[:-1]
    mesh.export(tmp_path / "open.stl")
    with pytest.raises(ModelError, match=r"body\[1\].mesh = open.stl is open: 3 of its 18 edges"):
        dem(1, 0, 1, **{"body[1].mesh": tmp_path / "open.stl"}).initialise()
    trimesh.creation.box((0.04, 0.04, 0.02)).export(tmp_path / "box.stl")
    one = dem(1, 0, 1, **{"body[1].mesh": tmp_path / "box.stl"})
    for tool in (one.u["wheel"][0], one.u["body"][0]):
        place(tool, (0.01, 0.02, above()))
    one.u["wheel"]["active"] = 0.0
    one.u["body"]["r_0"][0, 2] = 0.01
    one.initialise()
    with pytest.raises(ModelError, match=r"body 1, at z = 0.01 m, overlaps a particle by more than 0.3 of its radius"):
        one.step(0.0, 1e-3)


def test_experiments_name_the_option_at_fault():
    def refuse(match, tiers=("DEM", "BCM"), **overrides):
        with pytest.raises(ExperimentError, match=match):
            load_experiment("two_wheel", tiers=tiers, overrides={"wheel.n_g": 0, **overrides}).instances()

    refuse(r"--set dem.box_width: dem.box_width = 0.2 m: for this tool it must be at least 0.25 m", **{"dem.box_width": 0.2})
    refuse(r"h_g = 0.01 m is 0.5 mean diameters", **{"wheel.n_g": 12, "dem.d": 0.02})
    refuse(r"wheels on SCM and on DEM: each tier owns the soil under all wheels; put the others on BCM or VEM", tiers=("DEM", "SCM"))
    refuse(r"dem.bed = 'none.npz': no such file; correct the path", **{"dem.bed": "none.npz"})
    with pytest.raises(ExperimentError, match=r"rocks lie in SCM's soil, not in particles: put the wheels on SCM, BCM or VEM"):
        load_experiment("rocks_in_sand", tiers=("DEM", "DEM"))


def test_a_bed_that_is_given_says_that_its_own_grains_count():
    one = dem(**{"grain.mu": 0.6})
    one.initialise()
    (text,) = one.warnings
    assert text.endswith("the bed that is given has grains of its own (mu = 0.5, not 0.6): these count")


@pytest.mark.parametrize(
    "value, message", [({"e": 0.0}, "e = 0: it must be above 0 and at most 1"), ({"density": -1.0}, "density = -1: it must")]
)
def test_a_material_that_cannot_be_is_refused(value, message):
    with pytest.raises(ModelError, match=message):
        Material(**value)


def test_a_simulation_refuses_what_it_cannot_do():
    positions, radii = np.zeros((1, 3)), np.full(1, 0.005)
    with pytest.raises(ModelError, match=r"dt = 0.01 s: above the stability limit of particles of 10 mm .* use at most"):
        Simulation(positions, radii, Material(), dt=0.01)
    with pytest.raises(ModelError, match=r"positions have the shape \(1, 3\): \(2, 3\) is needed"):
        Simulation(positions, np.full(2, 0.005), Material())
    with pytest.raises(ModelError, match=r"threads = 500: on this machine at most"):
        Simulation(positions, radii, Material(), threads=500)
