"""The wheel as mesh, cloud, analytic surface and contact geometry: one wheel; and how it rolls."""

import math

import numpy as np
import pytest
import trimesh
from meshes import Scene, pose, random_rotation

from cdl_fmu.cloud import cloud_of
from cdl_fmu.frames import axis_rotation
from cdl_fmu.mesh.contacts import GAP, ID, KINDS, NORMAL, POINT, RIM_EDGE, RIM_FACE, RIM_VERTEX, A
from cdl_fmu.mesh.rocks import rock
from cdl_fmu.slave.model import ModelError
from cdl_fmu.wheel_mesh import grouser_plates, wheel_mesh
from cdl_fmu.wheel_surface import wheel_distance

R, W = 0.125, 0.125
WHEEL = dict(r_w=R, b_w=W, n_g=12, h_g=0.010, t_g=0.002)  # Table 8.2
MARGIN = 0.004
SMOOTH, TESSELLATED, PLATES = -1, 0, 1


def rolled(angle):
    """World to wheel after rolling ahead by an angle [rad]."""
    return axis_rotation(2, angle)


@pytest.mark.parametrize("spacing", [2.5e-3, 1e-3])
def test_mesh_and_cloud_lie_on_the_analytic_surface(spacing):
    mesh = wheel_mesh(**WHEEL, spacing=spacing)
    chord = spacing**2 / (8.0 * R)
    at_vertices = np.array([wheel_distance(*v, **WHEEL) for v in mesh.vertices if np.hypot(v[0], v[2]) > 0.0])
    assert np.abs(at_vertices).max() < 1e-12
    elements = cloud_of("wheel", mesh, 4e-3).elements
    distances = np.array([wheel_distance(*e[:3], **WHEEL) for e in elements])
    assert distances.max() < 1e-12 and distances.min() > -1.01 * chord
    outside = np.array([wheel_distance(*(e[:3] + 1e-4 * e[3:6]), **WHEEL) for e in elements])
    assert np.median(outside) == pytest.approx(1e-4, abs=1e-9) and outside.min() > 0.0


def test_area_and_volume_are_those_of_the_closed_form():
    mesh = wheel_mesh(**WHEEL, spacing=2e-4)
    half = 0.5 * WHEEL["t_g"]
    root = math.asin(half / R)
    profile = math.pi * R**2 + 12 * (2 * half * (R + 0.010) - half * math.sqrt(R**2 - half**2) - R**2 * root)
    outline = (2.0 * math.pi - 24.0 * root) * R + 12 * (2.0 * half + 2.0 * (R + 0.010 - R * math.cos(root)))
    assert mesh.volume == pytest.approx(W * profile, rel=1e-6)
    assert mesh.area == pytest.approx(W * outline + 2.0 * profile, rel=1e-6)
    cloud = cloud_of("wheel", mesh, 4e-3)
    assert cloud.elements[:, 6].sum() == pytest.approx(mesh.area, rel=1e-12) and cloud.volume == mesh.volume


def test_distances_from_the_analytic_surface():
    assert wheel_distance(0.0, 0.0, -0.140, **WHEEL) == pytest.approx(0.005)
    assert wheel_distance(0.0, 0.0655, 0.1390, **WHEEL) == pytest.approx(0.005)
    assert wheel_distance(0.0, 0.0, 0.0, **WHEEL) == pytest.approx(-0.0625)
    between = math.radians(15.0)
    assert wheel_distance(0.130 * math.sin(between), 0.0, -0.130 * math.cos(between), **WHEEL) == pytest.approx(0.005)
    assert wheel_distance(0.0, 0.0, -0.130, **(WHEEL | {"n_g": 0})) == pytest.approx(0.005)


def test_plates_stand_where_the_mesh_has_its_grousers():
    plates = grouser_plates(**WHEEL)
    assert plates.is_watertight and plates.volume > 0.0 and len(plates.faces) == 144
    distance = np.array([wheel_distance(*v, **WHEEL) for v in plates.vertices])
    outer = np.hypot(plates.vertices[:, 0], plates.vertices[:, 2]) > R
    assert outer.sum() == 48 and distance[outer] == pytest.approx(0.0, abs=1e-12) and distance.max() < 1e-12


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"n_g": 0}, "n_g = 0, h_g = 0.01 m: a smooth wheel has no plates; give both above 0, or use the rim alone"),
        ({"n_g": 400}, "n_g = 400: grousers of t_g = 0.002 m overlap on the 0.785 m around the rim; use at most 392 or thinner ones"),
    ],
)
def test_plates_that_are_none_are_refused(change, text):
    with pytest.raises(ModelError, match=text):
        grouser_plates(**(WHEEL | change))


@pytest.fixture(scope="module")
def floor():
    return Scene(trimesh.creation.box((2.0, 1.0, 0.1)), trimesh.creation.box((2.0, 0.05, 0.1)), grouser_plates(**WHEEL))


@pytest.mark.parametrize("gap", [0.002, -0.001])
def test_a_smooth_wheel_rolls_on_a_floor_without_ripple(floor, gap):
    for x in np.linspace(-0.5, 0.5, 101):
        rows = floor.wheel(R, W, SMOOTH, pose((x, 0.1, 0.05 + R + gap), rolled(x / R)), 0, pose(), MARGIN)
        ends = np.unique(rows[:, POINT : POINT + 3].round(9), axis=0)  # twice where the floor's diagonal runs below
        assert ends == pytest.approx(np.array([[x, 0.0375, 0.05 + 0.5 * gap], [x, 0.1625, 0.05 + 0.5 * gap]]), abs=1e-9)
        assert rows[:, GAP] == pytest.approx(gap, abs=1e-12) and set(rows[:, ID] % KINDS) == {RIM_FACE}
        assert rows[:, NORMAL + 2] == pytest.approx(1.0) and set(rows[:, A]) == {7}


@pytest.mark.parametrize("gap", [0.002, -0.001])
def test_a_wheel_on_a_rail_rolls_on_both_its_edges(floor, gap):
    for x in np.linspace(-0.5, 0.5, 41):
        rows = floor.wheel(R, W, SMOOTH, pose((x, 0.01, 0.05 + R + gap), rolled(x / R)), 1, pose(), MARGIN)
        assert rows[:, ID] % KINDS == pytest.approx([RIM_EDGE] * 2)
        assert rows[:, GAP] == pytest.approx(gap, abs=1e-12)
        assert sorted(rows[:, POINT + 1]) == pytest.approx([-0.025, 0.025]) and rows[:, POINT] == pytest.approx(x)


@pytest.mark.parametrize("gap", [0.001, -0.001])
def test_a_wheel_against_a_step(floor, gap):
    """Its edge runs along the axle: touched at both ends of the rim."""
    angle = 0.6
    x, z = 1.0 + (R + gap) * math.sin(angle), 0.05 + (R + gap) * math.cos(angle)
    rows = floor.wheel(R, W, SMOOTH, pose((x, 0.1, z), rolled(1.0)), 0, pose(), MARGIN)
    assert set(rows[:, ID] % KINDS) == {RIM_EDGE}
    assert rows[:, GAP] == pytest.approx(gap, abs=1e-12)
    assert sorted(rows[:, POINT + 1]) == pytest.approx([0.0375, 0.1625])
    assert rows[:, NORMAL : NORMAL + 3] == pytest.approx(np.tile([math.sin(angle), 0.0, math.cos(angle)], (len(rows), 1)))


def test_a_wheel_that_leans_touches_with_one_end(floor):
    T = rolled(0.3) @ axis_rotation(1, 0.2)
    low = R * math.cos(0.2) + 0.5 * W * math.sin(0.2)
    rows = floor.wheel(R, W, SMOOTH, pose((0.0, 0.0, 0.05 + low - 0.001), T), 0, pose(), MARGIN)
    assert rows[:, GAP].min() == pytest.approx(-0.001, abs=1e-12)
    assert rows[:, NORMAL + 2] == pytest.approx(1.0)


def test_a_spike_in_the_rim():
    spike = trimesh.creation.cone(0.002, 0.05, sections=16)
    spike.apply_translation((0.0, 0.0, -0.05))
    rows = Scene(spike).wheel(R, W, SMOOTH, pose(), 0, pose((0.0, 0.0, -R + 0.002)), MARGIN)
    tip = rows[rows[:, ID] % KINDS == RIM_VERTEX]
    assert len(tip) == 1 and tip[0, GAP] == pytest.approx(-0.002, abs=1e-9)
    assert tip[0, NORMAL : NORMAL + 3] == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)


@pytest.mark.parametrize("gap", [0.001, -0.001])
def test_a_corner_beside_the_rim_presses_along_the_axle(gap):
    cube, T = trimesh.creation.box((0.05, 0.05, 0.05)), axis_rotation(1, 0.6) @ axis_rotation(3, 0.7)
    reach = -(cube.vertices @ T)[:, 1].min()
    rows = Scene(cube).wheel(R, W, SMOOTH, pose(), 0, pose((0.0, 0.5 * W + reach + gap, -0.08), T), 0.003)
    corner = rows[rows[:, GAP].argmin()]
    assert corner[ID] % KINDS == RIM_VERTEX and corner[GAP] == pytest.approx(gap, abs=1e-12)
    assert corner[NORMAL : NORMAL + 3] == pytest.approx([0.0, -1.0, 0.0], abs=1e-12)


def test_a_wheel_stands_on_its_grousers(floor):
    rows = floor.wheel(R, W, 2, pose((0.0, 0.0, 0.05 + R + 0.010 - 0.001)), 0, pose(), MARGIN)
    assert len(rows) == 4 and rows[:, GAP] == pytest.approx(-0.001, abs=1e-12)
    assert sorted(map(tuple, rows[:, POINT : POINT + 2].round(9))) == [(x, y) for x in (-0.001, 0.001) for y in (-0.0625, 0.0625)]
    assert set(rows[:, A]) == {7}


def test_plates_within_the_rim_make_no_contacts(floor):
    rows = floor.wheel(R, W, 2, pose((0.0, 0.0, 0.05 + R - 0.001), rolled(math.radians(15.0))), 0, pose(), MARGIN)
    assert set(rows[:, ID] % KINDS) == {RIM_FACE} and rows[:, GAP] == pytest.approx(-0.001, abs=1e-12)


@pytest.mark.parametrize("smooth", [True, False])
def test_rim_and_plates_agree_with_the_tessellated_wheel_on_rocks(smooth):
    spacing = 1e-3
    chord = spacing**2 / (8.0 * R)
    fine = wheel_mesh(**(WHEEL | ({"n_g": 0} if smooth else {})), spacing=spacing)
    scene = Scene(fine, grouser_plates(**WHEEL), *(rock(seed, (0.25, 0.2, 0.15), 0.3) for seed in range(3)))
    random, errors = np.random.default_rng(0), []
    for k in range(120):
        T = random_rotation(random) if k % 2 else rolled(random.uniform(0.0, 6.0)) @ axis_rotation(1, 0.2 * random.normal())
        stone, where, goal = 2 + k % 3, pose(random.uniform(-0.04, 0.04, 3), random_rotation(random)), random.uniform(-5e-4, 1e-3)
        wheel = pose((*random.uniform(-0.08, 0.08, 2), 0.45), T)
        while wheel["r_0"][2] > 0.0:  # lower it until it is as near as wanted
            rows = scene.wheel(0.0, W, TESSELLATED, wheel, stone, where, MARGIN)
            gap = rows[:, GAP].min(initial=math.inf)
            if gap <= goal:
                break
            wheel["r_0"][2] -= max(0.3 * (gap - goal), 2e-5) if gap < math.inf else 2e-3
        if gap > -1e-3:
            exact = scene.wheel(R, W, SMOOTH if smooth else PLATES, wheel, stone, where, MARGIN)
            errors.append(exact[:, GAP].min(initial=math.inf) - gap)
    assert len(errors) > 100
    # Where bodies do not overlap the exact rim is nearer by a chord's sagitta at most; a facet's depth may be that of another facet.
    assert np.median(np.abs(errors)) < chord
    assert min(errors) > -1.1 * chord and max(errors) < 30.0 * chord


def test_contacts_keep_their_numbers_while_the_wheel_rolls():
    stone = rock(1, (0.3, 0.25, 0.2))
    scene = Scene(stone)
    top = stone.vertices[:, 2].max()
    kept = total = 0
    before = None
    for x in np.arange(-0.02, 0.02, 1e-4):
        rows = scene.wheel(R, W, SMOOTH, pose((x, 0.0, top + R - 0.002), rolled(x / R)), 0, pose(), MARGIN)
        now = set(rows[:, ID])
        assert len(now) == len(rows)
        if before is not None:
            kept, total = kept + len(now & before), total + len(now)
        before = now
    assert total > 100 and kept > 0.95 * total
