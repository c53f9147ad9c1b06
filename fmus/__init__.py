"""What is shipped: the contact tiers, the FMUs that ``cdl build`` makes, and the experiments (TOML files beside this one)."""

from pathlib import Path

from cdl_fmu.bcm import BCM
from mbs.driver import Driver
from mbs.rover import Rover

#: Name of a tier in experiments -> its model.
TIERS = {"BCM": BCM}

#: Every FMU that is shipped, one for each set of sizes.
SHIPPED = [BCM(1), BCM(2), BCM(1, 1), BCM(2, 2), Rover(2), Driver(2)]

#: The statements of section 8.5 on the experiment two_wheel, which `cdl compare` measures.
CLAIMS = Path(__file__).with_name("two_wheel_claims.toml")

#: Name of a shipped experiment -> its file.
EXPERIMENTS = {path.stem: path for path in sorted(Path(__file__).parent.glob("*.toml")) if path != CLAIMS}
