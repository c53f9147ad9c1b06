"""A cone pressed into a bed of particles, as a penetrometer is: force over depth, in Python alone."""

import numpy as np
import trimesh

from cdl_fmu.dem.bed import BedKey
from cdl_fmu.dem.library import Library
from cdl_fmu.dem.material import Material
from cdl_fmu.dem.simulation import Tool
from cdl_fmu.dem.sizes import Uniform
from cdl_fmu.mesh.surface import surface_of


def penetrate(depth: float = 0.04, speed: float = 0.1, d: float = 0.008) -> tuple[np.ndarray, np.ndarray]:
    """Depths of the tip [m] and vertical forces on the cone [N]."""
    material = Material(mu=0.5, mu_r=0.2, density=2650.0)
    bed = Library().get(BedKey(material, Uniform(0.9 * d, 1.1 * d), porosity=0.42, depth=12.0 * d, size=(16.0 * d, 16.0 * d)))
    shape = trimesh.creation.cone(radius=0.015, height=0.04)
    shape.apply_transform(np.diag([1.0, -1.0, -1.0, 1.0]))  # its tip, at z = 0.04, points down
    cone = Tool(material, surface=surface_of(shape))
    cone.r_0 = np.array([*(0.5 * period for period in bed.periods), 0.04 + d])
    simulation = bed.simulation([cone])
    depths, forces = [], []
    while -cone.r_0[2] + 0.04 < depth:
        cone.r_0 = cone.r_0 - [0.0, 0.0, 1e-3 * speed]
        simulation.step(1e-3)
        depths.append(0.04 - cone.r_0[2])
        forces.append(cone.f_0[2])
    return np.array(depths), np.array(forces)


if __name__ == "__main__":
    for z, f in zip(*penetrate()):
        if round(1e4 * z) % 50 == 0:
            print(f"{1e3 * z:6.1f} mm  {f:7.2f} N")
