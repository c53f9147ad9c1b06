"""Slopes: the rover up, down and across, in process, and heaps of soil on them."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from fmus import EXPERIMENTS

from ..assemble import assemble
from ..experiment import load_experiment
from ..panels import colours, frame, legend
from ..settle import Wires
from . import sand
from .bench import ROVER_WHEEL_LOAD, Bench, Point
from .rows import Findings, Row, Table, absolute, limited

# Bars: forces in weights of the rover, a wheel's pull in its load, slip, angles.
_FORCES, _PULL, _SLIP, _REPOSE = 0.01, 0.02, 0.02, math.radians(1.0)

_TIERS = ("BCM", "SCM")
_ALONG = {True: (0.0, 10.0), False: (0.0, 5.0, 10.0, 15.0)}  # deg, by whether there is little time
_DOWN = _ACROSS = 10.0  # deg
_LEFT = math.pi / 2  # where the hill is on a cross slope
_SECONDS, _STEADY = 8.0, 3.0  # of a drive, and of its end over which means are taken
_SINGLE = (-0.05, 0.0, 0.05, 0.1, 0.15, 0.2, 0.3)  # slips of the single wheel on level ground
#: Heaps: angle of repose, slope and uphill [deg], along the cells and between them.
_HEAPS = {
    True: ((36.7, 20.0, 30.0),),
    False: ((29.0, 10.0, 0.0), (29.0, 20.0, 30.0), (36.7, 20.0, 0.0), (36.7, 20.0, 30.0), (36.7, 25.0, 45.0)),
}

_SINGLE_WHEEL = "single wheel on level ground"
_WEIGHT = 2.0 * ROVER_WHEEL_LOAD
_COLUMNS = (
    "tier",
    "course",
    "slope [deg]",
    "slip, front",
    "slip, rear",
    "slip angle, front [deg]",
    "slip angle, rear [deg]",
    "drift [deg]",
)
_CONE = 4.5  # slope of the cone from which a heap slides


@dataclass(frozen=True)
class Drive:
    """What the rover did on a slope; forces [N], slip and slip angle [rad] are means over the steady part, front wheel first.

    Attributes:
        pull, lateral, load: Drawbar pull, lateral force and load of both wheels together.
        front: Drawbar pull of the front wheel over its load.
        slip, slip_angle: Of each wheel.
        path: x and y of the rover's middle [m] over the whole drive, [n, 2].
        drift: Angle [rad] from where it headed at the start to where it went in the steady part, positive to the left.
    """

    pull: float
    lateral: float
    load: float
    front: float
    slip: tuple[float, float]
    slip_angle: tuple[float, float]
    path: np.ndarray
    drift: float


def check(bench: Bench) -> Findings:
    """Slopes: the rover up, down and across, heaps"""
    curves = _single_wheels(bench)
    rows, numbers, climbs, crossings = [], [], {}, {}
    for tier in _TIERS:
        climbs[tier] = {degrees: drive(tier, degrees) for degrees in _ALONG[bench.quick]}
        down, crossings[tier] = drive(tier, _DOWN, math.pi), drive(tier, _ACROSS, _LEFT)
        for degrees, found in climbs[tier].items():
            rows += _equilibrium(tier, found, degrees, "up", "drawbar pull", found.pull, 1.0)
            numbers.append(_numbers(tier, "up", degrees, found))
        rows += _equilibrium(tier, down, _DOWN, "down", "drawbar pull", down.pull, -1.0)
        rows += _equilibrium(tier, crossings[tier], _ACROSS, "across", "lateral force", crossings[tier].lateral, 1.0)
        numbers += [_numbers(tier, "down", _DOWN, down), _numbers(tier, "across", _ACROSS, crossings[tier])]
        slips = [np.mean(found.slip) for found in (down, *climbs[tier].values())]
        rows.append(
            limited(tier, "slope after slope", "rise of the slip, least, from 10 deg down", float(np.diff(slips).min()), "1", (0.0, None))
        )
        drift = -crossings[tier].drift
        rows.append(limited(tier, "slope's fall line", f"drift downhill, {_ACROSS:g} deg across", drift, "rad", (0.0, None)))
        for degrees, found in climbs[tier].items():
            rows += _against_single(tier, degrees, found, curves[tier]) if degrees else []
    for heap in _HEAPS[bench.quick]:
        rows += _heap(*heap)
    note = (
        f"The two-wheel rover drives straight on for {_SECONDS:g} s, its wheels at one rate; means over the last {_STEADY:g} s. Its wheel, "
        "alone on level ground under half its weight, says what the front wheel should pull at its slip, and with what slip the rover "
        f"should climb if its rear wheel, which follows in the rut, pulled alike. A cone of {math.degrees(math.atan(_CONE)):.0f} deg "
        "slides until it rests, and its inclination against the horizontal is read on eight sides, the first of them uphill: the one "
        "farthest off counts."
    )
    return Findings(rows, _figure(climbs, crossings, curves), [Table("Drives", _COLUMNS, numbers)], note)


def drive(tier: str, degrees: float, uphill: float = 0.0) -> Drive:
    """Drive the two-wheel rover along x on a slope [deg] that rises most towards ``uphill`` [rad] from there."""
    slope = {"environment.slope": math.radians(degrees), "environment.uphill": uphill, "driver.steer_to": [0.0, 0.0]}
    experiment = load_experiment("two_wheel", tiers=[tier, tier], overrides=slope)
    assembly, h = assemble(experiment), experiment.settings.step
    parts, wires = assembly.instances, Wires(assembly.instances, assembly.connections)
    parts["driver"].initialise()
    soil, rover, wheels, path = parts[tier.lower()], parts["rover"], [], []
    for k in range(round(_SECONDS / h)):
        for name in (tier.lower(), "driver", "rover"):
            wires.feed(name)
            parts[name].step(k * h, h)
        wheels.append([[d.drawbar_pull, d.lateral_force, d.normal_load, d.slip, d.slip_angle] for d in soil.y.diagnostics])
        path.append(rover.y.body.r_0[:2].copy())
    steady = round(_STEADY / h)
    pull, lateral, load, slip, slip_angle = np.mean(wheels[-steady:], axis=0).T
    forward, left = path[-1] - path[-steady]
    return Drive(
        float(pull.sum()),
        float(lateral.sum()),
        float(load.sum()),
        float(pull[0] / load[0]),
        tuple(slip.tolist()),
        tuple(slip_angle.tolist()),
        np.array(path),
        math.atan2(left, forward),
    )


def _equilibrium(tier: str, found: Drive, degrees: float, course: str, force: str, value: float, sign: float) -> list[Row]:
    along, normal = sign * math.sin(math.radians(degrees)), math.cos(math.radians(degrees))
    where = f"both wheels, {degrees:g} deg {course}"
    return [
        absolute(tier, "W sin(slope)", f"{force}, {where}", along, value / _WEIGHT, "W", _FORCES),
        absolute(tier, "W cos(slope)", f"load, {where}", normal, found.load / _WEIGHT, "W", _FORCES),
    ]


def _numbers(tier: str, course: str, degrees: float, found: Drive) -> list[float | str]:
    return [tier, course, degrees, *found.slip, *(np.degrees([*found.slip_angle, found.drift]).round(3) + 0.0).tolist()]


def _single_wheels(bench: Bench) -> dict[str, np.ndarray]:
    """Tier -> drawbar pull over load at each slip of a single wheel on level ground, which is the rover's under half its weight."""
    tables = tomllib.loads(EXPERIMENTS["two_wheel"].read_text(encoding="utf-8"))
    rim = tables["wheel"]["r_w"] * tables["driver"]["wheel_rate"]  # m/s

    def point(tier: str, slip: float) -> Point:
        own = {f"{part}.{key}": value for part in ("soil", "wheel", tier.lower()) for key, value in tables[part].items()}
        own |= {"bcm.V_j_mode": "constant"} if tier == "BCM" else {}  # which the testbed's experiment sets, and the rover's leaves as it is
        return {
            "tier": tier,
            "load_N": ROVER_WHEEL_LOAD,
            "slip": slip,
            "carriage_speed": rim * (1.0 - slip) if slip > 0.0 else rim / (1.0 + slip),
            **own,
        }

    facts = iter(bench.measure([point(tier, slip) for tier in _TIERS for slip in _SINGLE]))
    return {tier: np.array([next(facts)["drawbar_pull_N"] for _ in _SINGLE]) / ROVER_WHEEL_LOAD for tier in _TIERS}


def _against_single(tier: str, degrees: float, found: Drive, pulls: np.ndarray) -> list[Row]:
    tangent = math.tan(math.radians(degrees))
    expected = float(np.interp(tangent, pulls, _SINGLE, math.nan, math.nan)) if (np.diff(pulls) > 0.0).all() else math.nan
    quantity = f"slip, mean of the wheels, {degrees:g} deg up"
    pull = float(np.interp(found.slip[0], _SINGLE, pulls))
    return [
        absolute(tier, _SINGLE_WHEEL, f"drawbar pull / load of the front wheel, {degrees:g} deg up", pull, found.front, "W", _PULL),
        absolute(tier, _SINGLE_WHEEL, quantity, expected, float(np.mean(found.slip)), "1", _SLIP),
    ]


def _heap(repose: float, slope: float, uphill: float) -> list[Row]:
    angles = {key: math.radians(value) for key, value in (("repose", repose), ("slope", slope), ("uphill", uphill))}
    instance = sand.heap(lambda x, y: np.maximum(0.0, 0.4 - _CONE * np.hypot(x, y)), 0.6, cell=0.005, **angles)
    before = sand.volume_error(instance)
    sand.wait_for_rest(instance, 60.0)
    found = sand.inclinations(instance)
    worst = float(found[np.argmax(np.abs(found - angles["repose"]))])
    lost = (sand.volume_error(instance) - before) * float(instance.p.cell) ** 2
    where = f"slope of {slope:g} deg, {uphill:g} deg from the cells' rows"
    return [
        absolute("SCM", "angle of repose", f"heap of {repose:g} deg, {where}", angles["repose"], worst, "rad", _REPOSE),
        limited("SCM", "conservation", f"volume of that heap, {where}, after less before", lost, "m3", (0.0, 0.0)),
    ]


def _figure(climbs: Mapping[str, Mapping[float, Drive]], crossings: Mapping[str, Drive], curves: Mapping[str, Sequence[float]]) -> Figure:
    figure = Figure(figsize=(9.0, 3.4), dpi=110, layout="constrained")
    axes = figure.subplots(1, 2)
    for colour, tier in zip(colours(), _TIERS):
        axes[0].plot(np.degrees(np.arctan(curves[tier])), _SINGLE, "--", color=colour, lw=1.2)
        axes[0].plot(list(climbs[tier]), [np.mean(found.slip) for found in climbs[tier].values()], "o", color=colour, ms=5)
        axes[1].plot(*(crossings[tier].path * (1.0, 1e3)).T, color=colour, lw=1.2)
    axes[0].set(xlabel="slope, uphill [deg]; dashed: single wheel on level ground", ylabel="slip", xlim=(-2.0, 22.0))
    axes[1].set(xlabel=f"$x$ [m], {_ACROSS:g} deg across, the hill on the left", ylabel="$y$ [mm]")
    for ax in axes:
        frame(ax)
    legend(figure, list(_TIERS))
    return figure
