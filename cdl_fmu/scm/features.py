"""Fine features of a surface, such as grousers: what is too thin for the cells of the soil to hold its print.

Alike however the body is turned, so they are found once, from the surface around each element within ``_REACH`` cells:

- The flank of a feature is thinner than a cell and stands steeply on the mean of that surface, without what faces the other way.
- Its tip lies near flanks, and well above most of the surface that faces the same way.

A tip presses as it is but leaves no mark of its own, as loose soil closes behind it; below it the surface goes on, as that of the analytic
wheel does below its grousers. A flank pushes soil aside.
"""

from __future__ import annotations

import numpy as np

#: Kinds of an element.
SURFACE, TIP, FLANK = 0.0, 1.0, 2.0

_REACH = 4.0  # cells
_STEEP = 0.5  # cosine of 60 deg, between a flank and the surface that it stands on; and between surfaces that face the same way
_BACK = -0.87  # cosine of 150 deg, between a face and the other side of a thin part
_HIGH = 0.35  # cells by which a tip lies above the surface around it
_MOST = 0.6  # share of the surface facing the same way that lies so much lower


def with_kinds(elements: np.ndarray, cell: float) -> np.ndarray:
    """The elements with their kind as last column, and the surface below each tip.

    Args:
        elements: Surface elements, [n, 7] as in :class:`cdl_fmu.cloud.Cloud`.
        cell: Size of a cell of the soil [m].
    """
    lumps, lump_of = _lumps(elements, cell)
    kinds = _kinds(lumps, cell)[lump_of]
    tips, surface = elements[kinds == TIP], elements[kinds == SURFACE]
    marked = np.column_stack([elements, kinds])
    if len(tips) == 0 or len(surface) == 0:
        return marked
    # Along the tip's normal down to the plane of the nearest surface that faces the same way.
    below, near = tips.copy(), surface[_nearest(tips, surface, cell)]
    height = ((near[:, :3] - tips[:, :3]) * near[:, 3:6]).sum(axis=1) / np.maximum((tips[:, 3:6] * near[:, 3:6]).sum(axis=1), _STEEP)
    below[:, :3] += height[:, None] * tips[:, 3:6]
    return np.vstack([marked, np.column_stack([below, np.full(len(below), SURFACE)])])


def _lumps(elements: np.ndarray, cell: float) -> tuple[np.ndarray, np.ndarray]:
    """Elements of one cell that face much the same way joined into one, and the number of the lump that each is in."""
    keys = np.round(np.hstack([elements[:, :3] / cell, 2.0 * elements[:, 3:6]])).astype(np.int64)
    _, lump_of = np.unique(keys, axis=0, return_inverse=True)
    area = np.bincount(lump_of, elements[:, 6])
    lumps = np.stack([np.bincount(lump_of, elements[:, 6] * elements[:, k]) / area for k in range(6)] + [area], axis=1)
    lumps[:, 3:6] /= np.linalg.norm(lumps[:, 3:6], axis=1)[:, None]
    return lumps, lump_of


def _nearest(elements: np.ndarray, others: np.ndarray, cell: float) -> np.ndarray:
    """Index of the other element nearest to each, among those that face the same way if there are any."""
    from scipy.spatial import cKDTree

    weight = [1.0] * 3 + [4.0 * cell] * 3
    return cKDTree(others[:, :6] * weight).query(elements[:, :6] * weight)[1]


def _kinds(elements: np.ndarray, cell: float) -> np.ndarray:
    from scipy.spatial import cKDTree

    n = len(elements)
    pairs = cKDTree(elements[:, :3]).query_pairs(_REACH * cell, output_type="ndarray")
    of = np.concatenate([pairs[:, 0], pairs[:, 1], np.arange(n)])
    others = np.concatenate([pairs[:, 1], pairs[:, 0], np.arange(n)])
    normals, area = elements[:, 3:6], elements[others, 6]
    cosine = (normals[of] * normals[others]).sum(axis=1)
    above = ((elements[others, :3] - elements[of, :3]) * normals[of]).sum(axis=1)

    def total(weights):
        return np.bincount(of, weights, n)

    thin = total((cosine < _BACK) & (above < 0.0) & (above > -cell)) > 0.0
    around = np.where(cosine > -_STEEP, area, 0.0)
    mean = np.stack([total(around * normals[others, k]) for k in range(3)], axis=1)
    flank = thin & ((normals * mean).sum(axis=1) < _STEEP * np.linalg.norm(mean, axis=1))
    alike = np.where(cosine > _STEEP, area, 0.0)
    tip = (total(flank[others]) > 0.0) & (total(alike * (above < -_HIGH * cell)) > _MOST * total(alike))
    return np.where(flank, FLANK, np.where(tip, TIP, SURFACE))
