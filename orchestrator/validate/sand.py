"""SCM's soil without wheels, in process: heaps that slide, and what they look like afterwards."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from cdl_fmu.frames import vertical
from cdl_fmu.scm import SCM
from cdl_fmu.scm.pool import Heights, heights
from cdl_fmu.scm.tiles import FILL, QUANTUM, SINKAGE, SLIDING, TILE, let_slide, touch
from cdl_fmu.slave.model import Instance


def scm(n_wheels: int = 1, **parameters: object) -> Instance:
    """SCM with wheels that are not there yet."""
    instance = Instance(SCM(n_wheels), "scm", **parameters)
    instance.u.wheel["active"] = 0.0
    instance.initialise()
    return instance


def fields(instance: Instance, field: int) -> np.ndarray:
    """A field of all touched cells, [n, TILE, TILE]."""
    return instance.pool.rows[: instance.pool.head[0], field]


def volume_error(instance: Instance) -> float:
    """Soil that is there and soil that was compacted, less what there was, as height on one cell [m]."""
    return float(fields(instance, FILL).sum() - fields(instance, SINKAGE).sum()) + float(instance.x.compacted)


def surface(instance: Instance) -> Heights:
    """Heights of the touched cells; NaN elsewhere."""
    return heights(instance.pool.save(), float(instance.p.cell))


def heap(height: Callable[[np.ndarray, np.ndarray], np.ndarray], reach: float, **parameters: object) -> Instance:
    """Loose soil that is about to slide: ``height(x, y)`` [m] up to ``reach`` [m] from the origin along both axes; no wheel near."""
    instance = scm(**parameters)
    cell = float(instance.p.cell)
    n = math.ceil(reach / (cell * TILE))
    for i in range(-n * TILE, n * TILE, TILE):
        for j in range(-n * TILE, n * TILE, TILE):
            instance.pool.reserve(instance.u)
            rows, marks, head, ground, frame = instance.pool.arrays[:5]
            row = touch(instance.p, rows, marks, head, ground, frame, i // TILE, j // TILE)
            x, y = np.meshgrid((i + np.arange(TILE)) * cell, (j + np.arange(TILE)) * cell, indexing="ij")
            rows[row, FILL] = np.round(height(x, y) / QUANTUM) * QUANTUM
            let_slide(instance.p, rows, marks, head, ground, frame, i, i + TILE - 1, j, j + TILE - 1)
    return instance


def wait_for_rest(instance: Instance, most: float = 10.0, h: float = 0.01) -> None:
    """Step without wheels until nothing slides; RuntimeError after ``most`` [s]."""
    for k in range(round(most / h)):
        if instance.pool.head[SLIDING] == 0:
            return
        instance.step(k * h, h)
    raise RuntimeError(f"soil still slides after {most} s")


def slopes(instance: Instance, top: float, directions: int = 32) -> np.ndarray:
    """Slope [rad] of a heap around the origin between 0.2 and 0.8 of its height ``top`` [m], by direction."""
    soil = surface(instance)
    axes = [o + soil.spacing * np.arange(n) for o, n in zip(soil.origin, soil.z.shape)]
    height = RegularGridInterpolator(axes, soil.z)
    r = np.arange(0.0, min(map(np.max, axes)), 0.25 * soil.spacing)
    out = []
    for a in 2.0 * math.pi * np.arange(directions) / directions:
        h = height(np.stack([r * math.cos(a), r * math.sin(a)], axis=1))
        flank = (h > 0.2 * top) & (h < 0.8 * top)
        out.append(math.atan(-np.polyfit(r[flank], h[flank], 1)[0]))
    return np.array(out)


def inclinations(instance: Instance, sides: int = 8) -> np.ndarray:
    """Inclination [rad] of a heap's surface against the horizontal, on a slope too, between 0.2 and 0.8 of its height above the ground.

    Means over its sides, which part the directions from its highest cell: the first is uphill, the others follow to the left.
    """
    soil, p = surface(instance), instance.p
    top, z = np.unravel_index(np.nanargmax(soil.z), soil.z.shape), soil.z
    (rise_x, rise_y), (up_x, up_y, up_z) = np.gradient(z, soil.spacing), vertical(p.slope, p.uphill)
    cosine = (up_z - rise_x * up_x - rise_y * up_y) / np.sqrt(1.0 + rise_x**2 + rise_y**2)
    x, y = np.indices(z.shape) - np.reshape(top, (2, 1, 1))
    side = np.round((np.arctan2(y, x) - p.uphill) * sides / (2.0 * math.pi)).astype(int) % sides
    flank = (z > 0.2 * z[top]) & (z < 0.8 * z[top])
    return np.array([np.arccos(cosine[flank & (side == k)]).mean() for k in range(sides)])
