import numpy as np
import pytest

from cdl_fmu.frames import axis_rotation, cross, dot, is_rotation, resolve1, resolve2


def test_axis_rotation_turns_the_frame_as_in_multibody():
    T = axis_rotation(3, np.pi / 2)  # frame 2's x axis points along world y
    assert resolve1(T, 1.0, 0.0, 0.0) == pytest.approx((0, 1, 0))
    assert resolve2(T, 0.0, 1.0, 0.0) == pytest.approx((1, 0, 0))
    assert axis_rotation(1, 0.3) @ axis_rotation(1, -0.3) == pytest.approx(np.eye(3))


def test_resolve1_undoes_resolve2():
    T = axis_rotation(2, 0.7) @ axis_rotation(1, -1.1) @ axis_rotation(3, 2.0)
    v = (0.3, -2.0, 1.5)
    assert resolve1(T, *resolve2(T, *v)) == pytest.approx(v)
    assert resolve2(T, *v) == pytest.approx(tuple(T @ v))


def test_products():
    assert cross(1.0, 0.0, 0.0, 0.0, 1.0, 0.0) == (0, 0, 1)
    assert dot(1.0, 2.0, 3.0, 4.0, 5.0, 6.0) == 32


def test_is_rotation():
    T = axis_rotation(2, 0.7) @ axis_rotation(1, -1.1)
    assert is_rotation(T)
    assert is_rotation(T * 1.0004)
    assert not is_rotation(T * 1.001)
    assert not is_rotation(np.zeros((3, 3)))
    assert not is_rotation(np.diag((1.0, 1.0, -1.0)))
    assert not is_rotation(np.full((3, 3), np.nan))
