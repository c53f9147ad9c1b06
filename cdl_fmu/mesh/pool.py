"""Surfaces of a model's tools as its pool."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..slave.model import ModelError
from ..slave.pool import ConstantPool
from .contacts import CONTACT, Scratch, scratch_for
from .surface import Meshes, Surface, join, load_surface, nothing, surface_of

#: Most candidates of one pair of tools, of which few are kept.
CANDIDATES = 512


def mesh_pool(meshes: Meshes, memory: tuple[np.ndarray, ...] = ()) -> ConstantPool:
    """Arrays for kernels that search for contacts: those of ``Meshes``, those of ``Scratch``, candidates, and further memory."""
    return ConstantPool((*meshes, *scratch_for(meshes), np.zeros((CANDIDATES, CONTACT)), *memory))


#: How many arrays of the pool are those of Meshes and Scratch, and where the candidates are.
N_MESHES, N_SCRATCH = len(Meshes._fields), len(Scratch._fields)
FOUND = N_MESHES + N_SCRATCH
MEMORY = FOUND + 1


def tool_surfaces(p, n_bodies: int, files: dict[str, Path]) -> Meshes:
    """Surfaces of bodies 0 .. n_bodies - 1, then that of the plates of the wheels' grousers, and the wheels' own mesh in place of them.

    What there is none of has the root -1.

    Raises:
        ModelError: A file does not hold a closed mesh in metres, or the grousers do not fit; the message begins with the parameter's name.
    """
    surfaces: list[Surface | None] = [surface_in(f"body[{j + 1}].mesh", files) for j in range(n_bodies)]
    own = surface_in("wheel_mesh", files)
    surfaces += [None if own else _plates(p), own]
    given = [surface for surface in surfaces if surface is not None]
    meshes = join(given) if given else nothing()
    place = np.cumsum([surface is not None for surface in surfaces]) - 1
    roots = np.full(len(surfaces), -1, np.int64)
    spheres = np.zeros((len(surfaces), 4))
    for k, surface in enumerate(surfaces):
        if surface is not None:
            roots[k], spheres[k] = meshes.roots[place[k]], meshes.spheres[place[k]]
    roots.flags.writeable = spheres.flags.writeable = False
    return meshes._replace(roots=roots, spheres=spheres)


def surface_in(name: str, files: dict[str, Path]) -> Surface | None:
    """Surface of the mesh of this parameter, None if no file is given. Raises ModelError, whose message begins with the name."""
    if name not in files:
        return None
    try:
        return load_surface(files[name])
    except ModelError as error:
        raise ModelError(f"{name} = {error}") from None


def _plates(p) -> Surface | None:
    if p.n_g == 0.0 or p.h_g == 0.0:
        return None
    from ..wheel_mesh import grouser_plates

    return surface_of(grouser_plates(p.r_w, p.b_w, p.n_g, p.h_g, p.t_g))
