"""Two convex edges that touch each other."""

from __future__ import annotations

import math

from ..frames import cross, dot
from ..slave.kernel import kernel
from .surface import FACES

_PARALLEL = 1e-6  # square of the sine between two edges below which their vertices alone make contacts
_BEYOND = 0.035  # own choice: sine by which a normal may leave an edge's cone, 2 degrees


@kernel(inline=True)
def cone_weight(meshes, edge, d_x, d_y, d_z, n_x, n_y, n_z):
    """Weight of a contact along a unit vector across a convex edge: 1 between the normals of its faces, less beyond, 0 from 2 deg on.

    Where a plate's tip lies along a rock's face it is a contact at both edges of that, and at one of them as soon as it is tilted. Without
    weights what bears would jump there.

    Args:
        d_x, d_y, d_z: Unit vector along the edge, from its first end.
        n_x, n_y, n_z: The vector, in the frame of the surface as well.
    """
    f, g = meshes.edges[edge, FACES], meshes.edges[edge, FACES + 1]
    # Into the first face from its edge is normal x edge, into the second one edge x normal; a vector of the cone has no part along either.
    x, y, z = cross(meshes.normals[f, 0], meshes.normals[f, 1], meshes.normals[f, 2], d_x, d_y, d_z)
    weight = taper(dot(x, y, z, n_x, n_y, n_z) / _BEYOND)
    x, y, z = cross(d_x, d_y, d_z, meshes.normals[g, 0], meshes.normals[g, 1], meshes.normals[g, 2])
    return weight * taper(dot(x, y, z, n_x, n_y, n_z) / _BEYOND)


@kernel(inline=True)
def taper(x):
    """1 up to x = 0, 0 from x = 1 on, smooth between them."""
    x = min(max(x, 0.0), 1.0)
    return 1.0 - x * x * (3.0 - 2.0 * x)


@kernel(inline=True)
def crossing(p_x, p_y, p_z, d_x, d_y, d_z, q_x, q_y, q_z, e_x, e_y, e_z, margin):
    """Where two edges, from p along d and from q along e, are nearest to each other, if that is within both.

    Returns:
        found, places on them s, t in 0..1, and their common normal, of either sense (3).
    """
    r_x, r_y, r_z = p_x - q_x, p_y - q_y, p_z - q_z
    dd, ee, de = dot(d_x, d_y, d_z, d_x, d_y, d_z), dot(e_x, e_y, e_z, e_x, e_y, e_z), dot(d_x, d_y, d_z, e_x, e_y, e_z)
    determinant = dd * ee - de * de  # square of |d x e|
    if determinant <= _PARALLEL * dd * ee:
        return False, 0.0, 0.0, 0.0, 0.0, 0.0
    dr, er = dot(d_x, d_y, d_z, r_x, r_y, r_z), dot(e_x, e_y, e_z, r_x, r_y, r_z)
    s, t = (de * er - dr * ee) / determinant, (dd * er - de * dr) / determinant
    if not (0.0 < s < 1.0 and 0.0 < t < 1.0):
        return False, 0.0, 0.0, 0.0, 0.0, 0.0
    n_x, n_y, n_z = cross(d_x, d_y, d_z, e_x, e_y, e_z)
    length = math.sqrt(determinant)
    n_x, n_y, n_z = n_x / length, n_y / length, n_z / length
    return abs(dot(r_x, r_y, r_z, n_x, n_y, n_z)) < margin, s, t, n_x, n_y, n_z
