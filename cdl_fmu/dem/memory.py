"""Memory that particles take, known before they are made."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from ..slave.model import ModelError
from .law import LAW
from .particles import particles_of
from .shape import Shape
from .tools import PLANE, SHAPE, tools_of

_SAMPLE = 10_000


def estimate_memory(n_particles: int, n_tools: int = 1, precision=np.float64, shape: Shape | None = None) -> int:
    """Memory [bytes] of so many particles and tools: the arrays of small beds, carried on in proportion.

    Args:
        n_particles: Number of particles.
        n_tools: Number of tools.
        precision: Type of the numbers of contacts, float64 or float32.
        shape: Of the particles; None: spheres.
    """
    small, large = (_size(_SAMPLE * k, n_tools, precision, shape) for k in (1, 2))
    return round(small + (large - small) * (n_particles / _SAMPLE - 1.0))


def _size(n: int, n_tools: int, precision, shape: Shape | None) -> int:
    grains = particles_of(np.zeros((n, 3)), np.ones(n), 1.0, precision=precision, shape=shape)
    tools = tools_of([PLANE] * n_tools, np.zeros((n_tools, SHAPE)), [-1] * n_tools, np.zeros((n_tools, LAW), precision), n)
    return sum(array.nbytes for array in (*grains, *tools))


def available_memory() -> int | None:
    """Memory [bytes] that this machine could give now; None where it does not say."""
    try:
        for line in Path("/proc/meminfo").read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return 1024 * int(line.split()[1])
        return os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError, AttributeError):
        return None


def check_memory(n_particles: int, n_tools: int = 1, precision=np.float64, shape: Shape | None = None) -> None:
    """Raise ModelError if so many particles need more memory than there is; arguments as in ``estimate_memory``."""
    needed, available = estimate_memory(n_particles, n_tools, precision, shape), available_memory()
    if available is not None and needed > available:
        raise ModelError(
            f"{n_particles} particles need {needed / 1e9:.3g} GB of memory, {available / 1e9:.3g} GB are available: take coarser grains "
            "(twice the diameter needs an eighth), a smaller box, refinement that leaves fine grains to the top, or a larger machine"
        )
