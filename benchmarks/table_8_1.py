"""Table 8.1 of the chapter, measured: what each contact tier costs and considers, side by side, and the marks that follow.

    python benchmarks/table_8_1.py [--tiers DEM ...]

Costs are best / median over steps of 1 ms of the tier alone, called from Python on one core, of a rigid chassis that drives on the wheels
of Table 8.2 (``vehicle.py``), to be read beside the calibration loop of ``speed.py``. Effects are of one smooth wheel (``effects.py``).

DEM takes most of an hour, the other tiers minutes together. BCM's cost is measured with any of them, as efficiency is told over it.
"""

from __future__ import annotations

import argparse
import math
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import trimesh
from dem_tier import CLEARANCE, GROUSERS, SOIL, D
from effects import BALL, Tier, export, measured, tiers, with_bodies
from marks import CHAPTER, EFFECTS, RULES, below, of_deformation, of_effects, reading, shows
from speed import calibration
from vehicle import RADIUS, TIP, Vehicle, freedom

from cdl_fmu.bcm import BCM
from cdl_fmu.dem.model import DEM
from cdl_fmu.frames import axis_rotation
from cdl_fmu.rbc import RBC
from cdl_fmu.scm import SCM
from cdl_fmu.slave.model import Instance
from cdl_fmu.vem import VEM
from cdl_fmu.wheel import WHEEL

H, TIMED = 1e-3, 1500
WHEELS = (1, 2, 4, 6, 8)
NAMES = ("RBC", "VEM", "BCM", "SCM", "DEM")
#: Of DEM, whose steps take far longer: how many are timed, after how many seconds of rolling, and numbers of wheels and of balls.
FEW, SHORT, NUMBERS = 60, 0.1, (1, 2)
#: Diameters of its grains over those of the other measurements.
SHARES = (1.4, 1.0, 0.7)


def times(vehicle: Vehicle, rate: float = 1.0, settle: float = 0.5, timed: int = TIMED) -> tuple[tuple[float, float], float]:
    """Best and median cost of a step [us], and mean number of contacts, after the wheels have rolled some way."""
    vehicle.put_down(0.5)
    vehicle.rate = rate
    vehicle.run(settle + timed * H, H)
    return summary(vehicle.times[-timed:]), float(np.mean(vehicle.contacts[-timed:]))


def summary(seconds: list[float]) -> tuple[float, float]:
    """Best and median [us] of steps; the best is the fiftieth part's, as single steps are noise."""
    late = np.sort(seconds) * 1e6
    return float(late[len(late) // 50]), float(np.median(late))


def exponent(sizes, costs) -> float:
    """b of cost ~ size^b, by least squares of logarithms, to 0.01: marks follow from what is printed."""
    return round(float(np.polyfit(np.log(sizes), np.log(costs), 1)[0]), 2)


def both(cost: tuple[float, float]) -> str:
    return f"{cost[0]:.1f} / {cost[1]:.1f}"


def table(head: list[str], rows: list[list[str]]) -> None:
    """Print a table in Markdown."""
    print("\n| " + " | ".join(head) + " |\n" + "|---" * len(head) + "|")
    for row in rows:
        print("| " + " | ".join(row) + " |")


def by_wheels(folder: Path, names: list[str]) -> tuple[dict[str, float], dict[str, float]]:
    """Print costs by number of wheels; median [us] of two wheels, and exponent from two wheels on, of these tiers and of BCM."""
    floor = [(export(folder, "floor", trimesh.creation.box((8.0, 4.0, 0.2))), (0.0, 0.0, -0.1))]
    columns: dict[str, Callable[[int], Instance]] = {
        "RBC, bodies": lambda n: with_bodies(RBC(n, 1), floor),
        "VEM, bodies": lambda n: with_bodies(VEM(n, 0, 1), floor),
        "VEM, plane": lambda n: Instance(VEM(n)),
        "BCM": lambda n: Instance(BCM(n)),
        "BCM, critical_state": lambda n: Instance(BCM(n), strength="critical_state"),
        "SCM": lambda n: Instance(SCM(n)),
        "DEM": lambda n: Instance(DEM(n), **(SOIL | GROUSERS)),
    }
    rows, two, growth = [], {}, {}
    for name, make in columns.items():
        if name.split(",")[0] not in (*names, "BCM"):
            continue
        numbers, clearance, options = WHEELS, 0.0, {}
        if name == "DEM":
            numbers, clearance, options = NUMBERS, CLEARANCE, dict(settle=SHORT, timed=FEW)
        results = [times(Vehicle(make(n), freedom(n), clearance=clearance), **options) for n in numbers]
        costs = [median for (_, median), _ in results]
        rest = max(len(numbers) - 1, 2)  # from two wheels on where there are enough
        two[name], growth[name] = costs[1], exponent(numbers[-rest:], costs[-rest:])
        texts = [both(cost) for cost, _ in results] + ["none"] * (len(WHEELS) - len(numbers))
        rows.append([name, *texts, f"{growth[name]:.2f}", "", " / ".join(f"{n:.0f}" for _, n in results)])
    for row in rows:
        row[-2] = f"{two[row[0]] / two['BCM']:.2g}"
    table(["us a step, best / median", *(f"{n} wheels" if n > 1 else "1 wheel" for n in WHEELS), "exponent", "over BCM", "contacts"], rows)
    return two, growth


def by_domain(folder: Path, names: list[str]) -> dict[str, float]:
    """Print costs of two wheels by size and resolution of the ground; the larger exponent of each of these tiers."""
    rows: list[list[str]] = []
    worst = dict.fromkeys(names, -math.inf)

    def series(tier: str, of: str, unit: str, sizes, results, note=""):
        power = exponent(sizes, [median for _, median in results])
        worst[tier] = max(worst[tier], power)
        texts = [f"{size:g}: {both(cost)}" for size, cost in zip(sizes, results)]
        rows.append([tier, of, unit, "; ".join(texts), f"{power:.2f}", note])

    mesh, finer, faces = trimesh.creation.box((8.0, 4.0, 0.2)), [], []
    mesh.apply_translation((0.0, 0.0, -0.1))
    for splits in range(7):
        if splits % 2 == 0:
            finer.append(export(folder, f"floor{splits}", mesh))
            faces.append(len(mesh.faces))
        mesh = mesh.subdivide()
    on_mesh = {
        ("RBC", "a body, finer"): lambda path: with_bodies(RBC(2, 1), [(path, (0.0, 0.0, 0.0))]),
        ("VEM", "a body, finer"): lambda path: with_bodies(VEM(2, 0, 1), [(path, (0.0, 0.0, 0.0))]),
        ("VEM", "a plane in the ground's mesh, finer"): lambda path: Instance(VEM(2, n_grounds=1), ground=path),
        ("BCM", "a plane in the ground's mesh, finer"): lambda path: Instance(BCM(2, n_grounds=1), ground=path),
    }
    for (name, of), make in on_mesh.items():
        if name in names:
            series(name, of, "faces", faces, [times(Vehicle(make(path), freedom(2)))[0] for path in finer])
    stone = export(folder, "ball", trimesh.creation.icosphere(3, BALL))
    for name, model in chosen(names, RBC=lambda n: RBC(2, n), VEM=lambda n: VEM(2, 0, n)):
        farther = []
        for n in (1, 4, 16):
            bodies = [(finer[0], (0.0, 0.0, 0.0))] + [(stone, (1.0 + 0.2 * k, 1.5, 0.1)) for k in range(n - 1)]
            farther.append(times(Vehicle(with_bodies(model(n), bodies), freedom(2)))[0])
        series(name, "stones that nothing touches", "bodies", (1, 4, 16), farther)
    for name, model in chosen(names, VEM=VEM(2), BCM=BCM(2), SCM=SCM(2)):
        vehicle, distances, results, tiles = Vehicle(Instance(model), ("z", "pitch")), (1, 4, 16), [], []
        vehicle.put_down(0.5)
        vehicle.q[0], vehicle.rate = 1.0, 1.0 / TIP
        for start, end in zip((0, *distances), distances):
            vehicle.run((end - start) / vehicle.q[0], H)
            results.append(summary(vehicle.times[-1000:]))
            tiles.append(f"{int(vehicle.instance.pool.head[0])}" if vehicle.instance.pool else "none")
        series(name, "longer drive", "m", distances, results, f"tiles of soil: {', '.join(tiles)}" if name == "SCM" else "")
    if "SCM" in names:
        cells = (0.02, 0.01, 0.005)
        results = [times(Vehicle(Instance(SCM(2), cell=cell), freedom(2)))[0] for cell in cells]
        series("SCM", "finer cells, of 20, 10, 5 mm", "cells / m2", [1.0 / cell**2 for cell in cells], results)
    if "DEM" in names:
        series("DEM", f"finer grains, of {', '.join(f'{1e3 * share * D:.3g}' for share in SHARES)} mm", "live particles", *by_grains())
        distances, results, live = (0.5, 1.0, 2.0), [], []
        vehicle = smooth_on_particles()
        vehicle.free = [2, 4]
        vehicle.q[0], vehicle.rate = 1.0, 1.0 / RADIUS
        for start, end in zip((0.0, *distances), distances):
            vehicle.run(end - start, H)
            results.append(summary(vehicle.times[-FEW:]))
            live.append(len(vehicle.instance.pool.live))
        series("DEM", "longer drive", "m", distances, results, f"live particles: {', '.join(map(str, live))}")
    table(["tier", "ground", "size", "size: us a step, best / median", "exponent", ""], rows)
    for name, model in chosen(names, VEM=VEM(2, 2), BCM=BCM(2, 2)):
        cost = times(Vehicle(Instance(model), freedom(2), ground=lambda x, y: 0.0 * x))[0]
        print(f"\n{name}, two wheels on patches of 13 x 9 nodes: {both(cost)} us a step", end="")
    print()
    return worst


def chosen(names: list[str], **of_tiers):
    """What belongs to these tiers, with their names."""
    return [(name, one) for name, one in of_tiers.items() if name in names]


def smooth_on_particles(d: float = D) -> Vehicle:
    """Two smooth wheels that were put down on DEM's particles of this mean diameter [m]."""
    vehicle = Vehicle(Instance(DEM(2), **(SOIL | {"n_g": 0, "d": d})), freedom(2), clearance=d, radius=RADIUS)
    vehicle.put_down(0.5)
    return vehicle


def by_grains() -> tuple[list[int], list[tuple[float, float]]]:
    """Live particles of two wheels, and cost of a step, with finer grains."""
    live, results = [], []
    for share in SHARES:
        vehicle = smooth_on_particles(share * D)
        vehicle.rate = 1.0
        vehicle.run(SHORT + FEW * H, H)
        live.append(len(vehicle.instance.pool.live))
        results.append(summary(vehicle.times[-FEW:]))
    return live, results


def by_contacts(folder: Path, names: list[str]) -> dict[str, float]:
    """Print costs by number of contacts with bodies; exponent of each of these tiers."""
    ball = export(folder, "ball", trimesh.creation.icosphere(3, BALL))
    rows, growth = [], {}
    for name, model in chosen(names, RBC=RBC, VEM=lambda w, n: VEM(w, 0, n)):
        results = []
        for n in WHEELS:
            at = Vehicle(Instance(SCM(n)), ()).offsets[:, :2]
            bodies = [(ball, (x + dx, y, 0.0)) for x, y in at for dx in (-0.08, 0.08)]
            slippery = {f"body[{j}].mu": 0.2 for j in range(1, len(bodies) + 1)}
            instance = with_bodies(model(n, len(bodies)), bodies, n_g=0, **slippery)
            results.append(times(Vehicle(instance, freedom(n), clearance=BALL + 0.001, radius=0.125)))
        growth[name] = exponent([k for _, k in results[1:]], [cost[1] for cost, _ in results[1:]])
        text = "; ".join(f"{k:.0f}: {both(cost)}" for cost, k in results)
        rows.append([f"{name}, 1 to 8 wheels that spin between two stones each", text, f"{growth[name]:.2f}"])
    on_soil = {"SCM": (SCM, (1, 2, 4, 8), {}), "DEM": (DEM, NUMBERS, dict(apart=0.6, lead=0.05, timed=FEW, n_g=0, **SOIL))}
    for name, (model, numbers, options) in chosen(names, **on_soil):
        results = [dragged(model(1, 0, n), ball, **options) for n in numbers]
        growth[name] = exponent(numbers, [cost[1] for cost in results])
        text = "; ".join(f"{n}: {both(cost)}" for n, cost in zip(numbers, results))
        rows.append([f"{name}, balls of 0.1 m that are drawn through sand, 20 mm deep", text, f"{growth[name]:.2f}"])
    if rows:
        table(["contacts", "contacts: us a step, best / median", "exponent"], rows)
    return growth


def dragged(model, ball: Path, apart: float = 0.3, lead: float = 0.2, timed: int = TIMED, **parameters) -> tuple[float, float]:
    """Cost of a step of soil through which bodies are drawn.

    Args:
        model: Of the soil and the bodies.
        ball: Mesh of each.
        apart: Distance from one to the next [m]; on DEM so large that no two share the soil that moves.
        lead: Time [s] for which they are drawn at their depth before steps are timed.
        timed: Number of steps that are.
        **parameters: Of the soil.
    """
    soil = with_bodies(model, [(ball, (0.0, apart * k, BALL + 0.01)) for k in range(model.sizes["n_bodies"])], **parameters)
    soil.u.wheel["active"] = 0.0
    soil.initialise()
    seconds = []
    for k in range(300 + round(lead / H) + timed):
        for body in soil.u.body:
            body.v_0[:] = 0.1, 0.0, -0.1 if k < 300 else 0.0
            body.r_0 += H * body.v_0
        start = time.perf_counter()
        soil.step(k * H, H)
        seconds.append(time.perf_counter() - start)
    return summary(seconds[-timed:])


def effects(all_tiers: list[Tier], folder: Path) -> dict[str, dict]:
    """Print what was measured of each effect, in bold where the tier shows it."""
    answers = {tier.name: measured(tier, folder) for tier in all_tiers}

    def text(effect, name):
        bold = "**" if shows(effect, answers[name]) else ""
        return f"{bold}{reading(effect, answers[name])}{bold}"

    table(["effect", *answers], [[effect.text, *(text(effect, name) for name in answers)] for effect in EFFECTS])
    return answers


def descriptions(folder: Path, names: list[str]) -> None:
    """Print what describes the wheel and what it meets: numbers to which the force answers, and files and inputs that models declare."""
    slab = trimesh.creation.box((8.0, 4.0, 0.2))
    floor = [(export(folder, "floor", slab), (0.0, 0.0, -0.1))]
    slab.apply_translation((0.0, 0.0, -0.1))
    ground = export(folder, "ground", slab)
    variants = {
        "RBC": [lambda **p: with_bodies(RBC(1, 1), floor, **p)],
        "VEM": [
            lambda **p: with_bodies(VEM(1, 0, 1), floor, **p),
            lambda **p: Instance(VEM(1, 1), normal_model="bekker", **p),
            lambda **p: Instance(VEM(1, n_grounds=1), normal_model="bekker", ground=ground, **p),
        ],
        "BCM": [lambda **p: Instance(BCM(1, 1), **p), lambda **p: Instance(BCM(1, n_grounds=1), ground=ground, **p)],
        "SCM": [lambda **p: Instance(SCM(1), **p)],
        "DEM": [lambda **p: Instance(DEM(1), box_width=0.3, **(SOIL | GROUSERS | p))],
    }
    wheels, seconds = ["wheel"], ["2nd body"]
    for _, makers in chosen(names, **variants):
        models = [make().model for make in makers]
        numbers = [name for name in WHEEL.fields if any(answers_to(make, name) for make in makers)]
        mesh = ["surface mesh"] if any("wheel_mesh" in model.files for model in models) else []
        wheels.append(", ".join(numbers + mesh))
        found = {
            "surface mesh": any({"body[1].mesh", "ground"} & model.files.keys() for model in models),
            "elevation map": any("base" in model.files for model in models),
            "particle filled volume": any("bed" in model.files for model in models),
            "patch of heights": any(model.sizes.get("n_patches", 0) > 0 and "patch" in model.inputs.fields for model in models),
        }
        seconds.append(", ".join(text for text, there in found.items() if there))
    table(["description", *names], [wheels, seconds])


def answers_to(make: Callable[..., Instance], name: str) -> bool:
    """Whether the force on a wheel that leans, slips and is pressed in changes with a number that describes it."""
    forces = []
    for more in (0.0, 1.0):
        instance = make()
        instance.p[name] += more if name == "n_g" else 0.01 * more * instance.p[name]
        wheel = instance.u.wheel[0]
        wheel["T"][:] = axis_rotation(2, 0.3) @ axis_rotation(1, 0.1)
        depth = 0.005 if "reach" in instance.model.parameters.fields else 0.025  # of grousers in rock, of the rim in sand
        fall = 0.0
        if isinstance(instance.model, DEM):  # particles have to make way
            depth, fall = 0.005, CLEARANCE + 0.005
        wheel.r_0[2] = TIP * math.cos(0.1) + 0.0625 * math.sin(0.1) - depth + fall
        wheel.v_0[0], wheel.w_0[1] = 0.1, 1.0
        instance.initialise()
        for k in range(1 + round(fall / 5e-4)):  # at 0.5 m/s
            wheel.r_0[2] -= 5e-4 * bool(k)
            instance.step(k * H, H)
        forces.append(np.concatenate([instance.y.wheel[0].f_0, instance.y.wheel[0].t_0]))
    return not np.allclose(forces[0], forces[1], rtol=1e-9, atol=1e-9)


def marks(two: dict, growth: dict, domain: dict, contacts: dict, answers: dict) -> None:
    """Print the chapter's marks beside those that follow, for the tiers that were measured."""
    names = list(answers)

    def largest(of: dict, tier: str) -> float:
        return max(value for column, value in of.items() if column in (tier, f"{tier}, bodies", f"{tier}, plane"))

    found = {
        "Wheel stone contact": [of_effects(answers[name], "stone") for name in names],
        "Wheel soft soil contact": [of_effects(answers[name], "soil") for name in names],
        "Computational efficiency": [below(largest(two, name) / two["BCM"], (0.5, 2.0, 10.0)) for name in names],
        "Considered effects": [of_effects(answers[name]) for name in names],
        "Soil scalability": [below(domain[name], (0.1, 0.5, 1.0)) for name in names],
        "Multiple contacts": [below(max(largest(growth, name), contacts.get(name, 0.0)), (1.1, 1.5, 2.0)) for name in names],
        "Soil deformation": [of_deformation(answers[name]) for name in names],
    }
    rows = [[row, *(f"{one} ({its[name]})" for one, name in zip(found[row], names))] for row, its in CHAPTER.items()]
    table(["measured (chapter)", *names], rows)
    print(RULES)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--tiers", nargs="+", choices=NAMES, default=NAMES, help="Columns of the table")
    names = [name for name in NAMES if name in parser.parse_args().tiers]
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    print(f"calibration loop {calibration():.3f} s")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        two, growth = by_wheels(folder, names)
        domain = by_domain(folder, names)
        contacts = by_contacts(folder, names)
        answers = effects([tier for tier in tiers(folder) if tier.name in names], folder)
        descriptions(folder, names)
        marks(two, growth, domain, contacts, answers)
    print(f"calibration loop {calibration():.3f} s")


if __name__ == "__main__":
    main()
