"""The SCM step: its stages, and the two kernels that run them, with one thread or with several.

Two stages are work for several threads: the stresses of each tool, which read the soil as it was and write to memory of their own, and
the landslides of each tile, which only find what is to move. All else is serial, and what is summed over cells is exact, so no result
depends on the number of threads.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numba
import numpy as np

from ..contact import NO_DATA, has_pose, is_set, lowest_point, refusal, sees
from ..slave.kernel import kernel
from ..slave.model import STATUS_SPAN
from ..strength import tabulate_pushes
from .bodies import (
    BODY_NO_DATA,
    BODY_THROUGH,
    approach_with_mesh,
    body_contact,
    box_around,
    half_sizes,
    rearrange_body,
    refused_body,
    wheel_contact_with_mesh,
)
from .columns import CELLS, DEEPEST, DEPTH, STILL
from .embedding import lay_around, take_back
from .erosion import settle, slide
from .flow import press
from .heights import fill_patch, height_at
from .rest import answer_body, find_still, stand_up, stay, take_seats
from .stress import deepest_of_table, pressure_modulus, tabulate
from .tiles import SLIDING, base_height_at
from .tools import answer, approach, diagnose, forget, patch_inside, place, rearrange, recall, remember, wheel_inside
from .wheel import wheel_contact

#: Status numbers beside those of wheels and bodies.
OUTSIDE, THROUGH, FULL, PATCH_OUTSIDE = 5, 6, 7, 8
NO_ROOM_TO_SLIDE = 14


class Inputs(NamedTuple):
    """What comes from the tools, each an array of records, as in the declaration."""

    wheel: np.ndarray
    trailing: np.ndarray
    body: np.ndarray


class Memory(NamedTuple):
    """What tools remember of their contact."""

    wheel: np.ndarray
    body: np.ndarray


class Outputs(NamedTuple):
    """What goes to the tools."""

    wheel: np.ndarray
    contact: np.ndarray
    diagnostics: np.ndarray
    patch: np.ndarray
    body: np.ndarray
    support: np.ndarray


#: What the kernels get: arrays of any length, so that one step serves models of all sizes.
ARGUMENTS = (
    *("p", "u.wheel", "u.trailing", "u.body", "x", "x.wheel", "x.body"),
    *("y.wheel", "y.contact", "y.diagnostics", "y.patch", "y.body", "y.support"),
)


@kernel
def initialise(t, P, X, wheels, bodies, wrenches, contacts, diagnostics, patches, answers, supports, arrays):
    p, x = P[0], X[0]
    x.stamp = 0.0
    x.sweep_time = 0.0
    x.compacted = 0.0
    tabulate(p.n, deepest_of_table(p), x.powers)
    tabulate_pushes(p.phi, x.pushes)
    for i in range(len(wheels)):
        _start(wheels[i])
    for i in range(len(bodies)):
        _start(bodies[i])
        bodies[i].laid = bodies[i].steps = bodies[i].since = bodies[i].held.in_contact = 0.0
        stand_up(bodies[i].seat)


@kernel
def _start(memory):
    memory.silent = memory.side[0] = memory.side[1] = 0.0
    memory.pushed[0] = memory.pushed[1] = 0.0


@kernel
def place_all(u, h, *arrays):
    """Poses of all tools with a mesh, wheels and bodies alike, for code that serves both."""
    ranges, poses = arrays[6], arrays[18]
    for i in range(len(u.wheel)):
        if ranges[i, 1] > ranges[i, 0]:
            place(u.wheel[i], h, poses[i])
    for i in range(len(u.body)):
        place(u.body[i], h, poses[len(u.wheel) + i])


@kernel
def refused(p, u, memory, y, *arrays):
    """Number of the error that the step ends with before anything changes, or 0."""
    rows, marks, head, ground, frame, elements, ranges, shapes = arrays[:8]
    poses = arrays[18]
    for i in range(len(u.wheel)):
        wheel = u.wheel[i]
        surface = height_at(p, rows, marks, head, ground, frame, wheel.r_0[0], wheel.r_0[1])
        status = refusal(p, wheel, memory.wheel[i].silent, surface)
        if status:
            return status + STATUS_SPAN * i
        if wheel.active > 0.0 and has_pose(wheel) and not wheel_inside(p, ground, frame, wheel):
            return OUTSIDE + STATUS_SPAN * i
    for i in range(len(u.body)):
        k = len(u.wheel) + i
        status = refused_body(p, ground, frame, poses[k], memory.body[i].silent, ranges[k, 1] - ranges[k, 0], shapes[k])
        if status:
            return status + STATUS_SPAN * i
    for i in range(len(u.trailing)):
        if is_set(u.trailing[i].r_0) and not patch_inside(p, ground, frame, u.trailing[i].r_0, y.patch[i]):
            return PATCH_OUTSIDE + STATUS_SPAN * i
    return 0


@kernel
def make_all_ready(p, u, *arrays):
    """Make the tiles of all tools that are near the ground ready; CELLS of the others is -1. False if the pool is full."""
    rows, marks, head, ground, frame, elements, ranges, shapes, grid, corner, cells, sums = arrays[:12]
    poses = arrays[18]
    for k in range(len(sums)):
        sums[k, CELLS] = -1.0
    for i in range(len(u.wheel)):
        wheel = u.wheel[i]
        if wheel.active > 0.0 and has_pose(wheel):
            if ranges[i, 1] > ranges[i, 0]:
                done = approach_with_mesh(p, poses[i], shapes[i], rows, marks, head, ground, frame, grid[i], corner[i], sums[i])
            else:
                done = approach(p, wheel, rows, marks, head, ground, frame, grid[i], corner[i], sums[i])
            if not done:
                return False
    for i in range(len(u.body)):
        k, done = len(u.wheel) + i, True
        if has_pose(poses[k]):
            done = approach_with_mesh(p, poses[k], shapes[k], rows, marks, head, ground, frame, grid[k], corner[k], sums[k])
        if not done:
            return False
    return True


@kernel
def stress(k, h, P, X, wheels, wheel_memory, body_memory, *arrays):
    """Stresses on tool k, on the soil as it was at the step's begin."""
    p, x = P[0], X[0]  # numba's prange hands arrays to its threads, no records
    rows, marks, head, ground, frame, elements, ranges, shapes = arrays[:8]
    grid, corner, cells, sums, blocks, outflow, placed, links = arrays[8:16]
    pose, is_body = arrays[18][k], k >= len(wheels)
    if sums[k, CELLS] < 0.0:
        forget(sums[k])
    elif sums[k, STILL] > 0.0:
        sums[k, CELLS] = 0.0
    elif not is_body:
        wheel, modulus = wheels[k], pressure_modulus(p, p.b_w)
        recall(wheel_memory[k], sums[k])
        sums[k, DEPTH] = max(base_height_at(p, ground, frame, wheel.r_0[0], wheel.r_0[1]) - lowest_point(p, wheel), 0.0)
        if ranges[k, 1] > ranges[k, 0]:
            wheel_contact_with_mesh(
                p,
                x,
                pose,
                is_body,
                modulus,
                shapes[k],
                elements,
                ranges[k],
                rows,
                ground,
                frame,
                grid[k],
                corner[k],
                placed[k],
                links[k],
                cells[k],
                sums[k],
            )
        else:
            wheel_contact(p, wheel, (x.powers, x.pushes), modulus, h, x.stamp, rows, grid[k], corner[k], blocks[k], cells[k], sums[k])
    else:
        recall(body_memory[k - len(wheels)], sums[k])
        sums[k, DEPTH] = max(base_height_at(p, ground, frame, pose.r_0[0], pose.r_0[1]) - box_around(pose, shapes[k])[4], 0.0)
        body_contact(
            p,
            x,
            pose,
            is_body,
            shapes[k],
            elements,
            ranges[k],
            rows,
            ground,
            frame,
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
def answer_all(p, h, u, memory, y, *arrays):
    """The outputs of all tools, and what they remember; number of the warning that the step ends with, or 0."""
    ground, frame, sums, poses = arrays[3], arrays[4], arrays[11], arrays[18]
    status = 0
    for i in range(len(u.wheel)):
        wheel = u.wheel[i]
        remember(sums[i], memory.wheel[i])
        if sees(wheel, memory.wheel[i], y.wheel[i], y.contact[i], y.diagnostics[i]):
            if sums[i, CELLS] >= 0.0:
                answer(p, wheel, sums[i], y.wheel[i], y.contact[i])
            diagnose(p, ground, frame, wheel, sums[i], y.wheel[i], y.diagnostics[i])
        elif memory.wheel[i].silent > 0.0:
            status = NO_DATA + STATUS_SPAN * i
    for i in range(len(u.body)):
        k = len(u.wheel) + i
        if not answer_body(p, h, poses[k], memory.body[i], sums[k], y.body[i], y.support[i]):
            status = BODY_NO_DATA + STATUS_SPAN * i
    return status


@kernel
def displace(p, u, x, *arrays):
    """Press the soil below all tools, and move what they displace and drag along; False if there was no room to let all of it slide."""
    rows, marks, head, ground, frame, elements, ranges, shapes, grid, corner, cells, sums, blocks, outflow = arrays[:14]
    done = True
    for k in range(len(sums)):
        if sums[k, STILL] > 0.0:
            stay(p, k, arrays[18][k], shapes[k], x.stamp, rows, marks, grid[k], corner[k])
        elif sums[k, CELLS] > 0.0:
            x.compacted += press(p, k, sums[k], cells[k], x.stamp, rows, marks)
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
    for i in range(len(u.body)):
        k = len(u.wheel) + i
        if sums[k, CELLS] >= 0.0 and sums[k, STILL] == 0.0:
            done &= rearrange_body(
                p, arrays[18][k], shapes[k], x.stamp, rows, marks, head, ground, frame, grid[k], corner[k], cells[k], sums[k]
            )

    return done


@kernel
def sweeps_due(p, x, h):
    """Number of sweeps of landslides in this step."""
    x.sweep_time += h
    due = 0
    while due < p.erosion_sweeps and x.sweep_time >= p.erosion_interval * (1.0 - 1e-9):
        x.sweep_time -= p.erosion_interval
        due += 1
    if x.sweep_time >= p.erosion_interval:  # more are due than a step makes, after a long one without end
        x.sweep_time %= p.erosion_interval
    return due


@kernel
def slide_tile(k, P, X, *arrays):
    """What a sweep does to the k-th tile that slides."""
    rows, marks, head, ground, frame = arrays[:5]
    slide(P[0], rows, marks, head, ground, frame, X[0].stamp, k, arrays[16][k])


@kernel
def settle_all(p, *arrays):
    rows, marks, head, ground, frame = arrays[:5]
    return settle(p, rows, marks, head, ground, frame, arrays[16], arrays[17])


@cache
def step_kernels(compaction: bool):
    """The step of a model with or without compaction in its patches, with one thread and with several."""

    @kernel
    def fill_patches(p, u, y, *arrays):
        rows, marks, head, ground, frame = arrays[:5]
        for i in range(len(u.trailing)):
            patch = y.patch[i]
            if compaction:
                fill_patch(p, rows, marks, head, ground, frame, u.trailing[i].r_0, patch, patch.sinkage, patch.yield_pressure)
            else:
                fill_patch(p, rows, marks, head, ground, frame, u.trailing[i].r_0, patch)

    @kernel
    def step(
        t, h, P, wheels, trailing, bodies, X, wheel_memory, body_memory, wrenches, contacts, diagnostics, patches, answers, supports, arrays
    ):
        p, x, head, sums = P[0], X[0], arrays[2], arrays[11]
        u, memory = Inputs(wheels, trailing, bodies), Memory(wheel_memory, body_memory)
        y = Outputs(wrenches, contacts, diagnostics, patches, answers, supports)
        place_all(u, h, *arrays)
        status = refused(p, u, memory, y, *arrays)
        if status:
            return status
        if not make_all_ready(p, u, *arrays):
            return FULL
        x.stamp += 1.0
        take_seats(p, u, memory, *arrays)
        lay_around(p, u, memory, x, *arrays)
        find_still(p, h, u, memory, *arrays)
        for k in range(len(sums)):
            stress(k, h, P, X, wheels, wheel_memory, body_memory, *arrays)
        status = pressed_through(p, u, *arrays)
        if status:
            take_back(p, u, memory, x, *arrays)
            x.stamp -= 1.0
            return status
        status = answer_all(p, h, u, memory, y, *arrays)
        done = displace(p, u, x, *arrays)
        for _ in range(sweeps_due(p, x, h)):
            for k in range(head[SLIDING]):
                slide_tile(k, P, X, *arrays)
            done &= settle_all(p, *arrays)
        fill_patches(p, u, y, *arrays)
        return status if done or status else NO_ROOM_TO_SLIDE

    @kernel(parallel=True)
    def parallel_step(
        t, h, P, wheels, trailing, bodies, X, wheel_memory, body_memory, wrenches, contacts, diagnostics, patches, answers, supports, arrays
    ):
        p, x, head, sums = P[0], X[0], arrays[2], arrays[11]
        u, memory = Inputs(wheels, trailing, bodies), Memory(wheel_memory, body_memory)
        y = Outputs(wrenches, contacts, diagnostics, patches, answers, supports)
        place_all(u, h, *arrays)
        status = refused(p, u, memory, y, *arrays)
        if status:
            return status
        if not make_all_ready(p, u, *arrays):
            return FULL
        x.stamp += 1.0
        take_seats(p, u, memory, *arrays)
        lay_around(p, u, memory, x, *arrays)
        find_still(p, h, u, memory, *arrays)
        for k in numba.prange(len(sums)):  # unsigned there
            stress(np.int64(k), h, P, X, wheels, wheel_memory, body_memory, *arrays)
        status = pressed_through(p, u, *arrays)
        if status:
            take_back(p, u, memory, x, *arrays)
            x.stamp -= 1.0
            return status
        status = answer_all(p, h, u, memory, y, *arrays)
        done = displace(p, u, x, *arrays)
        for _ in range(sweeps_due(p, x, h)):
            for k in numba.prange(head[SLIDING]):
                slide_tile(np.int64(k), P, X, *arrays)
            done &= settle_all(p, *arrays)
        fill_patches(p, u, y, *arrays)
        return status if done or status else NO_ROOM_TO_SLIDE

    return step, parallel_step
