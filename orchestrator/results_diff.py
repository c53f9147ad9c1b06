"""The first difference between two results: what a CI job asks of a run and its baseline."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr


@dataclass(frozen=True)
class Difference:
    """Where a result first departs from its baseline; ``str()`` is the sentence to print.

    Attributes:
        signal: Channel that differs; ``time`` where the time grids do.
        time: When [s]; None where a channel as a whole is missing or has another unit.
        text: Signal, time, both values with unit, the relative difference and what was allowed.
    """

    signal: str
    time: float | None
    text: str

    def __str__(self) -> str:
        return self.text


def diff_results(result: xr.Dataset, baseline: xr.Dataset, rtol: float, atol: float = 0.0) -> Difference | None:
    """First difference of ``result`` from ``baseline``, or None: the earliest time, then the baseline's order of channels.

    A sample differs where ``|a - b| > atol + rtol * max|b|``, the maximum taken over the whole channel of the baseline: a
    tolerance relative to each sample would fail at every zero crossing. NaN equals NaN, and an infinity itself.
    ``rtol = atol = 0`` asks for equal values, sample by sample.
    Every channel of the baseline must be there, with its unit; channels that only ``result`` has are no difference, so a model
    may gain outputs. Times must agree within 1 ns; where they do not, or one run ends early, only what lies before is compared.

    Args:
        result, baseline: As :func:`orchestrator.results.open_result` reads them.
        rtol: Tolerance relative to a channel's largest magnitude in the baseline [1].
        atol: Tolerance in each channel's unit, for channels that are nothing but rounding.
    """
    for name in baseline.cdl:
        if name not in result.cdl:
            return Difference(name, None, f"{name}: missing in the result, present in the baseline")
        units = [str(d.cdl[name].attrs["units"]) for d in (result, baseline)]
        if units[0] != units[1]:
            return Difference(name, None, f"{name}: unit {units[0]!r} in the result, {units[1]!r} in the baseline")
    n = _common_rows(result.time.values, baseline.time.values)
    return _first_value(result, baseline, n, rtol, atol) or _first_time(result.time.values, baseline.time.values, n)


def _common_rows(a: np.ndarray, b: np.ndarray) -> int:
    """Number of leading rows at the same times."""
    shorter = min(len(a), len(b))
    apart = np.abs(a[:shorter] - b[:shorter]) > 1e-9
    return int(apart.argmax()) if apart.any() else shorter


def _first_value(result: xr.Dataset, baseline: xr.Dataset, n: int, rtol: float, atol: float) -> Difference | None:
    theirs = baseline.series.values
    ours = result.series.sel(channel=baseline.channel).values[:n]
    scale = np.abs(theirs).max(axis=0, initial=0.0, where=np.isfinite(theirs))
    theirs = theirs[:n]
    with np.errstate(invalid="ignore"):
        within = np.abs(ours - theirs) <= atol + rtol * scale
    # inf - inf is NaN, and NaN is within nothing.
    differs = ~(within | (ours == theirs) | (np.isnan(ours) & np.isnan(theirs)))
    if not differs.any():
        return None
    row, column = np.unravel_index(differs.argmax(), differs.shape)
    name, unit = str(baseline.channel.values[column]), str(baseline.unit.values[column])
    unit = "" if unit == "1" else f" {unit}"
    time, a, b, largest = float(baseline.time[row]), ours[row, column], theirs[row, column], scale[column]
    text = f"{name} at t = {time:.9g} s: {a:.17g}{unit} in the result, {b:.17g}{unit} in the baseline"
    if largest == 0.0:
        text += ", zero throughout"
    elif np.isfinite(a - b):
        text += f"; the relative difference is {abs(a - b) / largest:.3g} of the signal's largest magnitude, {largest:.6g}{unit}"
    return Difference(name, time, f"{text} (allowed: rtol {rtol:.3g}, atol {atol:.3g}{unit})")


def _first_time(a: np.ndarray, b: np.ndarray, n: int) -> Difference | None:
    if n == len(a) == len(b):
        return None
    here, there = (f"the next time is {t[n]:.9g} s" if n < len(t) else "it ends there" for t in (a, b))
    after = f"after t = {a[n - 1]:.9g} s" if n else "from the start"
    time = min(t[n] for t in (a, b) if n < len(t))
    return Difference("time", float(time), f"time: the grids differ {after}: in the result {here}, in the baseline {there}")
