"""Closed surface meshes as point clouds: the form in which bodies and meshed wheels meet the soil."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .slave.model import ModelError

if TYPE_CHECKING:
    import trimesh

_FORMATS = (".stl", ".obj", ".ply")
_LARGEST, _SMALLEST = 20.0, 1e-3  # [m] across: beyond these a file is taken to be in other units
_MOST_ELEMENTS = 2_000_000
_FLAT = 1e-9  # volume over the cube of the largest dimension, below which a mesh counts as a sheet


@dataclass(frozen=True)
class Cloud:
    """A closed surface cut into small flat elements, in the frame of the body.

    Attributes:
        elements: Float64, shape [n, 7], C-contiguous: centroid x, y, z [m], unit outward normal n_x, n_y, n_z [1], area [m2].
        radius: Largest distance of the surface from the frame's origin [m].
        bounds: Least and largest x, y, z [m], shape [2, 3].
        volume: Volume enclosed [m3].
        plan_area: Area of the convex hull of the projection on the x-y plane [m2].
        plan_perimeter: Perimeter of that hull [m]; 2 plan_area / plan_perimeter is Bekker's width of a foot (a disc's radius).
    """

    elements: np.ndarray
    radius: float
    bounds: np.ndarray
    volume: float
    plan_area: float
    plan_perimeter: float


def load_cloud(path: str | Path, spacing: float) -> Cloud:
    """Read a closed mesh (STL, OBJ or PLY, in metres) and cut its surface into elements with sides of at most ``spacing`` [m].

    The elements cover the mesh without overlap, and equal files give equal clouds. A mesh whose normals point inwards is turned;
    cavities keep theirs.

    Raises:
        ModelError: The file is missing, no mesh, open, wound inconsistently, flat or not in metres, or ``spacing`` is too small for it.
    """
    # It and trimesh take most of a second to import, which contacts without a mesh need not wait for.
    from scipy.spatial import ConvexHull

    path = Path(path)
    if not spacing > 0.0:
        raise ModelError(f"spacing = {spacing:g} m: it must be above 0 m (longest side of a surface element of {path.name})")
    mesh = _closed(path.name, _read(path))
    hull = ConvexHull(mesh.vertices[:, :2])  # in two dimensions its volume is the area and its area the perimeter
    return Cloud(
        elements=_elements(path.name, mesh, spacing),
        radius=float(np.linalg.norm(mesh.vertices, axis=1).max()),
        bounds=np.array(mesh.bounds),
        volume=float(mesh.volume),
        plan_area=float(hull.volume),
        plan_perimeter=float(hull.area),
    )


def _read(path: Path) -> trimesh.Trimesh:
    """Triangles of the file with vertices merged, whatever materials, normals and groups they had."""
    import trimesh

    if path.suffix.lower() not in _FORMATS:
        raise ModelError(f"{path.name}: a mesh is read from {', '.join(_FORMATS)}; export it as one of these, in metres")
    if not path.is_file():
        raise ModelError(f"{path}: no such file; give the path of a closed mesh ({', '.join(_FORMATS)})")
    try:
        loaded = trimesh.load_mesh(path)
        mesh = trimesh.Trimesh(loaded.vertices, loaded.faces)
    except Exception as error:  # readers of foreign files fail in every way
        raise ModelError(f"{path.name} is no mesh that can be read ({error}); export it again, e.g. as binary STL") from None
    a, b, c = mesh.faces.T
    mesh.update_faces((a != b) & (b != c) & (c != a) & mesh.unique_faces())
    mesh.remove_unreferenced_vertices()
    if len(mesh.faces) == 0:
        raise ModelError(f"{path.name} has no triangles: export the surface of the body, not points or curves")
    return mesh


def _closed(file: str, mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """The mesh with normals outwards; refuses one that bounds no body or is not in metres."""
    size = float(mesh.extents.max())
    if size > _LARGEST:
        raise ModelError(
            f"{file} is {size:.4g} m across: the file is most likely in millimetres; scale it by 0.001 (metres are expected, up to "
            f"{_LARGEST:g} m)"
        )
    if size < _SMALLEST:
        raise ModelError(
            f"{file} is {size:.4g} m across: the file is most likely in kilometres or was scaled to metres twice; scale it by 1000 "
            f"(metres are expected, from {_SMALLEST:g} m)"
        )
    edges, faces_at = np.unique(mesh.edges_sorted, axis=0, return_counts=True)
    # Where two parts touch along an edge, four faces meet: still closed.
    n_open = int(np.count_nonzero(faces_at % 2))
    if n_open:
        raise ModelError(
            f"{file} is open: {n_open} of its {len(edges)} edges have no second face; close it in the CAD tool or with "
            "trimesh.repair.fill_holes"
        )
    if not mesh.is_winding_consistent:
        raise ModelError(f"{file}: some triangles face inwards and some outwards; make them agree, e.g. with trimesh.repair.fix_winding")
    _turn_outwards(mesh)
    if mesh.volume < _FLAT * size**3:
        raise ModelError(f"{file} encloses {mesh.volume:.3g} m3 of volume: it is flat; give the sheet a thickness")
    return mesh


def _turn_outwards(mesh: trimesh.Trimesh) -> None:
    """Turn inverted parts; a part of negative volume within another one is a cavity and stays."""
    if mesh.volume < 0.0:
        mesh.invert()
    import trimesh

    parts = trimesh.graph.connected_components(mesh.face_adjacency, nodes=np.arange(len(mesh.faces)))
    if len(parts) == 1:
        return
    corners = mesh.triangles
    low = np.array([corners[part].min(axis=(0, 1)) for part in parts])
    high = np.array([corners[part].max(axis=(0, 1)) for part in parts])
    faces = mesh.faces.copy()
    for part, a, b in zip(parts, low, high):
        a_cavity = ((low < a) & (high > b)).all(axis=1).any()
        if not a_cavity and trimesh.triangles.mass_properties(corners[part], skip_inertia=True).volume < 0.0:
            faces[part] = faces[part][:, ::-1]
    mesh.faces = faces


def _elements(file: str, mesh: trimesh.Trimesh, spacing: float) -> np.ndarray:
    """Slice each triangle parallel to its shortest edge, and each slice across, into trapezoids."""
    area = np.array(mesh.area_faces)
    solid = area > 0.0  # a sliver of no area closes a mesh but touches nothing, and has no normal
    corners, area = np.array(mesh.triangles)[solid], area[solid]
    normals = mesh.triangles_cross[solid] / (2.0 * area[:, None])
    lengths = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)  # edge k runs from corner k to the next
    rows, shortest = np.arange(len(corners)), lengths.argmin(axis=1)
    apex = corners[rows, (shortest + 2) % 3]
    to_q, to_r = corners[rows, shortest] - apex, corners[rows, (shortest + 1) % 3] - apex
    n_slices = np.ceil(lengths.max(axis=1) / spacing)
    _check_number(file, n_slices.sum(), spacing)
    of_face, slice_ = _each(n_slices)
    base = lengths[rows, shortest] / n_slices
    n_across = np.ceil(base[of_face] * (slice_ + 1.0) / spacing)
    _check_number(file, n_across.sum(), spacing)
    of_slice, across = _each(n_across)
    face = of_face[of_slice]
    # A point is apex + f ((1 - g) to_q + g to_r); an element spans f_0..f_1 and 1 / n_across of g.
    f_0 = (slice_ / n_slices[of_face])[of_slice]
    f_1 = ((slice_ + 1.0) / n_slices[of_face])[of_slice]
    f = 2.0 / 3.0 * (f_0 * f_0 + f_0 * f_1 + f_1 * f_1) / (f_0 + f_1)
    g = ((across + 0.5) / n_across[of_slice])[:, None]
    elements = np.empty((len(face), 7))
    elements[:, :3] = apex[face] + f[:, None] * ((1.0 - g) * to_q[face] + g * to_r[face])
    elements[:, 3:6] = normals[face]
    elements[:, 6] = area[face] * (f_1 - f_0) * (f_0 + f_1) / n_across[of_slice]
    return elements


def _each(counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For counts [2, 3]: owners [0, 0, 1, 1, 1] and places [0, 1, 0, 1, 2]."""
    counts = counts.astype(np.int64)
    owner = np.repeat(np.arange(len(counts)), counts)
    return owner, np.arange(len(owner)) - (np.cumsum(counts) - counts)[owner]


def _check_number(file: str, number: float, spacing: float) -> None:
    if number > _MOST_ELEMENTS:
        raise ModelError(
            f"{file}: spacing = {spacing:g} m cuts it into {number:.3g} or more surface elements, the most are {_MOST_ELEMENTS:.3g}; "
            "choose a coarser spacing (SCM takes a quarter of its cell), simplify the mesh, or scale it if it is not in metres"
        )
