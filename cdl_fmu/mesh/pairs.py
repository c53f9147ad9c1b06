"""Contact candidates of two closed meshes: vertices of each on the other's surface, and convex edges across each other."""

from __future__ import annotations

import math

from ..frames import dot, resolve1
from ..slave.kernel import kernel
from .contacts import (
    AMOUNTS,
    CONTACT,
    EDGE_EDGE,
    GAP,
    KINDS,
    POINT,
    VERTEX_OF_A,
    VERTEX_OF_B,
    WEIGHT,
    add,
    moved,
    moved_back,
    place,
    turned,
    turned_back,
)
from .edges import cone_weight, crossing, taper
from .nearest import signed_distance
from .surface import ENDS
from .tree import FIRST_EDGE, FIRST_VERTEX, LAST_EDGE, LAST_VERTEX, RIGHT, distance_to_box


@kernel
def mesh_contacts(meshes, a, pose_a, b, pose_b, margin, scratch, contacts, n):
    """Contact candidates between the closed surfaces of bodies a and b, each once.

    A vertex is one where its normal opposes that of the surface that is nearest to it, two edges where the normal across both lies between
    the normals of the faces at each. Overlaps are found down to a depth of ``margin``.

    Args:
        meshes: ``surface.Meshes``.
        a, b: Indices of the bodies.
        pose_a, pose_b: Records with r_0 [m] and T, world to body.
        margin: Gap below which there is a candidate [m].
        scratch: ``contacts.scratch_for(meshes)``.
        contacts: Rows for candidates, [most, CONTACT].
        n: Rows that are taken.

    Returns:
        Rows that are taken now; one more than there are if some candidates did not fit.
    """
    frame, marks, found = scratch.frame, scratch.marks, scratch.found
    place(pose_a, pose_b, frame)
    spheres = meshes.spheres
    x, y, z = moved(frame, spheres[b, 0], spheres[b, 1], spheres[b, 2])
    x, y, z = x - spheres[a, 0], y - spheres[a, 1], z - spheres[a, 2]
    if dot(x, y, z, x, y, z) > (spheres[a, 3] + spheres[b, 3] + margin) ** 2:
        return n
    first = n
    n, n_found = _traverse(meshes, a, pose_a, b, margin, scratch, contacts, n)
    n_edges = n
    T, r = pose_a.T, pose_a.r_0
    for k in range(n_found):
        i, of_b = found[k] // 2, found[k] % 2
        marks[i] = 0
        x, y, z = meshes.vertices[i, 0], meshes.vertices[i, 1], meshes.vertices[i, 2]
        v_x, v_y, v_z = meshes.vertices[i, 3], meshes.vertices[i, 4], meshes.vertices[i, 5]
        if of_b == 0:
            q_x, q_y, q_z = moved_back(frame, x, y, z)
            v_x, v_y, v_z = turned_back(frame, v_x, v_y, v_z)
            touches, gap, n_x, n_y, n_z, weight, _ = signed_distance(
                meshes, meshes.roots[b], q_x, q_y, q_z, v_x, v_y, v_z, margin, scratch.stack
            )
            if not touches:
                continue
            n_x, n_y, n_z = turned(frame, n_x, n_y, n_z)
            shift, kind = -0.5 * gap, VERTEX_OF_A
        else:
            x, y, z = moved(frame, x, y, z)
            v_x, v_y, v_z = turned(frame, v_x, v_y, v_z)
            touches, gap, n_x, n_y, n_z, weight, twice = signed_distance(
                meshes, meshes.roots[a], x, y, z, v_x, v_y, v_z, margin, scratch.stack
            )
            # Two vertices are found from A's side.
            if not touches or twice:
                continue
            n_x, n_y, n_z = -n_x, -n_y, -n_z
            shift, kind = 0.5 * gap, VERTEX_OF_B
        x, y, z = resolve1(T, x + shift * n_x, y + shift * n_y, z + shift * n_z)
        n_x, n_y, n_z = resolve1(T, n_x, n_y, n_z)
        n = add(contacts, n, a, b, r[0] + x, r[1] + y, r[2] + z, n_x, n_y, n_z, gap, float(kind + KINDS * i), weight)
    return _without_far_edges(contacts, first, n_edges, n)


@kernel
def _without_far_edges(contacts, first, n_edges, n):
    """Take weight from edges of rows ``first`` to ``n_edges`` - 1 that overlap far more than a vertex beside them, and drop what has none.

    Where a corner dips into a face by little, its edges are deep behind those of the face, however far these are: along them is not the
    way out. own choice: a vertex within that depth which overlaps by less than half of it is, and one within twice the depth, or which
    overlaps by less than that, in part.

    Returns:
        The row after the last one kept.
    """
    if n > contacts.shape[0]:
        return n
    kept = first
    for c in range(first, n):
        gap = contacts[c, GAP]
        if c < n_edges and gap < 0.0:
            for d in range(n_edges, n):
                if gap < contacts[d, GAP] < 0.0:
                    x, y = contacts[c, POINT] - contacts[d, POINT], contacts[c, POINT + 1] - contacts[d, POINT + 1]
                    z = contacts[c, POINT + 2] - contacts[d, POINT + 2]
                    beside = taper(math.sqrt(dot(x, y, z, x, y, z)) / -gap - 1.0)
                    contacts[c, WEIGHT] *= 1.0 - beside * taper(2.0 * contacts[d, GAP] / gap - 1.0)
        if contacts[c, WEIGHT] > 0.0:
            for k in range(CONTACT):
                contacts[kept, k] = contacts[c, k]
            kept += 1
    return kept


@kernel
def _traverse(meshes, a, pose_a, b, margin, scratch, contacts, n):
    """Walk down both trees where they are near: add candidates of edges, mark vertices. Rows taken, and how many vertices are marked."""
    frame, stack, nodes, boxes = scratch.frame, scratch.stack, meshes.nodes, meshes.boxes
    n_found = 0
    stack[0], stack[1], top = meshes.roots[a], meshes.roots[b], 2
    while top > 0:
        top -= 2
        i, j = stack[top], stack[top + 1]
        if _apart(frame, boxes, i, j, margin):
            continue
        right_i, right_j = nodes[i, RIGHT], nodes[j, RIGHT]
        if right_i == 0 and right_j == 0:
            n = _cross_edges(meshes, a, pose_a, b, i, j, margin, frame, contacts, n)
            n_found = _mark(meshes, i, j, margin, scratch, n_found)
        elif right_j == 0 or (right_i > 0 and boxes[i, 3] + boxes[i, 4] + boxes[i, 5] > boxes[j, 3] + boxes[j, 4] + boxes[j, 5]):
            stack[top], stack[top + 1], stack[top + 2], stack[top + 3] = i + 1, j, right_i, j
            top += 4
        else:
            stack[top], stack[top + 1], stack[top + 2], stack[top + 3] = i, j + 1, i, right_j
            top += 4
    return n, n_found


@kernel(inline=True)
def _apart(frame, boxes, i, j, margin):
    """Whether one of the six faces' axes shows that box i of A and box j of B are further apart than the margin."""
    x, y, z = moved(frame, boxes[j, 0], boxes[j, 1], boxes[j, 2])
    x, y, z = x - boxes[i, 0], y - boxes[i, 1], z - boxes[i, 2]
    a_x, a_y, a_z = boxes[i, 3] + margin, boxes[i, 4] + margin, boxes[i, 5] + margin
    b_x, b_y, b_z = boxes[j, 3], boxes[j, 4], boxes[j, 5]
    k = AMOUNTS
    if abs(x) > a_x + frame[k] * b_x + frame[k + 1] * b_y + frame[k + 2] * b_z:
        return True
    if abs(y) > a_y + frame[k + 3] * b_x + frame[k + 4] * b_y + frame[k + 5] * b_z:
        return True
    if abs(z) > a_z + frame[k + 6] * b_x + frame[k + 7] * b_y + frame[k + 8] * b_z:
        return True
    x, y, z = turned_back(frame, x, y, z)
    a_x, a_y, a_z = boxes[i, 3], boxes[i, 4], boxes[i, 5]
    if abs(x) > b_x + margin + frame[k] * a_x + frame[k + 3] * a_y + frame[k + 6] * a_z:
        return True
    if abs(y) > b_y + margin + frame[k + 1] * a_x + frame[k + 4] * a_y + frame[k + 7] * a_z:
        return True
    return abs(z) > b_z + margin + frame[k + 2] * a_x + frame[k + 5] * a_y + frame[k + 8] * a_z


@kernel
def _mark(meshes, i, j, margin, scratch, n_found):
    """Mark the vertices of leaf i of A near the box of leaf j of B, and the other way round."""
    frame, marks, found, vertices = scratch.frame, scratch.marks, scratch.found, meshes.vertices
    square = margin * margin
    for k in range(meshes.nodes[i, FIRST_VERTEX], meshes.nodes[i, LAST_VERTEX]):
        if marks[k] & 1 == 0:
            x, y, z = moved_back(frame, vertices[k, 0], vertices[k, 1], vertices[k, 2])
            if distance_to_box(meshes.boxes, j, x, y, z) < square:
                marks[k] |= 1
                found[n_found] = 2 * k
                n_found += 1
    for k in range(meshes.nodes[j, FIRST_VERTEX], meshes.nodes[j, LAST_VERTEX]):
        if marks[k] & 2 == 0:
            x, y, z = moved(frame, vertices[k, 0], vertices[k, 1], vertices[k, 2])
            if distance_to_box(meshes.boxes, i, x, y, z) < square:
                marks[k] |= 2
                found[n_found] = 2 * k + 1
                n_found += 1
    return n_found


@kernel
def _cross_edges(meshes, a, pose_a, b, i, j, margin, frame, contacts, n):
    """Candidates of the convex edges of leaf i of A with those of leaf j of B."""
    vertices, edges, T, r = meshes.vertices, meshes.edges, pose_a.T, pose_a.r_0
    for f in range(meshes.nodes[j, FIRST_EDGE], meshes.nodes[j, LAST_EDGE]):
        k, m = edges[f, ENDS], edges[f, ENDS + 1]
        q_x, q_y, q_z = moved(frame, vertices[k, 0], vertices[k, 1], vertices[k, 2])
        e_x, e_y, e_z = moved(frame, vertices[m, 0], vertices[m, 1], vertices[m, 2])
        e_x, e_y, e_z = e_x - q_x, e_y - q_y, e_z - q_z
        for e in range(meshes.nodes[i, FIRST_EDGE], meshes.nodes[i, LAST_EDGE]):
            k, m = edges[e, ENDS], edges[e, ENDS + 1]
            p_x, p_y, p_z = vertices[k, 0], vertices[k, 1], vertices[k, 2]
            d_x, d_y, d_z = vertices[m, 0] - p_x, vertices[m, 1] - p_y, vertices[m, 2] - p_z
            cross_, s, t, n_x, n_y, n_z = crossing(p_x, p_y, p_z, d_x, d_y, d_z, q_x, q_y, q_z, e_x, e_y, e_z, margin)
            if not cross_:
                continue
            o_x, o_y, o_z = turned(frame, meshes.edge_normals[f, 0], meshes.edge_normals[f, 1], meshes.edge_normals[f, 2])
            if dot(o_x, o_y, o_z, n_x, n_y, n_z) < 0.0:
                n_x, n_y, n_z = -n_x, -n_y, -n_z
            length = math.sqrt(dot(d_x, d_y, d_z, d_x, d_y, d_z))
            weight = cone_weight(meshes, e, d_x / length, d_y / length, d_z / length, -n_x, -n_y, -n_z)
            if weight <= 0.0:
                continue
            length = math.sqrt(dot(e_x, e_y, e_z, e_x, e_y, e_z))
            o_x, o_y, o_z = turned_back(frame, e_x / length, e_y / length, e_z / length)
            m_x, m_y, m_z = turned_back(frame, n_x, n_y, n_z)
            weight *= cone_weight(meshes, f, o_x, o_y, o_z, m_x, m_y, m_z)
            if weight <= 0.0:
                continue
            p_x, p_y, p_z = p_x + s * d_x, p_y + s * d_y, p_z + s * d_z
            gap = dot(p_x - q_x - t * e_x, p_y - q_y - t * e_y, p_z - q_z - t * e_z, n_x, n_y, n_z)
            x, y, z = resolve1(T, p_x - 0.5 * gap * n_x, p_y - 0.5 * gap * n_y, p_z - 0.5 * gap * n_z)
            n_x, n_y, n_z = resolve1(T, n_x, n_y, n_z)
            id_ = EDGE_EDGE + KINDS * (float(e) * edges.shape[0] + f)
            n = add(contacts, n, a, b, r[0] + x, r[1] + y, r[2] + z, n_x, n_y, n_z, gap, id_, weight)
    return n
