"""The SCM step: its stages, and the two kernels that run them, with one thread or with several.

Two stages are work for several threads: the stresses of each tool, which read the soil as it was and write to memory of their own, and
the landslides of each tile, which only find what is to move. All else is serial, and what is summed over cells is exact, so no result
depends on the number of threads.
"""

from __future__ import annotations

from functools import cache

import numba

from ..contact import NO_DATA, has_pose, lowest_point, refusal, sees
from ..slave.kernel import kernel
from ..slave.model import STATUS_SPAN
from ..strength import tabulate_pushes
from .bodies import (
    BODY_NO_DATA,
    BODY_THROUGH,
    answer_body,
    approach_with_mesh,
    body_contact,
    box_around,
    half_sizes,
    rearrange_body,
    refused_body,
    wheel_contact_with_mesh,
)
from .columns import CELLS, DEEPEST, DEPTH, PUSHED_X, PUSHED_Y, SIDE_ACROSS, SIDE_ALONG, SUMS
from .erosion import settle, slide
from .flow import press
from .heights import fill_patch, height_at, is_set
from .stress import deepest_of_table, pressure_modulus, tabulate
from .tiles import SLIDING, base_height_at
from .tools import answer, approach, diagnose, patch_inside, rearrange, wheel_inside
from .wheel import wheel_contact

#: Status numbers beside those of wheels and bodies.
OUTSIDE, THROUGH, FULL, PATCH_OUTSIDE = 5, 6, 7, 8
NO_ROOM_TO_SLIDE = 14


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
def _initialise(t, p, x, y, *arrays):
    x.stamp = 0.0
    x.sweep_time = 0.0
    x.compacted = 0.0
    tabulate(p.n, deepest_of_table(p), x.powers)
    tabulate_pushes(p.phi, x.pushes)
    for i in range(len(x.wheel)):
        x.wheel[i].silent = x.wheel[i].side[0] = x.wheel[i].side[1] = 0.0
        x.wheel[i].pushed[0] = x.wheel[i].pushed[1] = 0.0


@kernel
def _initialise_with_bodies(t, p, x, y, *arrays):
    _initialise(t, p, x, y, *arrays)
    for i in range(len(x.body)):
        x.body[i].silent = x.body[i].side[0] = x.body[i].side[1] = 0.0
        x.body[i].pushed[0] = x.body[i].pushed[1] = 0.0


def initialise_kernel(bodies: bool):
    """The kernel that initialises a model with or without bodies."""
    return _initialise_with_bodies if bodies else _initialise


@cache
def step_kernels(patches: bool, bodies: bool, compaction: bool):
    """The step of a model with or without patches, bodies and compaction in its patches; with one thread and with several.

    Those without have no such records.
    """

    @kernel
    def refused(p, u, x, y, *arrays):
        """Number of the error that the step ends with before anything changes, or 0."""
        rows, marks, head, ground, frame, elements, ranges, shapes = arrays[:8]
        for i in range(len(u.wheel)):
            wheel = u.wheel[i]
            surface = height_at(p, rows, marks, head, ground, frame, wheel.r_0[0], wheel.r_0[1])
            status = refusal(p, wheel, x.wheel[i].silent, surface)
            if status:
                return status + STATUS_SPAN * i
            if wheel.active > 0.0 and has_pose(wheel) and not wheel_inside(p, ground, frame, wheel):
                return OUTSIDE + STATUS_SPAN * i
        if bodies:
            for i in range(len(u.body)):
                k = len(u.wheel) + i
                status = refused_body(p, ground, frame, u.body[i], x.body[i].silent, ranges[k, 1] - ranges[k, 0], shapes[k])
                if status:
                    return status + STATUS_SPAN * i
        if patches:
            for i in range(len(u.trailing)):
                if is_set(u.trailing[i].r_0) and not patch_inside(p, ground, frame, u.trailing[i].r_0, y.patch[i]):
                    return PATCH_OUTSIDE + STATUS_SPAN * i
        return 0

    @kernel
    def make_all_ready(p, u, *arrays):
        """Make the tiles of all tools that are near the ground ready; CELLS of the others is -1. False if the pool is full."""
        rows, marks, head, ground, frame, elements, ranges, shapes, grid, corner, cells, sums = arrays[:12]
        for k in range(len(sums)):
            sums[k, CELLS] = -1.0
        for i in range(len(u.wheel)):
            wheel = u.wheel[i]
            if wheel.active > 0.0 and has_pose(wheel):
                if ranges[i, 1] > ranges[i, 0]:
                    done = approach_with_mesh(p, wheel, shapes[i], rows, marks, head, ground, frame, grid[i], corner[i], sums[i])
                else:
                    done = approach(p, wheel, rows, marks, head, ground, frame, grid[i], corner[i], sums[i])
                if not done:
                    return False
        if bodies:
            for i in range(len(u.body)):
                k, body, done = len(u.wheel) + i, u.body[i], True
                if has_pose(body):
                    done = approach_with_mesh(p, body, shapes[k], rows, marks, head, ground, frame, grid[k], corner[k], sums[k])
                if not done:
                    return False
        return True

    @kernel
    def stress(k, h, p, u, x, *arrays):
        """Stresses on tool k, on the soil as it was at the step's begin."""
        rows, marks, head, ground, frame, elements, ranges, shapes = arrays[:8]
        grid, corner, cells, sums, blocks, outflow, placed, links = arrays[8:16]
        if sums[k, CELLS] < 0.0:
            forget(sums[k])
        elif k < len(u.wheel):
            wheel, modulus = u.wheel[k], pressure_modulus(p, p.b_w)
            recall(x.wheel[k], sums[k])
            sums[k, DEPTH] = max(base_height_at(p, ground, frame, wheel.r_0[0], wheel.r_0[1]) - lowest_point(p, wheel), 0.0)
            if ranges[k, 1] > ranges[k, 0]:
                wheel_contact_with_mesh(
                    p,
                    x,
                    h,
                    wheel,
                    modulus,
                    shapes[k],
                    elements,
                    ranges[k],
                    rows,
                    grid[k],
                    corner[k],
                    placed[k],
                    links[k],
                    cells[k],
                    sums[k],
                )
            else:
                wheel_contact(p, wheel, (x.powers, x.pushes), modulus, h, x.stamp, rows, grid[k], corner[k], blocks[k], cells[k], sums[k])
        elif bodies:
            i = k - len(u.wheel)
            recall(x.body[i], sums[k])
            body = u.body[i]
            sums[k, DEPTH] = max(base_height_at(p, ground, frame, body.r_0[0], body.r_0[1]) - box_around(body, shapes[k])[4], 0.0)
            body_contact(
                p,
                x,
                h,
                u.body[i],
                shapes[k],
                elements,
                ranges[k],
                rows,
                grid[k],
                corner[k],
                placed[k],
                links[k],
                cells[k],
                sums[k],
            )

    @kernel
    def pressed_through(p, u, *arrays):
        """Number of the error that a tool is pressed through the layer, or 0."""
        sums = arrays[11]
        for k in range(len(sums)):
            if sums[k, CELLS] > 0.0 and sums[k, DEEPEST] > p.layer_depth:
                n_wheels = len(u.wheel)
                return THROUGH + STATUS_SPAN * k if k < n_wheels else BODY_THROUGH + STATUS_SPAN * (k - n_wheels)
        return 0

    @kernel
    def answer_all(p, u, x, y, *arrays):
        """The outputs of all tools, and what they remember; number of the warning that the step ends with, or 0."""
        ground, frame, sums = arrays[3], arrays[4], arrays[11]
        status = 0
        for i in range(len(u.wheel)):
            wheel = u.wheel[i]
            remember(sums[i], x.wheel[i])
            if sees(wheel, x.wheel[i], y.wheel[i], y.contact[i], y.diagnostics[i]):
                if sums[i, CELLS] >= 0.0:
                    answer(p, wheel, sums[i], y.wheel[i], y.contact[i])
                diagnose(p, ground, frame, wheel, sums[i], y.wheel[i], y.diagnostics[i])
            elif x.wheel[i].silent > 0.0:
                status = NO_DATA + STATUS_SPAN * i
        if bodies:
            for i in range(len(u.body)):
                k = len(u.wheel) + i
                remember(sums[k], x.body[i])
                if not answer_body(u.body[i], x.body[i], sums[k], y.body[i]):
                    status = BODY_NO_DATA + STATUS_SPAN * i
        return status

    @kernel
    def displace(p, u, x, *arrays):
        """Press the soil below all tools, and move what they displace and drag along; False if there was no room to let all of it slide."""
        rows, marks, head, ground, frame, elements, ranges, shapes, grid, corner, cells, sums, blocks, outflow = arrays[:14]
        done = True
        for k in range(len(sums)):
            if sums[k, CELLS] > 0.0:
                x.compacted += press(p, sums[k], cells[k], x.stamp, rows, marks)
        for i in range(len(u.wheel)):
            if sums[i, CELLS] > 0.0:
                half, half_length = half_sizes(p, ranges[i], shapes[i])
                done &= rearrange(
                    p,
                    u.wheel[i],
                    half,
                    half_length,
                    x.stamp,
                    rows,
                    marks,
                    head,
                    ground,
                    frame,
                    grid[i],
                    corner[i],
                    cells[i],
                    sums[i],
                    outflow[i],
                )
        if bodies:
            for i in range(len(u.body)):
                k = len(u.wheel) + i
                if sums[k, CELLS] > 0.0:
                    done &= rearrange_body(
                        p, u.body[i], shapes[k], x.stamp, rows, marks, head, ground, frame, grid[k], corner[k], cells[k], sums[k]
                    )

        return done

    @kernel
    def sweeps_due(p, x, h):
        """Number of sweeps of landslides in this step."""
        x.sweep_time += h
        due = 0
        while x.sweep_time >= p.erosion_interval * (1.0 - 1e-9):
            x.sweep_time -= p.erosion_interval
            due += 1
        return min(due, int(p.erosion_sweeps))

    @kernel
    def slide_tile(k, p, x, *arrays):
        """What a sweep does to the k-th tile that slides."""
        rows, marks, head, ground, frame = arrays[:5]
        slide(p, rows, marks, head, ground, frame, x.stamp, k, arrays[16][k])

    @kernel
    def settle_all(p, *arrays):
        rows, marks, head, ground, frame = arrays[:5]
        return settle(p, rows, marks, head, ground, frame, arrays[16], arrays[17])

    @kernel
    def fill_patches(p, u, y, *arrays):
        if patches:
            rows, marks, head, ground, frame = arrays[:5]
            for i in range(len(u.trailing)):
                patch = y.patch[i]
                if compaction:
                    fill_patch(p, rows, marks, head, ground, frame, u.trailing[i].r_0, patch, patch.sinkage, patch.yield_pressure)
                else:
                    fill_patch(p, rows, marks, head, ground, frame, u.trailing[i].r_0, patch)

    @kernel
    def step(t, h, p, u, x, y, *arrays):
        head, sums = arrays[2], arrays[11]
        status = refused(p, u, x, y, *arrays)
        if status:
            return status
        if not make_all_ready(p, u, *arrays):
            return FULL
        x.stamp += 1.0
        for k in range(len(sums)):
            stress(k, h, p, u, x, *arrays)
        status = pressed_through(p, u, *arrays)
        if status:
            x.stamp -= 1.0
            return status
        status = answer_all(p, u, x, y, *arrays)
        done = displace(p, u, x, *arrays)
        for _ in range(sweeps_due(p, x, h)):
            for k in range(head[SLIDING]):
                slide_tile(k, p, x, *arrays)
            done &= settle_all(p, *arrays)
        fill_patches(p, u, y, *arrays)
        return status if done or status else NO_ROOM_TO_SLIDE

    # numba's prange hands arrays to its threads, no records: there these are taken out of arrays of length one.
    @kernel
    def stress_in_thread(k, h, P, U, X, *arrays):
        stress(k, h, P[0], U[0], X[0], *arrays)

    @kernel
    def slide_in_thread(k, P, X, *arrays):
        slide_tile(k, P[0], X[0], *arrays)

    @kernel(parallel=True)
    def parallel_step(t, h, P, U, X, Y, *arrays):
        p, u, x, y = P[0], U[0], X[0], Y[0]
        head, sums = arrays[2], arrays[11]
        status = refused(p, u, x, y, *arrays)
        if status:
            return status
        if not make_all_ready(p, u, *arrays):
            return FULL
        x.stamp += 1.0
        for k in numba.prange(len(sums)):
            stress_in_thread(k, h, P, U, X, *arrays)
        status = pressed_through(p, u, *arrays)
        if status:
            x.stamp -= 1.0
            return status
        status = answer_all(p, u, x, y, *arrays)
        done = displace(p, u, x, *arrays)
        for _ in range(sweeps_due(p, x, h)):
            for k in numba.prange(head[SLIDING]):
                slide_in_thread(k, P, X, *arrays)
            done &= settle_all(p, *arrays)
        fill_patches(p, u, y, *arrays)
        return status if done or status else NO_ROOM_TO_SLIDE

    return step, parallel_step
