"""Where checks get their numbers: points on the single-wheel testbed, each run once, side by side."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

from ..measurement import QUANTITIES
from ..side_by_side import Crew
from ..single_wheel import measure
from .rows import shown

#: Settings of a run, as ``cdl run single_wheel --set`` takes them.
Point = Mapping[str, object]

#: Load [N] on a wheel of the two-wheel rover of Table 8.2.
ROVER_WHEEL_LOAD = 27.0 * 9.81


class Bench:
    """Runs points for checks.

    Args:
        crew: Processes.
        quick: Whether checks are to leave out what takes long.
        status: Called with a line for each point that starts or is done.

    Attributes:
        about: What the runs are for, in the lines of ``status``.
        failed: Which points failed, and why.
    """

    def __init__(self, crew: Crew, quick: bool = False, status: Callable[[str], None] = lambda text: None):
        self.quick, self.about, self.failed = quick, "", []
        self._crew, self._status = crew, status
        self._known: dict[tuple, dict] = {}

    def measure(self, points: Sequence[Point]) -> list[dict]:
        """What :func:`orchestrator.single_wheel.measure` returns for each point. Of one that fails, all quantities are NaN."""
        keys = [tuple(sorted(point.items())) for point in points]
        new = [key for key in dict.fromkeys(keys) if key not in self._known]
        settings = [dict(key) for key in new]
        names = [f"{self.about}: {name}" for name in _names(settings)]
        left = len(new)

        def started(i: int) -> None:
            self._status(f"{names[i]}: started, {left} of {len(new)} left")

        def finished(i: int, facts: dict | None, error: str | None) -> None:
            nonlocal left
            left -= 1
            if error:
                self.failed.append(f"{names[i]}: {error}")
            self._known[new[i]] = facts or {"stationary": False} | dict.fromkeys(QUANTITIES, math.nan)
            self._status(f"{names[i]}: {'failed' if error else 'done'}, {left} of {len(new)} left")

        self._crew.work(measure, [(point,) for point in settings], started, finished)
        return [self._known[key] for key in keys]


def _names(points: Sequence[Point]) -> list[str]:
    """Each point by as few settings as tell it from the others: ``tier=SCM, slip=0.5``."""
    kept: list[str] = []

    def told_apart(keys: Sequence[str]) -> int:
        return len({tuple(point.get(key) for key in keys) for point in points})

    for key in dict.fromkeys(["tier", "slip", *(key for point in points for key in point)]):
        if told_apart([*kept, key]) > max(told_apart(kept), 1):
            kept.append(key)
    return [", ".join(f"{key}={shown(point[key])}" for key in kept if key in point) for point in points]
