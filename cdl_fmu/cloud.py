"""Closed surface meshes as point clouds: the form in which bodies and meshed wheels meet the soil."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .mesh.files import read_body
from .slave.model import ModelError

if TYPE_CHECKING:
    import trimesh

_MOST_ELEMENTS = 2_000_000


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

    Equal files give equal clouds.

    Raises:
        ModelError: The file is missing, no mesh, open, wound inconsistently, inside out, flat or not in metres, or ``spacing`` is too small
            for it.
    """
    path = Path(path)
    _check_spacing(path.name, spacing)
    return cloud_of(path.name, read_body(path), spacing)


def cloud_of(name: str, mesh: trimesh.Trimesh, spacing: float) -> Cloud:
    """Cut a mesh that ``mesh.files.check_body`` accepts into elements with sides of at most ``spacing`` [m], which do not overlap.

    Raises:
        ModelError: ``spacing`` is too small for it; the message begins with ``name``.
    """
    # It takes a part of a second to import, which contacts without a mesh need not wait for.
    from scipy.spatial import ConvexHull

    _check_spacing(name, spacing)
    hull = ConvexHull(mesh.vertices[:, :2])  # in two dimensions its volume is the area and its area the perimeter
    return Cloud(
        elements=_elements(name, mesh, spacing),
        radius=float(np.linalg.norm(mesh.vertices, axis=1).max()),
        bounds=np.array(mesh.bounds),
        volume=float(mesh.volume),
        plan_area=float(hull.volume),
        plan_perimeter=float(hull.area),
    )


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


def _check_spacing(file: str, spacing: float) -> None:
    if not spacing > 0.0:
        raise ModelError(f"spacing = {spacing:g} m: it must be above 0 m (longest side of a surface element of {file})")


def _check_number(file: str, number: float, spacing: float) -> None:
    if number > _MOST_ELEMENTS:
        raise ModelError(
            f"{file}: spacing = {spacing:g} m cuts it into {number:.3g} or more surface elements, the most are {_MOST_ELEMENTS:.3g}; "
            "choose a coarser spacing (SCM takes a quarter of its cell, half of it for bodies), simplify the mesh, or scale it if it is "
            "not in metres"
        )
