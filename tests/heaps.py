"""A small model with a pool: what falls at a place makes a heap there, and memory grows with the number of heaps."""

import math

import numpy as np

from cdl_fmu.slave.kernel import kernel
from cdl_fmu.slave.model import STATUS_SPAN, Event, KernelModel, ModelError, Rule
from cdl_fmu.slave.pool import RowPool
from cdl_fmu.slave.records import Real, Record

CELLS, FULL = 4, 1


class Heaps(KernelModel):
    """Rows of ``CELLS`` cells [kg], taken where something falls first; ``marks[r, 1]`` is the place of row r, ``head[1]`` counts steps."""

    identifier = "heaps"
    events = {FULL: Event("outlet {i}: no heap is left for its place; raise limit = {p.limit:.0f}")}
    rules = (Rule("limit = {p.limit:g}: it must be a whole number", lambda p: p.limit != math.floor(p.limit)),)
    parameters = Record(
        rate=Real(1.0, "kg/s", "Mass flow", min=0.0, max=1e3),
        limit=Real(64.0, "1", "Most heaps", min=1.0, max=1e6),
    )
    inputs = Record(place=Real(0.0, "m", "Place of each outlet; a heap is 1 m wide", (2,), min=-1e3, max=1e3))
    state = Record(steps=Real(0.0, "1", "Steps taken"))
    outputs = Record(
        heaps=Real(0.0, "1", "Heaps there are"),
        mass=Real(0.0, "kg", "Mass of each outlet's heap, times the share of its cells that count", (2,)),
    )
    files = {"shares": "Share of each cell of a heap that counts, one number a line", "hopper[1].map": "Not read"}
    pool_class = RowPool

    def make_pool(self, p, files):
        shares = np.loadtxt(files["shares"], ndmin=1) if "shares" in files else np.array([1.0, 0.5, 0.25, 0.125])
        if shares.shape != (CELLS,):
            raise ModelError(f"shares = '{files['shares']}': {shares.size} numbers; it must have {CELLS}")
        return RowPool((CELLS,), marks=2, head=2, per_step=2, limit=int(p.limit), extra=(shares,), scratch=(np.empty(CELLS),))

    @staticmethod
    @kernel
    def resize_kernel(p, extents, growth):
        growth[1] = int(p.limit)
        extents[0] = extents[2] = min(growth[0], growth[1])

    @staticmethod
    @kernel
    def initialise_kernel(t, p, x, y, rows, marks, head, shares, weighed):
        x.steps = 0.0
        head[1] = 1000

    @staticmethod
    @kernel
    def step_kernel(t, h, p, u, x, y, rows, marks, head, shares, weighed):
        x.steps += 1.0
        head[1] += 1
        for i in range(len(u.place)):
            r = row_of(int(np.floor(u.place[i])), rows, marks, head)
            if r < 0:
                return FULL + STATUS_SPAN * i
            marks[r, 0] = 1
            rows[r, head[1] % CELLS] += p.rate * h
            y.mass[i] = 0.0
            for c in range(CELLS):
                weighed[c] = shares[c] * rows[r, c]
            for c in range(CELLS):
                y.mass[i] += weighed[c]
        y.heaps = head[0]
        return 0


@kernel
def row_of(place, rows, marks, head):
    """Row of a place, taken if there is none; -1 if none is left."""
    for r in range(head[0]):
        if marks[r, 1] == place:
            return r
    if head[0] == len(rows):
        return -1
    r = head[0]
    head[0] += 1
    marks[r, 0] = 1
    marks[r, 1] = place
    return r
