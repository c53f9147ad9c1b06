"""Meshes of an SCM instance's tools: read once per file, joined in one array for the kernels."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from ..cloud import Cloud, load_cloud
from ..slave.model import ModelError
from .columns import ELEMENT, HALF, MIDDLE, SHAPE, WIDTH
from .features import with_kinds

#: Elements along a cell, of wheels and of bodies: the footprint's edge is resolved to half of one.
PER_CELL, PER_CELL_OF_BODIES = 4, 2


@dataclass(frozen=True)
class Meshes:
    """Surfaces of tools.

    Attributes:
        elements: Those of all files, [n, ELEMENT].
        ranges: First and last + 1 element of each tool, [n_tools, 2]; none for a tool without a mesh.
        shapes: Box around each tool and its width, [n_tools, SHAPE].
    """

    elements: np.ndarray
    ranges: np.ndarray
    shapes: np.ndarray

    @property
    def reach(self) -> float:
        """Largest distance of a tool's surface, and of the ground that heaves around it, from the middle of its box [m]."""
        return float((np.linalg.norm(self.shapes[:, HALF : HALF + 3], axis=1) + self.shapes[:, WIDTH]).max())


def load_meshes(names: list[str], files: dict[str, Path], widths: list[float], per_cell: list[int], cell: float) -> Meshes:
    """The meshes of tools.

    Args:
        names: Of the parameter that names each tool's file.
        files: Path of each file that is given.
        widths: Bekker's width b of each tool [m]; 0 = 2 A / L of the mesh's projection on its x-y plane.
        per_cell: Elements along a cell of each tool.
        cell: Size of a cell of the soil [m].

    Raises:
        ModelError: A file does not hold a closed mesh in metres; the message begins with the parameter's name.
    """
    parts: dict[tuple[Path, int], tuple[int, tuple[Cloud, np.ndarray]]] = {}
    ranges, shapes = np.zeros((len(names), 2), np.int64), np.zeros((len(names), SHAPE))
    n = 0
    for i, (name, width, fine) in enumerate(zip(names, widths, per_cell)):
        if name not in files:
            continue
        path = files[name]
        if (path, fine) not in parts:
            try:
                cloud = _loaded(path, path.stat().st_mtime_ns, cell, fine)
            except ModelError as error:
                raise ModelError(f"{name} = {error}") from None
            parts[path, fine] = n, cloud
            n += len(cloud[1])
        first, (cloud, elements) = parts[path, fine]
        ranges[i] = first, first + len(elements)
        low, high = cloud.bounds
        shapes[i, MIDDLE : MIDDLE + 3], shapes[i, HALF : HALF + 3] = 0.5 * (low + high), 0.5 * (high - low)
        shapes[i, WIDTH] = width or 2.0 * cloud.plan_area / cloud.plan_perimeter
    elements = np.concatenate([part for _, (_, part) in parts.values()]) if parts else np.zeros((0, ELEMENT))
    return Meshes(elements, ranges, shapes)


@lru_cache(maxsize=16)
def _loaded(path: Path, changed: int, cell: float, per_cell: int) -> tuple[Cloud, np.ndarray]:
    """The file as it was when it was last changed, and its elements with their kinds."""
    cloud = load_cloud(path, cell / per_cell)
    return cloud, with_kinds(cloud.elements, cell)
