"""What an SCM step does for each tool beside the contact itself: where it is and was, is it near the ground, its tiles, its outputs."""

from __future__ import annotations

import math

from ..contact import SLIP_FLOOR, anchor_here, lowest_point, show
from ..slave.kernel import kernel
from ..terramechanics import slip_ratio
from .columns import (
    ALONG_MAX,
    ALONG_MIN,
    CELLS,
    D_Z,
    F_X,
    F_Y,
    F_Z,
    K_X,
    K_Y,
    K_Z,
    PUSHED_X,
    PUSHED_Y,
    SIDE_ACROSS,
    SIDE_ALONG,
    SUMS,
    T_X,
    T_Y,
    T_Z,
)
from .flow import ends_share, heave, transport
from .heights import height_at
from .tiles import base_height_at, let_slide, look_up, nearest, tile_of, touch

#: [m] above the ground from which on a tool's tiles are made ready.
NEAR = 0.03


@kernel
def forget(sums):
    """A tool that is in the air remembers nothing of the soil."""
    for k in range(SIDE_ALONG, SUMS):
        sums[k] = 0.0


@kernel
def recall(memory, sums):
    """Take what a tool remembers of its contact from the state."""
    sums[SIDE_ALONG], sums[SIDE_ACROSS] = memory.side[0], memory.side[1]
    sums[PUSHED_X], sums[PUSHED_Y] = memory.pushed[0], memory.pushed[1]


@kernel
def remember(sums, memory):
    """Put it back."""
    memory.side[0], memory.side[1] = sums[SIDE_ALONG], sums[SIDE_ACROSS]
    memory.pushed[0], memory.pushed[1] = sums[PUSHED_X], sums[PUSHED_Y]


@kernel
def place(tool, h, pose):
    """Copy the pose and twist of a wheel or a body, which has moved with it for a step of h [s]."""
    pose.time = h
    for i in range(3):
        pose.r_0[i], pose.v_0[i], pose.w_0[i] = tool.r_0[i], tool.v_0[i], tool.w_0[i]
        pose.mean_v[i], pose.mean_w[i] = tool.v_0[i], tool.w_0[i]
        pose.seat_0[i] = tool.r_0[i]
        for j in range(3):
            pose.T[i, j] = pose.seat_T[i, j] = tool.T[i, j]


@kernel
def inside(p, ground, frame, x, y):
    """Whether a point lies on the map and, where there is one, on the base raster."""
    if not (p.map_min[0] <= x <= p.map_max[0] and p.map_min[1] <= y <= p.map_max[1]):
        return False
    if ground.shape[0] < 2:
        return True
    last_x, last_y = frame[0] + (ground.shape[0] - 1) * frame[2], frame[1] + (ground.shape[1] - 1) * frame[2]
    return frame[0] <= x <= last_x and frame[1] <= y <= last_y


@kernel
def wheel_inside(p, ground, frame, wheel):
    reach = p.r_w + p.h_g
    return inside(p, ground, frame, wheel.r_0[0] - reach, wheel.r_0[1] - reach) and inside(
        p, ground, frame, wheel.r_0[0] + reach, wheel.r_0[1] + reach
    )


@kernel
def patch_inside(p, ground, frame, r_0, patch):
    """Whether all of the patch around a wheel at r_0 is on the map."""
    # Its middle node is the one nearest to r_0, and a node stands for a square of the spacing around it.
    reach_x, reach_y = 0.5 * p.patch_spacing * (patch.z.shape[0] + 1), 0.5 * p.patch_spacing * (patch.z.shape[1] + 1)
    return inside(p, ground, frame, r_0[0] - reach_x, r_0[1] - reach_y) and inside(p, ground, frame, r_0[0] + reach_x, r_0[1] + reach_y)


@kernel
def _span(p, wheel):
    """Half extents [m] along the world's x and y of the soil that a wheel works on: its footprint and the ground that heaves around it."""
    level = math.sqrt(wheel.T[1, 0] ** 2 + wheel.T[1, 1] ** 2)
    along = p.r_w + p.h_g + 0.5 * p.b_w + 4.0 * p.cell
    # A cambered wheel's footprint lies beside its middle's.
    across = max(p.b_w, 0.5 * p.b_w + (p.r_w + p.h_g) * abs(wheel.T[1, 2])) + 4.0 * p.cell
    l_x, l_y = abs(wheel.T[1, 0] / level), abs(wheel.T[1, 1] / level)
    return along * l_y + across * l_x, along * l_x + across * l_y


@kernel
def approach(p, wheel, rows, marks, head, ground, frame, grid, corner, sums):
    """Make the tiles of a wheel ready if it is near the ground, which CELLS = 0 in its sums says; False if the pool is full.

    Near: its lowest point lies below the surface somewhere on a coarse raster below it, or little above.
    """
    lowest = lowest_point(p, wheel) - p.h_g - NEAR
    reach = p.r_w + p.h_g
    near = False
    for i in range(-2, 3):
        for j in range(-2, 3):
            x, y = wheel.r_0[0] + 0.5 * i * reach, wheel.r_0[1] + 0.5 * j * reach
            near = near or height_at(p, rows, marks, head, ground, frame, x, y) > lowest
    if not near:
        return True
    s_x, s_y = _span(p, wheel)
    r_0 = wheel.r_0
    i0, i1 = nearest(r_0[0] - s_x, p.cell), nearest(r_0[0] + s_x, p.cell)
    j0, j1 = nearest(r_0[1] - s_y, p.cell), nearest(r_0[1] + s_y, p.cell)
    sums[CELLS] = 0.0
    return make_ready(p, rows, marks, head, ground, frame, grid, corner, i0, i1, j0, j1)


@kernel
def make_ready(p, rows, marks, head, ground, frame, grid, corner, i0, i1, j0, j1):
    """Allocate and look up the tiles under the cells [i0, i1] x [j0, j1]; False if the pool is full."""
    for a in range(tile_of(i0), tile_of(i1) + 1):
        for b in range(tile_of(j0), tile_of(j1) + 1):
            if touch(p, rows, marks, head, ground, frame, a, b) < 0:
                return False
    look_up(marks, head, grid, corner, i0, i1, j0, j1)
    return True


@kernel
def rearrange(p, wheel, half, half_length, stamp, rows, marks, head, ground, frame, grid, corner, cells, sums, outflow):
    """Soil dragged along and soil that heaves, and what may slide after it; False if there was no room for all of that.

    Args:
        half, half_length: Half width and half length of the wheel [m].
    """
    transport(sums, cells, stamp, rows, marks, grid, corner)
    heave(p, sums, cells, wheel, half, half_length, outflow, rows, grid, corner)
    # The part of the wheel's surroundings that its footprint, the heave beside and ahead of it, and their neighbours fill.
    level = math.sqrt(wheel.T[1, 0] ** 2 + wheel.T[1, 1] ** 2)
    l_x, l_y = wheel.T[1, 0] / level, wheel.T[1, 1] / level
    near, far = 4.0 * p.cell, half + 4.0 * p.cell
    forward, backward = ends_share(wheel.v_0[0] * l_y - wheel.v_0[1] * l_x)
    front, back = sums[ALONG_MAX] + (far if forward > 0.0 else near), sums[ALONG_MIN] - (far if backward > 0.0 else near)
    x, y = wheel.r_0[0] + 0.5 * (front + back) * l_y, wheel.r_0[1] - 0.5 * (front + back) * l_x
    along, across = 0.5 * (front - back), half + far
    s_x, s_y = along * abs(l_y) + across * abs(l_x), along * abs(l_x) + across * abs(l_y)
    i0, i1 = nearest(x - s_x, p.cell), nearest(x + s_x, p.cell)
    j0, j1 = nearest(y - s_y, p.cell), nearest(y + s_y, p.cell)
    return let_slide(p, rows, marks, head, ground, frame, i0, i1, j0, j1)


@kernel
def answer(p, wheel, sums, wrench, contact):
    """Wrench and interface Jacobian from the sums of a wheel; none where it is not near the ground."""
    T = wheel.T
    level = math.sqrt(T[1, 0] ** 2 + T[1, 1] ** 2)
    l_x, l_y = T[1, 0] / level, T[1, 1] / level
    weight = wheel.active
    for k in range(3):
        contact.F[k] = weight * sums[F_X + k]
        contact.axes[0, k] = contact.axes[1, k] = contact.axes[2, k] = 0.0
        contact.point_0[k] = wheel.r_0[k]
    contact.axes[0, 0], contact.axes[0, 1] = l_y, -l_x
    contact.axes[1, 0], contact.axes[1, 1] = l_x, l_y
    contact.axes[2, 2] = 1.0
    contact.point_0[2] -= p.r_w
    wrench.f_0[0] = weight * (sums[F_X] * l_y + sums[F_Y] * l_x)
    wrench.f_0[1] = weight * (sums[F_Y] * l_y - sums[F_X] * l_x)
    wrench.f_0[2] = weight * sums[F_Z]
    wrench.t_0[0] = weight * (sums[T_X] * l_y + sums[T_Y] * l_x)
    wrench.t_0[1] = weight * (sums[T_Y] * l_y - sums[T_X] * l_x)
    wrench.t_0[2] = weight * sums[T_Z]
    contact.K[0], contact.K[1], contact.K[2] = weight * sums[K_X], weight * sums[K_Y], weight * sums[K_Z]
    contact.D[0], contact.D[1], contact.D[2] = p.tau_r * contact.K[0], p.tau_r * contact.K[1], weight * sums[D_Z]
    contact.in_contact = 1.0 if sums[F_Z] > 0.0 else 0.0
    anchor_here(wheel, contact)


@kernel
def diagnose(p, ground, frame, wheel, sums, wrench, shown):
    T, v, w = wheel.T, wheel.v_0, wheel.w_0
    level = math.sqrt(T[1, 0] ** 2 + T[1, 1] ** 2)
    v_x = (v[0] * T[1, 1] - v[1] * T[1, 0]) / level
    rim = p.r_w * (w[0] * T[1, 0] + w[1] * T[1, 1] + w[2] * T[1, 2])
    sinkage = base_height_at(p, ground, frame, wheel.r_0[0], wheel.r_0[1]) - lowest_point(p, wheel)
    front = back = 0.0
    if sums[CELLS] > 0.0:
        half = 0.5 * p.cell
        front = math.asin(min(1.0, max(-1.0, (sums[ALONG_MAX] + half) / p.r_w)))
        back = math.asin(min(1.0, max(-1.0, (sums[ALONG_MIN] - half) / p.r_w)))
    entry, exit_ = (front, back) if v_x + rim >= 0.0 else (back, front)
    torque = -(wrench.t_0[0] * T[1, 0] + wrench.t_0[1] * T[1, 1] + wrench.t_0[2] * T[1, 2])
    show(wheel, sinkage, slip_ratio(v_x, rim, SLIP_FLOOR), entry, exit_, wrench.f_0, torque, shown)
