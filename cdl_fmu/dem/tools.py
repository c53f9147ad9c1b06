"""What is not a particle: planes, wheels and bodies with a mesh, which move as they are told from one pose to the next."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..mesh.surface import Surface
from ..slave.kernel import kernel
from .particles import MOST_SLABS
from .touch import MOST

#: Kinds of tools: a half space below the plane through its origin, z outwards; the parametric wheel; a body with a closed mesh.
PLANE, WHEEL, MESH = range(3)
#: Columns of a shape: those of the wheel, and the radius of the sphere around a wheel or body.
R_W, B_W, N_G, H_G, T_G, AROUND, SHAPE = range(7)
#: Columns of a pose: position [m], rows of T, velocity [m/s], angular velocity [rad/s].
POSITION, ROTATION, VELOCITY, SPIN, POSE = 0, 3, 12, 15, 18
#: Columns of what a tool feels: force [N], torque [N.m], stiffness and damping of its contacts: xx, xy, xz, yy, yz, zz [N/m], [N.s/m];
#: point that the stiffness is about, times its trace [N]; number of contacts; deepest overlap, in radii
#: of the particle, less of contacts that go on: the largest of a step, where all else are means.
FORCE, TORQUE, TENSOR, DAMPER, MIDDLE, CONTACTS, DEEPEST, FELT = 0, 3, 6, 12, 18, 21, 22, 23
#: Columns of what is kept of a contact with a particle: normal, tangential displacement [m], rolling angle [rad].
NORMAL, SLID, ROLLED, KEPT = 0, 3, 6, 9


class Tools(NamedTuple):
    """Arrays of n tools that touch up to k particles.

    Attributes:
        kinds: int64 [n].
        present: 1 for a tool that is there, 0 for one that touches nothing, int64 [n].
        roots: First node of a body's mesh, int64 [n].
        shapes: [n, SHAPE].
        laws: Contact laws with particles, [n, LAW].
        poses: [n, POSE].
        goals: Poses at the step's end: position and T, [n, VELOCITY].
        turns: Rotation from one substep to the next, of the rows of T: T_next = T turn, [n, 9].
        margins: How far a tool's surface may move until its list is too old, and how far it has moved [m], [n, 2].
        felt: What the touches of each slab of the bed add, [n, MOST_SLABS, FELT].
        sums: What each tool feels, means over the step, [n, FELT].
        first: Where the touches of each tool begin, int64 [2, n + 1].
        slabs: Where the touches of each tool begin in each slab of the bed, int64 [n, MOST_SLABS + 1].
        particle: Particle of each touch, int32 [2, k].
        kept: History of each touch, [2, k, MOST, KEPT].
        slots: Memory: touch of each particle.
        rows: Memory: contacts of the particle at hand, [MOST_SLABS, 2 * MOST, KEPT].
        stack: Memory of the search in meshes, int64 [MOST_SLABS, 256].
    """

    kinds: np.ndarray
    present: np.ndarray
    roots: np.ndarray
    shapes: np.ndarray
    laws: np.ndarray
    poses: np.ndarray
    goals: np.ndarray
    turns: np.ndarray
    margins: np.ndarray
    felt: np.ndarray
    sums: np.ndarray
    first: np.ndarray
    slabs: np.ndarray
    particle: np.ndarray
    kept: np.ndarray
    slots: np.ndarray
    rows: np.ndarray
    stack: np.ndarray


def wheel_shape(r_w: float, b_w: float, n_g: float, h_g: float, t_g: float) -> np.ndarray:
    """Shape of the parametric wheel of ``cdl_fmu.wheel.WHEEL``, [SHAPE]."""
    return np.array([r_w, b_w, n_g, h_g, t_g, math.hypot(r_w + (h_g if n_g else 0.0), 0.5 * b_w)])


def mesh_shape(surface: Surface) -> np.ndarray:
    """Shape of a body with a mesh, [SHAPE]."""
    shape = np.zeros(SHAPE)
    shape[AROUND] = np.linalg.norm(surface.triangles.reshape(-1, 3), axis=1).max()
    return shape


def tools_of(kinds, shapes, roots, laws, n_particles) -> Tools:
    """Tools at the origin.

    Args:
        kinds, shapes, roots, laws: As in ``Tools``.
        n_particles: Number of particles; on average at most one tool is near each, of a few particles all tools.
    """
    n = len(kinds)
    touches = min(n * n_particles, n_particles + 1000)
    poses = np.zeros((n, POSE))
    poses[:, ROTATION : ROTATION + 9] = np.eye(3).ravel()
    return Tools(
        kinds=np.array(kinds, np.int64),
        present=np.ones(n, np.int64),
        roots=np.array(roots, np.int64),
        shapes=np.array(shapes, float).reshape(n, SHAPE),
        laws=np.array(laws),
        poses=poses,
        goals=poses[:, :VELOCITY].copy(),
        turns=np.zeros((n, 9)),
        margins=np.zeros((n, 2)),
        felt=np.zeros((n, MOST_SLABS, FELT)),
        sums=np.zeros((n, FELT)),
        first=np.zeros((2, n + 1), np.int64),
        slabs=np.zeros((n, MOST_SLABS + 1), np.int64),
        particle=np.zeros((2, touches), np.int32),
        kept=np.zeros((2, touches, MOST, KEPT)),
        slots=np.zeros(n_particles, np.int64),
        rows=np.zeros((MOST_SLABS, 2 * MOST, KEPT)),
        stack=np.zeros((MOST_SLABS, 256), np.int64),
    )


@kernel
def set_out(tools, t, h, n_steps):
    """Give tool t the velocities by which it moves evenly from its pose to its goal in h [s], in n_steps."""
    pose, goal, turn = tools.poses[t], tools.goals[t], tools.turns[t]
    for k in range(3):
        pose[VELOCITY + k] = (goal[POSITION + k] - pose[POSITION + k]) / h
    # The rotation from the pose to the goal, of vectors in the world: Q = T_goal' T, and its axis times sin(angle).
    q = turn  # row-major
    for i in range(3):
        for j in range(3):
            q[3 * i + j] = 0.0
            for k in range(3):
                q[3 * i + j] += goal[ROTATION + 3 * k + i] * pose[ROTATION + 3 * k + j]
    s_x, s_y, s_z = 0.5 * (q[7] - q[5]), 0.5 * (q[2] - q[6]), 0.5 * (q[3] - q[1])
    sine, cosine = math.sqrt(s_x * s_x + s_y * s_y + s_z * s_z), 0.5 * (q[0] + q[4] + q[8] - 1.0)
    angle = math.atan2(sine, cosine)
    if sine > 1e-14:
        s_x, s_y, s_z = s_x / sine, s_y / sine, s_z / sine
    else:
        s_x = s_y = s_z = angle = 0.0
    pose[SPIN], pose[SPIN + 1], pose[SPIN + 2] = s_x * angle / h, s_y * angle / h, s_z * angle / h
    # Rodrigues: what rows of T are turned by in a substep, from the right by the transposed rotation.
    c, s = math.cos(angle / n_steps), math.sin(angle / n_steps)
    turn[0], turn[4], turn[8] = c + (1.0 - c) * s_x * s_x, c + (1.0 - c) * s_y * s_y, c + (1.0 - c) * s_z * s_z
    turn[1], turn[3] = (1.0 - c) * s_x * s_y + s * s_z, (1.0 - c) * s_x * s_y - s * s_z
    turn[2], turn[6] = (1.0 - c) * s_x * s_z - s * s_y, (1.0 - c) * s_x * s_z + s * s_y
    turn[5], turn[7] = (1.0 - c) * s_y * s_z + s * s_x, (1.0 - c) * s_y * s_z - s * s_x


@kernel
def go_on(tools, t, dt):
    """Move tool t by a substep dt [s]; True if its list is too old now."""
    pose, turn = tools.poses[t], tools.turns[t]
    for k in range(3):
        pose[POSITION + k] += pose[VELOCITY + k] * dt
    for i in range(3):
        a, b, c = pose[ROTATION + 3 * i], pose[ROTATION + 3 * i + 1], pose[ROTATION + 3 * i + 2]
        for j in range(3):
            pose[ROTATION + 3 * i + j] = a * turn[j] + b * turn[3 + j] + c * turn[6 + j]
    tools.margins[t, 1] += surface_speed(tools, t) * dt
    return tools.margins[t, 1] > tools.margins[t, 0]


@kernel
def arrive(tools, t):
    """Put tool t at its goal: what substeps leave of rounding is gone."""
    for k in range(VELOCITY):
        tools.poses[t, k] = tools.goals[t, k]


@kernel
def surface_speed(tools, t):
    """Largest speed [m/s] of tool t's surface across itself: a smooth wheel's does not move where it spins."""
    pose, shape = tools.poses[t], tools.shapes[t]
    speed = math.sqrt(pose[VELOCITY] ** 2 + pose[VELOCITY + 1] ** 2 + pose[VELOCITY + 2] ** 2)
    w_x, w_y, w_z = pose[SPIN], pose[SPIN + 1], pose[SPIN + 2]
    if tools.kinds[t] == WHEEL and shape[N_G] == 0.0:
        along = w_x * pose[ROTATION + 3] + w_y * pose[ROTATION + 4] + w_z * pose[ROTATION + 5]
        w_x, w_y, w_z = w_x - along * pose[ROTATION + 3], w_y - along * pose[ROTATION + 4], w_z - along * pose[ROTATION + 5]
    return speed + shape[AROUND] * math.sqrt(w_x * w_x + w_y * w_y + w_z * w_z)
