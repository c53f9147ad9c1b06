"""Surfaces as arrays: triangles, edges and vertices with their normals, ordered along a tree of boxes, and several joined for kernels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .files import parts_of, read_body, read_ground
from .tree import (
    FIRST_EDGE,
    FIRST_TRIANGLE,
    FIRST_VERTEX,
    LAST_EDGE,
    LAST_TRIANGLE,
    LAST_VERTEX,
    RIGHT,
    build,
)

if TYPE_CHECKING:
    import trimesh

#: Columns of ``triangles``: corners, and edges from each corner to the next. Columns of ``edges``: ends, in the direction in which the
#: first face has them; the two faces (-1: none, the edge of an open ground); 1 if convex.
CORNERS, EDGES = 0, 3
ENDS, FACES, CONVEX = 0, 2, 4

_FLAT = 2e-3  # sine of the angle between two faces up to which their edge counts as flat: rounding of single precision in files


class Meshes(NamedTuple):
    """Surfaces of several bodies, each in its body's frame, for kernels.

    Attributes:
        vertices: Position [m] and unit angle-weighted normal, [n, 6].
        triangles: Corners and edges, [n, 6].
        normals: Unit outward normal of each triangle, [n, 3]; 0 where it has no area.
        edges: Ends, faces, and whether convex, [n, 5].
        edge_normals: Unit mean of the normals of the two faces, [n, 3].
        boxes, nodes: Of the trees, as in ``tree.build``, [n, 6] and [n, NODE].
        roots: First node of each body, [n_bodies].
        spheres: Middle and radius of a sphere around each body [m], [n_bodies, 4].
    """

    vertices: np.ndarray
    triangles: np.ndarray
    normals: np.ndarray
    edges: np.ndarray
    edge_normals: np.ndarray
    boxes: np.ndarray
    nodes: np.ndarray
    roots: np.ndarray
    spheres: np.ndarray


@dataclass(frozen=True, eq=False)
class Surface:
    """One surface: ``arrays``, with a single body, and what it weighs.

    Attributes:
        arrays: In the body's frame.
        volume: Volume enclosed [m3].
        centre: Its centre of mass [m], shape [3].
        inertia: Its tensor about that centre, in the axes of the frame, for a density of 1 kg/m3 [m5], shape [3, 3].
    """

    arrays: Meshes
    volume: float
    centre: np.ndarray
    inertia: np.ndarray

    @property
    def triangles(self) -> np.ndarray:
        """Corners of all triangles [m], shape [n, 3, 3]."""
        return self.arrays.vertices[self.arrays.triangles[:, CORNERS : CORNERS + 3], :3]


def load_surface(path: str | Path, *, ground: bool = False) -> Surface:
    """Read the surface of a closed body, or with ``ground`` an open one that rays alone will meet; equal files are read once.

    Raises:
        ModelError: The file cannot be used (``files.read_body``, ``files.read_ground``).
    """
    path = Path(path)
    # One that is missing is told of by the reader.
    return _loaded(path, path.stat().st_mtime_ns if path.is_file() else 0, ground)


@lru_cache(maxsize=32)
def _loaded(path: Path, changed: int, ground: bool) -> Surface:
    return surface_of(read_ground(path) if ground else read_body(path))


def surface_of(mesh: trimesh.Trimesh) -> Surface:
    """The surface of a mesh that ``files.check_body`` accepts, or of an open ground.

    Normals of edges and vertices are those by which the sign of a distance is right (Baerentzen & Aanaes 2005).
    """
    faces, vertices = _apart(mesh)
    corners = vertices[faces]
    order, nodes, boxes = build(corners.min(axis=1), corners.max(axis=1))
    faces, corners = faces[order], corners[order]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = _unit(cross)

    leaves = np.flatnonzero(nodes[:, RIGHT] == 0)
    per_leaf = nodes[leaves, LAST_TRIANGLE] - nodes[leaves, FIRST_TRIANGLE]
    leaf_of = np.repeat(np.arange(len(leaves)), per_leaf)

    # Vertices in the order of the first triangle that has them.
    vertex_normals = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(vertex_normals, faces[:, k], _angle(corners, k)[:, None] * normals)  # Baerentzen & Aanaes 2005
    first_seen = np.full(len(vertices), len(faces))
    np.minimum.at(first_seen, faces, np.arange(len(faces))[:, None])
    vertex_order = np.argsort(first_seen, kind="stable")
    owner = first_seen[vertex_order]
    nodes[leaves, FIRST_VERTEX] = np.searchsorted(owner, nodes[leaves, FIRST_TRIANGLE])
    nodes[leaves, LAST_VERTEX] = np.searchsorted(owner, nodes[leaves, LAST_TRIANGLE])
    place = np.empty_like(vertex_order)
    place[vertex_order] = np.arange(len(vertex_order))
    faces, vertices, vertex_normals = place[faces], vertices[vertex_order], _unit(vertex_normals[vertex_order])

    # Edges in the order of leaves, convex ones first.
    edges, edges_of = _edges(faces, vertices, normals)
    leaf = leaf_of[edges[:, FACES]]
    edge_order = np.lexsort((1 - edges[:, CONVEX], leaf))
    edges, leaf = edges[edge_order], leaf[edge_order]
    place = np.empty_like(edge_order)
    place[edge_order] = np.arange(len(edge_order))
    nodes[leaves, FIRST_EDGE] = np.searchsorted(leaf, np.arange(len(leaves)))
    nodes[leaves, LAST_EDGE] = nodes[leaves, FIRST_EDGE] + np.bincount(leaf, edges[:, CONVEX], len(leaves)).astype(np.int64)
    has_two = edges[:, FACES + 1] >= 0
    edge_normals = _unit(normals[edges[:, FACES]] + np.where(has_two[:, None], normals[edges[:, FACES + 1]], 0.0))

    middle = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    radius = np.linalg.norm(vertices - middle, axis=1).max()
    arrays = Meshes(
        vertices=np.hstack([vertices, vertex_normals]),
        triangles=np.hstack([faces, place[edges_of]]),
        normals=normals,
        edges=edges,
        edge_normals=edge_normals,
        boxes=boxes,
        nodes=nodes,
        roots=np.zeros(1, np.int64),
        spheres=np.array([[*middle, radius]]),
    )
    if not mesh.is_watertight:  # a sheet of ground weighs nothing
        return Surface(_read_only(arrays), 0.0, np.zeros(3), np.zeros((3, 3)))
    return Surface(_read_only(arrays), float(mesh.volume), np.array(mesh.center_mass), np.array(mesh.moment_inertia) / mesh.density)


def nothing() -> Meshes:
    """No surface, in arrays of the types that surfaces have."""
    import trimesh

    return _read_only(Meshes(*(np.zeros((0, *a.shape[1:]), a.dtype) for a in surface_of(trimesh.creation.box((1.0, 1.0, 1.0))).arrays)))


def join(surfaces: Sequence[Surface]) -> Meshes:
    """The surfaces of bodies 0, 1, ... in one set of arrays, each surface once, however many bodies have it."""
    distinct = list(dict.fromkeys(surfaces))
    joined: dict[str, list[np.ndarray]] = {name: [] for name in Meshes._fields}
    n_vertices = n_triangles = n_edges = n_nodes = 0
    root = {}
    for surface in distinct:
        own = surface.arrays
        root[surface] = n_nodes
        edges, nodes, triangles = own.edges.copy(), own.nodes.copy(), own.triangles.copy()
        triangles[:, CORNERS : CORNERS + 3] += n_vertices
        triangles[:, EDGES : EDGES + 3] += n_edges
        edges[:, ENDS : ENDS + 2] += n_vertices
        edges[:, FACES : FACES + 2] += np.where(edges[:, FACES : FACES + 2] >= 0, n_triangles, 0)
        nodes[:, RIGHT] += np.where(nodes[:, RIGHT] > 0, n_nodes, 0)
        nodes[:, [FIRST_TRIANGLE, LAST_TRIANGLE]] += n_triangles
        nodes[:, [FIRST_EDGE, LAST_EDGE]] += n_edges
        nodes[:, [FIRST_VERTEX, LAST_VERTEX]] += n_vertices
        for name, part in own._replace(triangles=triangles, edges=edges, nodes=nodes)._asdict().items():
            joined[name].append(part)
        n_vertices, n_triangles = n_vertices + len(own.vertices), n_triangles + len(own.triangles)
        n_edges, n_nodes = n_edges + len(own.edges), n_nodes + len(own.nodes)
    joined["roots"] = [np.array([root[surface] for surface in surfaces], np.int64)]
    joined["spheres"] = [surface.arrays.spheres for surface in surfaces]
    return _read_only(Meshes(**{name: np.concatenate(parts) for name, parts in joined.items()}))


def _read_only(meshes: Meshes) -> Meshes:
    for array in meshes:
        array.flags.writeable = False
    return meshes


def _unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors at length 1, those of length 0 as they are."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors / np.where(length > 0.0, length, 1.0)


def _angle(corners: np.ndarray, k: int) -> np.ndarray:
    """Angle [rad] of each triangle at corner k."""
    to_next, to_last = corners[:, (k + 1) % 3] - corners[:, k], corners[:, (k + 2) % 3] - corners[:, k]
    return np.arctan2(np.linalg.norm(np.cross(to_next, to_last), axis=1), (to_next * to_last).sum(axis=1))


def _apart(mesh: trimesh.Trimesh) -> tuple[np.ndarray, np.ndarray]:
    """Faces and vertices of a mesh whose parts that touch share no vertices, as that would mix their normals."""
    part = np.empty(len(mesh.faces), np.int64)
    for number, members in enumerate(parts_of(mesh)):
        part[members] = number
    keys = part[:, None] * len(mesh.vertices) + mesh.faces
    own, faces = np.unique(keys, return_inverse=True)
    return faces.reshape(-1, 3), np.array(mesh.vertices, np.float64)[own % len(mesh.vertices)]


def _edges(faces: np.ndarray, vertices: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Edges, [n, 5], and the edge from each corner of each face to the next, [n_faces, 3]."""
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    face = np.repeat(np.arange(len(faces)), 3)
    n = len(vertices)
    key, forward = np.minimum(start, end) * n + np.maximum(start, end), start < end
    # Two faces meet where one runs along an edge and the other back; a part that touches itself along an edge has two such pairs.
    ahead, back = (np.flatnonzero(side)[np.argsort(key[side], kind="stable")] for side in (forward, ~forward))
    turn_ahead, turn_back = _repeats(key[ahead]), _repeats(key[back])
    labels_ahead = key[ahead] * 4 + np.minimum(turn_ahead, 3)
    labels_back = key[back] * 4 + np.minimum(turn_back, 3)
    labels, index = np.unique(np.concatenate([labels_ahead, labels_back]), return_inverse=True)
    edges_of = np.empty(len(face), np.int64)
    edges_of[ahead], edges_of[back] = index[: len(ahead)], index[len(ahead) :]
    edges = np.full((len(labels), 5), -1, np.int64)
    edges[:, ENDS], edges[:, ENDS + 1] = labels // 4 // n, labels // 4 % n
    edges[edges_of[ahead], FACES], edges[edges_of[back], FACES + 1] = face[ahead], face[back]
    alone = edges[:, FACES] < 0  # only the face that runs back
    edges[alone] = edges[alone][:, [1, 0, 3, 2, 4]]
    # Left of the first face and right of the second one the body is within: faces turn away from each other at a convex edge.
    along = _unit(vertices[edges[:, ENDS + 1]] - vertices[edges[:, ENDS]])
    bend = (np.cross(normals[edges[:, FACES]], normals[edges[:, FACES + 1]]) * along).sum(axis=1)
    edges[:, CONVEX] = (edges[:, FACES + 1] >= 0) & (bend > _FLAT)
    return edges, edges_of.reshape(-1, 3)


def _repeats(sorted_keys: np.ndarray) -> np.ndarray:
    """How often each key came before, of keys in ascending order."""
    new = np.flatnonzero(np.diff(sorted_keys, prepend=-1))
    return np.arange(len(sorted_keys)) - np.repeat(new, np.diff(new, append=len(sorted_keys)))
