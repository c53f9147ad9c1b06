"""The problem of a step: velocities per impulse, free velocities, and what the normal ones have to reach."""

from __future__ import annotations

from ..mesh.contacts import GAP, A, B
from ..mesh.tools import is_fixed
from ..slave.kernel import kernel

#: Time [s] in which an overlap is taken back, in no fewer than so many steps. own choice: what is pushed out faster hops, by its speed,
#: higher than it was deep. A scalar mass is pushed out faster, as the overlap is what bears the weight that it does not know.
_PUSHED_OUT, _PUSHED_OUT_SCALAR, _STEPS_OUT = 0.02, 0.005, 5.0


@kernel
def take_mobility(u, mobility):
    """Unpack the inverse inertia that the multibody system tells into ``mobility`` [n, n]; False if it tells none."""
    at, told = 0, False
    for i in range(len(mobility)):
        for j in range(i + 1):
            mobility[i, j] = mobility[j, i] = u.inverse_inertia[at]
            at += 1
        told |= mobility[i, i] > 0.0
    return told


@kernel
def make_problem(h, p, laws, u, wheels, bodies, n, rows, lever, mobility, mobile, G, b, target, mu, twist, exact):
    """Velocities per impulse G, free velocities b, what the normal ones have to reach, and friction."""
    n_wheels = len(wheels)
    for i in range(n_wheels + len(bodies)):
        for k in range(3):
            twist[i, k] = wheels[i].v_0[k] if i < n_wheels else bodies[i - n_wheels].v_0[k]
            twist[i, 3 + k] = wheels[i].w_0[k] if i < n_wheels else bodies[i - n_wheels].w_0[k]
    for c in range(n):
        on, against, approach = 6 * int(rows[c, A]), 6 * int(rows[c, B]), 0.0
        for r in range(3):
            now = free = 0.0
            for k in range(6):
                now += lever[c, r, k] * twist[on // 6, k] + lever[c, r, 6 + k] * twist[against // 6, k]
                free += lever[c, r, k] * u.free_twist[on + k] + lever[c, r, 6 + k] * u.free_twist[against + k]
            b[3 * c + r] = free if exact else now
            if r == 0:
                approach = now
        slow = max(_PUSHED_OUT if exact else _PUSHED_OUT_SCALAR, _STEPS_OUT * h)
        _bound(h, slow, p, laws, n_wheels, c, rows, b[3 * c], approach, target, mu)
    if not exact:
        _scalar_masses(p, laws, n_wheels, n, rows, G)
        return
    for d in range(n):
        on, against = 6 * int(rows[d, A]), 6 * int(rows[d, B])
        for s in range(3):
            for r in range(len(mobility)):
                total = 0.0
                for k in range(6):
                    total += mobility[r, on + k] * lever[d, s, k] + mobility[r, against + k] * lever[d, s, 6 + k]
                mobile[s, r] = total
        for c in range(d, n):
            on_c, against_c = 6 * int(rows[c, A]), 6 * int(rows[c, B])
            for r in range(3):
                for s in range(3):
                    total = 0.0
                    for k in range(6):
                        total += lever[c, r, k] * mobile[s, on_c + k] + lever[c, r, 6 + k] * mobile[s, against_c + k]
                    G[3 * c + r, 3 * d + s] = G[3 * d + s, 3 * c + r] = total


@kernel
def _bound(h, slow, p, laws, n_wheels, c, rows, free, now, target, mu):
    """Least normal velocity at the step's end: what closes the gap, or takes back the overlap in time, or the rebound (Newton).

    An overlap is taken back within ``slow`` [s].
    """
    on, against = int(rows[c, A]), int(rows[c, B])
    law = laws[against - n_wheels]
    mu[c], restitution = law.mu, law.restitution
    if on >= n_wheels:
        mu[c] = min(mu[c], laws[on - n_wheels].mu)
        restitution = min(restitution, laws[on - n_wheels].restitution)
    gap = rows[c, GAP]
    least = 0.0
    if h > 0.0:
        least = -gap / h if gap > 0.0 else -gap / slow
    if now < -p.rest_speed and gap + h * min(free, now) <= 0.0:
        least = max(least, -restitution * now)
    target[c] = least


@kernel
def _scalar_masses(p, laws, n_wheels, n, rows, G):
    """Contacts that do not know of each other, each with its share of the tools' masses (mass splitting, Tonge 2012)."""
    for c in range(n):
        mobility = 0.0
        for side in range(2):
            tool, on_tool = int(rows[c, A + side]), 0
            for d in range(n):
                on_tool += int(rows[d, A] == tool) + int(rows[d, B] == tool)
            if tool < n_wheels:
                mobility += on_tool / p.effective_mass
            elif not is_fixed(laws[tool - n_wheels]):
                mobility += on_tool / laws[tool - n_wheels].mass
        for r in range(3):
            for d in range(n):
                for s in range(3):
                    G[3 * c + r, 3 * d + s] = mobility if c == d and r == s else 0.0
