"""The smooth rim of a wheel, a cylinder about its y axis, against a closed mesh: exact, so that it rolls without ripple."""

from __future__ import annotations

import math

from ..frames import cross, dot, resolve1
from ..slave.kernel import kernel
from .contacts import AMOUNTS, KINDS, RIM_EDGE, RIM_FACE, RIM_VERTEX, add, moved, moved_back, place, turned, turned_back
from .edges import within_cone
from .surface import CORNERS, ENDS
from .tree import FIRST_EDGE, FIRST_TRIANGLE, FIRST_VERTEX, LAST_EDGE, LAST_TRIANGLE, LAST_VERTEX, RIGHT

_ALONG_AXLE = 1e-9  # square of the sine between a line and the axle below which no direction across is nearest
_BEYOND = 0.02  # sine by which the normal at an end of the rim may lean away from it: an edge along the axle touches at both ends
_OUTSIDE = 1e-9  # share by which a face's contact may lie beyond its edges, so that none is lost between two faces


@kernel
def rim_contacts(i, radius, width, pose_wheel, meshes, j, pose_j, margin, scratch, contacts, n):
    """Contact candidates between the rim of wheel i, body A, and the closed surface of body j, body B.

    - Vertices of the mesh: radially, or along the axle where they are less deep behind an end of the rim.
    - Convex edges: where they are nearest to the axle, and where they cross the planes of the rim's ends.
    - Faces: on the circle at each end of the rim, the point that is furthest against the face's normal.

    Args:
        i: Index written as A.
        radius, width: Of the rim [m].
        pose_wheel, pose_j: Records with r_0 [m] and T, world to body.
        meshes, margin, scratch, contacts, n: As in ``pairs.mesh_contacts``.

    Returns:
        Rows that are taken now; one more than there are if some candidates did not fit.
    """
    frame, stack, spheres = scratch.frame, scratch.stack, meshes.spheres
    place(pose_wheel, pose_j, frame)
    x, y, z = moved(frame, spheres[j, 0], spheres[j, 1], spheres[j, 2])
    reach = spheres[j, 3] + margin
    if abs(y) > 0.5 * width + reach or x * x + z * z > (radius + reach) ** 2:
        return n
    stack[0], top = meshes.roots[j], 1
    while top > 0:
        top -= 1
        node = stack[top]
        if _clear(frame, meshes.boxes, node, radius, 0.5 * width, margin):
            continue
        right = meshes.nodes[node, RIGHT]
        if right > 0:
            stack[top], stack[top + 1] = node + 1, right
            top += 2
            continue
        n = _vertices(i, radius, 0.5 * width, pose_wheel, meshes, j, node, margin, frame, contacts, n)
        n = _edges(i, radius, 0.5 * width, pose_wheel, meshes, j, node, margin, frame, contacts, n)
        n = _faces(i, radius, 0.5 * width, pose_wheel, meshes, j, node, margin, frame, contacts, n)
    return n


@kernel(inline=True)
def _clear(frame, boxes, node, radius, half, margin):
    """Whether a box is further than the margin from the rim's surface, outside or within."""
    x, y, z = moved(frame, boxes[node, 0], boxes[node, 1], boxes[node, 2])
    x, y, z = abs(x), abs(y), abs(z)
    b_x, b_y, b_z, k = boxes[node, 3], boxes[node, 4], boxes[node, 5], AMOUNTS
    h_x = frame[k] * b_x + frame[k + 1] * b_y + frame[k + 2] * b_z
    h_y = frame[k + 3] * b_x + frame[k + 4] * b_y + frame[k + 5] * b_z
    h_z = frame[k + 6] * b_x + frame[k + 7] * b_y + frame[k + 8] * b_z
    near_x, near_z = max(x - h_x, 0.0), max(z - h_z, 0.0)
    if y - h_y > half + margin or near_x * near_x + near_z * near_z > (radius + margin) ** 2:
        return True
    far_x, far_z, within = x + h_x, z + h_z, radius - margin
    return within > 0.0 and y + h_y < half - margin and far_x * far_x + far_z * far_z < within * within


@kernel(inline=True)
def _add(contacts, n, i, j, pose, x, y, z, n_x, n_y, n_z, gap, id_):
    """Add a candidate given in the wheel's frame by the point of the mesh."""
    x, y, z = resolve1(pose.T, x + 0.5 * gap * n_x, y + 0.5 * gap * n_y, z + 0.5 * gap * n_z)
    n_x, n_y, n_z = resolve1(pose.T, n_x, n_y, n_z)
    return add(contacts, n, i, j, pose.r_0[0] + x, pose.r_0[1] + y, pose.r_0[2] + z, n_x, n_y, n_z, gap, id_)


@kernel
def _vertices(i, radius, half, pose, meshes, j, node, margin, frame, contacts, n):
    vertices = meshes.vertices
    for k in range(meshes.nodes[node, FIRST_VERTEX], meshes.nodes[node, LAST_VERTEX]):
        x, y, z = moved(frame, vertices[k, 0], vertices[k, 1], vertices[k, 2])
        rho = math.sqrt(x * x + z * z)
        radial, axial = rho - radius, abs(y) - half
        if not max(radial, axial) < margin or rho == 0.0:
            continue
        side = math.copysign(1.0, y)
        if radial > 0.0 and axial > 0.0:  # nearest to the circle at the rim's end
            gap = math.hypot(radial, axial)
            o_x, o_y, o_z = x / rho * radial / gap, side * axial / gap, z / rho * radial / gap
        elif radial >= axial:
            gap, o_x, o_y, o_z = radial, x / rho, 0.0, z / rho
        else:
            gap, o_x, o_y, o_z = axial, 0.0, side, 0.0
        v_x, v_y, v_z = turned(frame, vertices[k, 3], vertices[k, 4], vertices[k, 5])
        if abs(gap) < margin and dot(o_x, o_y, o_z, v_x, v_y, v_z) < 0.0:
            n = _add(contacts, n, i, j, pose, x, y, z, -o_x, -o_y, -o_z, gap, float(RIM_VERTEX + KINDS * k))
    return n


@kernel
def _edges(i, radius, half, pose, meshes, j, node, margin, frame, contacts, n):
    vertices, edges = meshes.vertices, meshes.edges
    for e in range(meshes.nodes[node, FIRST_EDGE], meshes.nodes[node, LAST_EDGE]):
        k, m = edges[e, ENDS], edges[e, ENDS + 1]
        p_x, p_y, p_z = moved(frame, vertices[k, 0], vertices[k, 1], vertices[k, 2])
        q_x, q_y, q_z = moved(frame, vertices[m, 0], vertices[m, 1], vertices[m, 2])
        if min(p_y, q_y) > half or max(p_y, q_y) < -half:
            continue
        d_x, d_y, d_z = q_x - p_x, q_y - p_y, q_z - p_z
        length = math.sqrt(dot(d_x, d_y, d_z, d_x, d_y, d_z))
        d_x, d_y, d_z = d_x / length, d_y / length, d_z / length
        across = d_x * d_x + d_z * d_z
        if across > _ALONG_AXLE:
            s = -(p_x * d_x + p_z * d_z) / across
            y = p_y + s * d_y
            if 0.0 < s < length and abs(y) <= half:
                x, z = p_x + s * d_x, p_z + s * d_z
                n = _edge_at(i, radius, 0.0, pose, meshes, j, e, 0, x, y, z, d_x, d_y, d_z, margin, frame, contacts, n)
        for side in (1, 2):
            out = 1.0 if side == 1 else -1.0
            # It crosses the plane of this end.
            if (p_y - out * half) * (q_y - out * half) < 0.0:
                s = (out * half - p_y) / d_y
                x, z = p_x + s * d_x, p_z + s * d_z
                n = _edge_at(i, radius, out, pose, meshes, j, e, side, x, out * half, z, d_x, d_y, d_z, margin, frame, contacts, n)
    return n


@kernel
def _edge_at(i, radius, out, pose, meshes, j, e, place_, x, y, z, d_x, d_y, d_z, margin, frame, contacts, n):
    """A convex edge along d at (x, y, z): on the rim (out = 0), or on the circle at its left or right end (1, -1)."""
    rho = math.sqrt(x * x + z * z)
    if not abs(rho - radius) < margin or rho == 0.0:
        return n
    u_x, u_z = x / rho, z / rho
    n_x, n_y, n_z = u_x, 0.0, u_z
    if out != 0.0:
        # Across the edge and the circle's tangent; where that leans away from the rim's end, the edge is nearest elsewhere.
        n_x, n_y, n_z = cross(d_x, d_y, d_z, u_z, 0.0, -u_x)
        size = math.sqrt(dot(n_x, n_y, n_z, n_x, n_y, n_z))
        if size < _BEYOND:
            return n
        sense = math.copysign(1.0, n_x * u_x + n_z * u_z) / size
        n_x, n_y, n_z = sense * n_x, sense * n_y, sense * n_z
        if out * n_y < -_BEYOND:
            return n
    gap = (rho - radius) * (n_x * u_x + n_z * u_z)  # of the two tangents
    o_x, o_y, o_z = turned_back(frame, d_x, d_y, d_z)
    m_x, m_y, m_z = turned_back(frame, n_x, n_y, n_z)
    if not within_cone(meshes, e, o_x, o_y, o_z, -m_x, -m_y, -m_z):
        return n
    return _add(contacts, n, i, j, pose, x, y, z, -n_x, -n_y, -n_z, gap, RIM_EDGE + KINDS * (3.0 * e + place_))


@kernel
def _faces(i, radius, half, pose, meshes, j, node, margin, frame, contacts, n):
    vertices, triangles, normals = meshes.vertices, meshes.triangles, meshes.normals
    for t in range(meshes.nodes[node, FIRST_TRIANGLE], meshes.nodes[node, LAST_TRIANGLE]):
        n_x, n_y, n_z = turned(frame, normals[t, 0], normals[t, 1], normals[t, 2])
        across = n_x * n_x + n_z * n_z
        if across < _ALONG_AXLE:
            continue
        scale = -radius / math.sqrt(across)
        k = triangles[t, CORNERS]
        o_x, o_y, o_z = moved(frame, vertices[k, 0], vertices[k, 1], vertices[k, 2])
        for end in range(2):
            x, y, z = scale * n_x, half - 2.0 * half * end, scale * n_z
            gap = dot(x - o_x, y - o_y, z - o_z, n_x, n_y, n_z)
            if abs(gap) < margin:
                x, y, z = x - gap * n_x, y - gap * n_y, z - gap * n_z
                q_x, q_y, q_z = moved_back(frame, x, y, z)
                if _over(vertices, triangles, t, normals, q_x, q_y, q_z):
                    n = _add(contacts, n, i, j, pose, x, y, z, n_x, n_y, n_z, gap, float(RIM_FACE + KINDS * (2 * t + end)))
    return n


@kernel(inline=True)
def _over(vertices, triangles, t, normals, x, y, z):
    """Whether a point lies within the prism over a triangle, in the frame of the mesh."""
    for corner in range(3):
        k, m = triangles[t, CORNERS + corner], triangles[t, CORNERS + (corner + 1) % 3]
        e_x, e_y, e_z = vertices[m, 0] - vertices[k, 0], vertices[m, 1] - vertices[k, 1], vertices[m, 2] - vertices[k, 2]
        in_x, in_y, in_z = cross(normals[t, 0], normals[t, 1], normals[t, 2], e_x, e_y, e_z)
        d = dot(in_x, in_y, in_z, x - vertices[k, 0], y - vertices[k, 1], z - vertices[k, 2])
        if d < -_OUTSIDE * dot(e_x, e_y, e_z, e_x, e_y, e_z):
            return False
    return True
