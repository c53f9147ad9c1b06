"""Contact candidates of closed meshes: boxes by hand, convex bodies against all their features, and what must not touch."""

import math

import numpy as np
import pytest
import trimesh
from meshes import Scene, distance, pose, random_rotation

from cdl_fmu.frames import axis_rotation
from cdl_fmu.mesh.contacts import EDGE_EDGE, GAP, ID, KINDS, NORMAL, POINT, VERTEX_OF_A, VERTEX_OF_B, A, B
from cdl_fmu.mesh.pairs import mesh_contacts
from cdl_fmu.mesh.rocks import rock

MARGIN = 0.004
box = trimesh.creation.box


def points(rows):
    return rows[:, POINT : POINT + 3]


def normals(rows):
    return rows[:, NORMAL : NORMAL + 3]


def kinds(rows):
    return rows[:, ID] % KINDS


@pytest.mark.parametrize("gap", [0.003, 0.0, -0.0005, -0.003])
def test_a_box_stands_on_its_four_corners(gap):
    scene = Scene(box((0.1, 0.06, 0.1)), box((0.4, 0.4, 0.1)))
    rows = scene.pair(0, pose((0.02, 0.01, 0.1 + gap)), 1, pose(), MARGIN)
    assert rows[:, [A, B]].tolist() == [[0, 1]] * 4
    assert rows[:, GAP] == pytest.approx(gap, abs=1e-15)
    assert normals(rows) == pytest.approx(np.tile([0.0, 0.0, 1.0], (4, 1)), abs=1e-15)
    assert sorted(map(tuple, points(rows)[:, :2].round(12))) == [(-0.03, -0.02), (-0.03, 0.04), (0.07, -0.02), (0.07, 0.04)]
    assert points(rows)[:, 2] == pytest.approx(0.05 + 0.5 * gap, abs=1e-15)
    # Seen from the other body: the same, the other way round.
    seen = scene.pair(1, pose(), 0, pose((0.02, 0.01, 0.1 + gap)), MARGIN)
    assert seen[:, GAP] == pytest.approx(gap, abs=1e-15)
    assert normals(seen) == pytest.approx(np.tile([0.0, 0.0, -1.0], (4, 1)), abs=1e-15)
    assert set(kinds(seen)) == {VERTEX_OF_B}


@pytest.mark.parametrize("gap", [0.001, -0.001])
def test_a_column_of_equal_boxes_touches_at_four_corners(gap):
    scene = Scene(box((0.1, 0.1, 0.1)))
    rows = scene.pair(0, pose((0.0, 0.0, 0.1 + gap)), 0, pose(), MARGIN)
    assert rows[:, GAP] == pytest.approx(gap, abs=1e-14)
    assert normals(rows) == pytest.approx(np.tile([0.0, 0.0, 1.0], (len(rows), 1)), abs=1e-12)
    assert len(np.unique(points(rows)[:, :2].round(9), axis=0)) == 4


@pytest.mark.parametrize("gap", [0.002, -0.002])
def test_crossed_bars_touch_at_four_crossings_of_edges(gap):
    bar = box((0.02, 0.3, 0.02))
    scene = Scene(bar)
    rows = scene.pair(0, pose((0.0, 0.0, 0.02 + gap)), 0, pose((0.0, 0.0, 0.0), axis_rotation(3, 0.5 * math.pi)), MARGIN)
    assert len(rows) == 4 and set(kinds(rows)) == {EDGE_EDGE}
    assert rows[:, GAP] == pytest.approx(gap, abs=1e-14)
    assert normals(rows) == pytest.approx(np.tile([0.0, 0.0, 1.0], (4, 1)), abs=1e-12)
    assert sorted(map(tuple, points(rows)[:, :2].round(9))) == [(-0.01, -0.01), (-0.01, 0.01), (0.01, -0.01), (0.01, 0.01)]


@pytest.mark.parametrize("gap", [0.002, 0.0, -0.002])
def test_two_edges_across_each_other(gap):
    on_edge = axis_rotation(1, 0.25 * math.pi)
    scene = Scene(box((0.3, 0.1, 0.1)))
    rows = scene.pair(0, pose((0.0, 0.0, 0.1 * math.sqrt(2.0) + gap), on_edge), 0, pose(T=on_edge @ axis_rotation(3, 1.0)), MARGIN)
    assert len(rows) == 1 and kinds(rows) == EDGE_EDGE
    assert rows[0, GAP] == pytest.approx(gap, abs=1e-14)
    assert normals(rows)[0] == pytest.approx([0.0, 0.0, 1.0], abs=1e-12)
    assert points(rows)[0] == pytest.approx([0.0, 0.0, 0.05 * math.sqrt(2.0) + 0.5 * gap], abs=1e-12)


@pytest.mark.parametrize("gap", [0.002, -0.002])
def test_a_corner_on_a_face(gap):
    T = axis_rotation(1, 0.6) @ axis_rotation(2, 0.7)
    low = (box((0.1, 0.1, 0.1)).vertices @ T)[:, 2].min()
    scene = Scene(box((0.1, 0.1, 0.1)), box((0.4, 0.4, 0.1)))
    rows = scene.pair(0, pose((0.01, 0.03, 0.05 - low + gap), T), 1, pose(), 0.003)
    assert rows[:, GAP].min() == pytest.approx(gap, abs=1e-14)
    deepest = rows[rows[:, GAP].argmin()]
    assert deepest[ID] % KINDS == VERTEX_OF_A
    assert deepest[NORMAL : NORMAL + 3] == pytest.approx([0.0, 0.0, 1.0], abs=1e-12)


def test_a_ball_of_facets_on_a_plane():
    ball = trimesh.creation.icosphere(3, 0.1)
    low = ball.vertices[:, 2].min()
    rows = Scene(ball, box((1.0, 1.0, 0.1))).pair(0, pose((0.0, 0.0, 0.05 - low - 0.001)), 1, pose(), MARGIN)
    near = np.flatnonzero(ball.vertices[:, 2] - low - 0.001 < MARGIN)
    assert sorted(rows[:, GAP]) == pytest.approx(sorted(ball.vertices[near, 2] - low - 0.001), abs=1e-14)
    assert normals(rows)[:, 2] == pytest.approx(1.0)


@pytest.mark.parametrize("move", [(0.2, 0, 0), (0.104, 0.104, 0), (5.0, 0, 0), (0, 0, 0.11)])
def test_bodies_apart_have_no_candidates(move):
    assert len(Scene(box((0.1, 0.1, 0.1))).pair(0, pose(move), 0, pose(), MARGIN)) == 0


def test_within_a_cavity_its_walls_are_touched():
    room, cavity = box((1.0, 1.0, 1.0)), box((0.5, 0.5, 0.5))
    cavity.invert()
    rows = Scene(box((0.1, 0.1, 0.1)), room + cavity).pair(0, pose((0.0, 0.0, -0.201)), 1, pose(), MARGIN)
    assert rows[:, GAP] == pytest.approx([-0.001] * 4, abs=1e-14)
    assert normals(rows)[:, 2] == pytest.approx(1.0)


def test_a_vertex_in_a_thin_plate_is_pushed_out_where_it_came_in():
    # 0.5 mm from the side, 0.8 mm deep: the nearest face, the side, does not face the vertex.
    plate, spike = box((0.002, 0.1, 0.05)), trimesh.creation.cone(0.02, 0.02, sections=16)
    spike.apply_translation((0.0, 0.0, -0.02))  # tip up, at the origin
    rows = Scene(spike, plate).pair(0, pose((0.0005, 0.01, -0.025 + 0.0008)), 1, pose(), MARGIN)
    tip = rows[(kinds(rows) == VERTEX_OF_A) & (rows[:, GAP] < 0.0)]
    assert len(tip) == 1 and tip[0, GAP] == pytest.approx(-0.0008, abs=1e-9)
    assert tip[0, NORMAL : NORMAL + 3] == pytest.approx([0.0, 0.0, -1.0], abs=1e-9)


def near_pair(random, first, second):
    """Poses of two convex bodies with a known least distance of up to 3 mm [m], as those move towards each other."""
    pose_a, pose_b = pose(random.uniform(-1.0, 1.0, 3), random_rotation(random)), pose((0, 0, 0), random_rotation(random))
    away = random.normal(size=3)
    away /= np.linalg.norm(away)
    pose_a["r_0"] = 0.3 * away
    goal = random.uniform(2e-4, 3e-3)
    while (d := distance(first, pose_a, second, pose_b)) > goal:
        pose_a["r_0"] -= max(d - goal, 1e-4) * away
        if d - goal < 2e-4:
            break
    return pose_a, pose_b


@pytest.mark.parametrize("seed", range(30))
def test_the_least_gap_of_convex_bodies_is_their_distance(seed):
    random = np.random.default_rng(seed)
    first, second = (trimesh.convex.convex_hull(random.normal(size=(n, 3)) * 0.04) for n in (12, 30))
    first.vertices -= first.center_mass
    second.vertices -= second.center_mass
    pose_a, pose_b = near_pair(random, first, second)
    scene = Scene(first, second)
    d = distance(first, pose_a, second, pose_b)
    rows = scene.pair(0, pose_a, 1, pose_b, MARGIN)
    assert rows[:, GAP].min() == pytest.approx(d, abs=1e-12)
    nearest = rows[rows[:, GAP].argmin()]
    # Moved along its normal to an overlap of 0.4 mm the same features are that deep; a vertex beside an edge is less deep in another face.
    normal = nearest[NORMAL : NORMAL + 3]
    pose_a["r_0"] -= (d + 4e-4) * normal
    again = scene.pair(0, pose_a, 1, pose_b, MARGIN)
    same = again[again[:, ID] == nearest[ID]]
    assert len(same) == 1 and -4e-4 - 1e-12 < same[0, GAP] < -3.5e-4
    assert same[0, NORMAL : NORMAL + 3] @ normal > 0.98
    if same[0, ID] % KINDS == EDGE_EDGE:
        assert same[0, GAP] == pytest.approx(-4e-4, abs=1e-12)


def test_candidates_are_those_of_both_sides_and_none_twice():
    random = np.random.default_rng(5)
    first, second = rock(1, (0.2, 0.15, 0.1)), rock(2, (0.2, 0.2, 0.2))
    scene = Scene(first, second)
    for _ in range(20):
        pose_a, pose_b = near_pair(random, first, second)
        rows, seen = scene.pair(0, pose_a, 1, pose_b, MARGIN), scene.pair(1, pose_b, 0, pose_a, MARGIN)
        assert len(np.unique(rows[:, ID])) == len(rows) > 0
        assert rows[:, GAP].max() < MARGIN
        assert seen[:, GAP].min() == pytest.approx(rows[:, GAP].min(), abs=1e-12)
        assert np.linalg.norm(normals(rows), axis=1) == pytest.approx(1.0, abs=1e-12)


def test_candidates_turn_with_the_world():
    random = np.random.default_rng(1)
    first, second = rock(1, (0.2, 0.15, 0.1)), rock(2, (0.2, 0.2, 0.2))
    scene = Scene(first, second)
    pose_a, pose_b = near_pair(random, first, second)
    rows = scene.pair(0, pose_a, 1, pose_b, MARGIN)
    Q, shift = random_rotation(random), np.array([3.0, -2.0, 1.0])
    moved = [pose(Q @ p["r_0"] + shift, p["T"] @ Q.T) for p in (pose_a, pose_b)]
    again = scene.pair(0, moved[0], 1, moved[1], MARGIN)
    order, order_again = np.argsort(rows[:, ID]), np.argsort(again[:, ID])
    assert again[order_again][:, [ID]] == pytest.approx(rows[order][:, [ID]])
    assert points(again)[order_again] == pytest.approx(points(rows)[order] @ Q.T + shift, abs=1e-12)
    assert normals(again)[order_again] == pytest.approx(normals(rows)[order] @ Q.T, abs=1e-9)


def test_overflow_is_told():
    scene = Scene(box((0.1, 0.1, 0.1)), box((0.4, 0.4, 0.1)), most=3)
    rows = scene.pair(0, pose((0.0, 0.0, 0.1)), 1, pose(), MARGIN)
    assert len(rows) == 3
    n = mesh_contacts(scene.meshes, 0, pose((0.0, 0.0, 0.1)), 1, pose(), MARGIN, scene.scratch, scene.rows, 0)
    assert n == 4


@pytest.mark.parametrize("behind", [0.002, 0.008, 0.016])
def test_an_edge_far_behind_a_face_that_a_corner_dips_into_is_no_contact(behind):
    """A thin plate that stands on a table 0.1 mm deep: out is up, however near the table's end is."""
    scene = Scene(trimesh.creation.box((0.002, 0.02, 0.04)), trimesh.creation.box((0.4, 0.4, 0.1)))
    lean = axis_rotation(2, 0.02) @ axis_rotation(1, 0.03)
    low = -(scene.surfaces[0].arrays.vertices[:, :3] @ lean)[:, 2].min()
    rows = scene.pair(0, pose((0.2 - behind, 0.0, 0.05 + low - 1e-4), lean), 1, pose(), 0.02)
    deep = rows[rows[:, GAP] < 0.0]
    assert len(deep) >= 1 and deep[:, GAP].min() == pytest.approx(-1e-4, abs=1e-9)
    assert deep[:, NORMAL + 2] == pytest.approx(1.0, abs=1e-6)
