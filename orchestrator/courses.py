"""Signals of a two-wheel drive over the rear wheel's x: runs differ in speed, so that nothing of them can be compared over time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import xarray as xr
from scipy.signal import savgol_filter

from .report import wheels_of
from .results import ResultError

#: [m] between two values of a course.
SPACING = 0.5e-3

#: [m] of travel over which a course is smoothed: two cells of SCM, whose passing is what the chapter calls the noise of the soil's
#: discretisation. A quadratic is fitted, so that neither a steady rise nor a bend of the signal counts as noise.
SMOOTHING = 0.02

#: Wheels that a course is about.
WHEELS = ("front", "rear")

_SMOOTHED = round(SMOOTHING / SPACING) + 1


@dataclass(frozen=True)
class Signal:
    """What can be said of a drive at a place: unit, meaning, and how it follows from a :class:`Course`.

    Values have the shape [n], those of a ``compound`` signal [n_parts, n].
    """

    unit: str
    meaning: str
    values: Callable[[Course], np.ndarray]
    compound: bool = False


class Course:
    """The signals of a drive at multiples of ``SPACING`` of the rear wheel's x.

    Where the rear wheel stands or slides back, what it did there before counts.

    Args:
        result: Of a run with a front and a rear wheel.

    Raises:
        ResultError: it has other wheels, or no rows.
    """

    def __init__(self, result: xr.Dataset):
        self._wheels = {wheel.name: wheel for wheel in wheels_of(result)}
        if not set(WHEELS) <= self._wheels.keys():
            raise ResultError(f"the result has the wheels {', '.join(self._wheels)}: a comparison needs a front and a rear one")
        x = self._wheels["rear"].centre("x")
        # The row at the start comes before the contacts' first step: it has poses, but no forces.
        self._rows = 1 + np.flatnonzero(x[1:] > np.maximum.accumulate(x)[:-1])
        self._x = x[self._rows]
        self._first = round(x[0] / SPACING)
        self._end = int(self._x[-1] / SPACING + 1e-6) + 1 if self._rows.size else self._first
        #: x of the rear wheel [m], shape [n].
        self.x = np.arange(self._first, self._end) * SPACING
        self._signals: dict[str, np.ndarray] = {}

    def window(self, low: float, high: float) -> slice | None:
        """The values from ``low`` to ``high`` [m], both included; None if the drive does not reach so far."""
        first, last = round(low / SPACING), round(high / SPACING)
        return slice(first - self._first, last + 1 - self._first) if self._first <= first and last < self._end else None

    def signal(self, name: str) -> np.ndarray:
        """Values of a signal out of ``SIGNALS``, shape [n] or, compound, [n_parts, n]."""
        if name not in self._signals:
            self._signals[name] = SIGNALS[name].values(self)
        return self._signals[name]

    def smooth(self, name: str) -> np.ndarray:
        """The signal without its noise, same shape; the drive must be longer than ``SMOOTHING``."""
        return savgol_filter(self.signal(name), _SMOOTHED, 2)

    def diagnostic(self, wheel: str, name: str) -> np.ndarray:
        """A contact diagnostic of a wheel, shape [n]."""
        return self._at_nodes(self._wheels[wheel].diagnostic(name))

    def centre(self, wheel: str, axis: str) -> np.ndarray:
        """Coordinate of a wheel's centre [m], z above the undeformed ground, shape [n]."""
        return self._at_nodes(self._wheels[wheel].centre(axis))

    def force(self, wheel: str) -> np.ndarray:
        """Horizontal contact force on a wheel, resolved in world [N], shape [2, n]."""
        w = self._wheels[wheel]
        return np.array([self._at_nodes(w.result.cdl[f"{w.instance}.wheel[{w.index}].f_0[{k}]"].values) for k in (1, 2)])

    def _at_nodes(self, values: np.ndarray) -> np.ndarray:
        return np.interp(self.x, self._x, values[self._rows])


def _yaw(course: Course) -> np.ndarray:
    along = [course.centre("front", axis) - course.centre("rear", axis) for axis in "xy"]
    return np.arctan2(along[1], along[0])


def _across(course: Course) -> np.ndarray:
    yaw, force = _yaw(course), course.force("rear")
    return force[1] * np.cos(yaw) - force[0] * np.sin(yaw)


def _offset(course: Course) -> np.ndarray:
    path = np.interp(course.x, course.signal("front.x"), course.signal("front.y"))
    return course.signal("rear.y") - path


def _both(combine: Callable[[np.ndarray, np.ndarray], np.ndarray], name: str) -> Callable[[Course], np.ndarray]:
    return lambda course: combine(course.signal(f"rear.{name}"), course.signal(f"front.{name}"))


def _stack(*names: str) -> Callable[[Course], np.ndarray]:
    return lambda course: np.array([course.signal(name) for name in names])


def _of_wheel(wheel: str) -> dict[str, Signal]:
    diagnostics = {
        "F_x": ("N", "contact force along the wheel's heading", "drawbar_pull"),
        "F_y": ("N", "contact force across the wheel's heading, positive to the left", "lateral_force"),
        "F_z": ("N", "vertical contact force", "normal_load"),
        "sinkage": ("m", "sinkage of the lowest rim point below the undeformed ground", "sinkage"),
    }
    axes = {"x": "x of the wheel's centre", "y": "y of the wheel's centre", "z": "height of the wheel's centre above the undeformed ground"}
    return {
        **{
            f"{wheel}.{name}": Signal(unit, meaning, lambda course, channel=channel: course.diagnostic(wheel, channel))
            for name, (unit, meaning, channel) in diagnostics.items()
        },
        **{f"{wheel}.{axis}": Signal("m", text, lambda course, axis=axis: course.centre(wheel, axis)) for axis, text in axes.items()},
    }


#: Everything that can be asked of a course. Forces of one wheel are in the heading frame: z global, x along the wheel's heading.
SIGNALS: dict[str, Signal] = {
    **_of_wheel("front"),
    **_of_wheel("rear"),
    "rear.F_xy": Signal("N", "size of the rear wheel's horizontal force", lambda c: np.hypot(c.signal("rear.F_x"), c.signal("rear.F_y"))),
    "rear.F_across": Signal("N", "force on the rear wheel across the line to the front wheel, positive to the left", _across),
    "rear.offset": Signal("m", "lateral distance of the rear wheel from the front wheel's path, positive to the left", _offset),
    "shift.F_x": Signal("N", "F_x of the rear wheel minus that of the front one", _both(np.subtract, "F_x")),
    "shift.F_z": Signal("N", "F_z of the rear wheel minus that of the front one", _both(np.subtract, "F_z")),
    "sum.F_x": Signal("N", "F_x of both wheels together", _both(np.add, "F_x")),
    "larger.F_x": Signal("N", "the larger |F_x| of the two wheels", _both(lambda a, b: np.maximum(abs(a), abs(b)), "F_x")),
    "total.F": Signal("N", "size of both wheels' horizontal forces together", lambda c: np.hypot(*(c.force("front") + c.force("rear")))),
    "rover.yaw": Signal("rad", "direction from the rear to the front wheel", _yaw),
    "all.F": Signal("N", "F_x and F_y of both wheels", _stack("front.F_x", "front.F_y", "rear.F_x", "rear.F_y"), compound=True),
    "both.y": Signal("m", "y of both wheels", _stack("front.y", "rear.y"), compound=True),
}
