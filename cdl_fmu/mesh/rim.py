"""The smooth rim of a wheel, a cylinder about its y axis, against a closed mesh: exact, so that it rolls without ripple."""

from __future__ import annotations

import math

from ..frames import cross, dot, resolve1
from ..slave.kernel import kernel
from .contacts import AMOUNTS, KINDS, RIM_EDGE, RIM_FACE, RIM_VERTEX, add, moved, moved_back, place, turned, turned_back
from .edges import cone_weight, taper
from .nearest import vertex_weight
from .surface import CORNERS, ENDS
from .tree import FIRST_EDGE, FIRST_TRIANGLE, FIRST_VERTEX, LAST_EDGE, LAST_TRIANGLE, LAST_VERTEX, RIGHT

_ALONG_AXLE = 1e-9  # square of the sine between a line and the axle below which no direction across is nearest
_BEYOND = 0.02  # sine by which the normal at an end of the rim may lean away from it: an edge along the axle touches at both ends
_FLAT = 1e-6  # part of an edge along the axle below which the planes of the rim's ends do not cut it
_STEPS, _CLOSE = 20, 1e-13  # of Newton's method, and share of the radius at which it ends
_SAME = 1e-6  # share of an edge within which two of its places are one
_OUTSIDE = 1e-9  # share by which a face's contact may lie beyond its edges, so that none is lost between two faces


@kernel
def rim_contacts(i, radius, width, pose_wheel, meshes, j, pose_j, margin, scratch, contacts, n):
    """Contact candidates between the rim of wheel i, body A, and the closed surface of body j, body B.

    - Vertices of the mesh: radially, or along the axle where they are less deep behind an end of the rim.
    - Convex edges: where they are nearest to the axle, and to the circles at the rim's ends.
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
    first = n
    n = _search(i, radius, width, pose_wheel, meshes, j, margin, False, frame, stack, contacts, n)
    if n == first:  # nothing near, or a face that cuts through the wheel deeper than that
        n = _search(i, radius, width, pose_wheel, meshes, j, margin, True, frame, stack, contacts, n)
    return n


@kernel
def _search(i, radius, width, pose_wheel, meshes, j, margin, deep, frame, stack, contacts, n):
    """Candidates near the rim's surface; or ``deep`` ones, faces that cut through it below its axle, which tell of an overlap."""
    stack[0], top = meshes.roots[j], 1
    while top > 0:
        top -= 1
        node = stack[top]
        depth = _depth(frame, meshes.boxes, node, radius, 0.5 * width, margin)
        if depth < 0.0:
            continue
        if depth > 0.0:  # deeper than candidates are looked for: one tells of it
            x, y, z = moved(frame, meshes.boxes[node, 0], meshes.boxes[node, 1], meshes.boxes[node, 2])
            n = _add(contacts, n, i, j, pose_wheel, x, y, z, 0.0, 0.0, 1.0, -depth, -1.0, 1.0)
            continue
        right = meshes.nodes[node, RIGHT]
        if right > 0:
            stack[top], stack[top + 1] = node + 1, right
            top += 2
            continue
        if not deep:
            n = _vertices(i, radius, 0.5 * width, pose_wheel, meshes, j, node, margin, frame, contacts, n)
            n = _edges(i, radius, 0.5 * width, pose_wheel, meshes, j, node, margin, frame, contacts, n)
        n = _faces(i, radius, 0.5 * width, pose_wheel, meshes, j, node, margin, deep, frame, contacts, n)
    return n


@kernel(inline=True)
def _depth(frame, boxes, node, radius, half, margin):
    """How deep within the rim a box lies at least [m]: below 0 if it is further than the margin outside of it, 0 near its surface."""
    x, y, z = moved(frame, boxes[node, 0], boxes[node, 1], boxes[node, 2])
    x, y, z = abs(x), abs(y), abs(z)
    b_x, b_y, b_z, k = boxes[node, 3], boxes[node, 4], boxes[node, 5], AMOUNTS
    h_x = frame[k] * b_x + frame[k + 1] * b_y + frame[k + 2] * b_z
    h_y = frame[k + 3] * b_x + frame[k + 4] * b_y + frame[k + 5] * b_z
    h_z = frame[k + 6] * b_x + frame[k + 7] * b_y + frame[k + 8] * b_z
    near_x, near_z = max(x - h_x, 0.0), max(z - h_z, 0.0)
    if y - h_y > half + margin or near_x * near_x + near_z * near_z > (radius + margin) ** 2:
        return -1.0
    depth = min(radius - math.sqrt((x + h_x) ** 2 + (z + h_z) ** 2), half - y - h_y)
    return depth if depth > margin else 0.0


@kernel(inline=True)
def _add(contacts, n, i, j, pose, x, y, z, n_x, n_y, n_z, gap, id_, weight):
    """Add a candidate given in the wheel's frame by the point of the mesh."""
    x, y, z = resolve1(pose.T, x + 0.5 * gap * n_x, y + 0.5 * gap * n_y, z + 0.5 * gap * n_z)
    n_x, n_y, n_z = resolve1(pose.T, n_x, n_y, n_z)
    return add(contacts, n, i, j, pose.r_0[0] + x, pose.r_0[1] + y, pose.r_0[2] + z, n_x, n_y, n_z, gap, id_, weight)


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
        weight = vertex_weight(dot(o_x, o_y, o_z, v_x, v_y, v_z))
        if abs(gap) < margin and weight > 0.0:
            n = _add(contacts, n, i, j, pose, x, y, z, -o_x, -o_y, -o_z, gap, float(RIM_VERTEX + KINDS * k), weight)
    return n


@kernel
def _edges(i, radius, half, pose, meshes, j, node, margin, frame, contacts, n):
    vertices, edges = meshes.vertices, meshes.edges
    for e in range(meshes.nodes[node, FIRST_EDGE], meshes.nodes[node, LAST_EDGE]):
        k, m = edges[e, ENDS], edges[e, ENDS + 1]
        p_x, p_y, p_z = moved(frame, vertices[k, 0], vertices[k, 1], vertices[k, 2])
        q_x, q_y, q_z = moved(frame, vertices[m, 0], vertices[m, 1], vertices[m, 2])
        low, high = min(p_y, q_y), max(p_y, q_y)
        if low > half + margin or high < -half - margin:
            continue
        d_x, d_y, d_z = q_x - p_x, q_y - p_y, q_z - p_z
        length = math.sqrt(dot(d_x, d_y, d_z, d_x, d_y, d_z))
        d_x, d_y, d_z = d_x / length, d_y / length, d_z / length
        across, along = d_x * d_x + d_z * d_z, p_x * d_x + p_z * d_z
        if across > _ALONG_AXLE:
            s = -along / across  # where it is nearest to the axle
            if 0.0 < s < length and abs(p_y + s * d_y) <= half:
                x, y, z = p_x + s * d_x, p_y + s * d_y, p_z + s * d_z
                n = _edge_on_rim(i, radius, pose, meshes, j, e, x, y, z, d_x, d_y, d_z, margin, frame, contacts, n)
        # The square of half its chord in the rim's cylinder, in units of s.
        chord = -1.0
        if across > _ALONG_AXLE:
            chord = (radius * radius - p_x * p_x - p_z * p_z) / across + (along / across) ** 2
        for end in range(2):
            out = 1.0 - 2.0 * end
            if not (low - margin <= out * half <= high + margin):
                continue
            first, second, taken = math.inf, math.inf, 0
            # It is nearest to the circle about where it crosses the plane of that, or enters or leaves the cylinder, or passes beside it.
            for start in range(3):
                if start == 0:
                    if abs(d_y) < _FLAT:
                        continue
                    s = (out * half - p_y) / d_y
                else:
                    if across <= _ALONG_AXLE or (start == 2 and chord <= 0.0):
                        continue
                    s = -along / across + (2 * start - 3) * math.sqrt(max(chord, 0.0))
                s = _nearest_to_circle(radius, out * half, p_x, p_y, p_z, d_x, d_y, d_z, s)
                if not 0.0 < s < length or min(abs(s - first), abs(s - second)) < _SAME * length:
                    continue
                x, y, z = p_x + s * d_x, p_y + s * d_y, p_z + s * d_z
                id_ = 1 + end + 2 * taken
                n = _edge_on_circle(i, radius, half, out, id_, pose, meshes, j, e, x, y, z, d_x, d_y, d_z, margin, frame, contacts, n)
                first, second, taken = s, first, taken + 1
    return n


@kernel
def _nearest_to_circle(radius, y_0, p_x, p_y, p_z, d_x, d_y, d_z, s):
    """Place on the line p + s d whose distance from the circle rho = radius, y = y_0 is stationary, by Newton's method from s; nan if none.

    With the point of the circle that is nearest to p + s d, (rho - radius) u + (y - y_0) e_y is across the line: g(s) = 0.
    """
    for _ in range(_STEPS):
        x, z = p_x + s * d_x, p_z + s * d_z
        rho = math.sqrt(x * x + z * z)
        if rho < 0.5 * radius:
            return math.nan
        slope = (x * d_x + z * d_z) / rho
        g = (rho - radius) * slope + (p_y + s * d_y - y_0) * d_y
        rise = slope * slope + d_y * d_y + (rho - radius) / rho * (d_x * d_x + d_z * d_z - slope * slope)
        if rise < _ALONG_AXLE:
            return math.nan
        step = g / rise
        s -= step
        if abs(step) < _CLOSE * radius:
            return s
    return math.nan


@kernel
def _edge_on_rim(i, radius, pose, meshes, j, e, x, y, z, d_x, d_y, d_z, margin, frame, contacts, n):
    """Convex edge e along d, at its point (x, y, z) nearest to the axle."""
    rho = math.sqrt(x * x + z * z)
    if not abs(rho - radius) < margin or rho == 0.0:
        return n
    weight = _weight(meshes, e, frame, d_x, d_y, d_z, x / rho, 0.0, z / rho)
    if weight <= 0.0:
        return n
    return _add(contacts, n, i, j, pose, x, y, z, -x / rho, 0.0, -z / rho, rho - radius, RIM_EDGE + KINDS * (7.0 * e), weight)


@kernel
def _edge_on_circle(i, radius, half, out, place_, pose, meshes, j, e, x, y, z, d_x, d_y, d_z, margin, frame, contacts, n):
    """Convex edge e along d, at its point (x, y, z) nearest to the circle at the rim's end out = 1 or -1."""
    rho = math.sqrt(x * x + z * z)
    u_x, u_z, axial = x / rho, z / rho, y - out * half
    if (rho - radius) ** 2 + axial * axial >= margin * margin:
        return n
    # Across the edge and the circle's tangent.
    n_x, n_y, n_z = cross(d_x, d_y, d_z, u_z, 0.0, -u_x)
    size = math.sqrt(dot(n_x, n_y, n_z, n_x, n_y, n_z))
    if size < _BEYOND:
        return n
    radial = n_x * u_x + n_z * u_z
    size = math.copysign(size, radial + out * n_y)
    n_x, n_y, n_z, radial = n_x / size, n_y / size, n_z / size, radial / size
    # Where it leans away from the rim's end or its axle, the edge is nearest to another place of the rim.
    weight = taper(-out * n_y / _BEYOND) * taper(-radial / _BEYOND) * _weight(meshes, e, frame, d_x, d_y, d_z, n_x, n_y, n_z)
    if weight <= 0.0:
        return n
    gap = (rho - radius) * radial + axial * n_y
    return _add(contacts, n, i, j, pose, x, y, z, -n_x, -n_y, -n_z, gap, RIM_EDGE + KINDS * (7.0 * e + place_), weight)


@kernel(inline=True)
def _weight(meshes, e, frame, d_x, d_y, d_z, n_x, n_y, n_z):
    """``cone_weight`` of edge e of the mesh, along d, for what a normal out of the wheel opposes; both in the wheel's frame."""
    d_x, d_y, d_z = turned_back(frame, d_x, d_y, d_z)
    n_x, n_y, n_z = turned_back(frame, n_x, n_y, n_z)
    return cone_weight(meshes, e, d_x, d_y, d_z, -n_x, -n_y, -n_z)


@kernel
def _faces(i, radius, half, pose, meshes, j, node, margin, deep, frame, contacts, n):
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
            if abs(gap) < margin or (deep and -radius * math.sqrt(across) < gap < 0.0):
                x, y, z = x - gap * n_x, y - gap * n_y, z - gap * n_z
                q_x, q_y, q_z = moved_back(frame, x, y, z)
                if _over(vertices, triangles, t, normals, q_x, q_y, q_z):
                    n = _add(contacts, n, i, j, pose, x, y, z, n_x, n_y, n_z, gap, float(RIM_FACE + KINDS * (2 * t + end)), 1.0)
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
