"""What the rover's kernels work in: constants of its build, memory that means nothing between steps, and what MuJoCo holds."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from cdl_fmu.slave.interface import n_pairs
from cdl_fmu.slave.pool import ConstantPool

from .implicit import ANCHOR, ROW
from .rover_mjcf import STEERED, two_wheel


class Constants(NamedTuple):
    """What is the same for all parameters; n frames are the wheels, then the rocks.

    Attributes:
        compiled: MuJoCo's model as it saves it: number of bytes, then the bytes; ``rover.c`` loads it.
        bodies: Number in MuJoCo of the rover's body, then of each frame's [1 + n].
        roots: Of the body on which each of these hangs [1 + n].
        spins: Coordinate of each wheel's angle.
        steers: Of its steering angle, -1 where it does not steer.
        follows: 1 where a coordinate moves a frame [n, n_dof].
    """

    compiled: np.ndarray
    bodies: np.ndarray
    roots: np.ndarray
    spins: np.ndarray
    steers: np.ndarray
    follows: np.ndarray


class Work(NamedTuple):
    """What is written before it is read, but for ``is_set``: 1 once the parameters are in MuJoCo's model.

    Attributes:
        gains: Of the servos, by coordinate.
        moves: ``follows`` without the coordinates of rocks that are fixed.
        masses: What a wheel carries, and what a rock is [n].
        R, T, twists, J: Poses, twists and Jacobians of the frames; R_before, T_before, twists_before: as the step began.
        mass, bias: Mass matrix, and forces without acceleration, on the coordinates.
        anchors, lifted, applied, rows, n_rows, A, forces, room: See ``rover_step``.
        eigen: Two 3x3 matrices.
    """

    is_set: np.ndarray
    gains: np.ndarray
    moves: np.ndarray
    masses: np.ndarray
    R: np.ndarray
    T: np.ndarray
    twists: np.ndarray
    J: np.ndarray
    R_before: np.ndarray
    T_before: np.ndarray
    twists_before: np.ndarray
    mass: np.ndarray
    bias: np.ndarray
    anchors: np.ndarray
    lifted: np.ndarray
    applied: np.ndarray
    rows: np.ndarray
    n_rows: np.ndarray
    A: np.ndarray
    forces: np.ndarray
    room: np.ndarray
    eigen: np.ndarray


class Bodies(NamedTuple):
    """What MuJoCo holds, under its own names; ``rover.c`` lists the same in the same order.

    Attributes:
        addresses: Of MuJoCo's model and data.
    """

    addresses: np.ndarray
    gravity: np.ndarray
    body_pos: np.ndarray
    body_mass: np.ndarray
    body_ipos: np.ndarray
    body_iquat: np.ndarray
    body_inertia: np.ndarray
    qpos: np.ndarray
    qvel: np.ndarray
    xpos: np.ndarray
    xmat: np.ndarray
    cvel: np.ndarray
    subtree_com: np.ndarray
    cdof: np.ndarray


class RoverPool(ConstantPool):
    """Memory of a rover with rocks and slaves of hard contacts, and the objects of MuJoCo that it points into."""

    def __init__(self, n_wheels: int, n_rocks: int, n_hard: int):
        # MuJoCo would write its warnings to MUJOCO_LOG.TXT in the working directory; a lost state is caught by the step instead.
        mujoco.set_mju_user_warning(lambda text: None)
        self.m = m = two_wheel(n_rocks)
        self.d = d = mujoco.MjData(m)
        n, n_hard_pairs = n_wheels + n_rocks, n_hard * n_pairs(n_wheels, n_rocks)
        zeros = np.zeros
        work = Work(
            *(zeros(1, np.int64), zeros(m.nv), zeros((n, m.nv)), zeros(n)),
            *(zeros((n, 3)), zeros((n, 3, 3)), zeros((n, 6)), zeros((n, 6, m.nv))),
            *(zeros((n, 3)), zeros((n, 3, 3)), zeros((n, 6))),
            *(zeros((m.nv, m.nv)), zeros(m.nv)),
            *(zeros((1 + n_hard, n, ANCHOR)), zeros(n + n_hard_pairs), zeros((n, 3))),
            *(zeros((3 * (n + n_hard_pairs) + 3 * n_rocks, m.nv + ROW)), zeros(1, np.int64)),
            *(zeros((m.nv, m.nv)), zeros(m.nv), zeros((6 * n, m.nv)), zeros((2, 9))),
        )
        bodies = Bodies(
            *(np.array([m._address, d._address]), m.opt.gravity),
            *(m.body_pos, m.body_mass, m.body_ipos, m.body_iquat, m.body_inertia),
            *(d.qpos, d.qvel, d.xpos, d.xmat, d.cvel, d.subtree_com, d.cdof),
        )
        super().__init__((*_constants(m, n_wheels, n_rocks), *work), bodies)


def _constants(m: mujoco.MjModel, n_wheels: int, n_rocks: int) -> Constants:
    frames = [*(f"wheel{i}" for i in range(n_wheels)), *(f"rock{j}" for j in range(n_rocks))]
    bodies = np.array([m.body(name).id for name in ("body", *frames)])
    follows = np.zeros((len(frames), m.nv))
    for i, body in enumerate(bodies[1:]):
        while body:
            first = m.body_dofadr[body]
            follows[i, first : first + m.body_dofnum[body]] = 1.0
            body = m.body_parentid[body]
    buffer = np.zeros(-(-mujoco.mj_sizeModel(m) // 8) * 8, np.uint8)
    mujoco.mj_saveModel(m, None, buffer)
    return Constants(
        compiled=np.concatenate([[mujoco.mj_sizeModel(m)], buffer.view(np.int64)]),
        bodies=bodies,
        roots=m.body_rootid[bodies].astype(np.int64),
        spins=np.array([m.joint(f"spin{i}").dofadr[0] for i in range(n_wheels)], np.int64),
        steers=np.array([m.joint(f"steer{i}").dofadr[0] if STEERED[i] else -1 for i in range(n_wheels)], np.int64),
        follows=follows,
    )
