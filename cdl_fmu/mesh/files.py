"""Mesh files: read, and refused by name where they bound no body."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..slave.model import ModelError

if TYPE_CHECKING:
    import trimesh

_FORMATS = (".stl", ".obj", ".ply")
_LARGEST, _SMALLEST = 20.0, 1e-3  # [m] across: beyond these a body's file is taken to be in other units
_LARGEST_GROUND = 5000.0  # [m] across
_MOST_FACES = 1_000_000
_FLAT = 1e-9  # volume over the cube of the largest dimension, below which a mesh counts as a sheet


def read_body(path: str | Path) -> trimesh.Trimesh:
    """Read a closed mesh (STL, OBJ or PLY, in metres) with normals outwards; cavities within it have theirs inwards.

    Raises:
        ModelError: The file is missing, no mesh, has over a million triangles, or ``check_body`` refuses it.
    """
    path = Path(path)
    mesh = _read(path)
    check_body(path.name, mesh)
    return mesh


def read_ground(path: str | Path) -> trimesh.Trimesh:
    """Read a ground's surface (STL, OBJ or PLY, in metres), open or closed, with normals upwards; it can be seen by rays only.

    Raises:
        ModelError: The file is missing, no mesh, not in metres, wound inconsistently, seen from below, or has over a million triangles.
    """
    path = Path(path)
    mesh = _read(path)
    _check_size(path.name, mesh, _LARGEST_GROUND)
    _check_winding(path.name, mesh)
    if not mesh.is_watertight and mesh.triangles_cross[:, 2].sum() <= 0.0:
        raise ModelError(
            f"{path.name}: the normals of this ground point down, so that no ray from above meets it; flip them in the CAD tool or with "
            "trimesh's mesh.invert()"
        )
    return mesh


def check_body(name: str, mesh: trimesh.Trimesh) -> None:
    """Refuse a mesh that bounds no body, is inside out, or is not in metres.

    Args:
        name: Of the file or the parameter, with which messages begin.
        mesh: With vertices merged.

    Raises:
        ModelError: It is open, wound inconsistently, has normals inwards, is flat or not in metres.
    """
    _check_size(name, mesh, _LARGEST)
    edges, faces_at = np.unique(mesh.edges_sorted, axis=0, return_counts=True)
    # Where two parts touch along an edge, four faces meet: still closed.
    n_open = int(np.count_nonzero(faces_at % 2))
    if n_open:
        raise ModelError(
            f"{name} is open: {n_open} of its {len(edges)} edges have no second face; close it in the CAD tool or with "
            "trimesh.repair.fill_holes"
        )
    _check_winding(name, mesh)
    _check_outwards(name, mesh)
    if mesh.volume < _FLAT * float(mesh.extents.max()) ** 3:
        raise ModelError(f"{name} encloses {mesh.volume:.3g} m3 of volume: it is flat; give the sheet a thickness")


def parts_of(mesh: trimesh.Trimesh) -> list[np.ndarray]:
    """Indices of the faces of each connected part."""
    import trimesh

    return trimesh.graph.connected_components(mesh.face_adjacency, nodes=np.arange(len(mesh.faces)))


def _read(path: Path) -> trimesh.Trimesh:
    """Triangles of the file with vertices merged, whatever materials, normals and groups they had."""
    # It takes most of a second to import, which contacts without a mesh need not wait for.
    import trimesh

    if path.suffix.lower() not in _FORMATS:
        raise ModelError(f"{path.name}: a mesh is read from {', '.join(_FORMATS)}; export it as one of these, in metres")
    if not path.is_file():
        raise ModelError(f"{path}: no such file; give the path of a mesh ({', '.join(_FORMATS)})")
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
    if len(mesh.faces) > _MOST_FACES:
        raise ModelError(
            f"{path.name} has {len(mesh.faces)} triangles, the most are {_MOST_FACES:.3g}: contacts need a few thousand; simplify it, e.g. "
            "with trimesh's mesh.simplify_quadric_decimation"
        )
    return mesh


def _check_size(name: str, mesh: trimesh.Trimesh, largest: float) -> None:
    size = float(mesh.extents.max())
    if size > largest:
        raise ModelError(
            f"{name} is {size:.4g} m across: the file is most likely in millimetres; scale it by 0.001 (metres are expected, up to "
            f"{largest:g} m)"
        )
    if size < _SMALLEST:
        raise ModelError(
            f"{name} is {size:.4g} m across: the file is most likely in kilometres or was scaled to metres twice; scale it by 1000 "
            f"(metres are expected, from {_SMALLEST:g} m)"
        )


def _check_winding(name: str, mesh: trimesh.Trimesh) -> None:
    if not mesh.is_winding_consistent:
        raise ModelError(f"{name}: some triangles face inwards and some outwards; make them agree, e.g. with trimesh.repair.fix_winding")


def _check_outwards(name: str, mesh: trimesh.Trimesh) -> None:
    """A part of negative volume is inside out, unless it lies within another one: then it is a cavity."""
    import trimesh

    parts, corners = parts_of(mesh), mesh.triangles
    low = np.array([corners[part].min(axis=(0, 1)) for part in parts])
    high = np.array([corners[part].max(axis=(0, 1)) for part in parts])
    for number, (part, a, b) in enumerate(zip(parts, low, high), start=1):
        volume = trimesh.triangles.mass_properties(corners[part], skip_inertia=True).volume
        a_cavity = ((low < a) & (high > b)).all(axis=1).any()
        if volume < 0.0 and not a_cavity:
            which = "its normals point" if len(parts) == 1 else f"the normals of part {number} of {len(parts)} point"
            raise ModelError(
                f"{name}: {which} inwards, so that it encloses {volume:.3g} m3; flip them in the CAD tool or with "
                "trimesh.repair.fix_inversion"
            )
