"""What is known of a tool in a step: columns of its list of pressed cells, and its sums."""

from __future__ import annotations

from ..slave.kernel import kernel
from .stress import whole
from .tiles import POINTS

#: Columns of a tool's list of pressed cells.
ROW, A, B, FLOOR, MEAN, J_X, J_Y, PATH, ALONG, ACROSS, FLUX_X, FLUX_Y, FIRST = range(13)
SLOPE = FIRST + POINTS  # while a cell of a meshed tool is looked at
FRICTION = SLOPE + POINTS  # that the cell can give a body, per area [Pa]
COLUMNS = FRICTION + 1
#: Points of a cell below a body: a wheel's are four, with elements half as long.
POINTS_OF_BODIES = 2
#: FLOOR of a cell that is not pressed, but covered so closely that no soil slides in: off the tool, or bare of grains that it dragged off.
OFF, BARE = -1.0, -2.0
#: Sums of a tool: force and torque about its centre in its own level axes (along, across, up), stiffness and damping, extent, cells,
#: deepest floor; pressure, and weighted with it the speed by which the tool pushes soil its way and the mobilised shares of friction that
#: push soil ahead and across; then what is updated: the displacement of its steep faces against the soil beside them and that
#: of the soil that is pushed ahead, in world axes; and its depth below undisturbed soil, which is given [m].
F_X, F_Y, F_Z, T_X, T_Y, T_Z, K_X, K_Y, K_Z, D_Z, ALONG_MIN, ALONG_MAX, CELLS, DEEPEST = range(14)
PRESSURE, PUSH_SPEED, PUSH_AHEAD, PUSH_ACROSS, SIDE_ALONG, SIDE_ACROSS, PUSHED_X, PUSHED_Y, DEPTH = range(14, 23)
#: Of a body only: its stiffness against motion into the soil and along it [N/m, N, N.m], and its damping against motion into it
#: [N.s/m, N.s, N.m.s], each a symmetric matrix of translation and rotation about its origin in world axes, of which the lower triangle is
#: kept row by row.
INTO, ALONG_SOIL, DAMPING = 23, 44, 65
#: Whether it is still, or slow enough to be; what tells the soil at it from other soil (see ``rest``).
STILL, SLOW, SOIL = 86, 87, 88
SUMS = 89

#: Columns of the elements of a mesh, in the frame of the body: centroid [m], outward normal [1], area [m2], kind.
ELEMENT = 8
#: Columns of those that are near the soil: centroid relative to the tool's origin and normal in world axes, area, kind, where they are
#: along the tool's heading in their cell, then which of its points they stand for, and the plan area with which they press, if they bear.
X, Y, Z, N_X, N_Y, N_Z, AREA, KIND, AT, PLAN = range(10)
PLACED = 10
#: Shape of a tool: middle and half sides of the box around its mesh [m], in the frame of the body, its width b in Bekker's sense [m], and
#: the depth by which a body that begins in the soil has pressed what is below it before [m].
MIDDLE, HALF, WIDTH, SETTLED = 0, 3, 6, 7
SHAPE = 8


@kernel
def clear(sums):
    """No contact."""
    for k in range(SIDE_ALONG):
        sums[k] = 0.0
    sums[ALONG_MIN], sums[ALONG_MAX] = 1e9, -1e9


@kernel(inline=True)
def add_force(sums, x, y, z, f_x, f_y, f_z):
    """Add a force [N] at a point [m] relative to the tool's centre, both in its level axes."""
    sums[F_X] += whole(f_x)
    sums[F_Y] += whole(f_y)
    sums[F_Z] += whole(f_z)
    sums[T_X] += whole(y * f_z - z * f_y)
    sums[T_Y] += whole(z * f_x - x * f_z)
    sums[T_Z] += whole(x * f_y - y * f_x)
