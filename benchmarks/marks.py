"""The chapter's Table 8.1, and marks like its own that follow from measured figures by stated rules."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

#: Rows of the chapter's table that carry marks, of each tier.
CHAPTER = {
    "Wheel stone contact": {"RBC": "++", "VEM": "+", "BCM": "n/a", "SCM": "n/a", "DEM": "--"},
    "Wheel soft soil contact": {"RBC": "n/a", "VEM": "--", "BCM": "--", "SCM": "+", "DEM": "++"},
    "Computational efficiency": {"RBC": "++", "VEM": "++", "BCM": "+", "SCM": "--", "DEM": "--"},
    "Considered effects": {"RBC": "--", "VEM": "--", "BCM": "+", "SCM": "+", "DEM": "++"},
    "Soil scalability": {"RBC": "n/a", "VEM": "++", "BCM": "++", "SCM": "--", "DEM": "--"},
    "Multiple contacts": {"RBC": "++", "VEM": "++", "BCM": "++", "SCM": "++", "DEM": "+"},
    "Soil deformation": {"RBC": "n/a", "VEM": "n/a", "BCM": "n/a", "SCM": "+", "DEM": "++"},
}

#: Own choice of all bounds: the chapter gives none.
RULES = """
Wheel stone and soft soil contact, considered effects: share of the effects on stone, on soil, and of all that the tier shows: up to a
third --, up to two thirds -, below 0.9 +, else ++; n/a where a wheel rests on no stone, or does not sink.
Computational efficiency: median cost of a step of two wheels over BCM's: up to 0.5 ++, up to 2 +, up to 10 -, else --.
Soil scalability: largest exponent of that cost with size or resolution of the ground: up to 0.1 ++, up to 0.5 +, up to 1 -, else --.
Multiple contacts: largest exponent of that cost with wheels or contacts: up to 1.1 ++, up to 1.5 +, up to 2 -, else --.
Soil deformation: neither rut nor berm n/a, one of them -, both +, and soil that moves by a millimetre below the rut, too, ++.
"""


@dataclass(frozen=True)
class Effect:
    """An effect, how its measurement reads, and whether a tier shows it."""

    text: str
    of: str  # "soil", "stone", or "all" where it counts for neither
    reading: Callable[[dict], str]
    shown: Callable[[dict], bool]


def _number(value: float, digits: int) -> str:
    return f"{round(value, digits) + 0.0:.{digits}f}"  # no -0.0


def _of_load(*keys: str) -> Callable[[dict], str]:
    return lambda a: ", ".join(_number(a[key], 3 if len(keys) == 1 else 2) for key in keys)


def _mm(key: str) -> Callable[[dict], str]:
    return lambda a: f"{_number(1e3 * a[key], 1)} mm"


EFFECTS = (
    Effect("sinkage under 265 N", "soil", _mm("sinkage"), lambda a: a["sinkage"] > 1e-3),
    Effect("sinkage under 530 N", "soil", _mm("sinkage_of_twice_the_load"), lambda a: a["sinkage_of_twice_the_load"] > a["sinkage"] + 1e-3),
    Effect("sinkage added by slip 0.6", "soil", _mm("slip_sinkage"), lambda a: a["slip_sinkage"] > 1e-3),
    Effect("energy lost a metre at slip 0, over the load", "soil", _of_load("loss"), lambda a: a["loss"] > 0.01),
    Effect(
        "pull over load at slip 0, 0.1, 0.3, 0.6",
        "soil",
        _of_load("pull_00", "pull_01", "pull_03", "pull_06"),
        lambda a: a["pull_03"] - a["pull_01"] > 0.05,
    ),
    Effect("pull added by grousers at slip 0.3, over the load", "soil", _of_load("grousers"), lambda a: a["grousers"] > 0.005),
    Effect("lateral force over load, slip angle 15 deg", "soil", _of_load("lateral"), lambda a: a["lateral"] > 0.05),
    Effect("depth of the rut", "soil", _mm("rut"), lambda a: a["rut"] > 1e-3),
    Effect("height of the berm", "soil", _mm("berm"), lambda a: a["berm"] > 1e-3),
    Effect("pull that a second pass adds, over the load", "soil", _of_load("second_pull"), lambda a: abs(a["second_pull"]) > 0.01),
    Effect("rest on a ball: height over its diameter", "stone", _of_load("on_a_stone"), lambda a: a["on_a_stone"] > 0.9),
    Effect(
        "between two balls: share of the load on the one that bears less",
        "stone",
        _of_load("least_of_two"),
        lambda a: a["least_of_two"] > 0.3,
    ),
    Effect(
        "rebound over impact speed at 1 m/s, by setting",
        "stone",
        lambda a: ", ".join(f"{name}: {e:.2f}" for name, e in a["rebounds"]),
        lambda a: a["rebounds"][-1][1] - a["rebounds"][0][1] > 0.5,
    ),
    Effect("creep of a locked wheel on 10 deg", "stone", lambda a: f"{_number(1e6 * a['creep'], 1)} um/s", lambda a: a["creep"] < 1e-6),
    Effect("height reached on a step of 40 mm, over that", "stone", _of_load("climbed"), lambda a: a["climbed"] > 0.95),
    Effect("stiffness under 265 N", "all", lambda a: f"{a['stiffness']:.2g} N/m", lambda a: a["stiffness"] < math.inf),
)


def below(value: float, bounds: tuple[float, float, float]) -> str:
    """Mark by three upper bounds."""
    return next((mark for mark, bound in zip(("++", "+", "-"), bounds) if value <= bound), "--")


def of_effects(answers: dict, of: str = "all") -> str:
    """Mark by how many of the effects on ``of`` a tier shows."""
    counted = [shows(effect, answers) for effect in EFFECTS if of in ("all", effect.of)]
    if of != "all" and not next(shows(effect, answers) for effect in EFFECTS if effect.of == of):  # the first one is that there is contact
        return "n/a"
    share = sum(counted) / len(counted)
    return "--" if share <= 1 / 3 else "-" if share <= 2 / 3 else "+" if share < 0.9 else "++"


def shows(effect: Effect, answers: dict) -> bool:
    """Whether a tier shows an effect; what was not measured it does not."""
    try:
        return effect.shown(answers)
    except KeyError:
        return False


def reading(effect: Effect, answers: dict) -> str:
    """What was measured, as text; ``none`` where there is nothing to be measured."""
    try:
        return effect.reading(answers)
    except KeyError:
        return "none"


def of_deformation(answers: dict) -> str:
    """Mark of what a wheel leaves behind."""
    rut_and_berm = sum(answers[key] > 1e-3 for key in ("rut", "berm"))
    return "++" if rut_and_berm == 2 and answers.get("below", 0.0) > 1e-3 else ("n/a", "-", "+")[rut_and_berm]
