"""Bodies at rest: most rocks of a scene do not move, and soil that nothing moves on answers as it did.

Own choice: the contact of a body that is nearly at rest is worked out anew when its surface has moved by ``FARTHEST`` since it was last, or
its force changed by ``SHARE``, when the soil at it has changed, and after ``MOST_STEPS`` steps at latest. In between its wrench is
continued along the interface Jacobian that was sent with it, so it stays a restoring force that dissipates. How far the body moved in that
time counts as shear displacement in the step that works the contact out again, so none is lost.

Own choice: a body is seated on the soil's cells. Which of its elements are on which cells changes with every ``SEAT`` that it moves and not
in between, as force jumps a little where an element goes from one cell to the next, on which a body could rock for ever.
"""

from __future__ import annotations

import math

from ..contact import anchor_here, has_pose
from ..frames import cross, is_rotation
from ..slave.kernel import kernel
from .bodies import box_around
from .columns import CELLS, F_X, HALF, MIDDLE, SLOW, SOIL, STILL, T_X
from .support import answer_support
from .tiles import BASE, FILL, OWNER, SINKAGE, STAMP, in_tile, nearest, row_of
from .tools import remember

#: Motion [m] and speed [m/s] of a body's surface, and number of steps, up to which its wrench is continued.
FARTHEST, FASTEST, MOST_STEPS = 2e-6, 1e-3, 100
#: Share of a body's force by which that may change meanwhile, by the stiffness that was sent: what it may jump by in the end is less.
SHARE = 2e-4
#: Motion of a body's surface after which it is seated anew, in cells.
SEAT = 0.02
#: Change of the soil, summed over cells, that is none [m]: the last grains of a landslide come to rest slowly.
LEAST_CHANGE = 1e-5
#: Cells around a body's box whose soil its contact reads.
_AROUND = 3


@kernel
def take_seats(p, u, memory, *arrays):
    """Seat each body where it was, unless it has moved too far since."""
    shapes, poses = arrays[7], arrays[18]
    for i in range(len(u.body)):
        k = len(u.wheel) + i
        body, seat = poses[k], memory.body[i].seat
        if is_rotation(seat.T) and has_pose(body) and _distance(body, seat, shapes[k]) <= SEAT * p.cell:
            for d in range(3):
                body.seat_0[d] = seat.r_0[d]
                for e in range(3):
                    body.seat_T[d, e] = seat.T[d, e]


@kernel
def stand_up(seat):
    """No seat."""
    for d in range(3):
        for e in range(3):
            seat.T[d, e] = 0.0


@kernel
def answer_body(p, h, body, known, sums, wrench, support):
    """Wrench and interface Jacobian of a body, and what is known of it; False if it has no pose, whose steps are counted."""
    if sums[STILL] > 0.0:
        _answer_still(h, body, known, wrench, support)
        return True
    remember(sums, known)
    for d in range(3):
        wrench.f_0[d] = sums[F_X + d] if sums[CELLS] >= 0.0 else 0.0
        wrench.t_0[d] = sums[T_X + d] if sums[CELLS] >= 0.0 else 0.0
        known.seat.r_0[d] = body.seat_0[d]
        for e in range(3):
            known.seat.T[d, e] = body.seat_T[d, e]
    answer_support(p, body, sums, support)
    _hold(body, sums, wrench, support, known)
    if not has_pose(body):
        known.silent += 1.0
        return False
    known.silent, known.laid = 0.0, 1.0
    return True


@kernel
def find_still(p, h, u, memory, *arrays):
    """Find which bodies are still, and over which time and with which mean velocities the others moved since their contact was known."""
    rows, shapes, grid, corner, sums, poses = arrays[0], arrays[7], arrays[8], arrays[9], arrays[11], arrays[18]
    n_wheels = len(u.wheel)
    for i in range(len(u.body)):
        k = n_wheels + i
        sums[k, STILL] = sums[k, SLOW] = 0.0
        body, known = poses[k], memory.body[i]
        if sums[k, CELLS] < 0.0 or not has_pose(body):
            continue
        if _length(body.v_0) + _reach(shapes[k]) * _length(body.w_0) <= FASTEST:
            sums[k, SLOW] = 1.0
            sums[k, SOIL] = _fingerprint(p, body, shapes[k], rows, grid[k], corner[k])
        if known.held.in_contact == 0.0:
            continue
        d_x, d_y, d_z = _moved(body, known.held.anchor)
        r_x, r_y, r_z = _turned(body, known.held.anchor)
        is_same = sums[k, SLOW] > 0.0 and abs(sums[k, SOIL] - known.soil) <= LEAST_CHANGE
        if is_same and known.steps < MOST_STEPS and _distance(body, known.held.anchor, shapes[k]) <= min(FARTHEST, known.farthest):
            sums[k, STILL] = 1.0
        if sums[k, STILL] == 0.0 and known.steps > 0.0:
            body.time = known.since + h
            rate = 1.0 / body.time
            body.mean_v[0], body.mean_v[1], body.mean_v[2] = d_x * rate, d_y * rate, d_z * rate
            body.mean_w[0], body.mean_w[1], body.mean_w[2] = r_x * rate, r_y * rate, r_z * rate


@kernel
def _distance(body, before, shape):
    """How far a body's surface has moved since a pose [m], at most."""
    return _length(_moved(body, before)) + _reach(shape) * _length(_turned(body, before))


@kernel
def _reach(shape):
    """Largest distance [m] of a body's surface from its origin, at most."""
    square = 0.0
    for d in range(3):
        square += (abs(shape[MIDDLE + d]) + shape[HALF + d]) ** 2
    return math.sqrt(square)


@kernel(inline=True)
def _length(a):
    return math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


@kernel(inline=True)
def _moved(body, anchor):
    """Displacement [m] of a body's origin since the anchor."""
    return body.r_0[0] - anchor.r_0[0], body.r_0[1] - anchor.r_0[1], body.r_0[2] - anchor.r_0[2]


@kernel
def _turned(body, anchor):
    """Small rotation vector [rad] since the anchor, in world axes."""
    x = y = z = 0.0
    for d in range(3):
        x += body.T[d, 2] * anchor.T[d, 1] - body.T[d, 1] * anchor.T[d, 2]
        y += body.T[d, 0] * anchor.T[d, 2] - body.T[d, 2] * anchor.T[d, 0]
        z += body.T[d, 1] * anchor.T[d, 0] - body.T[d, 0] * anchor.T[d, 1]
    return 0.5 * x, 0.5 * y, 0.5 * z


@kernel
def _window(p, body, shape):
    """Cells [i0, i1] x [j0, j1] whose soil a body's contact reads."""
    low_x, high_x, low_y, high_y, _ = box_around(body, shape)
    return (
        nearest(low_x, p.cell) - _AROUND,
        nearest(high_x, p.cell) + _AROUND,
        nearest(low_y, p.cell) - _AROUND,
        nearest(high_y, p.cell) + _AROUND,
    )


@kernel
def _fingerprint(p, body, shape, rows, grid, corner):
    """A number [m] that differs where the soil does that a body's contact reads."""
    i0, i1, j0, j1 = _window(p, body, shape)
    total = 0.0
    for i in range(i0, i1 + 1):
        for j in range(j0, j1 + 1):
            row, a, b = row_of(grid, corner, i, j), in_tile(i), in_tile(j)
            # Weights of which no two cells near one another have the same: soil that goes from one to the other is told.
            weight = 1.0 + 0.37 * (i - i0) + 0.61 * (j - j0)
            total += weight * (rows[row, BASE, a, b] + rows[row, FILL, a, b] + 3.1 * rows[row, SINKAGE, a, b])
    return total


@kernel
def _hold(body, sums, wrench, support, known):
    """Keep what was found of a body's contact, for as long as it is still; nothing if it may not be."""
    held = known.held
    known.steps = known.since = 0.0
    held.in_contact = support.in_contact if sums[SLOW] > 0.0 else 0.0
    if held.in_contact == 0.0:
        return
    known.soil = sums[SOIL]
    known.farthest = SHARE * _length(wrench.f_0) / max(support.K[0], support.K[1], support.K[2])
    anchor_here(body, held)
    for d in range(3):
        held.f_0[d], held.t_0[d], held.point_0[d] = wrench.f_0[d], wrench.t_0[d], support.point_0[d]
        held.K[d], held.D[d], held.K_r[d], held.D_r[d] = support.K[d], support.D[d], support.K_r[d], support.D_r[d]


@kernel
def _answer_still(h, body, known, wrench, support):
    """Wrench and interface Jacobian of a body that is still."""
    held = known.held
    known.steps, known.since = known.steps + 1.0, known.since + h
    at, anchor, f, t = held.point_0, held.anchor, wrench.f_0, wrench.t_0
    a_x, a_y, a_z = at[0] - anchor.r_0[0], at[1] - anchor.r_0[1], at[2] - anchor.r_0[2]
    moved, turned = _moved(body, anchor), _turned(body, anchor)
    w = body.w_0[0] - anchor.w_0[0], body.w_0[1] - anchor.w_0[1], body.w_0[2] - anchor.w_0[2]
    swung, faster = cross(turned[0], turned[1], turned[2], a_x, a_y, a_z), cross(w[0], w[1], w[2], a_x, a_y, a_z)
    from_point = cross(a_x, a_y, a_z, held.f_0[0], held.f_0[1], held.f_0[2])
    for d in range(3):
        f[d] = held.f_0[d] - held.K[d] * (moved[d] + swung[d]) - held.D[d] * (body.v_0[d] - anchor.v_0[d] + faster[d])
        t[d] = held.t_0[d] - from_point[d] - held.K_r[d] * turned[d] - held.D_r[d] * w[d]
    to_origin = cross(at[0] - body.r_0[0], at[1] - body.r_0[1], at[2] - body.r_0[2], f[0], f[1], f[2])
    for d in range(3):
        t[d] += to_origin[d]
        support.point_0[d] = at[d]
        support.K[d], support.D[d], support.K_r[d], support.D_r[d] = held.K[d], held.D[d], held.K_r[d], held.D_r[d]
    support.in_contact = 1.0
    anchor_here(body, support)


@kernel
def stay(p, k, body, shape, stamp, rows, marks, grid, corner):
    """Tool k, a still body, goes on to be on its cells."""
    i0, i1, j0, j1 = _window(p, body, shape)
    for i in range(i0, i1 + 1):
        for j in range(j0, j1 + 1):
            row, a, b = row_of(grid, corner, i, j), in_tile(i), in_tile(j)
            if rows[row, STAMP, a, b] == stamp - 1.0 and rows[row, OWNER, a, b] == k + 1.0:
                rows[row, STAMP, a, b] = stamp
                marks[row, 0] = 1
