"""Where a sphere touches a wheel or a mesh: closed forms, definitions, symmetry, continuity."""

import itertools
import math

import numpy as np
import pytest
import trimesh
from meshes import random_rotation

from cdl_fmu.dem.touch import DISTANCE, MOST, NORMAL, TOUCH
from cdl_fmu.dem.touch_mesh import mesh_touches
from cdl_fmu.dem.touch_wheel import wheel_touches
from cdl_fmu.frames import axis_rotation
from cdl_fmu.mesh.rocks import rock
from cdl_fmu.mesh.surface import surface_of
from cdl_fmu.wheel_mesh import wheel_mesh
from cdl_fmu.wheel_surface import wheel_distance

R, B = 0.125, 0.125
WHEEL = dict(r_w=R, b_w=B, n_g=12.0, h_g=0.010, t_g=0.002)  # Table 8.2
TIP = R + WHEEL["h_g"]
REACH = 0.006
WHEELS = [WHEEL | change for change in ({}, {"n_g": 0.0}, {"n_g": 1.0}, {"n_g": 2.0}, {"n_g": 7.0}, {"n_g": 90.0}, {"t_g": 0.0})]
OUT, STACK = np.zeros((MOST, TOUCH)), np.zeros(256, np.int64)


def on_wheel(point, reach=REACH, wheel=WHEEL):
    """All rows, whether met or not."""
    OUT[:] = np.inf
    n = wheel_touches(*point, reach, **wheel, out=OUT)
    assert (OUT[n:, DISTANCE] == np.inf).all()
    return OUT.copy()


def met(rows):
    return rows[np.isfinite(rows[:, DISTANCE])]


def at_angle(angle, rho, y=0.0):
    """Point of the wheel's frame; plate 0 is at angle 0."""
    return np.array([rho * math.sin(angle), y, -rho * math.cos(angle)])


def near_wheel(random, n, depth=0.004):
    """Points about the wheel's surface: around the rim and the plates, and at the flat ends."""
    middle = random.uniform(-0.5 * B, 0.5 * B, n)
    end = random.uniform(0.5 * B - depth, 0.5 * B + 0.006, n) * random.choice([-1, 1], n)
    y = np.where(random.random(n) < 0.5, middle, end)
    return [at_angle(*place) for place in zip(random.uniform(-4.0, 4.0, n), random.uniform(R - depth, TIP + 0.004, n), y)]


class OnMesh:
    """A mesh that is touched."""

    def __init__(self, mesh):
        self.mesh, self.arrays = mesh, surface_of(mesh).arrays

    def rows(self, point, reach):
        n = mesh_touches(self.arrays, 0, *map(float, point), reach, STACK, OUT)
        return OUT[:n].copy()

    def nearest(self, point):
        """Nearest point of each triangle, and its distance."""
        nearest = trimesh.triangles.closest_point(self.mesh.triangles, np.tile(point, (len(self.mesh.faces), 1)))
        return nearest, np.linalg.norm(point - nearest, axis=1)

    def has_within(self, point):
        """Whether the solid angle of all triangles is that of a sphere (Van Oosterom & Strackee 1983)."""
        a, b, c = np.moveaxis(self.mesh.triangles - point, 1, 0)
        la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
        ab, bc, ca = (a * b).sum(axis=1), (b * c).sum(axis=1), (c * a).sum(axis=1)
        half = np.arctan2((a * np.cross(b, c)).sum(axis=1), la * lb * lc + ab * lc + bc * la + ca * lb)
        return half.sum() > math.pi

    def by_definition(self, point, reach):
        """Outside of the mesh: distances and normals of local minima, from all pairs of triangles in reach."""
        nearest, distance = self.nearest(point)
        facing = ((point - self.mesh.triangles[:, 0]) * self.mesh.face_normals).sum(axis=1) >= 0.0
        rows = []
        for t in np.flatnonzero(facing & (distance < reach)):
            holds = self.nearest(nearest[t])[1] < 1e-9
            if distance[holds].min() > distance[t] - 1e-13:
                rows.append(np.array([distance[t], *(point - nearest[t]) / distance[t]]))
        return apart(rows)


def voxels(filled, side=0.01):
    """Closed surface of cubes that are joined, two triangles a face; coordinates are whole numbers of ``side``."""
    corners, faces = [], []
    for cell in filled:
        for axis, end in itertools.product(range(3), (0, 1)):
            beside = list(cell)
            beside[axis] += 2 * end - 1
            if tuple(beside) in filled:
                continue
            u, v = (axis + 1) % 3, (axis + 2) % 3
            square = np.tile(np.array(cell, float), (4, 1))
            square[:, axis] += end
            square[[1, 2], u] += 1.0
            square[[2, 3], v] += 1.0
            k = len(corners)
            corners.extend(square)
            faces.extend([(k, k + 1, k + 2), (k, k + 2, k + 3)] if end else [(k, k + 2, k + 1), (k, k + 3, k + 2)])
    return trimesh.Trimesh(side * np.array(corners), faces)


def floor_with(*walls):
    return {(i, j, 0) for i in range(3) for j in range(3)} | set(walls)


def apart(rows):
    """Rows that have no nearer one within 10 degrees, nearest first."""
    kept = []
    for row in sorted(rows, key=lambda row: row[DISTANCE]):
        if all(row[NORMAL:] @ other[NORMAL:] <= 0.985 for other in kept):
            kept.append(row)
    return np.array(kept).reshape(-1, TOUCH)


def total(rows, reach):
    return (reach - met(rows)[:, DISTANCE]).sum()


# The wheel


@pytest.mark.parametrize("wheel", WHEELS, ids=str)
def test_the_nearest_row_is_the_wheels_distance_and_rows_keep_to_reach(wheel):
    n_met = 0
    for point in near_wheel(np.random.default_rng(0), 1500, depth=0.0):
        rows, exact = met(on_wheel(point, wheel=wheel)), wheel_distance(*point, **wheel)
        assert rows[:, DISTANCE].min(initial=REACH) == pytest.approx(min(exact, REACH), abs=1e-14)
        assert (rows[:, DISTANCE] < REACH).all()
        n_met += len(rows)
    assert n_met > 500


@pytest.mark.parametrize("wheel", WHEELS[:5], ids=str)
def test_normals_are_the_slopes_of_distances(wheel):
    step, n_rows = 1e-7, 0
    for point in near_wheel(np.random.default_rng(1), 300):
        rows = on_wheel(point, wheel=wheel)
        around = [[on_wheel(point + sign * step * e, wheel=wheel)[:, DISTANCE] for e in np.eye(3)] for sign in (1, -1)]
        for row in np.flatnonzero(np.isfinite(rows[:, DISTANCE]) & np.isfinite(around).all(axis=(0, 1))):
            slope = (np.array(around)[0, :, row] - np.array(around)[1, :, row]) / (2.0 * step)
            assert rows[row, NORMAL:] == pytest.approx(slope, abs=1e-4)
            n_rows += 1
    assert n_rows > 150


def test_closed_forms_of_each_face_and_edge():
    between = math.radians(15.0)
    cases = [
        (at_angle(between, R + 0.004, 0.01), 0, 0.004, at_angle(between, 1.0)),  # rim
        (at_angle(between, R - 0.003, 0.01), 0, -0.003, at_angle(between, 1.0)),  # within it
        (at_angle(between, R - 0.02, -0.5 * B + 0.001), 0, -0.001, (0, -1, 0)),  # nearer to its end
        (at_angle(0.1, 0.05, 0.5 * B + 0.004), 0, 0.004, (0, 1, 0)),  # end
        (at_angle(between, R + 0.003, -0.5 * B - 0.004), 0, 0.005, at_angle(between, 0.6, -0.8)),  # edge of the end
        ((0.0002, 0.0, -TIP - 0.004), 1, 0.004, (0, 0, -1)),  # top of plate 0
        ((0.004, 0.0, -TIP + 0.003), 1, 0.003, (1, 0, 0)),  # its side
        ((-0.004, 0.0, -TIP - 0.004), 1, 0.005, (-0.6, 0, -0.8)),  # edge of its top
        ((-0.0002, 0.0, -TIP + 0.003), 1, -0.0008, (-1, 0, 0)),  # within it
        ((0.0, 0.5 * B + 0.003, -TIP + 0.005), 1, 0.003, (0, 1, 0)),  # its end
        ((0.004, -0.5 * B - 0.004, -TIP + 0.002), 1, 0.005, (0.6, -0.8, 0)),  # edge of its end
        ((0.003, 0.5 * B + 0.001, -TIP - 0.002), 1, 0.003, (2 / 3, 1 / 3, -2 / 3)),  # corner
    ]
    for point, row, distance, normal in cases:
        rows = on_wheel(point)
        assert rows[row] == pytest.approx([distance, *normal], abs=1e-12)
        assert len(met(rows)) == 1


def test_a_sphere_between_rim_and_plate_has_both():
    rows = on_wheel((0.005, 0.0, -math.sqrt((R + 0.0045) ** 2 - 0.005**2)))
    assert rows[:2, DISTANCE] == pytest.approx([0.0045, 0.004])
    assert rows[1, NORMAL:] == pytest.approx([1.0, 0.0, 0.0], abs=1e-15)


def test_a_sphere_on_two_plates_has_both_and_does_not_reach_the_rim_below_one():
    wheel = WHEEL | {"n_g": 90.0}  # 7.4 mm from tip to tip
    half = math.pi / 90.0
    rows = on_wheel(at_angle(half, TIP + 0.003), wheel=wheel)
    side, out = (TIP + 0.003) * math.sin(half) - 0.001, (TIP + 0.003) * math.cos(half) - TIP
    assert rows[1:3, DISTANCE] == pytest.approx(math.hypot(side, out)) and not np.isfinite(rows[[0, 3], DISTANCE]).any()
    up = (side * math.sin(half) + out * math.cos(half)) / math.hypot(side, out)
    assert rows[1:3, NORMAL:].sum(axis=0) == pytest.approx(at_angle(half, 2.0 * up))
    # A large sphere on one tip: the rim in reach is covered by the plate.
    assert len(met(on_wheel((0.0, 0.0, -TIP - 0.004), reach=0.020))) == 1


@pytest.mark.parametrize("n_g", [1, 2, 3, 5, 12, 13])
def test_a_plate_keeps_its_row_and_neighbours_have_others(n_g):
    row_of = {}
    for angle in np.linspace(-3.2 * math.pi, 3.2 * math.pi, 2001):
        nearest = round(angle * n_g / (2.0 * math.pi)) % n_g
        rows = on_wheel(at_angle(angle, TIP - 0.001), wheel=WHEEL | {"n_g": float(n_g)})
        for row in np.flatnonzero(np.isfinite(rows[1:, DISTANCE])) + 1:
            assert row_of.setdefault(nearest, row) == row
    assert len(row_of) == n_g
    assert n_g == 1 or all(row_of[k] != row_of[(k + 1) % n_g] for k in range(n_g))


def test_the_flat_end_of_a_plate_and_of_the_cylinder_are_one_face():
    y = 0.5 * B + 0.004
    for rho in np.linspace(R - 0.02, TIP, 50):
        for across in (0.0, 0.0009):
            assert met(on_wheel((across, y, -rho)))[:, :] == pytest.approx(np.array([[0.004, 0.0, 1.0, 0.0]]))
    # Beside the plate and beyond the rim two edges are met, on the cylinder's end one face.
    assert len(met(on_wheel(at_angle(0.003 / R, R + 1e-3, y)))) == 2
    assert len(met(on_wheel(at_angle(0.003 / R, R - 1e-6, y)))) == 1


@pytest.mark.parametrize("wheel", WHEELS[:5], ids=str)
def test_the_wheel_is_touched_as_its_mesh_is(wheel):
    spacing = 1e-3
    chord = spacing**2 / (8.0 * R)
    mesh, random, seen = OnMesh(wheel_mesh(**wheel, spacing=spacing)), np.random.default_rng(2), []
    for point in near_wheel(random, 600, depth=0.0):
        rows, on_mesh = met(on_wheel(point, wheel=wheel)), mesh.rows(point, REACH)
        if (np.abs(rows[:, DISTANCE] - REACH) < 2 * chord).any():
            continue  # in reach of one and not of the other
        rows = apart(rows)
        assert len(rows) == len(on_mesh)
        assert rows[:, DISTANCE] == pytest.approx(on_mesh[:, DISTANCE], abs=1.01 * chord)
        seen.append(len(rows))
    assert {0, 1} <= set(seen) and (wheel["n_g"] < 7 or 2 in seen)


def test_mirrored_and_turned_wheels_are_touched_alike():
    for point in near_wheel(np.random.default_rng(3), 300):
        rows = on_wheel(point)
        for mirror in ([1, -1, 1], [-1, 1, 1], [1, 1, -1]):  # an even number of plates
            other = on_wheel(point * mirror)
            assert other[:, DISTANCE] == pytest.approx(rows[:, DISTANCE], abs=1e-14)
            assert met(other)[:, NORMAL:] == pytest.approx(met(rows)[:, NORMAL:] * mirror, abs=1e-9)
        turn = axis_rotation(2, math.radians(60.0))
        turned = on_wheel(turn @ point)
        assert turned[:, DISTANCE] == pytest.approx(rows[:, DISTANCE], abs=1e-14)
        assert met(turned)[:, NORMAL:] == pytest.approx(met(rows)[:, NORMAL:] @ turn.T, abs=1e-9)


STEP = 1e-6


def paths(random, n, places, length=400):
    """Straight paths through places, in steps of STEP."""
    for _ in range(n):
        direction = random.normal(size=3)
        direction /= np.linalg.norm(direction)
        yield places[random.integers(len(places))] + np.arange(-length, length)[:, None] * STEP * direction


def test_no_jump_over_the_edges_of_rim_and_plates():
    places = [
        at_angle(0.2, R + 0.001, 0.5 * B + 0.003),  # from the rim to the end
        np.array([0.0012, 0.0, -TIP - 0.003]),  # from a plate's side to its top
        np.array([0.0012, -0.5 * B - 0.003, -TIP - 0.0001]),  # its corner
        at_angle(0.005 / R, R + 0.005),  # rim and plate
        np.array([0.0, 0.5 * B + 0.004, -R]),  # from the end of the cylinder to that of a plate
    ]
    for path in paths(np.random.default_rng(4), 60, places):
        totals = np.array([total(on_wheel(point), REACH) for point in path])
        assert np.abs(np.diff(totals)).max() < 2.0 * STEP


# Meshes


def test_a_box_is_touched_once_on_faces_edges_and_vertices():
    box = trimesh.creation.box((0.04, 0.04, 0.04))
    for mesh in (box, box.subdivide().subdivide()):
        touched = OnMesh(mesh)
        for point in np.random.default_rng(5).uniform(-0.026, 0.026, (400, 3)):
            nearest = np.clip(point, -0.02, 0.02)
            distance = np.linalg.norm(point - nearest)
            rows = touched.rows(point, 0.005)
            if 0.0 < distance < 0.005:
                assert rows == pytest.approx(np.array([[distance, *(point - nearest) / distance]]), abs=1e-12)
            elif distance > 0.0:
                assert len(rows) == 0
        # On seams of the tessellation, and over edges and vertices.
        assert touched.rows((0.0, 0.0, 0.023), 0.005) == pytest.approx(np.array([[0.003, 0, 0, 1]]))
        assert touched.rows((0.02, 0.01, 0.023), 0.005) == pytest.approx(np.array([[0.003, 0, 0, 1]]))
        assert touched.rows((0.023, 0.0, 0.024), 0.006) == pytest.approx(np.array([[0.005, 0.6, 0, 0.8]]))
        assert touched.rows((0.021, 0.022, -0.022), 0.006) == pytest.approx(np.array([[0.003, 1 / 3, 2 / 3, -2 / 3]]))
        assert touched.rows((0.02, 0.0, 0.0), 0.006) == pytest.approx(np.array([[0.0, 1, 0, 0]]))


def test_within_a_box_the_nearest_face_pushes_out():
    touched, random = OnMesh(trimesh.creation.box((0.04, 0.04, 0.04)).subdivide()), np.random.default_rng(6)
    for point in random.uniform(-0.02, 0.02, (300, 3)):
        axis = np.abs(point).argmax()
        depth = 0.02 - abs(point[axis])
        rows = touched.rows(point, 0.005)
        assert len(rows) == (depth < 0.005)
        if len(rows):
            assert rows[0] == pytest.approx([-depth, *np.sign(point[axis]) * np.eye(3)[axis]], abs=1e-12)


def test_a_corner_is_touched_on_each_of_its_faces():
    edge = OnMesh(voxels(floor_with((0, 0, 1), (0, 1, 1), (0, 2, 1))))
    assert edge.rows((0.014, 0.012, 0.013), 0.005) == pytest.approx(np.array([[0.003, 0, 0, 1], [0.004, 1, 0, 0]]))
    corner = OnMesh(voxels(floor_with((0, 0, 1), (0, 1, 1), (0, 2, 1), (1, 0, 1), (2, 0, 1))))
    assert corner.rows((0.014, 0.012, 0.013), 0.005) == pytest.approx(np.array([[0.002, 0, 1, 0], [0.003, 0, 0, 1], [0.004, 1, 0, 0]]))
    walls = [(i, j, 1) for i in range(3) for j in range(3) if (i, j) != (1, 1)]
    pit = OnMesh(voxels(floor_with(*walls)))
    rows = pit.rows((0.0142, 0.0151, 0.0154), 0.006)  # four walls and the floor
    assert rows[:, DISTANCE] == pytest.approx([0.0042, 0.0049, 0.0051, 0.0054]) and len(rows) == MOST
    assert rows[3, NORMAL:] == pytest.approx([0, 0, 1])


@pytest.mark.parametrize(
    "mesh",
    [
        rock(3, (0.05, 0.04, 0.03)),
        voxels(floor_with((0, 0, 1), (0, 1, 1), (1, 0, 1), (2, 2, 1), (2, 2, 2))),
        trimesh.creation.annulus(0.01, 0.02, 0.02, sections=24),
        trimesh.creation.cone(0.008, 0.06, sections=7),
    ],
    ids=["rock", "steps", "tube", "spike"],
)
def test_rows_are_the_local_minima_by_definition(mesh):
    touched, random, counts = OnMesh(mesh), np.random.default_rng(7), []
    points, faces = trimesh.sample.sample_surface(mesh, 150, seed=1)
    for point, normal in zip(points, mesh.face_normals[faces]):
        point = point + random.uniform(0.0, 0.004) * normal + random.normal(0.0, 0.002, 3)
        rows = touched.rows(point, 0.006)
        nearest, distance = touched.nearest(point)
        inside = touched.has_within(point)
        if distance.min() >= 0.006:
            assert len(rows) == 0
            continue
        assert rows[0, DISTANCE] == pytest.approx(-distance.min() if inside else distance.min(), abs=1e-12)
        assert rows[0, DISTANCE] * rows[0, NORMAL:] == pytest.approx(point - nearest[distance.argmin()], abs=1e-9)
        if inside:
            assert len(rows) == 1
        else:
            assert rows == pytest.approx(touched.by_definition(point, 0.006)[:MOST], abs=1e-9)
        counts.append(len(rows))
    assert 1 in counts


def test_a_thin_plate_pushes_a_sphere_back_to_its_side():
    touched = OnMesh(trimesh.creation.box((0.04, 0.04, 0.001)).subdivide())
    for side in (1.0, -1.0):
        assert touched.rows((0.011, 0.007, side * 0.002), 0.005) == pytest.approx(np.array([[0.0015, 0, 0, side]]))
        assert touched.rows((0.011, 0.007, side * 0.0004), 0.005) == pytest.approx(np.array([[-0.0001, 0, 0, side]]))
        assert touched.rows((0.023, 0.007, side * 0.0045), 0.006) == pytest.approx(np.array([[0.005, 0.6, 0, side * 0.8]]))


def test_parts_that_touch_are_one_floor():
    parts = [trimesh.creation.box((0.04, 0.04, 0.04)) for _ in range(2)]
    parts[1].apply_translation((0.04, 0.0, 0.0))
    touched = OnMesh(trimesh.util.concatenate(parts))
    for x in (0.018, 0.02, 0.0213):
        assert touched.rows((x, 0.003, 0.022), 0.005) == pytest.approx(np.array([[0.002, 0, 0, 1]]))


def test_a_tessellated_bowl_is_touched_once():
    """A sphere in a tube, on the facets' middles and over their seams, which are concave."""
    touched, half = OnMesh(trimesh.creation.annulus(0.05, 0.06, 0.04, sections=96)), math.pi / 96
    for angle in np.linspace(0.0, 0.3, 200):
        height = 0.05 * math.cos(half) - 0.046 * math.cos((angle % (2.0 * half)) - half)
        rows = touched.rows((0.046 * math.cos(angle), 0.046 * math.sin(angle), 0.003), 0.006)
        assert rows[:, DISTANCE] == pytest.approx([height], abs=1e-12)


def test_flat_faces_of_single_precision_are_touched_once():
    mesh = trimesh.creation.box((0.04, 0.04, 0.04)).subdivide().subdivide().subdivide()
    mesh.apply_transform(trimesh.transformations.rotation_matrix(0.7, (1.0, 2.0, 3.0), (0.1, 0.0, 0.0)))
    top, towards = mesh.triangles[mesh.face_normals @ mesh.face_normals[0] > 0.999], mesh.face_normals[0]
    touched = OnMesh(trimesh.Trimesh(mesh.vertices.astype(np.float32), mesh.faces, process=False))
    for point in np.concatenate([top[:, 0], top.mean(axis=1), 0.5 * (top[:, 0] + top[:, 1])]):
        rows = touched.rows(point + 0.004 * towards, 0.005)
        assert rows == pytest.approx(np.array([[0.004, *towards]]), abs=1e-5)


def test_a_turned_mesh_is_touched_alike():
    mesh, random = voxels(floor_with((0, 0, 1), (0, 1, 1), (1, 0, 1))), np.random.default_rng(8)
    for _ in range(20):
        turn, point = random_rotation(random), np.array([0.0142, 0.0134, 0.0131]) + random.uniform(-0.002, 0.003, 3) * 0.5
        turned = trimesh.Trimesh(mesh.vertices @ turn.T, mesh.faces, process=False)
        rows = OnMesh(mesh).rows(point, 0.005)
        other = OnMesh(turned).rows(turn @ point, 0.005)
        assert len(other) == len(rows) > 0
        assert other[:, DISTANCE] == pytest.approx(rows[:, DISTANCE], abs=1e-14)
        assert other[:, NORMAL:] == pytest.approx(rows[:, NORMAL:] @ turn.T, abs=1e-9)


def test_a_fine_cylinder_is_touched_as_the_smooth_wheel():
    smooth, spacing = WHEEL | {"n_g": 0.0}, 2e-3
    chord = spacing**2 / (8.0 * R)
    touched = OnMesh(wheel_mesh(**smooth, spacing=spacing))
    for point in near_wheel(np.random.default_rng(9), 300):
        rows, exact = touched.rows(point, 0.02), met(on_wheel(point, 0.02, smooth))
        assert len(rows) == len(exact) == 1
        assert rows[0, DISTANCE] == pytest.approx(exact[0, DISTANCE], abs=1.01 * chord)
        # A facet leans by half the angle between two at most, and where two faces are as near by rounding, either counts.
        if abs(abs(exact[0, NORMAL + 1]) - 0.5) > 0.49 and not abs(np.hypot(point[0], point[2]) - R - abs(point[1]) + 0.5 * B) < 2 * chord:
            assert rows[0, NORMAL:] @ exact[0, NORMAL:] > math.cos(0.51 * spacing / R) - 1e-9


@pytest.mark.parametrize(
    ("mesh", "places"),
    [
        (trimesh.creation.box((0.04, 0.04, 0.04)).subdivide(), [(0.021, 0.003, 0.023), (0.021, 0.0205, 0.023), (0.02, 0.0, 0.017)]),
        (trimesh.creation.icosphere(3, 0.02), [(0.022, 0.0, 0.0), (0.0, 0.013, 0.02)]),
        (voxels(floor_with((0, 0, 1), (0, 1, 1), (0, 2, 1))), [(0.014, 0.012, 0.014), (0.014, 0.01, 0.0195), (0.0101, 0.015, 0.0225)]),
    ],
    ids=["box", "ball", "step"],
)
def test_no_jump_over_the_edges_of_a_mesh(mesh, places):
    touched = OnMesh(mesh)
    for path in paths(np.random.default_rng(10), 15, [np.array(place) for place in places], length=300):
        totals = np.array([total(touched.rows(point, 0.005), 0.005) for point in path])
        assert np.abs(np.diff(totals)).max() < 2.0 * STEP
