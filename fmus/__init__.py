"""What is shipped: the contact tiers, the FMUs that ``cdl build`` makes, and the experiments (TOML files beside this one)."""

import re
from collections import Counter
from collections.abc import Container, Iterable
from pathlib import Path

from cdl_fmu.bcm import BCM
from cdl_fmu.dem import DEM
from cdl_fmu.rbc import RBC
from cdl_fmu.scm import SCM
from cdl_fmu.slave.model import KernelModel, Model, ModelError
from cdl_fmu.vem import VEM
from mbs.carriage import Carriage
from mbs.driver import Driver
from mbs.rover import Rover

#: Name of a tier in experiments -> its model.
TIERS = {"BCM": BCM, "SCM": SCM, "VEM": VEM, "DEM": DEM}

#: Tiers that own the soil under all wheels: of these there is one at most in a system.
SOIL_OWNERS = ("SCM", "DEM")

#: Name of a tier for rocks -> its model, of wheels and rocks.
ROCK_TIERS = {"RBC": RBC, "VEM": lambda n_wheels, n_bodies: VEM(n_wheels, 0, n_bodies)}

#: Every FMU that is shipped, one for each set of sizes.
SHIPPED = [
    *(BCM(1), BCM(2), BCM(1, 1), BCM(2, 2), BCM(1, 1, 1)),
    *(SCM(1), SCM(2), SCM(1, 1), SCM(1, 1, n_compacted=1)),
    *(VEM(1), VEM(2), VEM(1, 1)),
    *(DEM(1), DEM(2), DEM(1, 1)),
    *(BCM(2, n_grounds=1), VEM(2, n_grounds=1)),
    *(RBC(2, 1), VEM(2, 0, 1), SCM(2, 0, 1), Rover(2, 1, 1)),  # for a rover and a rock
    *(Rover(2), Driver(2), Carriage(1)),
]

_FAMILIES = {
    "cdl_bcm": BCM,
    "cdl_scm": SCM,
    "cdl_vem": VEM,
    "cdl_dem": DEM,
    "cdl_rbc": RBC,
    "cdl_rover": Rover,
    "cdl_driver": Driver,
    "cdl_carriage": Carriage,
}
_SIZES = {"w": "n_wheels", "p": "n_patches", "b": "n_bodies", "c": "n_compacted", "h": "n_hard", "g": "n_grounds"}

#: The statements of section 8.5 on the experiment two_wheel, which `cdl compare` measures.
CLAIMS = Path(__file__).with_name("two_wheel_claims.toml")

#: Name of a shipped experiment -> its file.
EXPERIMENTS = {path.stem: path for path in sorted(Path(__file__).parent.glob("*.toml")) if path != CLAIMS}


def model_of(identifier: str) -> Model:
    """The model of an FMU's name, in the sizes that the name gives: ``cdl_scm_w4p2b1`` has 4 wheels, 2 patches and a body.

    Raises:
        ModelError: There is no model of that name, or not in these sizes.
    """
    found = re.fullmatch(r"(cdl_[a-z]+)_((?:[a-z][1-9]\d*)+)", identifier)
    family = _FAMILIES.get(found[1]) if found else None
    sizes = dict(re.findall(r"([a-z])(\d+)", found[2])) if family else {}
    why = ""
    try:
        model = family(**{_SIZES[letter]: int(size) for letter, size in sizes.items()})
        if model.identifier == identifier:
            return model
    except (KeyError, TypeError):
        pass
    except ValueError as error:
        why = f": {error}"
    shipped = ", ".join(model.identifier for model in SHIPPED)
    raise ModelError(
        f"there is no FMU {identifier!r}{why}; shipped are {shipped}, and with other numbers of wheels (w), patches (p), patches with "
        "compaction (c), bodies (b), meshes of the ground (g) and hard contacts of a rover (h) others can be built, such as cdl_scm_w4p2b1"
    )


def contacts(tiers: Iterable[str], compaction: bool = False, n_rocks: int = 0, on_mesh: Container[str] = ()) -> dict[str, KernelModel]:
    """The model of each tier for wheels on these tiers, in an order in which each needs the outputs of earlier ones alone.

    Where SCM or DEM carries a wheel it owns the soil, in which rocks lie, and the wheels of other tiers stand on patches of it, which say
    what pressed the soil before if ``compaction`` is wanted of SCM. The ground of tiers in ``on_mesh`` is a mesh.

    Raises ValueError if both are to own it.
    """
    wheels = Counter(tiers)
    n_scm, n_dem, n_bcm, n_vem = wheels["SCM"], wheels["DEM"], wheels["BCM"], wheels["VEM"]
    if n_scm and n_dem:
        raise ValueError("wheels on SCM and on DEM: each tier owns the soil under all wheels; put the others on BCM or VEM, which share it")
    soil = n_scm + n_dem > 0
    n_compacted = n_bcm if compaction and n_scm else 0
    models: dict[str, KernelModel] = {}
    if n_scm:
        models["SCM"] = SCM(n_scm, n_bcm + n_vem, n_rocks, n_compacted)
    if n_dem:
        models["DEM"] = DEM(n_dem, n_bcm + n_vem)
    if n_bcm:
        models["BCM"] = BCM(n_bcm, n_bcm if soil else 0, n_compacted, int("BCM" in on_mesh))
    if n_vem:
        models["VEM"] = VEM(n_vem, n_vem if soil else 0, n_grounds=int("VEM" in on_mesh))
    return models
