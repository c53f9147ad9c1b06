"""Strength and its mobilisation from shear tests: tau = (c + p tan(phi)) (1 - exp(-j/K)), Mohr and Coulomb, Janosi and Hanamoto."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .measurements import IdentifyError, ShearTest

_PLATEAU = 0.05  # own choice: share of a test's rows whose mean is its largest stress; the largest reading alone would be its noise's peak
_MOBILISED = 0.95  # own choice: share of the strength up to which rows tell of K; beyond, the logarithm is of noise, or of a hump
_LONG_ENOUGH = 3.0  # own choice, in K: a test that ends before has mobilised less than 95 % of its strength
_SAME_PRESSURE = 1.1  # own choice: ratio of normal pressures up to which they do not tell c from phi


@dataclass(frozen=True, eq=False)
class FittedShear:
    """A shear test, its strength tau_max [Pa], and its own K [m] with the standard error by its rows."""

    test: ShearTest
    tau_max: float
    K: float
    K_error: float


@dataclass(frozen=True, eq=False)
class Shear:
    """What the shear tests give together.

    Attributes:
        c, phi, K: [Pa, rad, m].
        c_error, phi_error: Standard errors by the scatter of the tests; None where nothing is left to scatter, or where it was given.
        K_error: Standard error of the tests' K over their mean; None with a single test.
        tests: Each test.
    """

    c: float
    phi: float
    K: float
    c_error: float | None
    phi_error: float | None
    K_error: float | None
    tests: list[FittedShear]


def fit_shear(tests: Sequence[ShearTest], c: float | None = None, phi: float | None = None) -> tuple[Shear, list[str]]:
    """Fit strength and K to shear tests; returns them and what the user should know of them.

    The strength of a test is its largest stress, as a mean over a twentieth of its rows. The line tau_max = c + p tan(phi) goes through
    them with weights 1/tau_max^2 (own choice: soil scatters in proportion to its strength), and where it would have c < 0, through the
    origin. K is Wong's, over the rows before 95 % of the strength: -sum w j^2 / sum w j ln(1 - tau/tau_max), w = (1 - tau/tau_max)^2
    (Wong 1980).

    Args:
        tests: Each with at least 3 rows.
        c, phi: Values that are given [Pa, rad]; the other one is then fitted with it.

    Raises:
        IdentifyError: c and phi cannot be told apart, or no K from a test.
    """
    curves = [_Curve(test) for test in tests]
    fitted = [FittedShear(curve.test, curve.tau_max, *curve.K()) for curve in curves]
    notes = [
        f"shear test {one.test.name} ends at {one.test.j[-1] / one.K:.2g} K: its strength may not have been reached; shear to 3 K at least"
        for one in fitted
        if one.test.j[-1] < _LONG_ENOUGH * one.K
    ]
    p, tau = (np.array(column) for column in zip(*((one.test.p, one.tau_max) for one in fitted)))
    c, phi, c_error, phi_error = _strength(p, tau, c, phi, notes)
    K = -sum(curve.sums[0] for curve in curves) / sum(curve.sums[1] for curve in curves)
    spread = [one.K for one in fitted]
    K_error = float(np.std(spread, ddof=1) / math.sqrt(len(spread))) if len(spread) > 1 else None
    return Shear(c, phi, float(K), c_error, phi_error, K_error, fitted), notes


class _Curve:
    """A test's strength and the rows that tell of K."""

    def __init__(self, test: ShearTest):
        self.test = test
        width = max(1, round(_PLATEAU * test.tau.size))
        self.tau_max = float(np.convolve(test.tau, np.full(width, 1.0 / width), "valid").max())
        if self.tau_max <= 0.0:
            raise IdentifyError(f"shear test {test.name} has no stress, tau is at most {self.tau_max:g} Pa: correct it, or remove the test")
        reached = test.tau >= _MOBILISED * self.tau_max
        before = slice(0, int(np.argmax(reached)) if reached.any() else test.tau.size)
        self._j = test.j[before]
        self._rest = 1.0 - test.tau[before] / self.tau_max
        self._w = self._rest**2
        self.sums = float(np.sum(self._w * self._j**2)), float(np.sum(self._w * self._j * np.log(self._rest)))
        if not self.sums[1] < 0.0:
            raise IdentifyError(
                f"shear test {test.name} has no rise of tau from 0 to {self.tau_max:.4g} Pa that tells K: give the rows from j = 0 on, "
                "or remove the test"
            )

    def K(self) -> tuple[float, float]:
        """K of the rows, and its standard error."""
        slope = self.sums[1] / self.sums[0]  # of ln(1 - tau/tau_max) over j: -1/K
        off = np.log(self._rest) - slope * self._j
        variance = np.sum(self._w * off**2) / max(self._j.size - 1, 1) / self.sums[0]
        return -1.0 / slope, math.sqrt(variance) / slope**2


def _strength(
    p: np.ndarray, tau: np.ndarray, c: float | None, phi: float | None, notes: list[str]
) -> tuple[float, float, float | None, float | None]:
    """c, phi and their standard errors; adds to the notes."""
    w = 1.0 / tau
    if c is None and phi is None:
        if p.max() <= _SAME_PRESSURE * p.min():
            raise IdentifyError(
                f"all shear tests have one normal pressure, {p.mean():.4g} Pa: c and phi cannot be told apart; test at another one, "
                "or give --c (dry sand: 0) or --phi"
            )
        (c_found, tangent), errors = _line(np.stack([np.ones_like(p), p], axis=1), tau, w)
        if c_found >= 0.0:
            return c_found, math.atan(tangent), *_as_errors(errors, tangent)
        notes.append(f"the shear tests have c = {c_found:.4g} Pa: set to 0, and phi fitted again through the origin")
        c = 0.0
    if phi is None:
        (tangent,), (error,) = _line(p[:, None], tau - c, w)
        if tangent <= 0.0:
            raise IdentifyError(f"c = {c:g} Pa is more than the shear tests' strength, {tau.min():.4g} Pa and more: give a smaller one")
        return c, math.atan(tangent), *_as_errors((None, error), tangent)
    if c is None:
        (c,), (error,) = _line(np.ones((p.size, 1)), tau - p * math.tan(phi), w)
        if c < 0.0:
            notes.append(f"with phi = {phi:g} rad the shear tests have c = {c:.4g} Pa: set to 0")
            return 0.0, phi, None, None
        return c, phi, error, None
    return c, phi, None, None


def _line(columns: np.ndarray, y: np.ndarray, w: np.ndarray) -> tuple[list[float], list[float | None]]:
    """Weighted least squares, weights w^2: coefficients of the columns, and their standard errors."""
    found, *_ = np.linalg.lstsq(columns * w[:, None], y * w)
    spare = y.size - found.size
    if spare == 0:
        return found.tolist(), [None] * found.size
    variance = np.sum((w * (y - columns @ found)) ** 2) / spare
    weighted = columns * w[:, None]
    return found.tolist(), np.sqrt(variance * np.diag(np.linalg.inv(weighted.T @ weighted))).tolist()


def _as_errors(errors: Sequence[float | None], tangent: float) -> tuple[float | None, float | None]:
    """Standard errors of c, and of phi from that of its tangent."""
    return errors[0], None if errors[1] is None else errors[1] / (1.0 + tangent**2)
