"""Where the elements of a meshed tool are in the soil: each near it is chained to the cell whose node is nearest to it."""

from __future__ import annotations

from ..slave.kernel import kernel
from .columns import AREA, AT, KIND, N_X, N_Y, N_Z, X, Y, Z
from .features import FLANK, SURFACE
from .tiles import BASE, FILL, base_height, in_tile, nearest, row_of

#: Cells by which a surface no steeper than a bearing one can rise within a cell.
LAYER = 3.0
#: Share of a cell that steep faces which lean out over it have to cover, for it to belong to the tool.
LEAST_COVER = 0.5
#: Vertical share [1] of a normal over which a body's surface goes from steep to bearing, so that no force jumps where a flat side turns.
RAMP = 0.1
_ABOVE = 1.0  # cells above the level up to which elements are looked at
_UPWARD = 0.7  # upward normals up to which a flank can push


@kernel
def place_elements(p, tool, is_body, steep, h_x, h_y, rows, ground, frame, grid, corner, i0, i1, j0, j1, elements, range_, placed, links):
    """Turn and move the elements, and chain those near the soil to their cells, in their order; returns their number.

    Args:
        is_body: Whether soil may have been laid around the tool, which stands beside steep faces though its own cells lie deeper.
        steep: Largest downward normal [1] of a steep face.
        h_x, h_y: See ``cloud_contact``.
        placed, links: See ``cloud_contact``.
    """
    T, r_0, seat_T, seat_0, cell = tool.T, tool.r_0, tool.seat_T, tool.seat_0, p.cell
    n_j, next_ = j1 - j0 + 1, links.shape[0] - placed.shape[0]
    top = -1e300
    for i in range(i0, i1 + 1):
        for j in range(j0, j1 + 1):
            links[(i - i0) * n_j + j - j0] = -1
            row = row_of(grid, corner, i, j)
            top = max(top, rows[row, BASE, in_tile(i), in_tile(j)] + rows[row, FILL, in_tile(i), in_tile(j)])
    above = _ABOVE * cell - r_0[2]
    top += above
    n = 0
    for e in range(range_[1] - 1, range_[0] - 1, -1):  # a chain begins with what came last
        x, y, z = elements[e, 0], elements[e, 1], elements[e, 2]
        w_z = T[0, 2] * x + T[1, 2] * y + T[2, 2] * z
        if w_z > top:
            continue
        n_x, n_y, n_z, kind = elements[e, 3], elements[e, 4], elements[e, 5], elements[e, 7]
        m_z = T[0, 2] * n_x + T[1, 2] * n_y + T[2, 2] * n_z
        if m_z > (_UPWARD if kind == FLANK else steep):
            continue
        w_x, w_y = T[0, 0] * x + T[1, 0] * y + T[2, 0] * z, T[0, 1] * x + T[1, 1] * y + T[2, 1] * z
        s_x, s_y = seat_T[0, 0] * x + seat_T[1, 0] * y + seat_T[2, 0] * z, seat_T[0, 1] * x + seat_T[1, 1] * y + seat_T[2, 1] * z
        i, j = nearest(seat_0[0] + s_x, cell), nearest(seat_0[1] + s_y, cell)
        row = row_of(grid, corner, i, j)
        if w_z > rows[row, BASE, in_tile(i), in_tile(j)] + rows[row, FILL, in_tile(i), in_tile(j)] + above:
            undisturbed = base_height(p, ground, frame, i, j) if is_body and m_z > -steep - RAMP else -1e300
            if w_z > undisturbed + rows[row, FILL, in_tile(i), in_tile(j)] + above:
                continue
        placed[n, X], placed[n, Y], placed[n, Z] = w_x, w_y, w_z
        placed[n, AT] = (s_x - (i * cell - seat_0[0])) * h_x + (s_y - (j * cell - seat_0[1])) * h_y
        placed[n, N_X] = T[0, 0] * n_x + T[1, 0] * n_y + T[2, 0] * n_z
        placed[n, N_Y] = T[0, 1] * n_x + T[1, 1] * n_y + T[2, 1] * n_z
        placed[n, N_Z], placed[n, AREA], placed[n, KIND] = m_z, elements[e, 6], kind
        at = (i - i0) * n_j + j - j0
        links[next_ + n], links[at] = links[at], n
        n += 1
    return n


@kernel(inline=True)
def bearing_share(is_body, steep, n_z):
    """Share of a surface of this downward normal that bears; the rest pushes soil aside."""
    return min((-n_z - steep) / RAMP, 1.0) if is_body else 1.0


@kernel(inline=True)
def wall_share(is_body, steep, n_z):
    """Share of a steep surface of this normal that pushes soil aside: less where it nearly faces up."""
    return min((steep - n_z) / RAMP, 1.0) if is_body else 1.0


@kernel
def lowest_bearing(steep, start, placed, links):
    """Height [m] of the lowest bearing surface among a cell's elements."""
    lowest, e = 1e300, start
    while e >= 0:
        if placed[e, N_Z] <= -steep and placed[e, KIND] == SURFACE:
            lowest = min(lowest, placed[e, Z])
        e = links[links.shape[0] - placed.shape[0] + e]
    return lowest
