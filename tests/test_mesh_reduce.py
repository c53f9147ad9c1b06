"""Few candidates out of many, and springs that are shared."""

import math

import numpy as np
import pytest
from meshes import Scene, pose

from cdl_fmu.frames import axis_rotation
from cdl_fmu.mesh.contacts import CONTACT, GAP, ID, NORMAL, POINT, WEIGHT
from cdl_fmu.mesh.reduce import shares, thin_out
from cdl_fmu.mesh.rocks import rock
from cdl_fmu.wheel_mesh import grouser_plates

R, W = 0.125, 0.125


def candidates(*rows):
    """Rows (x, y, gap, tilt of the normal about y [rad])."""
    contacts = np.zeros((len(rows), CONTACT))
    for row, (x, y, gap, tilt) in zip(contacts, rows):
        row[POINT : POINT + 2], row[GAP] = (x, y), gap
        row[NORMAL : NORMAL + 3] = math.sin(tilt), 0.0, math.cos(tilt)
    contacts[:, ID], contacts[:, WEIGHT] = np.arange(len(rows)), 1.0
    return contacts


def kept(contacts, first, n, spacing, most):
    last = thin_out(contacts, first, n, spacing, most)
    return [int(id_) for id_ in contacts[first:last, ID]]


def test_of_near_ones_the_deepest_stays():
    assert kept(candidates((0, 0, 0.001, 0), (0.004, 0, -0.002, 0), (0.1, 0, 0.0, 0)), 0, 3, 0.01, 10) == [1, 2]


def test_near_ones_of_another_direction_stay():
    rows = ((0, 0, -0.001, 0), (0.001, 0, -0.0005, math.radians(25.0)), (0.0, 0.001, 0.0, math.radians(15.0)))
    assert kept(candidates(*rows), 0, 3, 0.01, 10) == [0, 1]


def test_of_too_many_those_far_apart_stay():
    line = [(x, 0.0, -0.001 - 1e-6 * (x == 0.0), 0.0) for x in np.linspace(0.0, 1.0, 11)]
    assert kept(candidates(*line), 0, 11, 0.01, 3) == [0, 10, 5]
    # One that is 50 mm off the ground is no use.
    line[10] = (1.0, 0.0, 0.05, 0.0)
    assert 10 not in kept(candidates(*line), 0, 11, 0.01, 3)


def test_rows_before_the_first_one_are_left_alone():
    contacts = candidates((0, 0, 0.001, 0), (0, 0, -0.002, 0), (0, 0, -0.001, 0))
    assert kept(contacts, 1, 3, 0.01, 10) == [1]
    assert contacts[0, ID] == 0


def test_points_at_one_place_share_one_spring():
    contacts, out = candidates((0, 0, -0.001, 0), (0, 0, -0.001, 0), (0, 0, -0.001, 0), (0.1, 0, -0.003, 0), (0.1, 0, 0.001, 0)), np.ones(5)
    shares(contacts, 0, 5, 0.02, out)
    assert out == pytest.approx([1 / 3, 1 / 3, 1 / 3, 1.0, 0.0])


def test_points_apart_or_across_each_other_have_their_own_springs():
    out = np.zeros(3)
    shares(candidates((0, 0, -0.001, 0), (0.02, 0, -0.004, 0), (0, 0, -0.002, 0.5 * math.pi)), 0, 3, 0.02, out)
    assert out == pytest.approx(1.0)


def test_a_new_point_changes_nothing():
    def force(depth):
        contacts, out = candidates((0, 0, -0.001, 0), (0.005, 0, -depth, 0.2)), np.zeros(2)
        shares(contacts, 0, 2, 0.02, out)
        return -contacts[:, GAP] * out

    assert force(1e-9) == pytest.approx(force(0.0), abs=2e-9)
    assert force(1e-9)[1] < 1e-12


class Roller:
    """A wheel on a rock, and its elastic force for a stiffness of 1 N/m with its moment about the centre over the radius."""

    def __init__(self, own):
        self.stone, self.own = rock(1, (0.3, 0.25, 0.2)), own
        self.scene, self.out = Scene(self.stone, grouser_plates(R, W, 12, 0.010, 0.002)), np.zeros(1000)

    def rows(self, x, z):
        return self.scene.wheel(R, W, self.own, self.pose(x, z), 0, pose(), 0.004)

    def pose(self, x, z):
        return pose((x, 0.01, z), axis_rotation(2, x / R))

    def load(self, x, z):
        rows = self.rows(x, z)
        shares(rows, 0, len(rows), 0.02, self.out)
        each = (np.maximum(-rows[:, GAP], 0.0) * self.out[: len(rows)])[:, None] * rows[:, NORMAL : NORMAL + 3]
        arm = rows[:, POINT : POINT + 3] - self.pose(x, z)["r_0"]
        return np.concatenate([each.sum(axis=0), np.cross(arm, each).sum(axis=0) / R])

    def resting(self, x):
        """Height at which it is 0.8 mm deep."""
        z = 0.3
        while self.rows(x, z)[:, GAP].min(initial=math.inf) > -0.0008:
            z -= 2e-4
        return z


@pytest.mark.parametrize("own", [-1, 1])
def test_the_force_is_continuous_as_a_wheel_rolls_over_a_rock(own):
    wheel, step = Roller(own), 2e-5
    for start in np.linspace(-0.08, 0.08, 9):
        z = wheel.resting(start)
        loads = np.array([wheel.load(x, z) for x in start + step * np.arange(150)])
        jumps = np.abs(np.diff(loads, axis=0)).max(axis=1)
        # A depth changes by at most the step, times a few points that touch; a point that came in with its depth at once would be 8e-4.
        assert jumps.max() < 8.0 * step


@pytest.mark.parametrize("own", [-1, 1])
def test_small_changes_of_the_pose_change_the_force_little(own):
    wheel, random = Roller(own), np.random.default_rng(0)
    for x in random.uniform(-0.08, 0.08, 40):
        z = wheel.resting(x)
        moved = wheel.load(x + 1e-7, z - 1e-7)
        assert np.abs(moved - wheel.load(x, z)).max() < 2e-6


def test_a_candidate_that_fades_out_takes_nothing_from_its_neighbour():
    """Together they bear as one spring at any weight, and alone one bears its weight."""
    contacts, out = candidates((0, 0, -0.001, 0), (0, 0, -0.001, 0), (0.1, 0, -0.001, 0)), np.ones(3)
    for weight in np.linspace(0.01, 1.0, 12):
        contacts[1, WEIGHT] = contacts[2, WEIGHT] = weight
        shares(contacts, 0, 3, 0.02, out)
        assert out[0] + out[1] == pytest.approx(1.0)
        assert out[2] == pytest.approx(weight)
