"""Bekker's law of sinkage, p = (k_c/b + k_phi) z^n, from plate tests: Wong's weighted fit, of all plates at once.

Minimised is the sum over tests of [sum p^2 (ln p - ln(k_c/b + k_phi) - n ln z)^2] / [sum p^2], b the radius of the plate (Wong 1980): the
weights p^2 undo what the logarithm does to errors of p, and each test counts the same, however many rows it has.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import least_squares

from .measurements import LEAST_ROWS, IdentifyError, PlateTest

#: Names of what is fitted, in the order of ``covariance``.
PARAMETERS = ("k_c", "k_phi", "n", "offset")

_BEARS = (
    0.01  # own choice: share of a test's largest pressure below which a row tells nothing of where the plate touched; its weight is 1e-4
)
_NEAREST = 1e-4  # own choice: share of the largest sinkage by which the first row is below where the plate touched, at least
_FAR = 3.0  # robust standard deviations from which a row is an outlier
_EXTRAPOLATED = 2.0  # own choice, see Sinkage.widths
_ASSUMED = 1.25  # own choice, see Sinkage.widths
_SAME_SIZE = 1.05  # own choice: ratio of radii up to which plates have one size, and tell nothing of k_c


@dataclass(frozen=True, eq=False)
class FittedPlate:
    """A plate test beside the fits.

    Attributes:
        test: The rows that were fitted.
        n, k: Its own law p = k z^n [1, N/m^(n+2)].
        goodness_own, goodness: 1 - sqrt(sum (p - p_hat)^2 / (N - 2)) / mean(p) of its own law and of all tests' common law.
        outliers: Lines of the file that are further than three robust standard deviations off its own law.
    """

    test: PlateTest
    n: float
    k: float
    goodness_own: float
    goodness: float
    outliers: np.ndarray


@dataclass(frozen=True, eq=False)
class Sinkage:
    """Bekker's law as all plates have it together.

    Attributes:
        k_c, k_phi, n: [N/m^(n+1), N/m^(n+2), 1].
        offset: Depth in the file's z at which the plates touched the soil [m]: the law holds for z - offset; 0 if it was not fitted.
        covariance: Of k_c, k_phi, n and, if it was fitted, the offset [SI], from the Jacobian of the fit: s^2 (J^T J)^-1. It takes the
            errors of rows to be independent, which those of a curve are not; what is given and not fitted has variance 0.
        over_tests: Standard errors of the same by the scatter of whole tests, leaving out one after the other (jackknife); None with less
            than three tests, or where one of them alone has a second size.
        k_c_is_given: True if k_c was not fitted.
        plates: Each test.
        goodness: As each plate's, over all rows.
        objective: The sum that was minimised.
        correlation: Between k = k_c/b + k_phi of the middle plate and n.
    """

    k_c: float
    k_phi: float
    n: float
    offset: float
    covariance: np.ndarray
    over_tests: np.ndarray | None
    k_c_is_given: bool
    plates: list[FittedPlate]
    goodness: float
    objective: float
    correlation: float

    @cached_property
    def standard_errors(self) -> np.ndarray:
        """Standard errors by the covariance, in its order."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def has_offset(self) -> bool:
        """True if the offset was fitted."""
        return len(self.covariance) == len(PARAMETERS)

    @property
    def radii(self) -> np.ndarray:
        """Radii of the plates [m], each once, ascending."""
        return np.unique([plate.test.b for plate in self.plates])

    @property
    def z_window(self) -> tuple[float, float]:
        """Least and largest sinkage z - offset in the tests [m]."""
        return _window([plate.test.z - self.offset for plate in self.plates])

    @property
    def p_window(self) -> tuple[float, float]:
        """Least and largest pressure in the tests [Pa]."""
        return _window([plate.test.p for plate in self.plates])

    @property
    def b_crit(self) -> float:
        """Width [m] up to which the law bears nothing, 0 if k_c >= 0."""
        return -self.k_c / self.k_phi if self.k_c < 0.0 < self.k_phi else 0.0

    @property
    def widths(self) -> tuple[float, float]:
        """Least and largest width of wheels [m] that the fit is good for.

        Bekker's b is a plate's radius and a wheel's width. From half the smallest radius to twice the largest: there k_c/b differs from
        what was measured under the nearest plate by no more than its own size there. And, where k_c is negative, above 2 b_crit: there k is
        at least half of k_phi; below, it is a small difference of large numbers. If k_c was given for plates of one size, within a quarter
        of their radius: in dry sand (CMU's) k there is by about a fifth another than k_c = 0 says.
        """
        reach = _ASSUMED if self.k_c_is_given and _is_one_size(self.radii) else _EXTRAPOLATED
        return float(max(self.radii[0] / reach, 2.0 * self.b_crit)), float(self.radii[-1] * reach)

    def pressure(self, b: float, z: np.ndarray) -> np.ndarray:
        """The law: pressure [Pa] under a plate of radius b [m] at the file's z [m]."""
        return (self.k_c / b + self.k_phi) * np.maximum(z - self.offset, 0.0) ** self.n


def fit_sinkage(tests: Sequence[PlateTest], k_c: float | None = None, with_offset: bool = False) -> tuple[Sinkage, list[str]]:
    """Fit Bekker's law to plate tests; returns it and what the user should know of it.

    Args:
        tests: Each with at least 3 rows of z > 0 and p > 0.
        k_c: Its value [N/m^(n+1)] if it is known or assumed; needed where all plates have one size.
        with_offset: Fit the depth at which the plates touched too, one for all tests; rows below a hundredth of their test's largest
            pressure are then left out.

    Raises:
        IdentifyError: Plates of one size without k_c, or no law fits.
    """
    radii = np.unique([test.b for test in tests])
    if k_c is None and _is_one_size(radii):
        diameters = " and ".join(f"{2e3 * b:g} mm" for b in radii)
        raise IdentifyError(
            f"all plates have one size, {diameters} in diameter: k_c cannot be told from k_phi; test a second size, best one with the "
            "wheel's width as radius, or give --k-c 0, which takes the soil to bear all widths alike and is good for wheels about as wide "
            f"as the plate's radius, {1e3 * radii[0]:g} mm"
        )
    if with_offset:
        tests = [_rows(test, test.p >= _BEARS * test.p.max()) for test in tests]
        for test in tests:
            if test.z.size < LEAST_ROWS or np.ptp(test.z) == 0.0:
                raise IdentifyError(
                    f"no offset of the plates' z can be told: test {test.name} has too few rows that bear more than nothing"
                )
    notes, solve = [], _Solver(k_c, with_offset)
    found = solve(tests)
    if found.values[1] < 0.0 and k_c is None:
        notes.append(
            f"k_phi = {found.values[1]:.4g} N/m^(n+2) from the fit: wide wheels would sink without end; fitted again with k_phi = 0"
        )
        solve = _Solver(None, with_offset, no_k_phi=True)
        found = solve(tests)
    k_c, k_phi, n = found.values[:3]
    offset = found.values[3] if with_offset else 0.0
    plates = [_beside(test, k_c / test.b + k_phi, n, offset) for test in tests]
    p = np.concatenate([test.p for test in tests])
    p_hat = np.concatenate([(k_c / test.b + k_phi) * (test.z - offset) ** n for test in tests])
    fit = Sinkage(
        *map(float, (k_c, k_phi, n, offset)),
        found.covariance,
        _over_tests(tests, solve),
        solve.k_c is not None,
        plates,
        _goodness(p, p_hat),
        found.objective,
        found.correlation,
    )
    if fit.widths[0] > fit.widths[1]:
        raise IdentifyError(
            f"k_c = {fit.k_c:g} N/m^(n+1) has the soil bear nothing below a width of {1e3 * fit.b_crit:.3g} mm, and the fit is good for no "
            f"width near the plates' radius, {1e3 * radii[0]:g} mm: give one nearer to 0"
        )
    return fit, notes


@dataclass(frozen=True, eq=False)
class _Found:
    """Values and covariance in the order of PARAMETERS, what was minimised, and the correlation of k under the middle plate and n."""

    values: np.ndarray
    covariance: np.ndarray
    objective: float
    correlation: float


@dataclass(frozen=True)
class _Solver:
    """The minimisation, for k_c fitted or given.

    Unknown are the logarithms of k under one or two of the plates, the anchors, between which k is linear in 1/b: so it is positive under
    every plate whatever the unknowns, and they are well scaled. Then n; then the logarithm of how far the first row is above the offset.
    """

    k_c: float | None
    with_offset: bool
    no_k_phi: bool = False

    def __call__(self, tests: Sequence[PlateTest]) -> _Found:
        sizes = np.array([len(test.z) for test in tests])
        x = np.repeat([1.0 / test.b for test in tests], sizes)
        z, y = np.concatenate([test.z for test in tests]), np.log(np.concatenate([test.p for test in tests]))
        w = np.concatenate([test.p / np.linalg.norm(test.p) for test in tests])
        first = z.min()
        share, base, to_k, from_k_c = self._anchors(x)
        m = share.shape[1]

        def law(q):
            depth = z - first + np.exp(q[m + 1]) if self.with_offset else z
            return share @ np.exp(q[:m]) + base, depth

        def residuals(q):
            k, depth = law(q)
            return w * (y - np.log(k) - q[m] * np.log(depth))

        def jacobian(q):
            k, depth = law(q)
            columns = [share * np.exp(q[:m]) / k[:, None], np.log(depth)[:, None]]
            if self.with_offset:
                columns.append((q[m] * np.exp(q[m + 1]) / depth)[:, None])
            return -w[:, None] * np.hstack(columns)

        n, ln_k = _line(np.log(z), y, w)
        start = [ln_k] * m + [n] + ([np.log(first)] if self.with_offset else [])
        spare = y.size - len(start)
        if spare > 0:
            with np.errstate(all="ignore"):  # a search that is lost ends in numbers that are not finite
                solved = least_squares(residuals, start, jacobian, method="lm", xtol=1e-14, ftol=1e-14, gtol=1e-14)
                q, k = solved.x, np.exp(solved.x[:m])
                above = np.exp(q[m + 1 :])  # the first row above the offset
                values = np.concatenate([to_k @ k + from_k_c, q[m : m + 1], first - above])
                change = np.zeros((values.size, q.size))  # of the values with the unknowns
                change[:2, :m], change[2, m], change[3:, m + 1 :] = to_k * k, 1.0, -above
                shape = change @ _inverse(solved.jac.T @ solved.jac) @ change.T
                middle = np.array([np.median(np.unique(x)), 1.0])
                along = shape[:2, 2] @ middle / np.sqrt(middle @ shape[:2, :2] @ middle * shape[2, 2])
            is_near = ((above > _NEAREST * z.max()) & (above < first + z.max())).all()  # the first row, and not beyond the curve's length
            if solved.success and is_near and np.isfinite([*values, *shape.flat, along]).all():
                return _Found(values, shape * 2.0 * solved.cost / spare, 2.0 * solved.cost, float(along))
        what = "no offset of the plates' z" if self.with_offset else "no law p = (k_c/b + k_phi) z^n"
        raise IdentifyError(f"{what} can be told from these plate tests: take tests with more rows over a wider range of z")

    def _anchors(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """k(x) = share @ e^q + base, and (k_c, k_phi) = to_k @ e^q + from_k_c, with x = 1/b."""
        low, high = x.min(), x.max()
        if self.no_k_phi:
            return (x / high)[:, None], np.zeros(x.size), np.array([[1.0 / high], [0.0]]), np.zeros(2)
        if self.k_c is None:
            share, span = (x - low) / (high - low), high - low
            return np.stack([share, 1.0 - share], axis=1), np.zeros(x.size), np.array([[1.0, -1.0], [-low, high]]) / span, np.zeros(2)
        least = high if self.k_c < 0.0 else low  # the plate with the least k
        return np.ones((x.size, 1)), self.k_c * (x - least), np.array([[0.0], [1.0]]), np.array([self.k_c, -self.k_c * least])


def _is_one_size(radii: np.ndarray) -> bool:
    return bool(radii[-1] <= _SAME_SIZE * radii[0])


def _inverse(matrix: np.ndarray) -> np.ndarray:
    """The inverse, not a number where there is none."""
    try:
        return np.linalg.inv(matrix)
    except np.linalg.LinAlgError:
        return np.full_like(matrix, np.nan)


def _line(x: np.ndarray, y: np.ndarray, w: np.ndarray) -> tuple[float, float]:
    """Slope and intercept of the line through y(x) with the weights w^2."""
    W = w**2 / np.sum(w**2)
    x_0, y_0 = W @ x, W @ y
    slope = W @ ((x - x_0) * (y - y_0)) / (W @ (x - x_0) ** 2)
    return float(slope), float(y_0 - slope * x_0)


def _rows(test: PlateTest, kept: np.ndarray) -> PlateTest:
    return PlateTest(test.name, test.b, test.lines[kept], test.z[kept], test.p[kept])


def _goodness(p: np.ndarray, p_hat: np.ndarray) -> float:
    return float(1.0 - np.sqrt(np.sum((p - p_hat) ** 2) / (p.size - 2)) / p.mean())  # Wong 1980


def _beside(test: PlateTest, k: float, n: float, offset: float) -> FittedPlate:
    depth = test.z - offset
    n_own, ln_k = _line(np.log(depth), np.log(test.p), test.p)
    own = np.exp(ln_k + n_own * np.log(depth))
    error = test.p - own
    middle = np.median(error)
    sigma = 1.4826 * np.median(np.abs(error - middle))  # of a normal distribution, whatever the outliers
    far = np.abs(error - middle) > max(_FAR * sigma, 1e-9 * test.p.max())
    k_own = float(np.exp(min(ln_k, 700.0)))  # rows at almost one sinkage have any law
    return FittedPlate(test, n_own, k_own, _goodness(test.p, own), _goodness(test.p, k * depth**n), test.lines[far])


def _over_tests(tests: Sequence[PlateTest], solve: _Solver) -> np.ndarray | None:
    """Standard errors by leaving out one test after the other."""
    if len(tests) < 3:
        return None
    found = []
    for i in range(len(tests)):
        rest = [*tests[:i], *tests[i + 1 :]]
        if solve.k_c is None and not solve.no_k_phi and _is_one_size(np.unique([test.b for test in rest])):
            return None
        try:
            found.append(solve(rest).values)
        except IdentifyError:
            return None
    found = np.array(found)
    return np.sqrt((len(tests) - 1) / len(tests) * np.sum((found - found.mean(axis=0)) ** 2, axis=0))


def _window(columns: list[np.ndarray]) -> tuple[float, float]:
    return float(min(c.min() for c in columns)), float(max(c.max() for c in columns))
