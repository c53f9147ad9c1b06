"""The stationary part of a run: after its signals have settled, if they do not drift on.

The path is cut into windows, from its end backwards: a window is as long as what recurs (a pitch of the grousers), so that a mean over it
has no ripple. A signal has settled where the means of all later windows lie in a band around the mean of the path's last quarter: as wide
as the signal's tolerance to both sides, or three standard deviations of the last quarter's windows if that is more. What follows is
stationary if the means of its four quarters are so close together that their drift, going on over as much as the whole path, would not
cross the tolerance's band. Four quarters rather than a slope: what rises and falls again has no slope.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

_MOST_WINDOWS, _FEWEST_WINDOWS = 200, 16
_QUARTERS = 4
_NOISE = 3.0  # standard deviations of windows


@dataclass(frozen=True)
class Signal:
    """Values [n] and their tolerance to both sides: ``absolute`` in their unit, or ``relative`` to their mean if that is more."""

    values: np.ndarray
    absolute: float
    relative: float = 0.0

    def tolerance(self, mean: float) -> float:
        """What the signal may be off this mean."""
        return max(self.absolute, self.relative * abs(mean))


@dataclass(frozen=True)
class Part:
    """The final part of a path in which all signals are stationary, or if they are nowhere, its last quarter.

    Attributes:
        first: Its first row.
        stationary: Whether it is.
        drifts: Drift of each signal over it, in the signal's unit per unit of the path; 0 where it is too short to tell.
    """

    first: int
    stationary: bool
    drifts: tuple[float, ...]


def stationary_part(path: np.ndarray, signals: Sequence[Signal], ripple: float = 0.0) -> Part:
    """Find the part of a path from which on all signals have settled, and whether they are stationary there.

    Args:
        path: Where each row lies along the path, rising, shape [n].
        signals: What must settle and not drift.
        ripple: Length of path over which the signals recur; 0 = they do not.
    """
    length = float(path[-1] - path[0]) if path.size else 0.0
    if length <= 0.0 or path.size < 2 * _FEWEST_WINDOWS:
        return Part(max(path.size - max(path.size // _QUARTERS, 1), 0), False, (0.0,) * len(signals))
    window = min(max(ripple, length / min(_MOST_WINDOWS, path.size // 2)), length / _FEWEST_WINDOWS)
    n = int(length / window * (1.0 + 1e-9))
    firsts = np.unique(np.searchsorted(path, path[-1] - window * np.arange(n, 0, -1) - 1e-9 * length))
    means = [np.add.reduceat(signal.values, firsts) / np.diff([*firsts, path.size]) for signal in signals]
    last_quarter = firsts.size - firsts.size // _QUARTERS
    begin = min(max(_settled(signal, mean, last_quarter) for signal, mean in zip(signals, means)), last_quarter)
    stationary = all(
        abs(_drift(mean[begin:], window)) * length <= 2.0 * signal.tolerance(float(mean[begin:].mean()))
        for signal, mean in zip(signals, means)
    )
    if not stationary:
        begin = last_quarter
    return Part(int(firsts[begin]), stationary, tuple(_drift(mean[begin:], window) for mean in means))


def _settled(signal: Signal, means: np.ndarray, last_quarter: int) -> int:
    """The first window from which on the means of all windows lie in the band."""
    end = means[last_quarter:]
    band = max(signal.tolerance(float(end.mean())), _NOISE * float(end.std()))
    outside = np.flatnonzero(np.abs(means - end.mean()) > band)
    return int(outside[-1]) + 1 if outside.size else 0


def _drift(means: np.ndarray, window: float) -> float:
    """Largest difference between the means of quarters, later less earlier, per path between the middles of the first and last quarter."""
    quarters = [float(quarter.mean()) for quarter in np.array_split(means, _QUARTERS)]
    low, high = int(np.argmin(quarters)), int(np.argmax(quarters))
    apart = window * means.size * (1.0 - 1.0 / _QUARTERS)
    return (1.0 if high >= low else -1.0) * (quarters[high] - quarters[low]) / apart
