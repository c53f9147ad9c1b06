"""Signed distance of a point from a closed mesh, near its surface."""

from __future__ import annotations

import math

from ..frames import dot
from ..slave.kernel import kernel
from .edges import taper
from .surface import CORNERS, EDGES
from .tree import FIRST_TRIANGLE, LAST_TRIANGLE, RIGHT, distance_to_box

#: Where on a triangle its nearest point is: within, at corner 0, 1, 2, on the edge from there.
WITHIN, CORNER, EDGE = 0, 1, 4
_TOUCHING = 1e-12  # [m] from an edge or corner, below which the direction from there is rounding
OPPOSES, _CLEARLY = -0.1, -0.3  # own choice: cosine between a vertex's normal and that of a surface below which they may touch, or do
_ABOVE = 1e-18  # [m2] square of the distance from the edges of a face within which a point still lies over it


@kernel
def nearest_on_triangle(vertices, triangles, t, x, y, z):
    """Point of triangle t nearest to (x, y, z), and where on the triangle it is (Ericson 2005, section 5.1.5)."""
    i, j, k = triangles[t, CORNERS], triangles[t, CORNERS + 1], triangles[t, CORNERS + 2]
    a_x, a_y, a_z = vertices[i, 0], vertices[i, 1], vertices[i, 2]
    b_x, b_y, b_z = vertices[j, 0] - a_x, vertices[j, 1] - a_y, vertices[j, 2] - a_z
    c_x, c_y, c_z = vertices[k, 0] - a_x, vertices[k, 1] - a_y, vertices[k, 2] - a_z
    p_x, p_y, p_z = x - a_x, y - a_y, z - a_z
    d_1, d_2 = dot(b_x, b_y, b_z, p_x, p_y, p_z), dot(c_x, c_y, c_z, p_x, p_y, p_z)
    if d_1 <= 0.0 and d_2 <= 0.0:
        return a_x, a_y, a_z, CORNER
    bb, bc, cc = dot(b_x, b_y, b_z, b_x, b_y, b_z), dot(b_x, b_y, b_z, c_x, c_y, c_z), dot(c_x, c_y, c_z, c_x, c_y, c_z)
    d_3, d_4 = d_1 - bb, d_2 - bc
    if d_3 >= 0.0 and d_4 <= d_3:
        return a_x + b_x, a_y + b_y, a_z + b_z, CORNER + 1
    v_c = d_1 * d_4 - d_3 * d_2
    if v_c <= 0.0 and d_1 >= 0.0 and d_3 <= 0.0:
        v = d_1 / (d_1 - d_3)
        return a_x + v * b_x, a_y + v * b_y, a_z + v * b_z, EDGE
    d_5, d_6 = d_1 - bc, d_2 - cc
    if d_6 >= 0.0 and d_5 <= d_6:
        return a_x + c_x, a_y + c_y, a_z + c_z, CORNER + 2
    v_b = d_5 * d_2 - d_1 * d_6
    if v_b <= 0.0 and d_2 >= 0.0 and d_6 <= 0.0:
        w = d_2 / (d_2 - d_6)
        return a_x + w * c_x, a_y + w * c_y, a_z + w * c_z, EDGE + 2
    v_a = d_3 * d_6 - d_5 * d_4
    if v_a <= 0.0 and d_4 - d_3 >= 0.0 and d_5 - d_6 >= 0.0:
        w = (d_4 - d_3) / ((d_4 - d_3) + (d_5 - d_6))
        return a_x + b_x + w * (c_x - b_x), a_y + b_y + w * (c_y - b_y), a_z + b_z + w * (c_z - b_z), EDGE + 1
    v, w = v_b / (v_a + v_b + v_c), v_c / (v_a + v_b + v_c)
    return a_x + b_x * v + c_x * w, a_y + b_y * v + c_y * w, a_z + b_z * v + c_z * w, WITHIN


@kernel(inline=True)
def feature_normal(meshes, t, where):
    """Unit normal of the face, edge or vertex where a nearest point is on triangle t: which side of it tells inside from outside."""
    if where == WITHIN:
        return meshes.normals[t, 0], meshes.normals[t, 1], meshes.normals[t, 2]
    if where >= EDGE:
        k = meshes.triangles[t, EDGES + where - EDGE]
        return meshes.edge_normals[k, 0], meshes.edge_normals[k, 1], meshes.edge_normals[k, 2]
    k = meshes.triangles[t, CORNERS + where - CORNER]
    return meshes.vertices[k, 3], meshes.vertices[k, 4], meshes.vertices[k, 5]


@kernel(inline=True)
def vertex_weight(cosine):
    """Weight of a vertex' contact by the cosine between its normal and the surface's."""
    return 1.0 - taper((OPPOSES - cosine) / (OPPOSES - _CLEARLY))


@kernel
def signed_distance(meshes, root, x, y, z, v_x, v_y, v_z, margin, stack):
    """Distance of a vertex of another body from a closed surface, if it may touch that.

    Its sign is that of its side of the nearest feature's normal (Baerentzen & Aanaes 2005). The vertex may touch where its own normal
    opposes that of the surface. Within a thin part the nearest face may not: then the nearest one counts that does.

    Args:
        root: First node of the surface.
        x, y, z: The vertex, in the frame of the surface [m].
        v_x, v_y, v_z: Its outward normal.
        margin: Largest distance on either side [m].
        stack: Memory.

    Returns:
        found, gap [m] (< 0 within), the surface's unit normal there (3), weight, and whether the nearest feature is a vertex, too.
    """
    vertices, triangles, normals = meshes.vertices, meshes.triangles, meshes.normals
    square, gap, n_x, n_y, n_z, at_corner = margin * margin, margin, 0.0, 0.0, 0.0, False
    found, opposed, best = False, -margin, -1
    stack[0], top = root, 1
    while top > 0:
        top -= 1
        i = stack[top]
        if distance_to_box(meshes.boxes, i, x, y, z) > square:
            continue
        right = meshes.nodes[i, RIGHT]
        if right > 0:
            # The nearer child goes first.
            left = i + 1
            if distance_to_box(meshes.boxes, left, x, y, z) < distance_to_box(meshes.boxes, right, x, y, z):
                left, right = right, left
            stack[top], stack[top + 1] = left, right
            top += 2
            continue
        for t in range(meshes.nodes[i, FIRST_TRIANGLE], meshes.nodes[i, LAST_TRIANGLE]):
            q_x, q_y, q_z, where = nearest_on_triangle(vertices, triangles, t, x, y, z)
            d_x, d_y, d_z = x - q_x, y - q_y, z - q_z
            d = dot(d_x, d_y, d_z, d_x, d_y, d_z)
            m_x, m_y, m_z = normals[t, 0], normals[t, 1], normals[t, 2]
            side = dot(d_x, d_y, d_z, m_x, m_y, m_z)
            if opposed < side <= 0.0 and d - side * side < _ABOVE and dot(v_x, v_y, v_z, m_x, m_y, m_z) < OPPOSES:
                opposed, best = side, t
            if d < square:
                square, found, at_corner = d, True, CORNER <= where < EDGE
                m_x, m_y, m_z = feature_normal(meshes, t, where)
                if where == WITHIN:
                    gap, n_x, n_y, n_z = side, m_x, m_y, m_z
                    continue
                gap = math.copysign(math.sqrt(d), dot(d_x, d_y, d_z, m_x, m_y, m_z))
                n_x, n_y, n_z = m_x, m_y, m_z
                if abs(gap) > _TOUCHING:
                    n_x, n_y, n_z = d_x / gap, d_y / gap, d_z / gap
    weight = vertex_weight(dot(v_x, v_y, v_z, n_x, n_y, n_z))
    if found and weight > 0.0:
        return True, gap, n_x, n_y, n_z, weight, at_corner
    if found and gap <= _TOUCHING and best >= 0:
        n_x, n_y, n_z = normals[best, 0], normals[best, 1], normals[best, 2]
        return True, opposed, n_x, n_y, n_z, vertex_weight(dot(v_x, v_y, v_z, n_x, n_y, n_z)), False
    return False, 0.0, 0.0, 0.0, 0.0, 0.0, False
