"""Impulses of rigid contacts in one time step: sweeps from those of the last step, and Lemke's method where they do not get there."""

from __future__ import annotations

import numpy as np

from ..slave.kernel import kernel
from ..slave.model import ModelError
from .friction import friction_directions
from .lemke import SOLVED, lemke
from .sweeps import gauss_seidel, residual, velocities

BY_SWEEPS, BY_PIVOTS, UNSOLVED = range(3)


def scratch(most_contacts: int, n_directions: int) -> tuple[np.ndarray, ...]:
    """The last arguments of :func:`solve`: friction directions, kept impulses, tableau and basis.

    The tableau takes 8 (most_contacts (n_directions + 2))^2 bytes, 320 kB for 20 contacts and 8 directions.

    Raises:
        ModelError: ``most_contacts`` is below 0, or ``n_directions`` is odd or below 4.
    """
    if most_contacts < 0:
        raise ModelError(f"most_contacts = {most_contacts}: it must be 0 or above (contacts of one time step)")
    directions = friction_directions(n_directions)
    size = most_contacts * (n_directions + 2)
    return directions, np.zeros(3 * most_contacts), np.zeros((size, size + 2)), np.zeros((3, 2 * size + 1), np.int64)


@kernel
def solve(n, G, b, target, mu, p, v, tolerance, max_sweeps, directions, kept, tableau, basis):
    """Find impulses p with v = b + G p that keep the conditions in :mod:`cdl_fmu.rbc.sweeps` at n contacts.

    Arrays may be longer than n contacts need. Three rows a contact: normal, first and second tangent.

    Args:
        n: Number of contacts.
        G: Velocities per impulse [1/kg], symmetric and positive semidefinite, shape [3n, 3n].
        b: Velocities at the end of the step without these impulses [m/s], shape [3n].
        target: Normal velocities that are reached at least [m/s], shape [n].
        mu: Coefficients of friction, >= 0, shape [n].
        p: Impulses [N.s], shape [3n]; given those of the last step, or 0, it gets the solution.
        v: Velocities at the end of the step [m/s], shape [3n], written.
        tolerance: Residual at which sweeps end [m/s], as :func:`cdl_fmu.rbc.sweeps.residual` measures it.
        max_sweeps: Most sweeps before Lemke's method, and again after it.
        directions, kept, tableau, basis: As :func:`scratch` makes them.

    Returns:
        ``BY_SWEEPS``, ``BY_PIVOTS`` or ``UNSOLVED`` (the residual is above the tolerance; p is the better of what both found), sweeps made
        in all, and the residual [m/s].
    """
    sweeps, off = gauss_seidel(n, G, b, target, mu, p, v, tolerance, max_sweeps, directions)
    if off <= tolerance:
        return BY_SWEEPS, sweeps, off
    for i in range(3 * n):
        kept[i] = p[i]
    if lemke(n, G, b, target, mu, p, directions, tableau, basis)[0] == SOLVED:
        velocities(n, G, b, p, v)
        off_by_pivots = residual(n, G, target, mu, p, v, directions)
        if off_by_pivots < off or off != off:
            off = off_by_pivots
            for i in range(3 * n):
                kept[i] = p[i]
        # Sweeps from there take away what rounding left, where it is too much.
        more, off_swept = gauss_seidel(n, G, b, target, mu, p, v, tolerance, max_sweeps, directions)
        sweeps += more
        if off_swept <= tolerance:
            return BY_PIVOTS, sweeps, off_swept
    for i in range(3 * n):
        p[i] = kept[i]
    velocities(n, G, b, p, v)
    return UNSOLVED, sweeps, off
