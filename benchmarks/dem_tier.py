"""DEM as a tier of Table 8.1: its soil, wheels on it, and what is seen of its particles."""

from __future__ import annotations

import numpy as np

from cdl_fmu.dem.particles import X, Z
from cdl_fmu.dem.patches import patch_heights
from cdl_fmu.dem.snapshot import of_saved
from cdl_fmu.slave.model import Instance

#: Diameter of the particles [m], and of those at the surface where wheels have grousers, which particles have to be half as large as.
D, FINE = 0.014, 0.005
#: The soil of the other tiers, loose, as soft as grains of its strength can be. Deep enough for wheels with grousers.
SOIL = dict(d=D, depth=0.165, porosity=0.43)
GROUSERS = dict(d=FINE, fine_depth=0.021, box_length=0.3)
#: Highest that particles reach above the mean surface [m], below which nothing may begin.
CLEARANCE = D

_SPACING, _AHEAD, _ASIDE = 0.02, 0.05, 0.25  # of points where heights are looked at, and how far around a point on the track [m]
_MIDDLE = 0.03  # half the width below which particles are under the wheel [m]


def across(instance: Instance, x: float) -> np.ndarray:
    """Heights [m] of the surface across the track at x [m], each the mean over a decimetre along the track: particles are coarse."""
    pool, nodes = instance.pool, [round(2.0 * reach / _SPACING) for reach in (_AHEAD, _ASIDE)]
    origin = np.array([x - _AHEAD, -_ASIDE]) + 0.5 * _SPACING
    return patch_heights(pool.ground, pool.live, origin, _SPACING, nodes).mean(axis=0)


def places(instance: Instance) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of all particles that were ever live, [n], and their centres [m], [n, 3]."""
    seen = of_saved(instance.pool.save())
    return seen.ident, seen.bodies[:, X : X + 3].copy()


def moved(before: tuple[np.ndarray, np.ndarray], after: tuple[np.ndarray, np.ndarray], x: float, top: float) -> float:
    """Median distance [m] by which particles of one layer under the track moved, whose centres lay up to a diameter below ``top``.

    Args:
        before, after: As ``places`` gives them.
        x: Where on the track [m].
        top: Height of the layer's top [m].
    """
    _, first, then = np.intersect1d(before[0], after[0], assume_unique=True, return_indices=True)
    was, now = before[1][first], after[1][then]
    under = (abs(was[:, 0] - x) < _AHEAD) & (abs(was[:, 1]) < _MIDDLE) & (was[:, Z] < top) & (was[:, Z] > top - D)
    return float(np.median(np.linalg.norm(now[under] - was[under], axis=1)))
