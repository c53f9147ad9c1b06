"""The parametric wheel as a mesh: closed, of the right volume, with the grousers where the contact models have them."""

import math

import numpy as np
import pytest

from cdl_fmu.cloud import load_cloud
from cdl_fmu.slave.model import ModelError
from cdl_fmu.wheel_mesh import wheel_mesh

WHEEL = dict(r_w=0.125, b_w=0.125, n_g=12, h_g=0.010, t_g=0.002)  # Table 8.2


def profile_area(r_w, n_g, h_g, t_g):
    """Circle and the parts of the plates outside it [m2]."""
    half = 0.5 * t_g
    inside = half * math.sqrt(r_w**2 - half**2) + r_w**2 * math.asin(half / r_w)
    return math.pi * r_w**2 + n_g * (t_g * (r_w + h_g) - inside)


@pytest.mark.parametrize(
    "change", [{}, {"n_g": 0}, {"h_g": 0.0}, {"n_g": 1}, {"n_g": 24, "t_g": 0.02}, {"n_g": 2, "t_g": 0.2}, {"h_g": 0.2}, {"r_w": 1.0}]
)
def test_closed_and_of_the_volume_of_the_wheel(change):
    wheel = WHEEL | change
    n_g = wheel["n_g"] if wheel["h_g"] > 0.0 else 0
    volume = wheel["b_w"] * profile_area(wheel["r_w"], n_g, wheel["h_g"], wheel["t_g"])
    spacing = 1e-3
    mesh = wheel_mesh(**wheel, spacing=spacing)
    assert mesh.is_watertight and mesh.is_winding_consistent
    # Chords of the angle a cut a^2 / 6 off the circle's sectors.
    assert volume * (1.0 - (spacing / wheel["r_w"]) ** 2 / 6.0) < mesh.volume < volume


def test_volume_to_the_last_digit():
    # 6.25 mm chords: 128 sides, all vertices on the rim.
    mesh = wheel_mesh(0.125, 0.1, 0, 0.0, 0.0, spacing=2.0 * math.pi * 0.125 / 128.0 * (1.0 + 1e-9))
    assert mesh.volume == pytest.approx(0.1 * 64.0 * 0.125**2 * math.sin(2.0 * math.pi / 128.0), rel=1e-13)


def test_the_rim_is_round_to_a_tenth_of_a_millimetre():
    mesh = wheel_mesh(**WHEEL)
    middles = mesh.vertices[mesh.edges_unique].mean(axis=1)
    on_rim = (np.abs(middles[:, 1]) == 0.0625) & (np.hypot(middles[:, 0], middles[:, 2]) > 0.12)
    assert np.hypot(middles[on_rim, 0], middles[on_rim, 2]).min() > 0.125 - 1e-5
    ring = mesh.vertices[np.hypot(mesh.vertices[:, 0], mesh.vertices[:, 2]) > 0.0]
    radius = np.hypot(ring[:, 0], ring[:, 2])
    assert set(np.round(radius, 9)) == {0.125, round(math.hypot(0.135, 0.001), 9)}


def test_one_grouser_points_down_and_the_next_is_a_pitch_on():
    vertices = wheel_mesh(**WHEEL).vertices
    tips = vertices[np.hypot(vertices[:, 0], vertices[:, 2]) > 0.13]
    assert len(tips) == 4 * 12
    lowest = tips[tips[:, 2] < -0.135 + 1e-12]
    assert sorted(map(tuple, np.round(lowest, 12))) == [(x, y, -0.135) for x in (-0.001, 0.001) for y in (-0.0625, 0.0625)]
    angle = np.degrees(np.arctan2(tips[:, 0], -tips[:, 2]))
    assert set(np.round(angle / 30.0) % 12) == set(range(12))
    assert np.abs((angle + 15.0) % 30.0 - 15.0) == pytest.approx(math.degrees(math.atan(0.001 / 0.135)), rel=1e-9)


def test_an_stl_of_it_is_the_same_wheel(tmp_path):
    mesh = wheel_mesh(**WHEEL)
    mesh.export(tmp_path / "wheel.stl")
    cloud = load_cloud(tmp_path / "wheel.stl", 2.5e-3)
    assert cloud.volume == pytest.approx(mesh.volume, rel=1e-6)
    assert cloud.bounds == pytest.approx(mesh.bounds, abs=1e-7)
    assert cloud.elements[:, 6].sum() == pytest.approx(mesh.area, rel=1e-6)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"r_w": -1.0}, r"r_w = -1 m: it must be at least 0.001 m \(Wheel radius without grousers\)"),
        ({"b_w": math.nan}, r"b_w = nan m: it must be finite"),
        ({"n_g": 2.5}, r"n_g = 2.5: the number of grousers must be whole"),
        ({"t_g": 0.0}, r"t_g = 0 m: a mesh cannot have grousers without thickness; give one above 0 m, or n_g = 0"),
        ({"n_g": 400}, r"n_g = 400: grousers of t_g = 0.002 m overlap on the 0.785 m around the rim; use at most 392 or thinner ones"),
        ({"n_g": 1, "t_g": 0.3}, r"n_g = 1: grousers of t_g = 0.3 m overlap on the 0.785 m around the rim; use at most 0 or thinner ones"),
        ({"spacing": 0.0}, r"spacing = 0 m: it must be above 0 m \(longest chord of the rim\)"),
    ],
)
def test_a_wheel_that_is_none_is_refused(change, text):
    with pytest.raises(ModelError, match=text):
        wheel_mesh(**(WHEEL | change))
