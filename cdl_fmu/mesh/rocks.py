"""Generated rocks, for experiments and tests."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..slave.model import ModelError

if TYPE_CHECKING:
    import trimesh

_CUTS = 14  # flat faces that break off the ellipsoid
_LUMPS = 12  # waves on it
MOST_ROUGH = 0.5


def rock(seed: int, size: Sequence[float], roughness: float = 0.2, *, subdivisions: int = 2) -> trimesh.Trimesh:
    """An angular stone, nearly convex, closed, its normals outwards; its centre of mass is the origin. Equal arguments give equal stones.

    Args:
        seed: Of the random shape.
        size: Its extents along x, y and z [m].
        roughness: Depth of cuts and lumps over the radius [1], 0 (an ellipsoid of facets) to 0.5.
        subdivisions: The stone has 20 * 4^subdivisions faces.

    Raises:
        ModelError: ``size`` or ``roughness`` is out of its bounds.
    """
    import trimesh

    for axis, extent in zip("xyz", size, strict=True):
        if not 0.0 < extent < np.inf:
            raise ModelError(f"size = {extent:g} m along {axis}: it must be above 0 m and finite (extent of a rock)")
    if not 0.0 <= roughness <= MOST_ROUGH:
        raise ModelError(f"roughness = {roughness:g}: it must be within 0 and {MOST_ROUGH:g} (depth of a rock's cuts over its radius)")
    random = np.random.default_rng(seed)
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions)
    out = np.array(mesh.vertices)
    # Own choice: planes cut a sphere, few and slow waves roughen it, both shortening radii only, so that it stays free of overhangs.
    cuts = random.normal(size=(_CUTS, 3))
    cuts /= np.linalg.norm(cuts, axis=1, keepdims=True)
    depth = 1.0 - roughness * random.random(_CUTS)
    facing = out @ cuts.T
    radius = np.where(facing > 0.0, depth / np.maximum(facing, 1e-9), np.inf).min(axis=1).clip(max=1.0)
    waves, phase = random.normal(scale=2.0, size=(_LUMPS, 3)), random.uniform(0.0, 2.0 * np.pi, _LUMPS)
    radius *= 1.0 - 0.1 * roughness * (1.0 + np.sin(out @ waves.T + phase).mean(axis=1))
    mesh.vertices = out * radius[:, None]
    mesh.vertices *= np.array(size) / mesh.extents
    mesh.vertices -= mesh.center_mass
    return mesh
