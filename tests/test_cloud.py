"""Closed meshes as surface elements, and what a mesh that bounds no body is told."""

import math

import numpy as np
import pytest
import trimesh

from cdl_fmu.cloud import load_cloud
from cdl_fmu.slave.model import ModelError

SIZE = (0.30, 0.20, 0.10)  # [m] of the box


@pytest.fixture
def file(tmp_path):
    def write(mesh, name="plate.stl"):
        path = tmp_path / name
        mesh.export(path)
        return path

    return write


def box(size=SIZE, centre=(0.0, 0.0, 0.0)):
    return trimesh.creation.box(extents=size, transform=trimesh.transformations.translation_matrix(centre))


def enclosed(elements):
    """Volume by Gauss's theorem from the elements alone [m3]."""
    return (elements[:, :3] * elements[:, 3:6]).sum(axis=1) @ elements[:, 6] / 3.0


@pytest.mark.parametrize("name", ["plate.stl", "plate.obj", "plate.ply", "PLATE.STL"])
def test_a_box_in_each_format(file, name):
    cloud = load_cloud(file(box(), name), 0.01)
    assert cloud.volume == pytest.approx(0.006, rel=1e-6)
    assert cloud.bounds == pytest.approx(np.array([[-0.15, -0.10, -0.05], [0.15, 0.10, 0.05]]), abs=1e-8)
    assert cloud.radius == pytest.approx(math.hypot(0.15, 0.10, 0.05), rel=1e-6)
    assert cloud.plan_area == pytest.approx(0.06, rel=1e-6)
    assert cloud.plan_perimeter == pytest.approx(1.0, rel=1e-6)


@pytest.mark.parametrize("spacing", [1.0, 0.03, 0.004])
def test_elements_cover_the_surface(file, spacing):
    mesh = trimesh.creation.torus(0.3, 0.1, 32, 16)
    elements = load_cloud(file(mesh), spacing).elements
    assert elements.dtype == np.float64 and elements.flags.c_contiguous and elements.shape[1] == 7
    assert np.linalg.norm(elements[:, 3:6], axis=1) == pytest.approx(1.0, abs=1e-12)
    assert elements[:, 6].min() > 0.0 and elements[:, 6].sum() == pytest.approx(mesh.area, rel=1e-6)
    assert elements[:, 3:6].T @ elements[:, 6] == pytest.approx(0.0, abs=1e-12)
    assert enclosed(elements) == pytest.approx(mesh.volume, rel=1e-6)


@pytest.mark.parametrize("spacing", [0.02, 0.005])
def test_no_part_of_the_surface_is_far_from_an_element(file, spacing):
    path = file(box((0.3, 0.2, 0.002)))
    elements = load_cloud(path, spacing).elements
    points, _ = trimesh.sample.sample_surface(trimesh.load_mesh(path), 2000, seed=1)
    distance = np.linalg.norm(points[:, None] - elements[None, :, :3], axis=2).min(axis=1)
    assert distance.max() < spacing
    # The number grows with the surface, however long and thin the triangles of the file are.
    assert len(elements) < 3.0 * (0.3 * 0.2 * 2.0 + 1.0 * spacing) / spacing**2


def test_equal_files_give_equal_clouds(file):
    mesh = trimesh.creation.icosphere(3, 0.1)
    first, again = (load_cloud(file(mesh, name), 0.005).elements for name in ("a.stl", "b.stl"))
    assert np.array_equal(first, again)


def test_bekkers_width_of_a_disc_is_its_radius(file):
    cloud = load_cloud(file(trimesh.creation.cylinder(0.1, 0.02, sections=256)), 0.01)
    assert 2.0 * cloud.plan_area / cloud.plan_perimeter == pytest.approx(0.1, rel=1e-3)


def test_the_origin_is_the_files(file):
    cloud = load_cloud(file(box(centre=(1.0, 0.0, 0.5))), 0.02)
    assert cloud.radius == pytest.approx(math.hypot(1.15, 0.1, 0.55), rel=1e-6)
    assert cloud.bounds[0] == pytest.approx([0.85, -0.1, 0.45], abs=1e-6)


def test_a_cavity_stays_one(file):
    hollow, cavity = box((1.0, 1.0, 1.0)), box((0.5, 0.5, 0.5))
    cavity.invert()
    assert load_cloud(file(hollow + cavity), 0.05).volume == pytest.approx(0.875, rel=1e-6)


def test_bodies_that_share_an_edge_are_closed(file):
    assert load_cloud(file(box((1.0, 1.0, 1.0)) + box((1.0, 1.0, 1.0), (1.0, 1.0, 0.0))), 0.1).volume == pytest.approx(2.0)


def test_triangles_without_area_do_not_matter(file):
    mesh = box()
    degenerate = np.vstack([mesh.faces, [[0, 0, 1], mesh.faces[0]]])
    elements = load_cloud(file(trimesh.Trimesh(mesh.vertices, degenerate, process=False)), 0.02).elements
    assert elements[:, 6].sum() == pytest.approx(0.22, rel=1e-6)


def refusal(path, spacing=0.01):
    with pytest.raises(ModelError) as raised:
        load_cloud(path, spacing)
    return str(raised.value)


def test_an_open_mesh_is_refused(file):
    mesh = box()
    mesh.update_faces(np.arange(12) > 0)
    text = refusal(file(mesh))
    assert text.startswith("plate.stl is open: 3 of its 18 edges have no second face; close it in the CAD tool or with trimesh.repair")


@pytest.mark.parametrize(
    ("factor", "text"),
    [
        (1000.0, "plate.stl is 300 m across: the file is most likely in millimetres; scale it by 0.001 (metres are expected, up to 20 m)"),
        (0.001, "plate.stl is 0.0003 m across: the file is most likely in kilometres or was scaled to metres twice; scale it by 1000"),
    ],
)
def test_other_units_are_refused(file, factor, text):
    assert text in refusal(file(box(np.array(SIZE) * factor)))


def test_mixed_normals_are_refused(file):
    mesh = box()
    mesh.faces[3] = mesh.faces[3][::-1]
    assert "plate.stl: some triangles face inwards and some outwards; make them agree, e.g. with trimesh" in refusal(file(mesh))


def test_inward_normals_are_refused(file):
    mesh = box()
    mesh.invert()
    text = "plate.stl: its normals point inwards, so that it encloses -0.006 m3; flip them in the CAD tool or with trimesh.repair.fix_"
    assert refusal(file(mesh)) == text + "inversion"


def test_a_body_inside_out_beside_another_is_refused(file):
    one, other = box((1.0, 1.0, 1.0)), box((0.1, 0.1, 0.1), (2.0, 0.0, 0.0))
    other.invert()
    assert "plate.stl: the normals of part 2 of 2 point inwards, so that it encloses -0.001 m3" in refusal(file(one + other))


def test_a_hollow_body_inside_out_is_refused(file):
    hollow, cavity = box((1.0, 1.0, 1.0)), box((0.5, 0.5, 0.5))
    hollow.invert()
    assert "plate.stl: the normals of part 1 of 2 point inwards, so that it encloses -1 m3" in refusal(file(hollow + cavity))


def test_a_sheet_is_refused(file):
    text = refusal(file(box((0.3, 0.2, 1e-12))))
    assert "plate.stl encloses" in text and "m3 of volume: it is flat; give the sheet a thickness" in text


def test_too_many_elements_are_refused(file):
    text = refusal(file(box()), 1e-4)
    assert (
        text.startswith("plate.stl: spacing = 0.0001 m cuts it into 2.53e+07 or more") and "surface elements, the most are 2e+06;" in text
    )
    assert text.endswith(
        "choose a coarser spacing (SCM takes a quarter of its cell, half of it for bodies), simplify the mesh, or scale it if it is not in "
        "metres"
    )
    assert "plate.stl: spacing = 1e-300 m cuts it into" in refusal(file(box()), 1e-300)


@pytest.mark.parametrize("spacing", [0.0, -1.0, math.nan])
def test_a_spacing_that_is_none_is_refused(file, spacing):
    text = refusal(file(box()), spacing)
    assert text == f"spacing = {spacing:g} m: it must be above 0 m (longest side of a surface element of plate.stl)"


def test_files_that_are_no_mesh_are_refused(tmp_path, file):
    assert "gone.stl: no such file; give the path of a mesh (.stl, .obj, .ply)" in refusal(tmp_path / "gone.stl")
    (tmp_path / "folder.stl").mkdir()
    assert "folder.stl: no such file" in refusal(tmp_path / "folder.stl")
    assert "plate.step: a mesh is read from .stl, .obj, .ply; export it as one of these, in metres" in refusal(tmp_path / "plate.step")
    (tmp_path / "noise.ply").write_text("this is no mesh")
    assert "noise.ply is no mesh that can be read" in refusal(tmp_path / "noise.ply")
    (tmp_path / "empty.stl").write_bytes(b"")
    assert "empty.stl has no triangles" in refusal(tmp_path / "empty.stl")
    (tmp_path / "empty.obj").write_text("v 0 0 0\nv 1 0 0\n")
    assert "empty.obj has no triangles: export the surface of the body" in refusal(tmp_path / "empty.obj")
    trimesh.PointCloud(np.random.default_rng(0).random((10, 3))).export(tmp_path / "points.ply")
    assert "points.ply has no triangles" in refusal(tmp_path / "points.ply")
