"""What is shipped: the contact tiers, the FMUs that ``cdl build`` makes, and the experiments (TOML files beside this one)."""

from collections import Counter
from collections.abc import Iterable
from pathlib import Path

from cdl_fmu.bcm import BCM
from cdl_fmu.scm import SCM
from cdl_fmu.slave.model import KernelModel
from mbs.driver import Driver
from mbs.rover import Rover

#: Name of a tier in experiments -> its model.
TIERS = {"BCM": BCM, "SCM": SCM}

#: Every FMU that is shipped, one for each set of sizes.
SHIPPED = [BCM(1), BCM(2), BCM(1, 1), BCM(2, 2), SCM(1), SCM(2), SCM(1, 1), Rover(2), Driver(2)]

#: The statements of section 8.5 on the experiment two_wheel, which `cdl compare` measures.
CLAIMS = Path(__file__).with_name("two_wheel_claims.toml")

#: Name of a shipped experiment -> its file.
EXPERIMENTS = {path.stem: path for path in sorted(Path(__file__).parent.glob("*.toml")) if path != CLAIMS}


def contacts(tiers: Iterable[str]) -> dict[str, KernelModel]:
    """The model of each tier for wheels on these tiers, in an order in which each needs the outputs of earlier ones alone.

    Where SCM carries a wheel it owns the soil, and the wheels of other tiers stand on patches of it.
    """
    wheels = Counter(tiers)
    n_scm, n_bcm = wheels["SCM"], wheels["BCM"]
    n_patches = n_bcm if n_scm else 0
    sizes = {"SCM": (n_scm, n_patches), "BCM": (n_bcm, n_patches)}
    return {tier: TIERS[tier](*sizes[tier]) for tier in sizes if wheels[tier]}
