"""Faces of a meshed tool that are too steep to press the soil down: they push it aside, against its passive earth pressure."""

from __future__ import annotations

import math

from ..slave.kernel import kernel
from ..terramechanics import janosi_displacement, unit_weight
from .columns import AREA, N_Z, SIDE_ACROSS, SIDE_ALONG, X, Y, Z
from .stress import counted, remembered, secant_share
from .tiles import BASE, FILL, STAMP, in_tile, nearest, row_of, surface_height


@kernel(inline=True)
def velocity(v_0, w_0, x, y, z):
    """Velocity [m/s] of a tool's point (x, y, z) [m]."""
    return v_0[0] + w_0[1] * z - w_0[2] * y, v_0[1] + w_0[2] * x - w_0[0] * z, v_0[2] + w_0[0] * y - w_0[1] * x


@kernel
def displace(p, tool, modulus, sums, h_x, h_y, placed, n_placed):
    """Move the steep faces on; returns the displacement that counts [m], in world axes, and the mobilised share by displacement [1/m].

    Own choice: one displacement for the whole tool. Where it rolls, soil is left behind and replaced by soil that was not displaced yet,
    so it relaxes over the length of contact, here the root of the plan area near the soil. Mobilised by ``modulus`` [m].
    """
    total, x, y, z = 0.0, 0.0, 0.0, 0.0
    for e in range(n_placed):
        plan = max(-placed[e, N_Z], 0.0) * placed[e, AREA]
        total, x, y, z = total + plan, x + plan * placed[e, X], y + plan * placed[e, Y], z + plan * placed[e, Z]
    if total > 0.0:
        x, y, z = x / total, y / total, z / total
    h = tool.time
    u_x, u_y, _ = velocity(tool.mean_v, tool.mean_w, x, y, z)
    rolling = math.hypot(tool.mean_v[0] - u_x, tool.mean_v[1] - u_y)
    kept = 1.0 / (1.0 + rolling * h / max(math.sqrt(total), p.cell))
    along, across = (sums[SIDE_ALONG] + h * (u_x * h_x + u_y * h_y)) * kept, (sums[SIDE_ACROSS] + h * (u_y * h_x - u_x * h_y)) * kept
    along, across = remembered(modulus, along, across)
    sums[SIDE_ALONG], sums[SIDE_ACROSS] = along, across
    u_x, u_y, _ = velocity(tool.v_0, tool.w_0, x, y, z)
    m_x, m_y, moved = counted(p.tau_r, along * h_x - across * h_y, along * h_y + across * h_x, u_x, u_y)
    return m_x, m_y, secant_share(modulus, moved, janosi_displacement(moved, modulus))


@kernel
def passive(p, N_phi, r_0, x, y, z, n_x, n_y, stamp, rows, grid, corner):
    """Rankine's passive earth pressure [Pa] on a steep face: of the soil that it faces, whose surface is that of a cell further out.

    Where that cell is still one of a hole that a tool fills, soil having been laid around it, it is that of the next one.
    """
    per_length = p.cell / max(math.sqrt(n_x * n_x + n_y * n_y), 1e-9)
    i, j = nearest(r_0[0] + x + n_x * per_length, p.cell), nearest(r_0[1] + y + n_y * per_length, p.cell)
    row, a, b = row_of(grid, corner, i, j), in_tile(i), in_tile(j)
    if rows[row, STAMP, a, b] >= stamp - 1.0 and rows[row, BASE, a, b] + rows[row, FILL, a, b] < r_0[2] + z:
        i, j = nearest(r_0[0] + x + 2.0 * n_x * per_length, p.cell), nearest(r_0[1] + y + 2.0 * n_y * per_length, p.cell)
    depth = surface_height(rows, row_of(grid, corner, i, j), i, j) - r_0[2] - z
    return unit_weight(p.rho, p.gravity, p.slope) * depth * N_phi + 2.0 * p.c * math.sqrt(N_phi) if depth > 0.0 else 0.0  # Eq. (8.8)
