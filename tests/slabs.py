"""Files and poses with which models that meet bodies can be tried: a slab for each body, the first one below the wheels."""

from pathlib import Path
from tempfile import gettempdir

import trimesh
from beds import R_W, VALUES, bed_file, highest_particle

#: Height [m] of the first slab's upper face, which a wheel of Table 8.2 at 0.1 m overlaps by a few millimetres.
TOP = -0.032


def files_of(model) -> dict[str, Path]:
    """A mesh for each body of a model, and for the ground that it stands on; a small bed of particles."""
    if model.identifier.startswith("cdl_dem"):
        return {"bed": bed_file()}
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


def values_of(model) -> dict[str, float]:
    """Parameters with which a model stands below wheels at 0.1 m, where its own values do not do: particles are a matter of minutes."""
    if not model.identifier.startswith("cdl_dem"):
        return {}
    # The wheel overlaps the highest particle by a tenth of a millimetre.
    return {**VALUES, "ground_z": 0.1 - R_W + 1e-4 - highest_particle(), "grains": 2.0}


def place_of(j: int) -> tuple[float, float, float]:
    """Where slab j, counted from 0, lies, clear of the others."""
    return 0.0, 2.0 * j, TOP
