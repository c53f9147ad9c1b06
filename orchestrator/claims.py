"""Statements on the drives BxB, SxB and SxS that can be measured, read from a TOML file, and what the drives say of them.

``fmus/two_wheel_claims.toml`` explains the form of a record at its head.
"""

from __future__ import annotations

import ast
import math
import operator
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .courses import SIGNALS, SMOOTHING, Course

#: Name of a run -> tier of its front and of its rear wheel.
RUNS = {"BxB": ("BCM", "BCM"), "SxB": ("SCM", "BCM"), "SxS": ("SCM", "SCM")}

#: The quantity without a window: a run's wall time for the same simulated time, relative to BxB's.
TIME_FACTOR = "time factor"

#: [m] A shorter window has too few values to tell noise from signal.
SHORTEST = 1.5 * SMOOTHING

#: Statistic -> its value from the signal and the smoothed signal in the window, and its noise relative to the noise of the signal;
#: a mean over n independent values is less noisy than one of them, and smoothing makes each ``SMOOTHING`` of travel independent.
STATISTICS: dict[str, tuple[Callable[[np.ndarray, np.ndarray], float], Callable[[float], float]]] = {
    "mean": (lambda raw, smooth: raw.mean(), lambda n: n**-0.5),
    "min": (lambda raw, smooth: smooth.min(), lambda n: 1.0),
    "max": (lambda raw, smooth: smooth.max(), lambda n: 1.0),
    "first": (lambda raw, smooth: smooth[0], lambda n: 1.0),
    "last": (lambda raw, smooth: smooth[-1], lambda n: 1.0),
    "change": (lambda raw, smooth: smooth[-1] - smooth[0], lambda n: 2**0.5),
    "swing": (lambda raw, smooth: np.ptp(smooth), lambda n: 2**0.5),
    "noise": (lambda raw, smooth: _rms(raw - smooth), lambda n: (2 * n) ** -0.5),
}
_RMS = "rms from "

_KEYS = {"id", "place", "text", "effect", "quantity", "compare"}
_QUANTITY = re.compile(
    r"(?P<statistic>.+) of (?P<signal>\S+) over (?P<low>[\d.]+) to (?P<high>[\d.]+) m"
    r"(?:, noise over (?P<noise_low>[\d.]+) to (?P<noise_high>[\d.]+) m)?"
)
_SIGN = re.compile(r"\s*([<>~])\s*")
_OPERATORS = {ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv}


class ClaimError(ValueError):
    """A file of claims is wrong; the message names the file, the record, the value and the remedy."""


@dataclass(frozen=True)
class Quantity:
    """A statistic of a signal over a window of the rear wheel's x [m]; ``signal`` is None for the time factor.

    ``calm`` is the window in which the signal's noise is taken: another one where the statement is about a jerk, which is no noise.
    """

    statistic: str = ""
    signal: str | None = None
    low: float = 0.0
    high: float = 0.0
    calm: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Relation:
    """``left`` compared with ``right`` by ``<``, ``>`` or ``~``; both are expressions of quantities, ``uses`` their runs and names."""

    left: str
    sign: str
    right: str
    uses: frozenset[tuple[str, str]]

    def __str__(self) -> str:
        return f"{self.left} {self.sign} {self.right}"


@dataclass(frozen=True)
class Claim:
    """One statement: it holds if all its relations do. ``effect`` is the smallest effect that counts, in ``unit``."""

    id: str
    place: str
    text: str
    must: bool
    effect: float
    unit: str
    quantities: Mapping[str, Quantity]
    relations: Sequence[Relation]


@dataclass(frozen=True)
class Finding:
    """What a relation came to: both sides, their difference and its noise, and the threshold, all in the claim's unit."""

    relation: Relation
    left: float
    right: float
    noise: float
    threshold: float

    @property
    def measured(self) -> float:
        return self.left - self.right

    @property
    def margin(self) -> float:
        """By how much the relation holds, or, negative, fails, relative to the threshold."""
        signed = {">": self.measured - self.threshold, "<": -self.measured - self.threshold, "~": self.threshold - abs(self.measured)}
        return signed[self.relation.sign] / self.threshold


@dataclass(frozen=True)
class Verdict:
    """A claim and its relation with the least margin, which decides; no finding where a run does not reach all windows."""

    claim: Claim
    finding: Finding | None

    @property
    def holds(self) -> bool | None:
        """None if the windows were not reached."""
        return None if self.finding is None else self.finding.margin >= 0.0


# -- reading


def load_claims(path: Path) -> list[Claim]:
    """Read a file of claims.

    Raises:
        ClaimError: a record lacks something, or refers to what there is not.
    """
    tables = tomllib.loads(path.read_text(encoding="utf-8"))
    claims: dict[str, Claim] = {}
    for record in tables.get("claim", []):
        try:
            claim = _claim(record, tables.get("effect", {}))
            if claim.id in claims:
                raise ClaimError("there is another record with this id: rename one of them")
        except ClaimError as error:
            raise ClaimError(f"{path.name}: claim {record.get('id', '(without id)')!r}: {error}") from None
        claims[claim.id] = claim
    return list(claims.values())


def _claim(record: Mapping, effects: Mapping) -> Claim:
    if missing := sorted(_KEYS - record.keys()):
        raise ClaimError(f"{', '.join(missing)} missing: a record has {', '.join(sorted(_KEYS))}, and must = true where it has to hold")
    if unknown := sorted(record.keys() - _KEYS - {"must"}):
        raise ClaimError(f"unknown key {', '.join(unknown)}: a record has {', '.join(sorted(_KEYS | {'must'}))}")
    effect = effects.get(record["effect"])
    if effect is None:
        raise ClaimError(f"unknown effect {record['effect']!r}: use one of {', '.join(effects)} or add [effect.{record['effect']}]")
    if missing := sorted({"value", "unit", "reason"} - effect.keys()):
        raise ClaimError(f"effect {record['effect']!r} has no {', '.join(missing)}: each has a value > 0, a unit and a reason")
    if not effect["value"] > 0.0:
        raise ClaimError(f"effect {record['effect']!r}: value = {effect['value']:g} {effect['unit']}: it must be positive")
    given = record["quantity"] if isinstance(record["quantity"], dict) else {"": record["quantity"]}
    quantities = {name: _quantity(text) for name, text in given.items()}
    relations = tuple(relation for text in record["compare"] for relation in _relations(text, quantities))
    return Claim(
        record["id"], record["place"], record["text"], record.get("must", False), effect["value"], effect["unit"], quantities, relations
    )


def _quantity(text: str) -> Quantity:
    if text == TIME_FACTOR:
        return Quantity()
    found = _QUANTITY.fullmatch(text)
    if found is None:
        raise ClaimError(f"quantity {text!r}: write 'mean of rear.F_x over 0.1 to 0.35 m' or {TIME_FACTOR!r}")
    statistic, signal, low, high = found["statistic"], found["signal"], float(found["low"]), float(found["high"])
    if signal not in SIGNALS:
        raise ClaimError(f"quantity {text!r}: unknown signal {signal!r}; use one of {', '.join(SIGNALS)}")
    distances = [_RMS + run for run in RUNS]
    if statistic not in [*STATISTICS, *distances]:
        raise ClaimError(f"quantity {text!r}: unknown statistic {statistic!r}; use one of {', '.join([*STATISTICS, *distances])}")
    if SIGNALS[signal].compound and statistic not in distances:
        raise ClaimError(f"quantity {text!r}: {signal} has several parts, so only {' or '.join(distances)} can be taken of it")
    calm = (float(found["noise_low"]), float(found["noise_high"])) if found["noise_low"] else (low, high)
    for start, end in ((low, high), calm):
        if end - start < SHORTEST - 1e-9:
            raise ClaimError(f"quantity {text!r}: the window is {end - start:g} m long; it must be at least {SHORTEST:g} m")
    return Quantity(statistic, signal, low, high, calm)


def _relations(text: str, quantities: Mapping[str, Quantity]) -> Iterator[Relation]:
    """The relations of a line: one for each sign, for each run if the line says ``every``."""
    for run in RUNS if "every" in text else [""]:
        parts = _SIGN.split(text.replace("every", run))
        if len(parts) < 3:
            raise ClaimError(f"compare {text!r}: write two sides with <, > or ~ between them, such as 'SxB > BxB'")
        for left, sign, right in zip(parts[:-2:2], parts[1::2], parts[2::2]):
            uses: set[tuple[str, str]] = set()
            for side in (left, right):
                _evaluate(side, lambda run, name: uses.add((run, name)) or 1.0)  # noqa: B023, called at once
            for run, name in uses:
                _refuse_unknown(text, run, name, quantities)
            yield Relation(left, sign, right, frozenset(uses))


def _refuse_unknown(text: str, run: str, name: str, quantities: Mapping[str, Quantity]) -> None:
    if run not in RUNS:
        raise ClaimError(f"compare {text!r}: unknown run {run!r}; use {', '.join(RUNS)} or every")
    if name not in quantities:
        known = ", ".join(f"{run}.{known}" if known else run for known in quantities)
        raise ClaimError(f"compare {text!r}: there is no quantity for {f'{run}.{name}' if name else run}; this record has {known}")


def _evaluate(text: str, value_of: Callable[[str, str], float]) -> float:
    """Value of an expression of numbers, ``RUN`` and ``RUN.name``, + - * / and brackets."""

    def value(node: ast.expr) -> float:
        match node:
            case ast.Constant(value=float() | int()):
                return float(node.value)
            case ast.UnaryOp(op=ast.USub()):
                return -value(node.operand)
            case ast.BinOp() if type(node.op) in _OPERATORS:
                return _OPERATORS[type(node.op)](value(node.left), value(node.right))
            case ast.Name():
                return value_of(node.id, "")
            case ast.Attribute(value=ast.Name()):
                return value_of(node.value.id, node.attr)
        raise ClaimError(f"{text!r} is no expression of numbers, runs and runs' quantities with + - * / and brackets")

    try:
        return value(ast.parse(text, mode="eval").body)
    except SyntaxError:
        raise ClaimError(f"{text!r} is no expression: write for example 'SxB.late - SxB.early'") from None


# -- judging


def judge(claims: Sequence[Claim], courses: Mapping[str, Course], time_factors: Mapping[str, float]) -> list[Verdict]:
    """What the runs say of each claim.

    Args:
        claims: From :func:`load_claims`.
        courses: Run -> its signals over the rear wheel's x.
        time_factors: Run -> its wall time for the same simulated time, relative to BxB's [1].
    """
    return [_judge(claim, courses, time_factors) for claim in claims]


def _judge(claim: Claim, courses: Mapping[str, Course], time_factors: Mapping[str, float]) -> Verdict:
    findings = []
    for relation in claim.relations:
        measured = {(run, name): _measure(claim.quantities[name], run, courses, time_factors) for run, name in relation.uses}
        if None in measured.values():
            return Verdict(claim, None)
        findings.append(_compare(relation, measured, claim.effect))
    return Verdict(claim, min(findings, key=lambda finding: finding.margin))


def _compare(relation: Relation, measured: Mapping[tuple[str, str], tuple[float, float]], effect: float) -> Finding:
    """Both sides and, by propagation of the independent noises of what they name, the noise of their difference."""

    def sides(noisy: tuple[str, str] | None = None) -> tuple[float, float]:
        values = {key: value + noise * (key == noisy) for key, (value, noise) in measured.items()}
        return tuple(_evaluate(side, lambda run, name: values[run, name]) for side in (relation.left, relation.right))

    left, right = sides()
    noise = math.hypot(*(a - b - (left - right) for a, b in (sides(key) for key in measured)))
    return Finding(relation, left, right, noise, max(effect, 2.0 * noise))


def _measure(quantity: Quantity, run: str, courses: Mapping[str, Course], time_factors: Mapping[str, float]) -> tuple[float, float] | None:
    """Value and noise of a run's quantity; None if its window is not reached."""
    if quantity.signal is None:
        return time_factors[run], 0.0
    involved = [run, quantity.statistic.removeprefix(_RMS)] if quantity.statistic.startswith(_RMS) else [run]
    raws, smooths, noises = [], [], []
    for name in involved:
        window, calm = courses[name].window(quantity.low, quantity.high), courses[name].window(*quantity.calm)
        if window is None or calm is None:
            return None
        raw, smooth = courses[name].signal(quantity.signal), courses[name].smooth(quantity.signal)
        raws.append(raw[..., window])
        smooths.append(smooth[..., window])
        noises.append(_rms((raw - smooth)[..., calm]))
    noise = math.hypot(*noises)
    n_independent = (quantity.high - quantity.low) / SMOOTHING
    if len(involved) == 2:
        return _rms(raws[0] - raws[1]), noise * n_independent**-0.5
    value, factor = STATISTICS[quantity.statistic]
    return float(value(raws[0], smooths[0])), noise * factor(n_independent)


def _rms(values: np.ndarray) -> float:
    return math.sqrt(np.mean(values**2))
