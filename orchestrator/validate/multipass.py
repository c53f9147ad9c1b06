"""One wheel through one rut again and again, in process: what each pass leaves for the next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from scipy.interpolate import RegularGridInterpolator

from cdl_fmu.scm.density import densification, density_of
from cdl_fmu.scm.tiles import COMPACTED
from cdl_fmu.slave.model import Instance

from ..assemble import assemble
from ..experiment import Experiment, load_experiment
from ..panels import colours, frame, legend
from ..settle import Wires
from . import cmu, sand
from .bench import ROVER_WHEEL_LOAD, Bench, Point
from .rows import Findings, Row, Table, limited

_PASSES = {False: 5, True: 2}  # by whether there is little time
_SLIP, _TRAVEL = 0.2, 0.5  # [m]
#: Travel [m] over which each pass is measured: clear of where the wheel was lowered, and of its contact where it is lifted.
_MEASURED = (0.25, 0.4)
_LIFT_SPEED = 0.05  # [m/s]

_DRIVE = {"slip": _SLIP, "travel": _TRAVEL}
_WHEELS: dict[str, Point] = {
    cmu.NAME: cmu.point("SCM", cmu.level_at(0.0), _DRIVE),
    "wheel of Table 8.2": {"tier": "SCM", "load_N": ROVER_WHEEL_LOAD, "soil.set": "mss_d", **_DRIVE},
}
#: Soils that each wheel is driven through, and what rows add to its name.
_SOILS: dict[str, Point] = {"": {}, ", compressible": {"scm.compressible": "on"}}
_AGAINST = "pass after pass"
_COLUMNS = ("wheel", "pass", "sinkage [mm]", "below the rut's floor [mm]", "rut left [mm]", "drawbar pull [W]", "resistance [W]")


@dataclass(frozen=True)
class Pass:
    """Means over the measured part of a pass.

    Attributes:
        sinkage: Of the rim's lowest point below undisturbed ground [m].
        rut: Depth of the floor that is left, on the rut's middle, below undisturbed ground [m].
        pull: Drawbar pull [N].
        resistance: Thrust that the drive's torque makes at the rim, less drawbar pull [N].
    """

    sinkage: float
    rut: float
    pull: float
    resistance: float


@dataclass(frozen=True)
class Rut:
    """What passes measured, and what is known of the soil after them.

    Attributes:
        passes: Means of each.
        lost: Volume that is unaccounted for [m3].
        stray: Volume compacted by what the cells say, less that in total [m3].
        density: Of the densest column, over that which its grains allow [1].
    """

    passes: Sequence[Pass]
    lost: float
    stray: float
    density: float


def check(bench: Bench) -> Findings:
    """Multipass: a wheel in its own rut"""
    rows, numbers, found = [], [], {}
    for wheel, point in _WHEELS.items():
        load, n = point["load_N"], _PASSES[bench.quick]
        ruts = {suffix: drive({**point, **soil}, n) for suffix, soil in _SOILS.items()}
        for suffix, rut in ruts.items():
            found[wheel + suffix] = [(p.sinkage, p.pull / load) for p in rut.passes]
            rows += _rows(wheel + suffix, rut, load)
            if _SOILS[suffix]:
                rows += _rows_of_density(wheel + suffix, rut, ruts[""], load)
            floor = 0.0
            for k, p in enumerate(rut.passes, 1):
                depths = (1e3 * depth for depth in (p.sinkage, p.sinkage - floor, p.rut))
                numbers.append([wheel + suffix, str(k), *depths, p.pull / load, p.resistance / load])
                floor = p.rut
    note = (
        f"Slip {_SLIP:g}; in each pass the wheel is lowered where it was in the first, driven {_TRAVEL:g} m and lifted straight off. "
        f"Means from {_MEASURED[0]:g} to {_MEASURED[1]:g} m; resistance is torque / r_w less drawbar pull. Nothing was measured here: what "
        "is asked is what wheels on sand have in common. In compressible soil a wheel pulls more in a rut than beside it (Holm 1969)."
    )
    return Findings(rows, _figure(found), [Table("Each pass", _COLUMNS, numbers)], note)


def drive(point: Point, n: int) -> Rut:
    """Drive through the same rut n times."""
    experiment = load_experiment("single_wheel", overrides=point)
    assembly = assemble(experiment)
    soil, z, passes, floor = assembly.instances["scm"], float(assembly.instances["carriage"].p.start.z), [], 0.0
    for _ in range(n):
        carriage = _carriage(experiment, z - floor)
        wires = Wires({"scm": soil, "carriage": carriage}, assembly.connections)
        readings = _pass(soil, carriage, wires, experiment)
        _lift(soil, z, experiment.settings.step)
        floor = _floor(soil, 0.0, 0.0)
        sinkage, pull, torque = readings.mean(axis=0).tolist()
        passes.append(Pass(sinkage, _floor(soil, *_MEASURED), pull, torque / float(soil.p.r_w) - pull))
    p, compacted = soil.p, sand.fields(soil, COMPACTED)
    density = p.rho * densification.py_func(density_of.py_func(p), compacted.max()) * (1.0 + p.e_min) / p.rho_s
    area = float(p.cell) ** 2
    return Rut(passes, sand.volume_error(soil) * area, float(compacted.sum() - soil.x.compacted) * area, float(density))


def _carriage(experiment: Experiment, z: float) -> Instance:
    carriage = experiment.instances()["carriage"]
    carriage.set_starts({"start.z": z})
    carriage.initialise()
    return carriage


def _pass(soil: Instance, carriage: Instance, wires: Wires, experiment: Experiment) -> np.ndarray:
    """Sinkage, drawbar pull and torque [m, N, N.m] in each step of the measured part, [n, 3]."""
    h, readings = experiment.settings.step, []
    for k in range(round(experiment.settings.stop_time / h)):
        wires.feed("scm")
        soil.step(k * h, h)
        wires.feed("carriage")
        carriage.step(k * h, h)
        if _MEASURED[0] <= carriage.y.travel <= _MEASURED[1]:
            diagnostics = soil.y.diagnostics[0]
            readings.append((diagnostics.sinkage, diagnostics.drawbar_pull, diagnostics.drive_torque))
    return np.array(readings)


def _lift(soil: Instance, z: float, h: float) -> None:
    """Lift the wheel off, straight up to where its centre is at z [m], and wait until no soil slides."""
    wheel = soil.u.wheel[0]
    wheel.v_0[:], wheel.w_0[:] = (0.0, 0.0, _LIFT_SPEED), 0.0
    while wheel.r_0[2] < z:
        wheel.r_0[2] += h * _LIFT_SPEED
        soil.step(0.0, h)
    wheel.v_0[:] = 0.0
    sand.wait_for_rest(soil)


def _floor(soil: Instance, start: float, end: float) -> float:
    """Mean depth [m] of the rut's middle from x = start to end [m] below undisturbed ground at 0."""
    surface = sand.surface(soil)
    axes = [o + surface.spacing * np.arange(n) for o, n in zip(surface.origin, surface.z.shape)]
    x = np.arange(start, end + 0.5 * surface.spacing, surface.spacing)
    return -float(RegularGridInterpolator(axes, surface.z)(np.stack([x, np.zeros_like(x)], axis=1)).mean())


def _rows(wheel: str, rut: Rut, load: float) -> list[Row]:
    added, (first, second) = np.diff([0.0, *(p.rut for p in rut.passes)]), rut.passes[:2]
    more, resistance, pull = float(np.diff(added).max()), second.resistance - first.resistance, second.pull - first.pull

    def row(quantity: str, error: float, unit: str, bar: tuple[float | None, float | None] | None, against: str = _AGAINST) -> Row:
        return limited("SCM", against, f"{quantity}, {wheel}", error, unit, bar)

    return [
        row("depth that a pass adds to the rut, least", float(added.min()), "m", (0.0, None)),
        row("depth that a pass adds less what the one before added, largest", more, "m", (None, 0.0)),
        row("resistance, second pass less first", resistance / load, "W", (None, 0.0)),
        row("drawbar pull, second pass less first", pull / load, "W", None),
        row(f"soil moved and compacted in {len(rut.passes)} passes, sum", rut.lost, "m3", (0.0, 0.0), "conservation"),
        row("soil compacted, sum over cells less total", rut.stray, "m3", (0.0, 0.0), "conservation"),
    ]


def _rows_of_density(wheel: str, rut: Rut, off: Rut, load: float) -> list[Row]:
    """Of soil that compaction makes denser, beside the same soil without."""
    first, *later = [p.pull for p in rut.passes]
    deepened, deepened_off = (r.passes[-1].rut - r.passes[0].rut for r in (rut, off))
    last = rut.passes[-1].pull - off.passes[-1].pull

    def row(against: str, quantity: str, error: float, unit: str, bar: tuple[float | None, float | None]) -> Row:
        return limited("SCM", against, f"{quantity}, {wheel}", error, unit, bar)

    return [
        row("Holm 1969", "drawbar pull, least of later passes less first", (min(later) - first) / load, "W", (0.0, None)),
        row("without density", "drawbar pull, last pass", last / load, "W", (0.0, None)),
        row("without density", "depth that later passes add to the rut", deepened - deepened_off, "m", (None, 0.0)),
        row("grains", "density, densest column over the least void ratio's", rut.density, "1", (None, 1.0)),
    ]


def _figure(found: Mapping[str, Sequence[tuple[float, float]]]) -> Figure:
    """Sinkage [m] and drawbar pull over load, pass after pass."""
    figure = Figure(figsize=(9.0, 3.2), dpi=110, layout="constrained")
    axes = figure.subplots(1, 2)
    for colour, each in zip(colours(), found.values()):
        count = range(1, len(each) + 1)
        axes[0].plot(count, [1e3 * sinkage for sinkage, _ in each], "-o", color=colour, lw=1.2, ms=4)
        axes[1].plot(count, [pull for _, pull in each], "-o", color=colour, lw=1.2, ms=4)
    for ax, label in zip(axes, ("sinkage [mm]", "drawbar pull / load")):
        frame(ax)
        ax.set(xlabel="pass", ylabel=label, xticks=count)
    axes[0].set_ylim(bottom=0.0)
    legend(figure, list(found))
    return figure
