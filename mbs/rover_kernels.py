"""The rover's two kernels: its start, and a step of it."""

from __future__ import annotations

from cdl_fmu.slave.kernel import kernel

from .rover_memory import Bodies, Constants, Work
from .rover_state import ON, is_at, load, remember, show, start, update
from .rover_step import LOST, advance, predict

#: What the kernels get: arrays of any length, so that what they call is compiled once for rovers of all sizes.
ARGUMENTS = (
    *("p", "p.rock", "u", "u.wheel", "u.contact", "u.rock", "u.support"),
    *("u.hard.wheel", "u.hard.body", "u.hard.pair", "u.hard.anchor"),
    *("x", "y", "y.wheel", "y.rock", "y.applied"),
)

# Where memory begins among the arrays, and what MuJoCo holds.
_OWN = len(Constants._fields)
_FOREIGN = _OWN + len(Work._fields)


@kernel
def initialise(
    t, P, rocks, U, wrenches, contacts, rock_wrenches, supports, hard_wheels, hard_rocks, pairs, sent, X, Y, wheels, poses, shown, arrays
):
    p, u, x, y = P[0], U[0], X[0], Y[0]
    constants, work, held = Constants(*arrays[:_OWN]), Work(*arrays[_OWN:_FOREIGN]), Bodies(*arrays[_FOREIGN:])
    start(p, rocks, x.q, x.q_dot)
    load(p, rocks, x.q, x.q_dot, work, constants, held)
    show(x, y, work, constants, held, wheels, poses, shown)
    if p.with_inverse_inertia == ON:
        soil, hard = (contacts, wrenches, supports, rock_wrenches), (hard_wheels, hard_rocks, pairs, sent)
        drives = work.gains, constants.spins, constants.steers, u.command.wheel_rate[:], u.command.steer_rate[:]
        remember(work)
        # Until a step tells how long steps are.
        predict(1e-3, drives, soil, hard, work, held.qvel, y.inverse_inertia[:], y.free_twist[:])


@kernel
def step(
    t, h, P, rocks, U, wrenches, contacts, rock_wrenches, supports, hard_wheels, hard_rocks, pairs, sent, X, Y, wheels, poses, shown, arrays
):
    p, u, x, y = P[0], U[0], X[0], Y[0]
    constants, work, held = Constants(*arrays[:_OWN]), Work(*arrays[_OWN:_FOREIGN]), Bodies(*arrays[_FOREIGN:])
    soil, hard = (contacts, wrenches, supports, rock_wrenches), (hard_wheels, hard_rocks, pairs, sent)
    drives = work.gains, constants.spins, constants.steers, u.command.wheel_rate[:], u.command.steer_rate[:]
    if not is_at(x.q, x.q_dot, work, held):
        load(p, rocks, x.q, x.q_dot, work, constants, held)
    remember(work)
    if advance(h, drives, soil, hard, work, held.qpos, held.qvel) == LOST:
        load(p, rocks, x.q, x.q_dot, work, constants, held)
        return LOST
    update(work, constants, held)
    show(x, y, work, constants, held, wheels, poses, shown)
    if p.with_inverse_inertia == ON:
        predict(h, drives, soil, hard, work, held.qvel, y.inverse_inertia[:], y.free_twist[:])
    return 0
