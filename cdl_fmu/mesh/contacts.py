"""Rows of contact candidates, and the memory in which they are found."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..slave.kernel import kernel
from .surface import Meshes

#: Columns of a candidate: indices of the two bodies; point [m], midway between the surfaces, and unit normal from B to A, the direction of
#: the force on A, both in world axes; gap [m], below 0 where the bodies overlap; a number that tells the pair of features, the same from
#: step to step as long as these touch; and a weight, 1 for what touches and less for what would if it were turned a little.
A, B, POINT, NORMAL, GAP, ID, WEIGHT = 0, 1, 2, 5, 8, 9, 10
CONTACT = 11

#: Kinds of pairs: ID = kind + KINDS * (a number within the kind).
VERTEX_OF_A, VERTEX_OF_B, EDGE_EDGE, RIM_VERTEX, RIM_EDGE, RIM_FACE = range(6)
KINDS = 6

#: Places in ``Scratch.frame``: rotation from B to A row by row, its entries' amounts, B's origin in A's frame [m].
ROTATION, AMOUNTS, ORIGIN = 0, 9, 18
_FRAME = 21
_STACK = 256  # nodes that wait: twice the sum of the depths of two trees of a million triangles is below 100


class Scratch(NamedTuple):
    """Memory for a search; between searches only ``marks`` has a meaning: all 0.

    Attributes:
        frame: Pose of B in A's frame, [21].
        stack: Nodes still to look at, [256].
        marks: Bit 1: this vertex of A is near B, bit 2: of B near A, [n_vertices].
        found: Vertices marked, twice their number and + 1 for B, [2 n_vertices].
    """

    frame: np.ndarray
    stack: np.ndarray
    marks: np.ndarray
    found: np.ndarray


def scratch_for(meshes: Meshes) -> Scratch:
    """Memory for searches in these meshes, one at a time."""
    n = len(meshes.vertices)
    return Scratch(np.zeros(_FRAME), np.zeros(_STACK, np.int64), np.zeros(n, np.int64), np.zeros(2 * n, np.int64))


@kernel(inline=True)
def add(contacts, n, a, b, x, y, z, n_x, n_y, n_z, gap, id_, weight):
    """Write a candidate as row n if there is room; the next n, at most one more than there are rows."""
    if n < contacts.shape[0]:
        contacts[n, A], contacts[n, B] = a, b
        contacts[n, POINT], contacts[n, POINT + 1], contacts[n, POINT + 2] = x, y, z
        contacts[n, NORMAL], contacts[n, NORMAL + 1], contacts[n, NORMAL + 2] = n_x, n_y, n_z
        contacts[n, GAP], contacts[n, ID], contacts[n, WEIGHT] = gap, id_, weight
    return min(n + 1, contacts.shape[0] + 1)


@kernel
def place(pose_a, pose_b, frame):
    """Write the pose of B in the frame of A: v_A = R v_B + origin."""
    S, T = pose_a.T, pose_b.T
    d_x, d_y, d_z = pose_b.r_0[0] - pose_a.r_0[0], pose_b.r_0[1] - pose_a.r_0[1], pose_b.r_0[2] - pose_a.r_0[2]
    for i in range(3):
        for j in range(3):
            entry = S[i, 0] * T[j, 0] + S[i, 1] * T[j, 1] + S[i, 2] * T[j, 2]
            frame[ROTATION + 3 * i + j], frame[AMOUNTS + 3 * i + j] = entry, abs(entry)
        frame[ORIGIN + i] = S[i, 0] * d_x + S[i, 1] * d_y + S[i, 2] * d_z


@kernel(inline=True)
def turned(frame, x, y, z):
    """A vector of B's frame in A's."""
    return (
        frame[0] * x + frame[1] * y + frame[2] * z,
        frame[3] * x + frame[4] * y + frame[5] * z,
        frame[6] * x + frame[7] * y + frame[8] * z,
    )


@kernel(inline=True)
def turned_back(frame, x, y, z):
    """A vector of A's frame in B's."""
    return (
        frame[0] * x + frame[3] * y + frame[6] * z,
        frame[1] * x + frame[4] * y + frame[7] * z,
        frame[2] * x + frame[5] * y + frame[8] * z,
    )


@kernel(inline=True)
def moved(frame, x, y, z):
    """A point of B's frame in A's."""
    p_x, p_y, p_z = turned(frame, x, y, z)
    return p_x + frame[ORIGIN], p_y + frame[ORIGIN + 1], p_z + frame[ORIGIN + 2]


@kernel(inline=True)
def moved_back(frame, x, y, z):
    """A point of A's frame in B's."""
    return turned_back(frame, x - frame[ORIGIN], y - frame[ORIGIN + 1], z - frame[ORIGIN + 2])
