"""Rays on meshes, and the contact plane of Fig. 8.4 on them."""

import math

import numpy as np
import pytest
import trimesh
from meshes import POSE, Scene, grid, pose, random_rotation

from cdl_fmu.frames import axis_rotation
from cdl_fmu.mesh.ray import cast_down, mesh_ground
from cdl_fmu.mesh.rocks import rock
from cdl_fmu.slave.interface import patch_in, wheel_pose
from cdl_fmu.terrain.plane import contact_plane

R, W = 0.135, 0.125


def poses(*records):
    array = np.zeros(len(records), POSE)
    for row, record in zip(array, records):
        row["r_0"], row["T"] = record["r_0"], record["T"]
    return array


def wheel_at(x, y, z, T=None):
    wheel = wheel_pose(1).starts().view(wheel_pose(1).dtype)[0]["wheel"]
    wheel["r_0"], wheel["T"] = (x, y, z), np.eye(3) if T is None else T
    return wheel[0]


def test_rays_on_a_turned_rock_end_where_all_its_faces_say():
    stone, random = rock(1, (0.3, 0.2, 0.2), 0.4), np.random.default_rng(0)
    scene = Scene(stone)
    hits = 0
    for _ in range(20):
        where = pose(random.uniform(-0.1, 0.1, 3), random_rotation(random))
        corners = (where["r_0"] + stone.vertices @ where["T"])[stone.faces]
        a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
        normal = np.cross(b - a, c - a)
        for x, y in random.uniform(-0.15, 0.15, (20, 2)):
            z = a[:, 2] - (normal[:, 0] * (x - a[:, 0]) + normal[:, 1] * (y - a[:, 1])) / normal[:, 2]
            p = np.stack([np.full_like(z, x), np.full_like(z, y), z], axis=1)
            over = np.all([(np.cross(q - o, p - o) * normal).sum(axis=1) >= 0.0 for o, q in ((a, b), (b, c), (c, a))], axis=0)
            hit, height, *n = cast_down(scene.meshes, 0, where, x, y, 1.0, scene.scratch.stack)
            assert hit == over.any()
            if hit:
                k = np.flatnonzero(over)[z[over].argmax()]
                assert height == pytest.approx(z[k], abs=1e-12)
                assert n == pytest.approx(normal[k] / np.linalg.norm(normal[k]), abs=1e-12)
                hits += 1
    assert hits > 100


def test_a_ray_begins_where_it_is_told():
    table = trimesh.creation.box((1.0, 1.0, 0.1)) + trimesh.creation.box((1, 1, 0.1), trimesh.transformations.translation_matrix((0, 0, 1)))
    scene = Scene(table)
    assert cast_down(scene.meshes, 0, pose(), 0.1, 0.2, 2.0, scene.scratch.stack) == pytest.approx((True, 1.05, 0.0, 0.0, 1.0))
    assert cast_down(scene.meshes, 0, pose(), 0.1, 0.2, 0.9, scene.scratch.stack) == pytest.approx((True, 0.05, 0.0, 0.0, 1.0))
    assert not cast_down(scene.meshes, 0, pose(), 0.1, 0.2, -0.9, scene.scratch.stack)[0]


def test_no_ray_slips_through_an_open_ground_along_its_edges():
    scene = Scene(grid(lambda x, y: 0.1 * x))
    for x, y in np.stack(np.meshgrid(np.linspace(-0.9, 0.9, 19), np.linspace(-0.9, 0.9, 37)), axis=-1).reshape(-1, 2):
        hit, z, *n = cast_down(scene.meshes, 0, pose(), x, y, 1.0, scene.scratch.stack)
        assert hit and z == pytest.approx(0.1 * x, abs=1e-12) and n == pytest.approx(np.array([-0.1, 0.0, 1.0]) / math.hypot(0.1, 1.0))


def test_an_exact_plane_is_recovered_from_a_mesh():
    ground = mesh_ground(Scene(grid(lambda x, y: 0.2 * x - 0.1 * y, n=7)).meshes, poses(pose((0.0, 0.0, 0.003))))
    found, *plane = contact_plane(None, wheel_at(0.1, 0.05, R - 0.03), R, W, None, ground)
    assert found and plane[:3] == pytest.approx(np.array([-0.2, 0.1, 1.0]) / math.sqrt(1.05), abs=1e-12)
    height = 0.2 * (0.1 + plane[3]) - 0.1 * (0.05 + plane[4]) + 0.003 - (R - 0.03)
    assert plane[5] == pytest.approx(height, abs=1e-12)


@pytest.mark.parametrize("heading", [0.0, 0.8])
def test_a_mesh_and_a_patch_of_one_hill_give_one_plane(heading):
    def hill(x, y):
        return 0.03 * np.sin(6.0 * x) * np.cos(5.0 * y)

    patch = patch_in(1).starts().view(patch_in(1).dtype)[0]["patch"]
    patch["spacing"], patch["origin"] = 0.03, (-0.15, -0.12)
    patch["z"][0] = hill(-0.15 + 0.03 * np.arange(13)[:, None], -0.12 + 0.03 * np.arange(9)[None, :])
    ground = mesh_ground(Scene(grid(hill, n=161, size=0.4)).meshes, poses(pose()))
    wheel = wheel_at(0.03, 0.0, R - 0.015, axis_rotation(3, heading))
    _, *on_patch = contact_plane(patch[0], wheel, R, W)
    _, *on_mesh = contact_plane(None, wheel, R, W, None, ground)
    assert np.degrees(np.arccos(np.dot(on_patch[:3], on_mesh[:3]))) < 0.5
    assert on_mesh[5] == pytest.approx(on_patch[5], abs=5e-4)


def test_the_highest_of_patch_and_bodies_counts():
    patch = patch_in(1).starts().view(patch_in(1).dtype)[0]["patch"]
    patch["spacing"], patch["origin"] = 0.03, (-0.18, -0.12)
    slab = trimesh.creation.box((1.0, 1.0, 0.1))
    low, high = (mesh_ground(Scene(slab, slab).meshes, poses(pose((0, 0, -1.0)), pose((0, 0, z - 0.05)))) for z in (-0.01, 0.01))
    wheel = wheel_at(0.0, 0.0, R - 0.02)
    assert contact_plane(patch[0], wheel, R, W, None, low) == pytest.approx(contact_plane(patch[0], wheel, R, W))
    found, *plane = contact_plane(patch[0], wheel, R, W, None, high)
    assert found and plane[5] == pytest.approx(0.01 - (R - 0.02))
