"""What `cdl run` prints of a run or a sweep."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

from .measurement import QUANTITIES, SWEEP
from .run import Outcome
from .terminal import output, table

if TYPE_CHECKING:
    from .single_wheel import Sweep

_SHOWN = {"N": ("N", 1.0), "Nm": ("N m", 1.0), "m": ("mm", 1e3)}  # end of a quantity's key -> unit in tables, and how many of them one is


def print_run(outcome: Outcome, facts: Mapping, resumed: bool) -> None:
    """How a run ended, means of its wheels or what its testbed measured, and its files."""
    end = outcome.simulated_s
    # A resumed run has simulated less than that in its wall time.
    speed = "" if resumed else f" ({end / max(outcome.wall_s, 1e-9):.3g} x real time)"
    done = "resumed, up to" if resumed else "simulated"
    print(f"{done} {end:g} s in {outcome.wall_s:.3g} s{speed}, scheme {outcome.scheme}, step {outcome.step_s * 1e3:g} ms")
    if "tier" in facts:
        _print_measurement(facts)
    elif facts["wheels"]:
        _print_wheels(facts["wheels"], end)
    if "solver" in facts:
        solver = {key: 100.0 * facts["solver"][key] for key in ("pivoted", "unsolved")}
        left = f"{solver['unsolved']:.2g} % left above the tolerance, largest error {facts['solver']['residual_m_s']:.1e} m/s"
        print(f"rigid contacts: of the steps with any, Lemke's method helped in {solver['pivoted']:.2g} %; {left}")
    for name in ("result.nc", "result.png", "particles.png", "particles/particles.pvd", "system.ssp"):
        if (path := outcome.result.parent / name).exists():
            print(path)


def print_sweep(sweep: Sweep) -> None:
    """What each point of a sweep measured, and the sweep's files."""
    headings = {key: f"{_name(key)} [{_unit(key)[0]}]" for key in QUANTITIES}
    caption = "mean ± standard deviation of the stationary part, or of the last quarter where there is none; forces in the heading frame"
    rows = table(*sweep.keys, *headings.values(), "stationary", right=headings.values(), caption=caption)
    for row in sweep.rows:
        rows.add_row(
            *(str(row[key]) for key in sweep.keys), *(_number(row, key) for key in QUANTITIES), "yes" if row["stationary"] else "(!)"
        )
    output().print(rows)
    for suffix in (".csv", ".json", ".png"):
        if (path := sweep.out / f"{SWEEP}{suffix}").exists():
            print(path)


def _print_wheels(wheels: list[Mapping], end: float) -> None:
    numbers = {"sinkage [mm]": ("sinkage_m", 1e3), "z [mm]": ("z_m", 1e3)}
    numbers |= {f"{name} [N]": (f"{name.lower()}_N", 1.0) for name in ("F_long", "F_lat", "F_n")}
    numbers |= {"slip [%]": ("slip", 100.0), "slip angle [deg]": ("slip_angle_rad", 180.0 / math.pi)}
    rows = table("wheel", "tier", *numbers, right=numbers, caption=f"means over the last {min(0.5, end):g} s; forces in the heading frame")
    for wheel in wheels:
        rows.add_row(wheel["name"], wheel["tier"], *(f"{wheel[key] * factor:z.2f}" for key, factor in numbers.values()))
        if rocks := wheel.get("rocks"):
            rows.add_row("", rocks["tier"], *(f"{rocks[key] * factor:z.2f}" if key in rocks else "" for key, factor in numbers.values()))
    output().print(rows)


def _print_measurement(facts: Mapping) -> None:
    settings = f"slip {facts['slip']:.4g}, slip angle {facts['slip_angle']:.4g} rad, wheel rate {facts['wheel_rate']:.4g} rad/s"
    part = f"from {facts['stationary_from_s']:g} s on, {facts['stationary_travel_m']:.3g} m"
    found = f"stationary {part}" if facts["stationary"] else f"NOT stationary; means over the last quarter, {part}: give more travel"
    caption = f"{facts['tier']}, {settings}; {found}; forces in the heading frame"
    rows = table("quantity", "mean", "deviation", "drift a metre", right=("mean", "deviation", "drift a metre"), caption=caption)
    for key in QUANTITIES:
        unit, factor = _unit(key)
        drift = facts.get(f"{key}_drift_per_m")
        shown = (facts[key], facts[f"{key}_std"], drift)
        rows.add_row(f"{_name(key)} [{unit}]", *("" if value is None else f"{value * factor:z.4g}" for value in shown))
    output().print(rows)


def _name(key: str) -> str:
    return key.rpartition("_")[0].replace("_", " ")


def _unit(key: str) -> tuple[str, float]:
    return _SHOWN[key.rpartition("_")[2]]


def _number(row: Mapping, key: str) -> str:
    factor = _unit(key)[1]
    return f"{row[key] * factor:z.4g} ± {row[f'{key}_std'] * factor:.2g}"
