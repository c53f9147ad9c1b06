"""Where a sphere touches a closed mesh: at each local minimum of its centre's distance from the surface."""

from __future__ import annotations

import math

from ..frames import dot
from ..mesh.nearest import CORNER, EDGE, WITHIN, feature_normal, nearest_on_triangle
from ..mesh.surface import CORNERS, EDGES, FACES
from ..mesh.tree import FIRST_TRIANGLE, LAST_TRIANGLE, RIGHT, distance_to_box
from ..slave.kernel import kernel
from .touch import DISTANCE, MOST, NORMAL, TOUCH

_ROUNDING = 1e-12  # [m] from the surface, below which the direction from there is rounding; nor is a triangle nearer by less
_ON = 1e-9  # [m] from a triangle, within which it holds a point
# Own choice: cosine of 10 degrees between two rows, above which they are one. Where two faces meet so flatly that a sphere overlaps both by
# more than 1 - cos of their angle, it would press twice on one spot: seams of flat faces in files of single precision, tessellated bowls.
_ONE_DIRECTION = 0.985


@kernel
def mesh_touches(meshes, root, x, y, z, reach, stack, out):
    """Rows of a sphere on a closed mesh, in the mesh's frame, deepest first: one on a face or over a convex edge, two or three in a corner.

    A point on a face is a row; one on an edge or at a vertex if no triangle that holds it has a nearer point. Of rows whose directions are
    within 10 degrees only the nearest counts. A face that looks away from the centre gives none, so that a plate thinner than the sphere
    pushes it back to its own side. A centre within the mesh has one row, of the nearest point of the surface; one as deep as ``reach`` has
    none.

    A face that lies within another part of the mesh counts as any other: join parts that overlap before.

    Args:
        meshes: ``mesh.surface.Meshes``.
        root: First node of the surface.
        x, y, z: Centre of the sphere [m].
        reach: Distance [m] below which a point is met, > 0: the sphere's radius and a margin.
        stack: Nodes still to look at, [256].
        out: Rows that are written, [MOST, TOUCH].

    Returns:
        Number of rows.
    """
    vertices, triangles, normals = meshes.vertices, meshes.triangles, meshes.normals
    square = reach * reach
    nearest, q_x, q_y, q_z, at, on = square, 0.0, 0.0, 0.0, -1, WITHIN
    n = 0
    stack[0], top = root, 1
    while top > 0:
        top -= 1
        i = stack[top]
        if distance_to_box(meshes.boxes, i, x, y, z) >= square:
            continue
        right = meshes.nodes[i, RIGHT]
        if right > 0:
            stack[top], stack[top + 1] = right, i + 1
            top += 2
            continue
        for t in range(meshes.nodes[i, FIRST_TRIANGLE], meshes.nodes[i, LAST_TRIANGLE]):
            k = triangles[t, CORNERS]
            d_x, d_y, d_z = x - vertices[k, 0], y - vertices[k, 1], z - vertices[k, 2]
            side = dot(d_x, d_y, d_z, normals[t, 0], normals[t, 1], normals[t, 2])
            if abs(side) >= reach:
                continue
            p_x, p_y, p_z, where = nearest_on_triangle(vertices, triangles, t, x, y, z)
            d_x, d_y, d_z = x - p_x, y - p_y, z - p_z
            d = dot(d_x, d_y, d_z, d_x, d_y, d_z)
            if d >= square:
                continue
            if d < nearest:
                nearest, q_x, q_y, q_z, at, on = d, p_x, p_y, p_z, t, where
            if side < 0.0:
                continue
            d = math.sqrt(d)
            if d <= _ROUNDING:
                continue
            if where == WITHIN or (
                not _neighbour_is_nearer(meshes, t, where, x, y, z, d) and _is_minimum(meshes, root, x, y, z, p_x, p_y, p_z, d, stack, top)
            ):
                n = _insert(out, n, d, d_x / d, d_y / d, d_z / d)
    if at < 0:
        return 0
    # The sign is that of the side of the nearest feature's normal (Baerentzen & Aanaes 2005).
    n_x, n_y, n_z = feature_normal(meshes, at, on)
    d = math.sqrt(nearest)
    if d > _ROUNDING:
        if dot(x - q_x, y - q_y, z - q_z, n_x, n_y, n_z) >= 0.0:
            return n
        d = -d
        n_x, n_y, n_z = (x - q_x) / d, (y - q_y) / d, (z - q_z) / d
    return _insert(out, 0, d, n_x, n_y, n_z)


@kernel
def _neighbour_is_nearer(meshes, t, where, x, y, z, distance):
    """Whether a face across the edge, or across the edges of the corner, where a nearest point is on triangle t, has a nearer one.

    That settles most of them, and without a search.
    """
    square = (distance - _ROUNDING) * (distance - _ROUNDING)
    edge = where - EDGE if where >= EDGE else where - CORNER
    for k in range(1 if where >= EDGE else 2):
        e = meshes.triangles[t, EDGES + (edge + 2 * k) % 3]
        other = meshes.edges[e, FACES] if meshes.edges[e, FACES] != t else meshes.edges[e, FACES + 1]
        p_x, p_y, p_z, _ = nearest_on_triangle(meshes.vertices, meshes.triangles, other, x, y, z)
        if _square(p_x - x, p_y - y, p_z - z) < square:
            return True
    return False


@kernel
def _is_minimum(meshes, root, x, y, z, q_x, q_y, q_z, distance, stack, first):
    """Whether no triangle that holds a point of the surface at this distance from the centre (x, y, z) has a nearer one."""
    square = (distance - _ROUNDING) * (distance - _ROUNDING)
    stack[first], top = root, first + 1
    while top > first:
        top -= 1
        i = stack[top]
        if distance_to_box(meshes.boxes, i, q_x, q_y, q_z) > _ON * _ON:
            continue
        right = meshes.nodes[i, RIGHT]
        if right > 0:
            stack[top], stack[top + 1] = right, i + 1
            top += 2
            continue
        for t in range(meshes.nodes[i, FIRST_TRIANGLE], meshes.nodes[i, LAST_TRIANGLE]):
            p_x, p_y, p_z, _ = nearest_on_triangle(meshes.vertices, meshes.triangles, t, q_x, q_y, q_z)
            if _square(p_x - q_x, p_y - q_y, p_z - q_z) > _ON * _ON:
                continue
            p_x, p_y, p_z, _ = nearest_on_triangle(meshes.vertices, meshes.triangles, t, x, y, z)
            if _square(p_x - x, p_y - y, p_z - z) < square:
                return False
    return True


@kernel(inline=True)
def _square(x, y, z):
    return x * x + y * y + z * z


@kernel
def _insert(out, n, distance, n_x, n_y, n_z):
    """Put a row where its distance belongs and return how many there are now; of rows in one direction the nearest stays."""
    kept = 0
    for k in range(n):
        if dot(out[k, NORMAL], out[k, NORMAL + 1], out[k, NORMAL + 2], n_x, n_y, n_z) > _ONE_DIRECTION:
            # Nearer rows come first: none is left out by the time that one of them is found.
            if out[k, DISTANCE] <= distance:
                return n
        else:
            for column in range(TOUCH):
                out[kept, column] = out[k, column]
            kept += 1
    if kept == MOST:
        if out[MOST - 1, DISTANCE] <= distance:
            return MOST
        kept -= 1
    k = kept
    while k > 0 and out[k - 1, DISTANCE] > distance:
        for column in range(TOUCH):
            out[k, column] = out[k - 1, column]
        k -= 1
    out[k, DISTANCE] = distance
    out[k, NORMAL], out[k, NORMAL + 1], out[k, NORMAL + 2] = n_x, n_y, n_z
    return kept + 1
