"""A small bed of coarse particles, settled once for all tests, and DEM instances on it."""

from functools import cache
from pathlib import Path
from tempfile import gettempdir

import numpy as np

from cdl_fmu.dem.bed import Bed, BedKey
from cdl_fmu.dem.bed_files import load_bed
from cdl_fmu.dem.library import Library
from cdl_fmu.dem.material import Material
from cdl_fmu.dem.model import DEM
from cdl_fmu.dem.particles import SIDE, M, N
from cdl_fmu.dem.sizes import Uniform
from cdl_fmu.slave.model import Instance

D, DEPTH = 0.01, 0.0625
KEY = BedKey(Material(), Uniform(0.9 * D, 1.1 * D), porosity=0.42, depth=DEPTH, size=(0.12, 0.12), seed=1)
#: A wheel, and parameters by which a DEM instance stands on the bed.
R_W, B_W = 0.05, 0.05
VALUES = dict(d=D, depth=DEPTH, r_w=R_W, b_w=B_W, n_g=0.0, box_length=0.15, box_width=0.12, gravity=9.81, slope=0.0)


@cache
def bed_file() -> Path:
    """The bed's file, which later runs of the tests find again."""
    library = Library(Path(gettempdir(), "cdl_beds"))
    library.get(KEY)
    return library.path(KEY)


@cache
def bed() -> Bed:
    return load_bed(bed_file())


def highest_particle() -> float:
    """How far particles reach above the bed's mean surface [m]."""
    return float((bed().positions[:, 2] + bed().radii).max())


def dem(n_wheels: int = 1, n_patches: int = 0, n_bodies: int = 0, **parameters) -> Instance:
    """An instance on the bed, not yet initialised, whose tools have no pose yet."""
    return Instance(DEM(n_wheels, n_patches, n_bodies), **{**VALUES, "grains": "given", "bed": bed_file(), **parameters})


def place(tool, r_0, v_0=(0.0, 0.0, 0.0), rate: float = 0.0, angle: float = 0.0, heading: float = 0.0) -> None:
    """Put a wheel, which spins by ``rate`` and has turned by ``angle``, or a body at r_0."""
    c, s, c_h, s_h = np.cos(angle), np.sin(angle), np.cos(heading), np.sin(heading)
    T = np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]]) @ np.array([[c_h, s_h, 0.0], [-s_h, c_h, 0.0], [0.0, 0.0, 1.0]])
    tool["r_0"], tool["T"], tool["v_0"], tool["w_0"] = r_0, T, v_0, rate * T[1]


def by_number(instance: Instance) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of the live particles in ascending order, and their records."""
    count = instance.pool._grains.count
    ident = instance.pool._grains.ident[count[SIDE], : count[N]]
    order = np.argsort(ident)
    return ident[order], instance.pool.live[order].copy()


def total_mass(instance: Instance) -> float:
    """Mass [kg] of all particles that are live or stored."""
    return sum(bodies[:, M].sum() for bodies in (instance.pool.live, *(grains.bodies for grains in instance.pool.ground.stored.values())))
