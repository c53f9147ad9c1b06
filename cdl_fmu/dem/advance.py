"""Substeps: lists where they are too old, forces of particles on each other and of tools, and motion.

The pairs of a slab of the bed reach into the next one. Threads share runs of slabs: first the pairs of each run's last slab, then all
others in a row, and each slab moves as soon as the forces on it are known, while it is in the processor's cache. Runs do not depend on the
number of threads, and what tools feel is added slab by slab, so that no result does.
"""

from __future__ import annotations

import numba
import numpy as np

from ..slave.kernel import kernel
from .cells import sort_particles
from .lists import fill_pairs, find_pairs, place_pairs, take_lists
from .motion import move_particles
from .pairs import slab_forces
from .particles import CROWDED, SLABS, STALE, Particles
from .tools import FELT, Tools, arrive, go_on, set_out
from .touches import gather_felt, list_touches, touch_forces

#: How many substeps lists are made for: margins are as wide as particles move in that time. Own choice, by speed.
HORIZON = 60
#: Most runs of slabs, and thus most threads that have work.
MOST_RUNS = 32


@kernel
def set_all_out(tools, h, n_steps):
    """Send all tools on their way to their goals, and clear what they feel."""
    for t in range(len(tools.kinds)):
        set_out(tools, t, h, n_steps)
        for c in range(FELT):
            tools.sums[t, c] = 0.0


@kernel
def move_tools(grains, tools, n_steps, dt):
    """Move all tools by a substep after what they felt in it is added to their sums."""
    for t in range(len(tools.kinds)):
        gather_felt(tools, t, grains.count[SLABS], 1.0 / n_steps)
        if go_on(tools, t, dt):
            grains.count[STALE] = 1


@kernel
def arrive_all(tools):
    """All tools are at their goals."""
    for t in range(len(tools.kinds)):
        arrive(tools, t)


@kernel
def runs_of(grains):
    """Number of runs of slabs: at least three in each."""
    return max(1, min(MOST_RUNS, grains.count[SLABS] // 3))


@kernel
def end_run(grains, law, run):
    """Forces of the pairs of a run's last slab, which reach into the next run."""
    slab_forces(grains, law, (run + 1) * grains.count[SLABS] // runs_of(grains) - 1)


@kernel
def do_run(grains, tools, meshes, law, gravity, dt, run):
    """Forces of all other pairs of a run, and of tools, and motion."""
    n = grains.count[SLABS]
    last = (run + 1) * n // runs_of(grains) - 1
    for slab in range(run * n // runs_of(grains), last + 1):
        if slab < last:
            slab_forces(grains, law, slab)
        touch_forces(grains, tools, meshes, slab)
        move_particles(grains, dt, gravity, slab)


@kernel
def advance(grains_arrays, tools_arrays, meshes, law, gravity, dt, n_steps):
    """Go on by n_steps substeps of dt [s] while the tools move to their goals.

    Returns False if particles are lost or the lists have no room; nothing is of use then.

    Args:
        grains_arrays: Arrays of ``Particles``.
        tools_arrays: Arrays of ``Tools``.
        meshes: Surfaces of the bodies, ``mesh.surface.Meshes``.
        law: Contact law of the particles, [LAW].
        gravity: Acceleration of gravity [m/s2], [3].
        dt: Substep [s].
        n_steps: Number of substeps.
    """
    grains, tools = Particles(*grains_arrays), Tools(*tools_arrays)
    count = grains.count
    set_all_out(tools, n_steps * dt, n_steps)
    for _ in range(n_steps):
        if count[STALE]:
            if not sort_particles(grains, HORIZON * dt):
                return False
            count[CROWDED] = 0
            for s in range(count[SLABS]):
                find_pairs(grains, s)
            if count[CROWDED] or not list_touches(grains, tools, meshes, HORIZON * dt):
                return False
            place_pairs(grains)
            for s in range(count[SLABS]):
                fill_pairs(grains, s)
            take_lists(grains)
        for run in range(runs_of(grains)):
            end_run(grains, law, run)
        for run in range(runs_of(grains)):
            do_run(grains, tools, meshes, law, gravity, dt, run)
        move_tools(grains, tools, n_steps, dt)
    arrive_all(tools)
    return True


@kernel(parallel=True)
def advance_in_parallel(grains_arrays, tools_arrays, meshes, law, gravity, dt, n_steps):
    """``advance`` with several threads."""
    grains, tools = Particles(*grains_arrays), Tools(*tools_arrays)
    count = grains.count
    set_all_out(tools, n_steps * dt, n_steps)
    for _ in range(n_steps):
        if count[STALE]:
            if not sort_particles(grains, HORIZON * dt):
                return False
            count[CROWDED] = 0
            for s in numba.prange(count[SLABS]):  # unsigned there, and numba's prange hands arrays to its threads, no named tuples
                find_pairs(Particles(*grains_arrays), np.int64(s))
            if count[CROWDED] or not list_touches(grains, tools, meshes, HORIZON * dt):
                return False
            place_pairs(grains)
            for s in numba.prange(count[SLABS]):
                fill_pairs(Particles(*grains_arrays), np.int64(s))
            take_lists(grains)
        for run in numba.prange(runs_of(grains)):
            end_run(Particles(*grains_arrays), law, np.int64(run))
        for run in numba.prange(runs_of(grains)):
            do_run(Particles(*grains_arrays), Tools(*tools_arrays), meshes, law, gravity, dt, np.int64(run))
        move_tools(grains, tools, n_steps, dt)
    arrive_all(tools)
    return True
