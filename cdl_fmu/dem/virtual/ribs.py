"""A ribbed plate, which grips particles as the plates of a shear box do."""

from __future__ import annotations

import numpy as np
import trimesh

from ...mesh.surface import Surface, surface_of

_WIDE, _HIGH, _THICK = 2.5, 1.0, 1.0  # own choice, in diameters: distance and height of the ribs, and what is behind them


def ribbed_plate(period: float, travel: float, breadth: float, diameter: float, down: bool) -> Surface:
    """A plate with ribs along y, whose tips lie in the plane z = 0, triangles side by side.

    Args:
        period: Length after which what it grips repeats itself along x [m]; the plate begins at x = 0, and its ribs fit into it.
        travel: How far it will be moved along x [m]; it is so much longer to the left, so that it never ends within the period.
        breadth: Period along y [m]; the plate begins at y = 0.
        diameter: Of the particles [m].
        down: Whether the ribs point down.
    """
    pitch = period / max(round(period / (_WIDE * diameter)), 1)
    first, last = -int(np.ceil((travel + 2.0 * diameter) / pitch)), round(period / pitch) + int(np.ceil(2.0 * diameter / pitch))
    x = pitch * np.arange(2 * first, 2 * last + 1) / 2.0
    z = np.where(np.arange(2 * first, 2 * last + 1) % 2 == 0, -_HIGH * diameter, 0.0)
    behind = -(_HIGH + _THICK) * diameter
    n = len(x)
    # Four rows of vertices: ribs and back, at either end of y.
    corners = [
        np.stack([x, np.full(n, y), height], axis=1)
        for y in (-2.0 * diameter, breadth + 2.0 * diameter)
        for height in (z, np.full(n, behind))
    ]
    k = np.arange(n - 1)

    def strip(a: int, b: int) -> np.ndarray:
        """Triangles between rows a and b, seen with a to the right as x grows."""
        a, b = a * n + k, b * n + k
        return np.concatenate([np.stack([a, a + 1, b + 1], axis=1), np.stack([a, b + 1, b], axis=1)])

    ends = [[0, 2 * n, n], [n, 2 * n, 3 * n], [n - 1, 2 * n - 1, 3 * n - 1], [2 * n - 1, 4 * n - 1, 3 * n - 1]]
    faces = np.concatenate([strip(0, 2), strip(2, 3), strip(3, 1), strip(1, 0), ends])
    vertices = np.concatenate(corners)
    if down:
        vertices, faces = vertices * [1.0, 1.0, -1.0], faces[:, ::-1]
    return surface_of(trimesh.Trimesh(vertices, faces, process=False))
