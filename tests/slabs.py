"""Files and poses with which models that meet bodies can be tried: a slab for each body, the first one below the wheels."""

from pathlib import Path
from tempfile import gettempdir

import trimesh

#: Height [m] of the first slab's upper face, which a wheel of Table 8.2 at 0.1 m overlaps by a few millimetres.
TOP = -0.032


def files_of(model) -> dict[str, Path]:
    """A mesh for each body of a model, and for the ground that it stands on."""
    names = [name for name in model.files if name.startswith("body[") or name == "ground"]
    if not names:
        return {}
    # Soil looks at each square centimetre of a body.
    length, width, height = (0.2, 0.2, 0.05) if model.identifier.startswith("cdl_scm") else (4.0, 1.8, 0.2)
    path = Path(gettempdir(), f"cdl_slab_{length}_{width}_{height}.stl")
    if not path.exists():
        slab = trimesh.creation.box((length, width, height))
        slab.apply_translation((0.0, 0.0, -0.5 * height))
        part = path.with_suffix(".part.stl")
        slab.export(part)
        part.replace(path)
    return dict.fromkeys(names, path)


def place_of(j: int) -> tuple[float, float, float]:
    """Where slab j, counted from 0, lies, clear of the others."""
    return 0.0, 2.0 * j, TOP
