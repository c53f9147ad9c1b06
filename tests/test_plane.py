"""Contact plane of Fig. 8.4: rays, least squares, eigenvector."""

import numpy as np
import pytest

from cdl_fmu.frames import axis_rotation
from cdl_fmu.slave.interface import patch_in, wheel_pose
from cdl_fmu.terrain.patch import surface
from cdl_fmu.terrain.plane import contact_plane, smallest_eigenvector

R, B = 0.135, 0.125


@pytest.fixture
def scene():
    """A patch and a wheel as records, the wheel 30 mm in the ground z = 0."""
    patch = patch_in(1).starts().view(patch_in(1).dtype)[0]["patch"]
    patch["spacing"], patch["origin"] = 0.03, (-0.18, -0.12)
    wheel = wheel_pose(1).starts().view(wheel_pose(1).dtype)[0]["wheel"]
    wheel["r_0"] = (0, 0, R - 0.03)
    return patch, wheel


def nodes(patch):
    x = patch["origin"][0, 0] + 0.03 * np.arange(13)[:, None]
    y = patch["origin"][0, 1] + 0.03 * np.arange(9)[None, :]
    return x, y


def test_surface_is_bilinear_between_nodes_and_ends_at_the_edge(scene):
    patch, _ = scene
    x, y = nodes(patch)
    patch["z"][0] = 0.3 * x - 0.2 * y + 0.1
    assert surface(patch[0], 0.05, 0.02) == pytest.approx((True, 0.3 * 0.05 - 0.2 * 0.02 + 0.1, 0.3, -0.2))
    assert surface(patch[0], 0.1799999, 0.1199999)[0]
    assert not surface(patch[0], 0.181, 0.0)[0]
    assert not surface(patch[0], 0.0, -0.121)[0]


@pytest.mark.parametrize("slopes", [(0.0, 0.0), (0.3, -0.2), (-0.5, 0.1)])
@pytest.mark.parametrize("heading", [0.0, 0.7])
@pytest.mark.parametrize("camber", [0.0, 0.2])
def test_an_exact_plane_is_recovered(scene, slopes, heading, camber):
    patch, wheel = scene
    x, y = nodes(patch)
    patch["z"][0] = slopes[0] * x + slopes[1] * y + 0.003
    wheel["T"][0] = axis_rotation(1, camber) @ axis_rotation(3, heading)
    found, *plane = contact_plane(patch[0], wheel[0], R, B)
    normal, point = np.array(plane[:3]), np.array(plane[3:])
    assert found
    assert normal == pytest.approx(np.array((-slopes[0], -slopes[1], 1)) / np.hypot(np.hypot(*slopes), 1), abs=1e-12)
    height = slopes[0] * point[0] + slopes[1] * point[1] + 0.003 - wheel["r_0"][0, 2]
    assert point[2] == pytest.approx(height, abs=1e-12)


def test_noise_of_2_mm_tilts_the_plane_by_a_few_degrees_at_most(scene):
    patch, wheel = scene
    rng = np.random.default_rng(0)
    tilts = []
    for _ in range(200):
        patch["z"][0] = rng.normal(0, 0.002, (13, 9))
        tilts.append(np.degrees(np.arccos(min(1.0, contact_plane(patch[0], wheel[0], R, B)[3]))))
    assert np.mean(tilts) < 1.5
    assert np.quantile(tilts, 0.95) < 3.0


def test_no_ray_hits_below_a_raised_wheel(scene):
    patch, wheel = scene
    wheel["r_0"][0, 2] = R + 0.001
    assert not contact_plane(patch[0], wheel[0], R, B)[0]


def test_smallest_eigenvector_agrees_with_lapack():
    rng = np.random.default_rng(0)
    for k in range(200):
        A = rng.normal(size=(3, 3))
        A = A + A.T if k % 2 else A[:, :1] @ A[:, :1].T * 1e-3 - A[:, 1:2] @ A[:, 1:2].T
        vector = np.array(smallest_eigenvector(A[0, 0], A[0, 1], A[0, 2], A[1, 1], A[1, 2], A[2, 2]))
        reference = np.linalg.eigh(A)[1][:, 0]
        assert abs(vector @ reference) == pytest.approx(1.0, abs=1e-13)
    assert smallest_eigenvector(1.0, 0.0, 0.0, 0.5, 0.0, 2.0) == (0.0, 1.0, 0.0)
