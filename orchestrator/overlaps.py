"""Whether closed meshes overlap where they are placed: what starts within another body finds no contact that would push it out."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

_MOST = 2_000_000  # pairs of points and triangles that are looked at for two bodies; finer meshes are sampled


def overlapping(bodies: Mapping[str, np.ndarray]) -> tuple[str, str] | None:
    """Names of two bodies of which one has a vertex within the other; None if there are none.

    Args:
        bodies: Name -> triangles in world, [n, 3, 3] [m], normals outwards.
    """
    names = list(bodies)
    for i, a in enumerate(names):
        for b in names[i + 1 :]:
            if _apart(bodies[a], bodies[b]):
                continue
            # Vertices alone miss bodies of one shape in one place.
            for points, triangles in ((bodies[a], bodies[b]), (bodies[b], bodies[a])):
                corners = np.unique(points.reshape(-1, 3), axis=0)
                middle = corners.mean(axis=0)
                corners = np.vstack([middle, middle + 0.999 * (corners - middle)])
                if _within(corners[:: max(1, len(corners) * len(triangles) // _MOST)], triangles).any():
                    return a, b
    return None


def _apart(a: np.ndarray, b: np.ndarray) -> bool:
    """Whether the boxes around two bodies do not meet."""
    return bool(((a.max(axis=(0, 1)) < b.min(axis=(0, 1))) | (b.max(axis=(0, 1)) < a.min(axis=(0, 1)))).any())


def _within(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Which points a closed surface winds around, by the solid angle of its triangles (Van Oosterom & Strackee 1983)."""
    inside = np.zeros(len(points), bool)
    for k, point in enumerate(points):
        a, b, c = np.moveaxis(triangles - point, 1, 0)
        l_a, l_b, l_c = (np.linalg.norm(v, axis=1) for v in (a, b, c))
        volume = (a * np.cross(b, c)).sum(axis=1)
        rest = l_a * l_b * l_c + (a * b).sum(axis=1) * l_c + (b * c).sum(axis=1) * l_a + (c * a).sum(axis=1) * l_b
        inside[k] = np.arctan2(volume, rest).sum() > np.pi
    return inside
