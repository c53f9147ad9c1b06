"""Rotations and vectors as kernels on floats; names as in Modelica.Mechanics.MultiBody.Frames.

``T`` rotates from frame 1 (world) to frame 2 (body): ``v_2 = T @ v_1``.
"""

from __future__ import annotations

import math

import numpy as np

from .slave.kernel import kernel

#: Largest entry of |T'T - I| of a matrix that still counts as a rotation.
ROTATION_TOLERANCE = 1e-3


@kernel
def resolve1(T, x, y, z):
    """Transform (x, y, z) from frame 2 (body) to frame 1 (world)."""
    return (
        T[0, 0] * x + T[1, 0] * y + T[2, 0] * z,
        T[0, 1] * x + T[1, 1] * y + T[2, 1] * z,
        T[0, 2] * x + T[1, 2] * y + T[2, 2] * z,
    )


@kernel
def resolve2(T, x, y, z):
    """Transform (x, y, z) from frame 1 (world) to frame 2 (body)."""
    return (
        T[0, 0] * x + T[0, 1] * y + T[0, 2] * z,
        T[1, 0] * x + T[1, 1] * y + T[1, 2] * z,
        T[2, 0] * x + T[2, 1] * y + T[2, 2] * z,
    )


@kernel
def dot(ax, ay, az, bx, by, bz):
    """Scalar product of two vectors."""
    return ax * bx + ay * by + az * bz


@kernel
def cross(ax, ay, az, bx, by, bz):
    """Vector product of two vectors."""
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@kernel
def is_rotation(T):
    """True if T is a rotation within ROTATION_TOLERANCE: orthonormal and right-handed."""
    for i in range(3):
        for j in range(i + 1):
            product = T[0, i] * T[0, j] + T[1, i] * T[1, j] + T[2, i] * T[2, j]
            if not abs(product - (1.0 if i == j else 0.0)) <= ROTATION_TOLERANCE:
                return False
    x, y, z = cross(T[0, 0], T[0, 1], T[0, 2], T[1, 0], T[1, 1], T[1, 2])
    return dot(x, y, z, T[2, 0], T[2, 1], T[2, 2]) > 0.0


@kernel
def vertical(slope, uphill):
    """Unit vector against gravity in the axes of a slope [rad] that rises most towards ``uphill`` [rad] from its x axis."""
    return math.sin(slope) * math.cos(uphill), math.sin(slope) * math.sin(uphill), math.cos(slope)


def axis_rotation(axis: int, angle: float) -> np.ndarray:
    """T of a frame 2 that is frame 1 turned by ``angle`` [rad] about axis 1, 2 or 3 (MultiBody's axisRotation), shape [3, 3]."""
    i, j = axis % 3, (axis + 1) % 3
    T = np.eye(3)
    T[i, i] = T[j, j] = math.cos(angle)
    T[i, j], T[j, i] = math.sin(angle), -math.sin(angle)
    return T
