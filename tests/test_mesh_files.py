"""Meshes as arrays: what their normals, edges and trees are, and which files are refused."""

import math

import numpy as np
import pytest
import trimesh
from meshes import grid, pose

from cdl_fmu.mesh.contacts import scratch_for
from cdl_fmu.mesh.files import read_body, read_ground
from cdl_fmu.mesh.nearest import signed_distance
from cdl_fmu.mesh.ray import cast_down
from cdl_fmu.mesh.rocks import rock
from cdl_fmu.mesh.surface import CONVEX, FACES, join, load_surface, surface_of
from cdl_fmu.mesh.tree import FIRST_EDGE, FIRST_TRIANGLE, FIRST_VERTEX, LAST_EDGE, LAST_TRIANGLE, LAST_VERTEX, LEAF, RIGHT
from cdl_fmu.slave.model import ModelError

box = trimesh.creation.box


def test_a_box_has_twelve_convex_edges_and_six_flat_ones():
    arrays = surface_of(box((0.3, 0.2, 0.1))).arrays
    assert len(arrays.edges) == 18 and arrays.edges[:, CONVEX].sum() == 12
    assert arrays.vertices[:, 3:] == pytest.approx(np.sign(arrays.vertices[:, :3]) / math.sqrt(3.0), abs=1e-12)
    convex = arrays.edges[arrays.edges[:, CONVEX] == 1]
    assert np.abs((arrays.normals[convex[:, FACES]] * arrays.normals[convex[:, FACES + 1]]).sum(axis=1)).max() < 1e-12


def test_edges_of_a_cavity_are_concave():
    room, cavity = box((1.0, 1.0, 1.0)), box((0.5, 0.5, 0.5))
    cavity.invert()
    arrays = surface_of(room + cavity).arrays
    inner = np.abs(arrays.vertices[:, :3]).max(axis=1) < 0.3
    convex = arrays.edges[arrays.edges[:, CONVEX] == 1]
    assert len(convex) == 12 and not inner[convex[:, :2]].any()


@pytest.mark.parametrize("mesh", [box((0.1, 0.1, 0.1)), rock(3, (0.3, 0.2, 0.2), 0.5, subdivisions=3), trimesh.creation.torus(0.2, 0.05)])
def test_each_feature_has_one_place_in_the_tree(mesh):
    arrays = surface_of(mesh).arrays
    leaves = arrays.nodes[arrays.nodes[:, RIGHT] == 0]
    for first, last, most in ((FIRST_TRIANGLE, LAST_TRIANGLE, len(mesh.faces)), (FIRST_VERTEX, LAST_VERTEX, len(mesh.vertices))):
        seen = np.concatenate([np.arange(leaf[first], leaf[last]) for leaf in leaves])
        assert np.array_equal(seen, np.arange(most))
    assert (leaves[:, LAST_TRIANGLE] - leaves[:, FIRST_TRIANGLE]).max() <= LEAF
    edges = np.concatenate([np.arange(leaf[FIRST_EDGE], leaf[LAST_EDGE]) for leaf in leaves])
    assert np.array_equal(edges, np.flatnonzero(arrays.edges[:, CONVEX]))
    assert len(arrays.edges) == len(mesh.edges_unique)


def test_what_a_body_weighs():
    mesh = box((0.3, 0.2, 0.1))
    mesh.apply_translation((1.0, 0.0, 0.0))
    surface = surface_of(mesh)
    assert surface.volume == pytest.approx(0.006) and surface.centre == pytest.approx([1.0, 0.0, 0.0])
    assert np.diag(surface.inertia) == pytest.approx(0.006 / 12.0 * np.array([0.2**2 + 0.1**2, 0.3**2 + 0.1**2, 0.3**2 + 0.2**2]))


def test_the_signed_distance_is_right_on_both_sides():
    torus = trimesh.creation.torus(0.2, 0.08, 24, 12)
    surface = surface_of(torus)
    stack = scratch_for(surface.arrays).stack
    points = np.random.default_rng(0).uniform(-0.32, 0.32, (300, 3)) * [1, 1, 0.4]
    corners = np.tile(torus.triangles, (len(points), 1, 1))
    nearest = trimesh.triangles.closest_point(corners, np.repeat(points, len(torus.faces), axis=0)).reshape(len(points), -1, 3)
    distance = np.linalg.norm(nearest - points[:, None], axis=2).min(axis=1)
    # Winding number of the surface around each point: sum of solid angles (van Oosterom & Strackee 1983).
    a, b, c = (torus.triangles[None, :, k] - points[:, None] for k in range(3))
    la, lb, lc = (np.linalg.norm(v, axis=2) for v in (a, b, c))
    top = (a * np.cross(b, c)).sum(-1)
    bottom = la * lb * lc + (a * b).sum(-1) * lc + (b * c).sum(-1) * la + (c * a).sum(-1) * lb
    within = 2.0 * np.arctan2(top, bottom).sum(axis=1) > 2.0 * math.pi
    assert 30 < within.sum() < 270
    for point, d, inside in zip(points, distance, within):
        # A vertex with a normal against every surface does not exist: one of these two directions opposes it.
        answers = [signed_distance(surface.arrays, 0, *point, *(sign * n), 1.0, stack) for sign in (1, -1) for n in np.eye(3)]
        gaps = [answer[1] for answer in answers if answer[0]]
        assert min(np.abs(gap - (-d if inside else d)) for gap in gaps) < 1e-12


def test_joined_surfaces_are_those_of_each_body():
    stone, cube, ground = surface_of(rock(1, (0.2, 0.2, 0.2))), surface_of(box((0.1, 0.1, 0.1))), surface_of(grid(lambda x, y: 0.2 * x))
    meshes = join([stone, cube, ground, stone])
    assert len(meshes.roots) == 4 and meshes.roots[0] == meshes.roots[3]
    assert len(meshes.triangles) == sum(len(s.arrays.triangles) for s in (stone, cube, ground))
    stack = scratch_for(meshes).stack
    for body, surface in enumerate((stone, cube, ground, stone)):
        for x, y in np.random.default_rng(2).uniform(-0.04, 0.04, (20, 2)):
            assert cast_down(meshes, body, pose(), x, y, 1.0, stack) == cast_down(surface.arrays, 0, pose(), x, y, 1.0, stack)
    assert not any(array.flags.writeable for array in meshes)


def test_a_file_is_read_once_until_it_changes(tmp_path):
    path = tmp_path / "stone.stl"
    rock(1, (0.2, 0.2, 0.2)).export(path)
    assert load_surface(path) is load_surface(path)
    assert len(load_surface(path).arrays.triangles) == 320


@pytest.mark.parametrize("roughness", [0.0, 0.2, 0.5])
def test_rocks_are_closed_of_their_size_and_the_same_again(roughness):
    for seed in range(5):
        stone = rock(seed, (0.3, 0.2, 0.1), roughness)
        assert stone.is_watertight and stone.is_winding_consistent and stone.volume > 0.0
        assert stone.extents == pytest.approx([0.3, 0.2, 0.1]) and stone.center_mass == pytest.approx(0.0, abs=1e-9)
        assert stone.volume > 0.8 * stone.convex_hull.volume
        assert np.array_equal(stone.vertices, rock(seed, (0.3, 0.2, 0.1), roughness).vertices)
    assert not np.allclose(rock(0, (0.3, 0.2, 0.1), 0.2).vertices, rock(1, (0.3, 0.2, 0.1), 0.2).vertices)


def test_a_rock_that_is_none_is_refused():
    with pytest.raises(ModelError, match=r"size = -1 m along y: it must be above 0 m and finite \(extent of a rock\)"):
        rock(0, (0.1, -1.0, 0.1))
    with pytest.raises(ModelError, match=r"roughness = 0.7: it must be within 0 and 0.5"):
        rock(0, (0.1, 0.1, 0.1), 0.7)


def test_only_a_ground_may_be_open(tmp_path):
    path = tmp_path / "hill.stl"
    grid(lambda x, y: 0.1 * x * y).export(path)
    assert len(read_ground(path).faces) == 800
    with pytest.raises(ModelError, match=r"hill.stl is open: 80 of its 1240 edges have no second face; close it in the CAD tool"):
        read_body(path)
    assert len(load_surface(path, ground=True).arrays.triangles) == 800


def test_a_ground_seen_from_below_is_refused(tmp_path):
    hill = grid(lambda x, y: 0.1 * x * y)
    hill.invert()
    hill.export(tmp_path / "hill.stl")
    with pytest.raises(ModelError, match=r"hill.stl: the normals of this ground point down, so that no ray from above meets it; flip them"):
        read_ground(tmp_path / "hill.stl")


def test_a_ground_in_millimetres_is_refused(tmp_path):
    grid(lambda x, y: 0.0, size=20000.0).export(tmp_path / "hill.stl")
    with pytest.raises(ModelError, match=r"hill.stl is 4e\+04 m across: .* scale it by 0.001 \(metres are expected, up to 5000 m\)"):
        read_ground(tmp_path / "hill.stl")


def test_a_scan_with_too_many_triangles_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("cdl_fmu.mesh.files._MOST_FACES", 10)
    box((1.0, 1.0, 1.0)).export(tmp_path / "scan.ply")
    with pytest.raises(ModelError, match=r"scan.ply has 12 triangles, the most are 10: contacts need a few thousand; simplify it"):
        read_body(tmp_path / "scan.ply")
