"""Rigid contact by Lemke's method: pivots of the whole problem, which end at a solution where sweeps converge slowly or not at all.

With z = (lambda_n, lambda_f, sigma) and w = M z + q of each contact, 0 <= w _|_ z >= 0 is Eq. (8.1) to (8.4) with

        | N   N D  0 |        | b_n - target |
    M = | D'N D'D  E |,   q = | D' b_t       |
        | mu  -E'  0 |        | 0            |

(N, ND, ... are rows and columns of G along normals and friction directions). M is copositive for mu >= 0, so the method ends at a solution
wherever the targets can be reached (Anitescu & Potra 1997; Cottle, Pang & Stone 1992, section 4.4).
"""

from __future__ import annotations

import math

import numpy as np

from ..slave.kernel import kernel
from .friction import D_X, D_Y

SOLVED, NO_WAY_ON, TOO_MANY_PIVOTS = range(3)

ROW, COLUMN, PLACE = range(3)  # rows of the basis: variable of each row, variable of each column, row or column of each variable
_LEAST_PIVOT = 1e-9  # own choice: rows are scaled to 1, and below this a coefficient is what rounding left of 0
_ROUNDING = 3e-11  # own choice: values that differ by less, in shares of the largest one at the start, are the same


@kernel
def lemke(n, G, b, target, mu, p, directions, tableau, basis):
    """Solve the problem of n contacts from nothing.

    Args: as :func:`cdl_fmu.rbc.solve.solve`; p gets the solution and stays as it was where there is none.

    Returns:
        Status, ``SOLVED`` or why not, and number of pivots.
    """
    size = n * (directions.shape[0] + 2)
    scale = _fill(n, G, b, target, mu, directions, tableau)
    if scale == 0.0:
        for i in range(3 * n):
            p[i] = 0.0
        return SOLVED, 0
    for i in range(size):  # variables: w from 0, z from size, z_0 last
        basis[ROW, i] = basis[PLACE, i] = i
        basis[COLUMN, i], basis[PLACE, size + i] = size + i, i
    basis[ROW, size], basis[COLUMN, size] = -1, 2 * size  # one column more than rows
    basis[PLACE, 2 * size] = size
    # z_0 enters for the most negative row; of equal ones the last, as the first has the largest symbolic perturbation.
    row = np.int64(0)
    for i in range(size):
        if tableau[i, size + 1] <= tableau[row, size + 1]:
            row = i
    left, pivots = _pivot(size, row, size, tableau, basis), 1
    # z_0 of rounding left of 0 is as good as z_0 gone: where bodies are jammed, no pivot may be left that takes it out.
    while left != 2 * size and tableau[basis[PLACE, 2 * size], size + 1] > _ROUNDING:
        if pivots >= 20 * size + 50:
            return TOO_MANY_PIVOTS, pivots
        column = basis[PLACE, left + size if left < size else left - size]
        row = _leaving(size, column, tableau, basis)
        if row < 0:
            return NO_WAY_ON, pivots
        left = _pivot(size, row, column, tableau, basis)
        pivots += 1
    _read(n, G, scale, p, directions, tableau, basis)
    return SOLVED, pivots


@kernel(inline=True)
def _scales(G, c):
    """Units of lambda_n and lambda_f of contact c, kg^0.5: with them the diagonal of M is 1, whatever the masses (own choice)."""
    i = 3 * c
    g_n, g_t = G[i, i], 0.5 * (G[i + 1, i + 1] + G[i + 2, i + 2])
    return 1.0 / math.sqrt(g_n) if g_n > 0.0 else 1.0, 1.0 / math.sqrt(g_t) if g_t > 0.0 else 1.0


@kernel
def _fill(n, G, b, target, mu, directions, tableau):
    """Write w = M z + z_0 + q, rows and columns scaled, and q to a largest entry of 1 below 0; returns that entry, 0 for none."""
    n_d = directions.shape[0]
    size = n * (n_d + 2)
    most = 0.0
    for c in range(n):
        s_n, s_f = _scales(G, c)
        i, r = 3 * c, c * (n_d + 2)
        for e in range(n):
            t_n, t_f = _scales(G, e)
            j, k = 3 * e, e * (n_d + 2)
            tableau[r, k] = s_n * t_n * G[i, j]
            tableau[r, k + n_d + 1] = tableau[r + n_d + 1, k] = tableau[r + n_d + 1, k + n_d + 1] = 0.0
            for m in range(n_d):
                tableau[r, k + 1 + m] = s_n * t_f * (G[i, j + 1] * directions[m, D_X] + G[i, j + 2] * directions[m, D_Y])
                tableau[r + n_d + 1, k + 1 + m] = 0.0
            for m in range(n_d):
                x, y = s_f * directions[m, D_X], s_f * directions[m, D_Y]
                tableau[r + 1 + m, k] = t_n * (x * G[i + 1, j] + y * G[i + 2, j])
                a_x, a_y = t_f * (x * G[i + 1, j + 1] + y * G[i + 2, j + 1]), t_f * (x * G[i + 1, j + 2] + y * G[i + 2, j + 2])
                for o in range(n_d):
                    tableau[r + 1 + m, k + 1 + o] = a_x * directions[o, D_X] + a_y * directions[o, D_Y]
                tableau[r + 1 + m, k + n_d + 1] = 0.0
        tableau[r + n_d + 1, r] = mu[c] * s_n / s_f
        tableau[r, size + 1] = s_n * (b[i] - target[c])
        tableau[r + n_d + 1, size + 1] = 0.0
        most = max(most, -tableau[r, size + 1])
        for m in range(n_d):
            tableau[r + 1 + m, r + n_d + 1] = 1.0
            tableau[r + n_d + 1, r + 1 + m] = -1.0
            tableau[r + 1 + m, size + 1] = s_f * (directions[m, D_X] * b[i + 1] + directions[m, D_Y] * b[i + 2])
            most = max(most, -tableau[r + 1 + m, size + 1])
    for i in range(size):
        tableau[i, size] = 1.0
        tableau[i, size + 1] = tableau[i, size + 1] / most if most > 0.0 else 0.0
    return most


@kernel
def _leaving(size, column, tableau, basis):
    """Row whose variable is the first to fall to 0 as that of the column grows, -1 for none; equal ones by the lexicographic rule."""
    least = math.inf
    for i in range(size):
        a = -tableau[i, column]
        if a > _LEAST_PIVOT:
            least = min(least, max(tableau[i, size + 1], 0.0) / a)
    if least == math.inf:
        return -1
    found = np.int64(-1)
    for i in range(size):
        a = -tableau[i, column]
        if a > _LEAST_PIVOT and max(tableau[i, size + 1], 0.0) <= (least + _ROUNDING) * a:
            if basis[ROW, i] == 2 * size:
                return i  # z_0 falls to 0: solved
            if found < 0 or _before(size, i, found, column, tableau, basis):
                found = i
    return found


@kernel
def _before(size, i, other, column, tableau, basis):
    """True if row i falls to 0 before the other one when w_0, w_1, ... are raised at the start, each by far less than the last one."""
    a, a_other = tableau[i, column], tableau[other, column]
    for k in range(size):
        place = basis[PLACE, k]
        if basis[ROW, place] == k:
            if place in (i, other):
                return place == other
        else:
            share, share_other = tableau[i, place] / a, tableau[other, place] / a_other
            if share != share_other:
                return share < share_other
    return False


@kernel
def _pivot(size, row, column, tableau, basis):
    """Exchange the variables of a row and a column; returns the one that was the row's."""
    per = 1.0 / tableau[row, column]
    for j in range(size + 2):
        tableau[row, j] *= -per
    tableau[row, column] = per
    for i in range(size):
        f = tableau[i, column]
        if i != row and f != 0.0:
            tableau[i, column] = 0.0
            for j in range(size + 2):
                tableau[i, j] += f * tableau[row, j]
    left, entered = basis[ROW, row], basis[COLUMN, column]
    basis[ROW, row], basis[COLUMN, column] = entered, left
    basis[PLACE, entered], basis[PLACE, left] = row, column
    return left


@kernel
def _read(n, G, scale, p, directions, tableau, basis):
    """Impulses [N.s] of the solution."""
    n_d = directions.shape[0]
    size = n * (n_d + 2)
    for c in range(n):
        s_n, s_f = _scales(G, c)
        p[3 * c] = p[3 * c + 1] = p[3 * c + 2] = 0.0
        for m in range(n_d + 1):
            z = size + c * (n_d + 2) + m
            place = basis[PLACE, z]
            if basis[ROW, place] == z:
                value = scale * max(tableau[place, size + 1], 0.0)
                if m == 0:
                    p[3 * c] = s_n * value
                else:
                    p[3 * c + 1] += s_f * value * directions[m - 1, D_X]
                    p[3 * c + 2] += s_f * value * directions[m - 1, D_Y]
