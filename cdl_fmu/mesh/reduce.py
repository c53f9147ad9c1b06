"""From many contact candidates to few, and to shares of one spring."""

from __future__ import annotations

import math

from ..frames import dot
from ..slave.kernel import kernel
from .contacts import CONTACT, GAP, NORMAL, POINT, WEIGHT

_ALIKE = math.cos(math.radians(20.0))  # of two normals
_DEEPER = 10.0  # distance to the others that a candidate must have more for each metre of gap, if only some are kept


@kernel
def thin_out(contacts, first, n, spacing, most):
    """Keep few of the candidates from row ``first`` to n - 1, the deepest first.

    One goes that is nearer than ``spacing`` [m] to one that is kept and has its normal within 20 degrees of that one's. Of more than
    ``most`` that are left, the deepest stays, and then again and again the one that is furthest from those that stay, less ten times its
    gap.

    Returns:
        The row after the last one kept.
    """
    n = min(n, contacts.shape[0])
    kept = first
    while kept < n:
        deepest = kept
        for k in range(kept + 1, n):
            if contacts[k, GAP] < contacts[deepest, GAP]:
                deepest = k
        _swap(contacts, kept, deepest)
        k = kept + 1
        while k < n:
            if at_one_place(contacts, kept, k, spacing):
                n -= 1
                _swap(contacts, k, n)
            else:
                k += 1
        kept += 1
    # They are in the order of their gaps now.
    if kept - first <= most:
        return kept
    for chosen in range(first + 1, first + most):
        best, score = chosen, -math.inf
        for k in range(chosen, kept):
            square = math.inf
            for m in range(first, chosen):
                square = min(square, _square(contacts, k, m))
            worth = math.sqrt(square) - _DEEPER * contacts[k, GAP]  # own choice
            if worth > score:
                best, score = k, worth
        _swap(contacts, chosen, best)
    return first + most


@kernel
def shares(contacts, first, n, spacing, out):
    """Share of each candidate in the spring that all near it make together, for penalty forces k * depth * share.

    own choice, with kappa_cd = max(0, 1 - (|x_c - x_d| / spacing)^2)^2 max(0, n_c . n_d)^2:
    share_c = max_d(kappa_cd weight_d min(1, depth_d / depth_c)) weight_c depth_c / sum_d kappa_cd weight_d depth_d

    Points within ``spacing`` of each other with one normal make one spring, however many they are; a candidate comes with depth 0 and
    counts for nothing then.

    Args:
        contacts: Candidates from row ``first`` to n - 1.
        spacing: [m].
        out: For the shares [1], by row; 0 where bodies do not overlap.
    """
    for c in range(first, min(n, contacts.shape[0])):
        out[c] = 0.0
        depth, total, most = -contacts[c, GAP], 0.0, 0.0
        if depth <= 0.0:
            continue
        for d in range(first, min(n, contacts.shape[0])):
            if contacts[d, GAP] < 0.0:
                near = max(0.0, 1.0 - _square(contacts, c, d) / (spacing * spacing))
                alike = max(0.0, _cosine(contacts, c, d))
                weight = near * near * alike * alike * contacts[d, WEIGHT]
                total -= weight * contacts[d, GAP]
                most = max(most, weight * min(1.0, -contacts[d, GAP] / depth))
        out[c] = most * contacts[c, WEIGHT] * depth / total


@kernel(inline=True)
def at_one_place(contacts, c, d, spacing):
    """Whether two candidates are nearer than ``spacing`` [m] and face alike."""
    return _square(contacts, c, d) < spacing * spacing and _cosine(contacts, c, d) > _ALIKE


@kernel(inline=True)
def _square(contacts, c, d):
    """Square of the distance of two candidates [m2]."""
    x, y, z = contacts[c, POINT] - contacts[d, POINT], contacts[c, POINT + 1] - contacts[d, POINT + 1], contacts[c, POINT + 2]
    z -= contacts[d, POINT + 2]
    return x * x + y * y + z * z


@kernel(inline=True)
def _cosine(contacts, c, d):
    """Of the angle between the normals of two candidates."""
    k = NORMAL
    return dot(contacts[c, k], contacts[c, k + 1], contacts[c, k + 2], contacts[d, k], contacts[d, k + 1], contacts[d, k + 2])


@kernel(inline=True)
def _swap(contacts, c, d):
    for k in range(CONTACT):
        contacts[c, k], contacts[d, k] = contacts[d, k], contacts[c, k]
