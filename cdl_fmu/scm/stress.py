"""What one small piece of a tool's surface feels in the soil: pressure by depth and memory, shear by displacement."""

from __future__ import annotations

import math

from ..slave.kernel import kernel
from ..terramechanics import bekker_modulus, janosi_displacement, unit_weight

#: Largest shear displacement that a cell remembers, in units of K: beyond it reversing would take longer than mobilising did.
LONGEST_MEMORY = 5.0
_FORCE_QUANTUM = 2.0**-30  # [N], [N.m]
_ROUND = 1.5 * 2.0**52 * _FORCE_QUANTUM
_EXACT = 4  # intervals of a table of powers in which the cubic may swing below 0: powers are computed there


@kernel(inline=True)
def whole(force):
    """Nearest multiple of 1e-9 N (N.m): sums of such are exact up to 4e6 N, so the order of the summands does not matter."""
    return (force + _ROUND) - _ROUND


@kernel
def pressure_modulus(p, b):
    """k [N/m^(n+2)] of the pressure k z^n under a tool of width b [m]."""
    if p.pressure_model == 2.0:
        gamma_s = unit_weight(p.rho, p.gravity, p.slope)
        return (p.c * p.k_c_1 + gamma_s * b * p.k_phi_1) / b**p.n  # Reece 1965: (c k'_c + gamma_s b k'_phi) (z/b)^n
    return bekker_modulus(p.k_c, p.k_phi, b)  # Eq. (8.5)


@kernel
def tabulate(n, deepest, table):
    """Fill ``table`` [2, nodes] with depth^n and its difference per node by slope, at depths from 0 to ``deepest`` [m].

    A power costs twenty times its cubic interpolation over the root of the depth, whose error is below 1e-4 from 0.1 mm on.
    """
    spacing = math.sqrt(deepest) / (table.shape[1] - 1)
    for k in range(table.shape[1]):
        root = k * spacing
        table[0, k] = root ** (2.0 * n) if root > 0.0 else 0.0
        table[1, k] = 2.0 * n * root ** (2.0 * n - 1.0) * spacing if root > 0.0 else 0.0


@kernel(inline=True)
def power(table, per_root, n, depth):
    """depth^n by cubic Hermite interpolation; depth > 0 [m], nodes ``per_root`` [m^-1/2], see ``nodes_per_root``."""
    s = math.sqrt(depth) * per_root
    k = int(s)
    if k < _EXACT or k >= table.shape[1] - 1:
        return depth**n
    s -= k
    a, b, d_a, d_b = table[0, k], table[0, k + 1], table[1, k], table[1, k + 1]
    c = b - a
    return a + s * (d_a + s * (3.0 * c - 2.0 * d_a - d_b + s * (d_a + d_b - 2.0 * c)))


@kernel
def nodes_per_root(p, table):
    """Nodes of a table of powers per root of depth [m^-1/2]."""
    return (table.shape[1] - 1.0) / math.sqrt(deepest_of_table(p))


@kernel(inline=True)
def counted(tau_r, j_x, j_y, v_x, v_y):
    """Shear displacement vector [m] that counts, and its length.

    Own choice: v tau_r is added to the displacement. The displacement law alone has no damping, and a rover's surge on it, of the
    frequency sqrt(tan(phi) g / K), becomes a limit cycle at low gravity.
    """
    x, y = j_x + tau_r * v_x, j_y + tau_r * v_y
    return x, y, math.sqrt(x * x + y * y)


@kernel(inline=True)
def secant_share(K, length, share):
    """Mobilised share of the strength per displacement [1/m], at a displacement of this length [m]."""
    return share / length if length >= 1e-9 * K else 1.0 / K


@kernel(inline=True)
def mobilised(p, j_x, j_y, v_x, v_y):
    """Shear displacement vector [m] that counts, mobilised share of the strength, and that share per displacement [1/m]."""
    x, y, length = counted(p.tau_r, j_x, j_y, v_x, v_y)
    share = janosi_displacement(length, p.K)
    return x, y, share, secant_share(p.K, length, share)


@kernel(inline=True)
def remembered(K, j_x, j_y):
    """Shear displacement vector [m], shortened to what the soil remembers."""
    longest = LONGEST_MEMORY * K
    kept = longest / max(math.sqrt(j_x * j_x + j_y * j_y), longest)
    return j_x * kept, j_y * kept


@kernel
def sheared(p, before, now, j_x, j_y, s_x, s_y, path, u_x, u_y):
    """Shear of a cell below a body, that gives back no more energy than went into it.

    Own choice: friction follows the displacement as a spring of the law's first slope, up to what the law mobilises along the path that was
    gone; sheared in one direction from the start it is the law itself. Where the load grows the force stays, where it falls the
    displacement does, and what was stored is lost (Elata & Berryman 1996). A spring that is as strong as its load, whichever way that came,
    makes bodies rock for ever.

    Args:
        before, now: Friction that the cell could give in the step before, 0 if there was none, and now [N].
        j_x, j_y: Shear displacement before the step [m].
        s_x, s_y: Displacement in the step [m].
        path: Of slip up to the step's end [m].
        u_x, u_y: Velocity [m/s].

    Returns:
        Shear displacement by which the law mobilises as much [m], displacement vector that counts [m], the mobilised share of the strength,
        and that share over the vector's length [1/m].
    """
    j = math.sqrt(j_x * j_x + j_y * j_y)
    kept = secant_share(p.K, j, janosi_displacement(j, p.K)) * p.K
    if now > before > 0.0:
        kept *= before / now
    e_x, e_y = kept * j_x + s_x, kept * j_y + s_y
    length, most = math.sqrt(e_x * e_x + e_y * e_y), p.K * janosi_displacement(min(path, LONGEST_MEMORY * p.K), p.K)
    if length > most:
        e_x, e_y, length = e_x * (most / length), e_y * (most / length), most
    longer = -p.K * math.log1p(-length / p.K) / length if length > 1e-9 * p.K else 1.0
    m_x, m_y, moved = counted(p.tau_r, e_x, e_y, u_x, u_y)
    fast = janosi_displacement(path + p.tau_r * math.sqrt(u_x * u_x + u_y * u_y), p.K)
    share = min(moved / p.K, fast)
    return e_x * longer, e_y * longer, m_x, m_y, share, secant_share(p.K, moved, share)


@kernel
def deepest_of_table(p):
    """Depth [m] up to which powers are tabulated: more than a wheel's radius."""
    return 2.0 * p.r_w
