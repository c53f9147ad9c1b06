"""Particles and contacts by their numbers, out of the arrays that kernels work on and into them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .columns import Grains, Live, Resting, Touching
from .particles import PAIRS, SIDE, STALE, N, Particles, history_of_pairs, set_history_of_pairs
from .tools import KEPT, Tools
from .touch import MOST


class Touches(NamedTuple):
    """Touches of wheels and bodies: tool and number of the particle, int64 [k], and history, [k, MOST, KEPT]."""

    tool: np.ndarray
    ident: np.ndarray
    kept: np.ndarray


def live_of(grains: Particles, tools: Tools) -> Live:
    """Copies of all particles, of their contacts that have a history, and of those with the floor, which is tool 0."""
    n, side, m = grains.count[N], grains.count[SIDE], grains.count[PAIRS]
    ident = grains.ident[side, :n].copy()
    history = history_of_pairs(grains.history[side], m)
    used = np.any(history != 0.0, axis=1)
    a = np.repeat(np.arange(n), np.diff(grains.first[side, : n + 1]))[used] if m else np.zeros(0, np.int64)
    b = grains.partner[side, :m][used]
    on_floor = slice(tools.first[side, 0], tools.first[side, 1])
    orientation = grains.orientation[side, :n].copy() if grains.orientation.shape[1] else np.zeros((n, 0))
    return Live(
        Grains(grains.body[side, :n].copy(), ident, orientation),
        Touching(ident[a], ident[b], history[used]),
        Resting(ident[tools.particle[side, on_floor]], tools.kept[side, on_floor, 0].copy()),
    )


def touches_of(grains: Particles, tools: Tools) -> Touches:
    """Copies of what wheels and bodies touch."""
    side = grains.count[SIDE]
    first = tools.first[side]
    these = slice(first[1], first[-1])
    tool = np.repeat(np.arange(len(tools.kinds)), np.diff(first))[these]
    return Touches(tool, grains.ident[side][tools.particle[side, these]], tools.kept[side, these].copy())


def make_live(grains: Particles, tools: Tools, live: Live, touches: Touches) -> None:
    """Fill the arrays; lists are made anew at the next substep. There is room for all."""
    (bodies, numbers, orientation), (first, second, history), (resting, kept_resting) = live
    n = len(bodies)
    grains.body[0, :n], grains.ident[0, :n] = bodies, numbers
    grains.orientation[0, : len(orientation) if orientation.shape[1] else 0] = orientation if orientation.shape[1] else 0.0
    grains.force[:] = 0.0
    order = np.argsort(numbers)
    a, b = (order[np.searchsorted(numbers, ends, sorter=order)] for ends in (first, second))
    by_first = np.argsort(a, kind="stable")
    grains.first[0, : n + 1] = np.searchsorted(a[by_first], np.arange(n + 1))
    grains.partner[0, : len(b)] = b[by_first]
    set_history_of_pairs(grains.history[0], history[by_first])
    on_floor = np.zeros((len(resting), MOST, KEPT))
    on_floor[:, 0] = kept_resting  # a plane has one row
    tool = np.concatenate([np.zeros(len(resting), np.int64), touches.tool])
    ident, kept = np.concatenate([resting, touches.ident]), np.concatenate([on_floor, touches.kept])
    here = np.isin(ident, numbers)
    tool, ident, kept = tool[here], ident[here], kept[here]
    tools.first[0] = np.searchsorted(tool, np.arange(len(tools.kinds) + 1))
    tools.particle[0, : len(ident)] = order[np.searchsorted(numbers, ident, sorter=order)]
    tools.kept[0, : len(ident)] = kept
    grains.count[N], grains.count[SIDE], grains.count[PAIRS], grains.count[STALE] = n, 0, len(b), 1
