"""Whether an explicit exchange of contact forces is stable at a step H: the checks that the master makes for explicit schemes.

Friction: lambda_max(A D) H < 2. Spring: a zero-order hold over H adds a damping ratio of about -omega H / 4 under Gauss-Seidel, so the
contact's own must be larger; omega^2 = lambda_max(A K). A is the operational-space inverse inertia at the contacts, from what a rover
offers about its wheels' centres as ``inverse_inertia[k]``; K and D come from the contacts' interface Jacobians.
"""

from __future__ import annotations

import math
import re

import numpy as np
from scipy.linalg import eigh

_ELEMENT = re.compile(r"inverse_inertia\[(\d+)\]")


class StabilityGuard:
    """Warns once about each wheel whose contact is too stiff for the step.

    Args:
        rover: Slave that offers ``inverse_inertia``.
        contacts: (contact slave, contact number there, wheel number at the rover) of every contact connected to the rover.
        warn: Called with the warning.
    """

    def __init__(self, rover, contacts: list[tuple], warn):
        self._warn = warn
        self._warned: set[int] = set()
        at = {name: i for i, name in enumerate(rover.outputs)}
        elements = sorted((int(m[1]), i) for n, i in at.items() if (m := _ELEMENT.fullmatch(n)))
        size = math.isqrt(2 * len(elements))  # of the matrix of which these are the lower triangle, row by row
        self._elements = np.empty((size, size), dtype=int)
        rows, columns = np.tril_indices(size)
        self._elements[rows, columns] = self._elements[columns, rows] = [i for _, i in elements]
        n_wheels = max(wheel for _, _, wheel in contacts)
        self._size = 3 * n_wheels
        self._centres = np.array([[at[f"wheel[{i + 1}].r_0[{k}]"] for k in (1, 2, 3)] for i in range(n_wheels)])
        self._rover = rover
        self._contacts = []
        for slave, number, wheel in contacts:
            index = {name: i for i, name in enumerate(slave.outputs)}
            pick = lambda names, index=index: np.array([index[n] for n in names])  # noqa: E731
            axes = pick([f"contact[{number}].axes[{i},{j}]" for i in (1, 2, 3) for j in (1, 2, 3)])
            K, D, point = (pick([f"contact[{number}].{q}[{i}]" for i in (1, 2, 3)]) for q in ("K", "D", "point_0"))
            self._contacts.append((slave, wheel, axes, K, D, point))

    def check(self, t: float, h: float) -> None:
        """Warn about wheels whose contact, as it is at t, is not stable under an exchange every h [s]."""
        K, D = np.zeros((self._size, self._size)), np.zeros((self._size, self._size))
        to_points = np.zeros((self._size, len(self._elements)))
        for slave, wheel, axes, k, d, point in self._contacts:
            R = slave.y[axes].reshape(3, 3)
            block = slice(3 * wheel - 3, 3 * wheel)
            x, y, z = slave.y[point] - self._rover.y[self._centres[wheel - 1]]
            to_points[block, 6 * wheel - 6 : 6 * wheel] = np.hstack([np.eye(3), [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]])
            K[block, block] += R.T @ np.diag(slave.y[k]) @ R
            D[block, block] += R.T @ np.diag(slave.y[d]) @ R
        A = to_points @ self._rover.y[self._elements] @ to_points.T
        if not (A.any() and (K.any() or D.any())):
            return
        values, vectors = np.linalg.eigh(0.5 * (A + A.T))
        root = vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T  # A = root root; root K root is symmetric, same eigenvalues as A K
        rates, modes = eigh(root @ D @ root)
        if rates[-1] * h >= 2.0:
            self._say(
                modes[:, -1], t, f"friction and damping need a step below {2.0 / rates[-1]:.2g} s (lambda_max(A D) = {rates[-1]:.3g} 1/s)"
            )
        squares, modes = eigh(root @ K @ root)
        omega = float(np.sqrt(max(squares[-1], 0.0)))
        if omega > 0.0:
            mode = modes[:, -1]
            zeta = float(mode @ root @ D @ root @ mode) / (2.0 * omega)
            if zeta <= omega * h / 4.0:
                text = f"its spring (omega = {omega:.3g} rad/s, damping ratio {zeta:.2g}) needs a step below {4.0 * zeta / omega:.2g} s"
                self._say(mode, t, text)

    def _say(self, mode: np.ndarray, t: float, text: str) -> None:
        wheel = int(np.abs(mode).reshape(-1, 3).max(axis=1).argmax()) + 1
        if wheel not in self._warned:
            self._warned.add(wheel)
            self._warn(
                f"{self._rover.name}.wheel[{wheel}]: {text} at t = {t:.4g} s under an explicit exchange; use scheme ij or a smaller step"
            )
