"""What a single-wheel testbed measures: means over the stationary part of a run, read from its result alone."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from .report import Wheel, is_testbed, wheels_of
from .results import ResultError
from .stationary import Part, Signal, stationary_part

#: Key of a measured quantity -> the contact's diagnostic, in the wheel's heading frame.
QUANTITIES = {
    "drawbar_pull_N": "drawbar_pull",
    "lateral_force_N": "lateral_force",
    "torque_Nm": "drive_torque",
    "sinkage_m": "sinkage",
    "normal_load_N": "normal_load",
}

# Tolerances of the stationary part: of sinkage in m and relative to its mean, of forces relative to the load.
_SINKAGE_ABSOLUTE, _SINKAGE_RELATIVE, _FORCE = 1e-4, 0.02, 0.02
#: Quantities that settle and do not drift in the stationary part.
_STEADY = ("sinkage_m", "drawbar_pull_N", "lateral_force_N")


#: Name of a sweep's files in its folder, without their endings.
SWEEP = "sweep"


@dataclass(frozen=True)
class Measurement:
    """A run on a testbed.

    Attributes:
        wheel: Its wheel.
        carriage: ``load_N, carriage_speed, slip, slip_angle, wheel_rate, full_speed_s`` of the run; SI units.
        path: Travel of the carriage in each row, or of the rim where the carriage stands [m], shape [n].
        part: The stationary part; drifts are those of sinkage, drawbar pull and lateral force.
    """

    wheel: Wheel
    carriage: Mapping[str, float]
    path: np.ndarray
    part: Part

    def series(self, quantity: str) -> np.ndarray:
        """A quantity out of ``QUANTITIES`` in each row, shape [n]."""
        return self.wheel.diagnostic(QUANTITIES[quantity])

    def facts(self) -> dict[str, str | float | bool]:
        """What ``cdl run --json`` says of the run: its settings, mean and standard deviation of each quantity, where it is stationary."""
        rows = slice(self.part.first, None)
        settings = {key: value for key, value in self.carriage.items() if key != "full_speed_s"}
        facts: dict[str, str | float | bool] = {"tier": self.wheel.tier, **settings}
        for quantity in QUANTITIES:
            values = self.series(quantity)[rows]
            facts |= {quantity: float(values.mean()), f"{quantity}_std": float(values.std())}
        return (
            facts
            | {
                "stationary": self.part.stationary,
                "stationary_from_s": float(self.wheel.result.time.values[self.part.first]),
                "stationary_travel_m": float(self.path[-1] - self.path[self.part.first]),
            }
            | {f"{quantity}_drift_per_m": drift for quantity, drift in zip(_STEADY, self.part.drifts)}
        )


def measure_result(result: xr.Dataset) -> Measurement:
    """Read a run on a testbed, and find where it is stationary.

    Raises:
        ResultError: the result is of no testbed, or has no rows.
    """
    if not is_testbed(result):
        raise ResultError("the result is of no single-wheel testbed (attribute 'carriage'): run the experiment single_wheel")
    (wheel,) = wheels_of(result)
    carriage, size = json.loads(result.attrs["carriage"]), json.loads(result.attrs["dimensions"])
    time = result.time.values
    full = np.flatnonzero(time >= carriage["full_speed_s"] - 1e-9)
    rate = abs(carriage["wheel_rate"])
    if carriage["carriage_speed"] > 0.0:
        path, per_radian = result.cdl[f"{wheel.mover}.travel"].values, carriage["carriage_speed"] / rate if rate > 0.0 else 0.0
    else:
        path, per_radian = size["r_w"] * rate * np.maximum(time - carriage["full_speed_s"], 0.0), size["r_w"]
    ripple = 2.0 * math.pi / size["n_g"] * per_radian if size["n_g"] > 0.0 else 0.0
    first = int(full[0]) if full.size else time.size
    signals = []
    for quantity in _STEADY:
        values = wheel.diagnostic(QUANTITIES[quantity])[first:]
        if quantity == "sinkage_m":
            signals.append(Signal(values, _SINKAGE_ABSOLUTE, _SINKAGE_RELATIVE))
        else:
            signals.append(Signal(values, _FORCE * carriage["load_N"]))
    part = stationary_part(path[first:], signals, ripple)
    begin = first + part.first if first < time.size else time.size - 1  # it ended before it was at full speed: its last row
    return Measurement(wheel, carriage, path, Part(begin, part.stationary, part.drifts))


def open_sweep(path: str | Path) -> dict[str, dict | list]:
    """Read ``sweep.json``, or the one in a folder: ``swept``, key -> values; ``runs``, what each finished point measured; ``failed``.

    Raises:
        ResultError: there is none, or it is no sweep's.
    """
    path = Path(path)
    if path.is_dir():
        path /= f"{SWEEP}.json"
    try:
        sweep = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ResultError(f"{path}: {error.strerror}; `cdl run` with a list for a key writes one") from None
    except ValueError as error:
        raise ResultError(f"{path} is no JSON ({error}): give the {SWEEP}.json of `cdl run`") from None
    if not isinstance(sweep, dict) or not {"swept", "runs", "failed"} <= sweep.keys():
        raise ResultError(f"{path} is of no sweep: give the {SWEEP}.json of `cdl run`")
    return sweep
