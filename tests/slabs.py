"""Files and poses with which models that meet bodies can be tried: a slab for each body, the first one below the wheels."""

from pathlib import Path
from tempfile import gettempdir

import trimesh

#: Height [m] of the first slab's upper face, which a wheel of Table 8.2 at 0.1 m overlaps by a few millimetres.
TOP = -0.032


def files_of(model) -> dict[str, Path]:
    """A mesh for each body of a model."""
    names = [name for name in model.files if name.startswith("body[")]
    if not names:
        return {}
    path = Path(gettempdir(), "cdl_slab_for_tests.stl")
    if not path.exists():
        slab = trimesh.creation.box((4.0, 1.0, 0.2))
        slab.apply_translation((0.0, 0.0, -0.1))
        part = path.with_suffix(".part.stl")
        slab.export(part)
        part.replace(path)
    return dict.fromkeys(names, path)


def place_of(j: int) -> tuple[float, float, float]:
    """Where slab j, counted from 0, lies, clear of the others."""
    return 0.0, 2.0 * j, TOP
