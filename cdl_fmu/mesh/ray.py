"""Vertical rays from above onto meshes, for the contact plane of Fig. 8.4 on rock."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..frames import cross, dot, resolve1, resolve2
from ..slave.kernel import kernel
from .surface import CORNERS, Meshes
from .tree import FIRST_TRIANGLE, LAST_TRIANGLE, RIGHT

_PARALLEL = 1e-12  # cosine between ray and face below which it is seen edgewise
_OUTSIDE = -1e-12  # share of a triangle by which a ray may pass beside it, so that none slips through between two
_STEEPEST = 1e300  # for the inverse of a direction without a part along an axis


class MeshGround(NamedTuple):
    """Bodies on which rays end.

    Attributes:
        meshes: Their surfaces; open ones may be among them.
        poses: Records with r_0 [m] and T, world to body, one each, [n_bodies].
        stack: Memory, [256].
    """

    meshes: Meshes
    poses: np.ndarray
    stack: np.ndarray


def mesh_ground(meshes: Meshes, poses: np.ndarray) -> MeshGround:
    """Bodies on which rays end, at the poses that are in this array of records when a ray is cast."""
    return MeshGround(meshes, poses, np.zeros(256, np.int64))


@kernel
def cast_down(meshes, j, pose, x, y, z_from, stack):
    """First crossing of the vertical line below (x, y, z_from) [m] with the upper side of mesh j, closed or open.

    Returns:
        hit, its height [m], unit normal there (3), all in world axes.
    """
    r = pose.r_0
    o_x, o_y, o_z = resolve2(pose.T, x - r[0], y - r[1], z_from - r[2])
    sphere = meshes.spheres
    s_x, s_y, s_z = resolve1(pose.T, sphere[j, 0], sphere[j, 1], sphere[j, 2])
    if (r[0] + s_x - x) ** 2 + (r[1] + s_y - y) ** 2 > sphere[j, 3] ** 2:
        return False, 0.0, 0.0, 0.0, 1.0
    d_x, d_y, d_z = resolve2(pose.T, 0.0, 0.0, -1.0)
    i_x, i_y, i_z = _inverse(d_x), _inverse(d_y), _inverse(d_z)
    vertices, triangles, normals, nodes = meshes.vertices, meshes.triangles, meshes.normals, meshes.nodes
    best, nearest = -1, math.inf
    stack[0], top = meshes.roots[j], 1
    while top > 0:
        top -= 1
        i = stack[top]
        if not _enters(meshes.boxes, i, o_x, o_y, o_z, i_x, i_y, i_z, nearest):
            continue
        right = nodes[i, RIGHT]
        if right > 0:
            stack[top], stack[top + 1] = i + 1, right
            top += 2
            continue
        for t in range(nodes[i, FIRST_TRIANGLE], nodes[i, LAST_TRIANGLE]):
            if dot(normals[t, 0], normals[t, 1], normals[t, 2], d_x, d_y, d_z) < -_PARALLEL:
                s = _along(vertices, triangles, t, o_x, o_y, o_z, d_x, d_y, d_z)
                if 0.0 <= s < nearest:
                    nearest, best = s, t
    if best < 0:
        return False, 0.0, 0.0, 0.0, 1.0
    n_x, n_y, n_z = resolve1(pose.T, normals[best, 0], normals[best, 1], normals[best, 2])
    return True, z_from - nearest, n_x, n_y, n_z


@kernel
def highest(ground, x, y, z_from):
    """The highest of all hits of ``cast_down`` on the bodies of a ``MeshGround``: hit, height [m], unit normal (3)."""
    hit, z, n_x, n_y, n_z = False, -math.inf, 0.0, 0.0, 1.0
    for j in range(ground.poses.shape[0]):
        met, z_j, j_x, j_y, j_z = cast_down(ground.meshes, j, ground.poses[j], x, y, z_from, ground.stack)
        if met and z_j > z:
            hit, z, n_x, n_y, n_z = True, z_j, j_x, j_y, j_z
    return hit, z, n_x, n_y, n_z


@kernel(inline=True)
def _inverse(d):
    return 1.0 / d if abs(d) > 1.0 / _STEEPEST else _STEEPEST


@kernel(inline=True)
def _enters(boxes, i, x, y, z, i_x, i_y, i_z, furthest):
    """Whether a ray from (x, y, z), with the inverse of its direction, meets box i before ``furthest`` (slabs, Kay & Kajiya 1986)."""
    first, last = 0.0, furthest
    for k, o, inverse in ((0, x, i_x), (1, y, i_y), (2, z, i_z)):
        # A little wider, as flat grounds have boxes of no height.
        half = boxes[i, 3 + k] + 1e-9
        a, b = (boxes[i, k] - half - o) * inverse, (boxes[i, k] + half - o) * inverse
        first, last = max(first, min(a, b)), min(last, max(a, b))
    return first <= last


@kernel(inline=True)
def _along(vertices, triangles, t, o_x, o_y, o_z, d_x, d_y, d_z):
    """Distance [m] along a ray to triangle t, -1 if it passes beside (Moeller & Trumbore 1997)."""
    i, j, k = triangles[t, CORNERS], triangles[t, CORNERS + 1], triangles[t, CORNERS + 2]
    a_x, a_y, a_z = vertices[i, 0], vertices[i, 1], vertices[i, 2]
    b_x, b_y, b_z = vertices[j, 0] - a_x, vertices[j, 1] - a_y, vertices[j, 2] - a_z
    c_x, c_y, c_z = vertices[k, 0] - a_x, vertices[k, 1] - a_y, vertices[k, 2] - a_z
    p_x, p_y, p_z = cross(d_x, d_y, d_z, c_x, c_y, c_z)
    determinant = dot(b_x, b_y, b_z, p_x, p_y, p_z)
    s_x, s_y, s_z = o_x - a_x, o_y - a_y, o_z - a_z
    u = dot(s_x, s_y, s_z, p_x, p_y, p_z) / determinant
    q_x, q_y, q_z = cross(s_x, s_y, s_z, b_x, b_y, b_z)
    v = dot(d_x, d_y, d_z, q_x, q_y, q_z) / determinant
    if u < _OUTSIDE or v < _OUTSIDE or u + v > 1.0 - _OUTSIDE:
        return -1.0
    return dot(c_x, c_y, c_z, q_x, q_y, q_z) / determinant
