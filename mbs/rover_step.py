"""The rover's implicit step as kernels: rows of its contacts gathered from the inputs, one step, and a look ahead.

Frames are the wheels, then the rocks. Contacts are counted alike, and after them the pairs of each hard contact slave.
"""

from __future__ import annotations

import math

from cdl_fmu.slave.kernel import kernel

from .implicit import (
    AGAINST,
    AXIS,
    CONTACT,
    NORMAL,
    ON,
    F,
    add_row,
    add_wrench,
    backward,
    begin,
    drop_row,
    end,
    factor,
    follow,
    forward,
    keep,
    start_row,
    take,
    turn_with,
)

#: Status of a step that led nowhere.
LOST = 1
LIMIT = 1e6  # [m], [rad], [m/s], [rad/s]: a state beyond it is no rover's


@kernel
def _gather(h, masses, where, soil, hard, anchors, rows, n_rows):
    """Rows of all contacts, by anchors that were sent or, where none were, those that ``anchors`` [n_ports, n, ANCHOR] hold already."""
    contacts, wheel_wrenches, supports, rock_wrenches = soil
    _, _, pairs, sent = hard
    n, n_wheels = 0, len(contacts)
    for i in range(n_wheels):
        contact = contacts[i]
        if contact.in_contact > 0.5:
            take(contact.anchor, anchors[0, i])
            for k in range(3):
                start_row(rows[n], i, -1, i, k == 2, contact.F[k], contact.K[k], contact.D[k], masses[i])
                _along(1.0, contact.axes[k], contact.point_0, i, where, anchors[0], rows[n])
                n += 1
    for j in range(len(supports)):
        support, i = supports[j], n_wheels + j
        if support.in_contact > 0.5:
            take(support.anchor, anchors[0, i])
            for k in range(3):
                start_row(rows[n], i, -1, i, k == 2, rock_wrenches[j].f_0[k], support.K[k], support.D[k], masses[i])
                unit = rows[n, AXIS : AXIS + 3]
                unit[k] = 1.0
                follow(1.0, unit, support.point_0, i, where, anchors[0], rows[n])
                n += 1
            for k in range(3):
                start_row(rows[n], i, -1, i, False, 0.0, support.K_r[k], support.D_r[k], masses[i])
                turn_with(1.0 * (k == 0), 1.0 * (k == 1), 1.0 * (k == 2), i, where, anchors[0], rows[n])
                n += 1
    first = n_wheels + len(supports)
    for p in range(len(pairs)):
        for i in range(sent.shape[1]):
            take(sent[p, i], anchors[1 + p, i])
        for c in range(pairs.shape[1]):
            pair = pairs[p, c]
            on, against = int(pair.on) - 1, int(pair.against) - 1
            if on < 0:
                continue
            mass = masses[on] if against < 0 else min(masses[on], masses[against])
            for k in range(3):
                start_row(rows[n], on, against, first + c, k == 2, pair.F[k], pair.K[k], pair.D[k], mass)
                _along(1.0, pair.axes[k], pair.point_0, on, where, anchors[1 + p], rows[n])
                if against >= 0:
                    follow(-1.0, pair.axes[k], pair.point_0, against, where, anchors[1 + p], rows[n])
                n += 1
        first += pairs.shape[1]
    for k in range(n):
        begin(h, rows[k])
    n_rows[0] = n


@kernel
def _along(sign, axis, point, i, where, anchors, row):
    for k in range(3):
        row[AXIS + k] = axis[k]
    follow(sign, axis, point, i, where, anchors, row)


@kernel
def _assemble(h, drives, dynamics, where, soil, hard, hard_acts, lifted, rows, n_rows, q_dot, A, forces):
    """The step's matrix, factored, and the forces at its begin; False if there is no such step.

    Unless ``hard_acts``, what hard contacts' wrenches hold beside their pairs, rigid impulses, is left out.
    """
    gains, spins, steers, wheel_rate, steer_rate = drives
    mass, bias, moves = dynamics
    J = where[3]
    contacts, wheel_wrenches, supports, rock_wrenches = soil
    hard_wheels, hard_rocks, _, _ = hard
    n_wheels = len(contacts)
    for d in range(forces.size):
        forces[d] = -bias[d] - gains[d] * q_dot[d]
        for e in range(d + 1):
            A[d, e] = mass[d, e]
        A[d, d] += h * gains[d]
    for i in range(spins.size):
        forces[spins[i]] += gains[spins[i]] * wheel_rate[i]
        if steers[i] >= 0:
            forces[steers[i]] += gains[steers[i]] * steer_rate[i]
    for i in range(n_wheels):
        if lifted[i] == 0.0:
            add_wrench(J[i], wheel_wrenches[i].f_0, wheel_wrenches[i].t_0, forces)
        if hard_acts:
            for p in range(len(hard_wheels)):
                add_wrench(J[i], hard_wheels[p, i].f_0, hard_wheels[p, i].t_0, forces)
    for j in range(len(supports)):
        i = n_wheels + j
        if lifted[i] == 0.0:
            add_wrench(J[i], rock_wrenches[j].f_0, rock_wrenches[j].t_0, forces)
        if hard_acts:
            for p in range(len(hard_wheels)):
                add_wrench(J[i], hard_rocks[p, j].f_0, hard_rocks[p, j].t_0, forces)
    for k in range(n_rows[0]):
        contact = int(rows[k, CONTACT])
        if not hard_acts and contact >= n_wheels + len(supports):
            rows[k, F] = 0.0  # what is left out holds it, too
        if lifted[contact] == 0.0:
            add_row(h, rows[k], A, forces)
        elif contact >= n_wheels + len(supports):  # of the others the whole wrench is left out
            drop_row(rows[k], forces)
    for d in range(forces.size):
        moved = False
        for i in range(len(moves)):
            moved |= moves[i, d] > 0.0
        if not moved:  # a rock that is fixed
            forces[d] = 0.0
    return factor(A)


@kernel
def advance(h, drives, soil, hard, work, q, q_dot):
    """Step rover and rocks on, coordinates and rates in place; ``work.applied`` gets the contact forces that acted on the frames."""
    where, dynamics = (work.R, work.T, work.twists, work.J), (work.mass, work.bias, work.moves)
    anchors, lifted, rows, n_rows, A, forces = work.anchors, work.lifted, work.rows, work.n_rows, work.A, work.forces
    for p in range(len(anchors)):
        keep(work.R, work.T, work.twists, anchors[p])
    for c in range(lifted.size):
        lifted[c] = 0.0
    _gather(h, work.masses, where, soil, hard, anchors, rows, n_rows)
    while True:
        if not _assemble(h, drives, dynamics, where, soil, hard, True, lifted, rows, n_rows, q_dot, A, forces):
            return LOST
        forward(A, forces)
        backward(A, forces)
        for d in range(forces.size):
            forces[d] *= h  # now the change of velocity
        pulled = False
        for k in range(n_rows[0]):
            contact = int(rows[k, CONTACT])
            if rows[k, NORMAL] > 0.0 and lifted[contact] == 0.0 and end(h, rows[k], forces) < 0.0:
                lifted[contact] = 1.0
                pulled = True
        if not pulled:
            break
    _sum_up(h, soil, hard, lifted, rows, n_rows, forces, work.applied)
    for d in range(q_dot.size):
        q_dot[d] += forces[d]
    _move_on(h, q, q_dot, len(work.applied) - len(soil[0]))
    for k in range(q.size):
        if not abs(q[k]) <= LIMIT:
            return LOST
    for k in range(q_dot.size):
        if not abs(q_dot[k]) <= LIMIT:
            return LOST
    return 0


@kernel
def _sum_up(h, soil, hard, lifted, rows, n_rows, change, applied):
    contacts, wheel_wrenches, supports, rock_wrenches = soil
    hard_wheels, hard_rocks, _, _ = hard
    n_wheels = len(contacts)
    for k in range(3):
        for i in range(len(applied)):
            f = wheel_wrenches[i].f_0[k] if i < n_wheels else rock_wrenches[i - n_wheels].f_0[k]
            applied[i, k] = f if lifted[i] == 0.0 else 0.0
            for p in range(len(hard_wheels)):
                applied[i, k] += hard_wheels[p, i].f_0[k] if i < n_wheels else hard_rocks[p, i - n_wheels].f_0[k]
    for r in range(n_rows[0]):
        row, contact = rows[r], int(rows[r, CONTACT])
        f = -row[F]
        if lifted[contact] == 0.0:
            f += end(h, row, change)
        elif contact < len(applied):
            continue
        on, against = int(row[ON]), int(row[AGAINST])
        for k in range(3):
            applied[on, k] += f * row[AXIS + k]
            if against >= 0:
                applied[against, k] -= f * row[AXIS + k]


@kernel
def _move_on(h, q, q_dot, n_rocks):
    """Move the coordinates with the rates; those of the rocks, the last ones, are position and quaternion."""
    n = q_dot.size - 6 * n_rocks
    for k in range(n):
        q[k] += h * q_dot[k]
    for j in range(n_rocks):
        at, rate = n + 7 * j, n + 6 * j
        for k in range(3):
            q[at + k] += h * q_dot[rate + k]
        w_x, w_y, w_z = q_dot[rate + 3], q_dot[rate + 4], q_dot[rate + 5]
        half = 0.5 * h * math.sqrt(w_x * w_x + w_y * w_y + w_z * w_z)
        share = 0.5 * h * (math.sin(half) / half if half > 1e-12 else 1.0)
        a, b, c, d = q[at + 3], q[at + 4], q[at + 5], q[at + 6]
        e, f, g, i = math.cos(half), share * w_x, share * w_y, share * w_z
        a, b, c, d = (
            a * e - b * f - c * g - d * i,
            a * f + b * e + c * i - d * g,
            a * g - b * i + c * e + d * f,
            a * i + b * g - c * f + d * e,
        )
        norm = math.sqrt(a * a + b * b + c * c + d * d)
        q[at + 3], q[at + 4], q[at + 5], q[at + 6] = a / norm, b / norm, c / norm, d / norm


@kernel
def predict(h, drives, soil, hard, work, q_dot, inverse, free):
    """Inverse inertia of the next step's own matrix at all frames, and their twists at its end without rigid impulses.

    Of the former it is the lower triangle, row by row. All other forces stay as they are; those that come with a Jacobian go on along it
    from the poses before the step just done, for which they were evaluated.
    """
    where, dynamics = (work.R, work.T, work.twists, work.J), (work.mass, work.bias, work.moves)
    anchors, lifted, rows, n_rows, A, forces = work.anchors, work.lifted, work.rows, work.n_rows, work.A, work.forces
    twists, J, room = work.twists, work.J, work.room
    for p in range(len(anchors)):
        keep(work.R_before, work.T_before, work.twists_before, anchors[p])
    for c in range(lifted.size):
        lifted[c] = 0.0
    _gather(h, work.masses, where, soil, hard, anchors, rows, n_rows)
    _assemble(h, drives, dynamics, where, soil, hard, False, lifted, rows, n_rows, q_dot, A, forces)
    forward(A, forces)
    for r in range(len(room)):
        for d in range(forces.size):
            room[r, d] = J[r // 6, r % 6, d]
        first = forward(A, room[r])
        change = 0.0
        for d in range(first, forces.size):
            change += room[r, d] * forces[d]
        free[r] = twists[r // 6, r % 6] + h * change
        for s in range(r + 1):
            total = 0.0
            for d in range(first, forces.size):
                total += room[r, d] * room[s, d]
            inverse[r * (r + 1) // 2 + s] = total
