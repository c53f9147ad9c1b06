"""A closed surface of small flat elements on the soil's cells: meshed wheels, footpads, bellies, rocks.

An element is worked on the cell whose node is nearest to it, and there stands for the nearest of the cell's points along the tool's
heading (a body's: world x), four of a wheel, two of a body, which is cut into larger elements. Those of one point press together, at their
mean depth; each bears its plan area's share, along its own normal. The area that the elements cover is the cell's coverage.

- Bearing elements face down. Faces steeper than pi/4 + phi/2, those of the rigid wedge below Prandtl's footing, do not press the soil down
  but push it aside: they bear Rankine's passive earth pressure. So do the flanks of fine features, such as grousers; their tips press
  but leave no mark of their own (see ``features``).
- Where surfaces lie above one another, the lowest counts (Z-buffer): what is higher than one surface can be within a cell is hidden.

Sums within a cell run in the order of the elements, sums over cells are exact, so forces do not depend on the order of work.
All work reads the soil as it was at the step's begin and writes to the tool's own memory only, so tools can run in parallel.
"""

from __future__ import annotations

import math

from ..slave.kernel import kernel
from ..strength import CRITICAL_STATE, angle, escape, left_by_push, log_of_push, softened, strength_of, yield_pressure
from ..terramechanics import flow_value
from ..unloading import pressure, unloading_of, unloading_stiffness
from .bearing import NOTHING, TOTAL, add, bear, pressed_with
from .columns import (
    ACROSS,
    ALONG,
    ALONG_MAX,
    ALONG_MIN,
    AREA,
    AT,
    BARE,
    CELLS,
    DEEPEST,
    DEPTH,
    FIRST,
    FLOOR,
    FLUX_X,
    FLUX_Y,
    FRICTION,
    J_X,
    J_Y,
    K_X,
    K_Y,
    KIND,
    MEAN,
    N_X,
    N_Y,
    N_Z,
    OFF,
    PATH,
    PLAN,
    POINTS_OF_BODIES,
    PRESSURE,
    PUSH_ACROSS,
    PUSH_AHEAD,
    PUSH_SPEED,
    PUSHED_X,
    PUSHED_Y,
    ROW,
    SIDE_ACROSS,
    SIDE_ALONG,
    SLOPE,
    A,
    B,
    X,
    Y,
    Z,
    clear,
)
from .density import bearing_gain, density_of, friction
from .elements import LAYER, LEAST_COVER, bearing_share, lowest_bearing, place_elements, wall_share
from .erosion import repose_of
from .faces import displace, passive
from .features import FLANK, SURFACE
from .rim import pushes
from .stress import nodes_per_root, power, whole
from .support import clear_support, resist_aside
from .tiles import (
    BASE,
    COMPACTED,
    FILL,
    HELD,
    POINT,
    POINTS,
    SHEAR_X,
    SHEAR_Y,
    SINKAGE,
    SLIP,
    STAMP,
    base_height,
    floor_depth,
    in_tile,
    row_of,
)
from .wheel import CLEARANCE, floor_slope, push_ahead

#: While a cell is looked at, columns of its row hold the plan area [m2], then the pressure [Pa], of each of its points.
_PLAN = _SIGMA = J_X


@kernel
def cloud_contact(
    p,
    tool,
    is_body,
    h_x,
    h_y,
    layer,
    width,
    length,
    modulus,
    tables,
    stamp,
    rows,
    ground,
    frame,
    grid,
    corner,
    window,
    elements,
    range_,
    placed,
    links,
    cells,
    sums,
):
    """Stresses on a meshed tool with soil under it; the arguments and results are those of ``wheel_contact`` unless said otherwise.

    Args:
        tool: Its pose and twist, and the mean twist and time since its contact was worked out last.
        is_body: Whether it is a body, whose support is wanted, and around which soil may have been laid.
        h_x, h_y: Unit vector of its level axis "along", horizontal; "across" is to the left.
        width, length: Of its contact, across and along [m].
        layer: Depth of the layer that goes with it at its speed [m].
        window: Cells [i0, i1] x [j0, j1] around it.
        elements: Those of all meshes, [n, ELEMENT]; from range_[0] to range_[1] - 1 they are this tool's.
        placed, links: Memory for those near the soil, [n, PLACED], and for their chains: one entry a cell of the window, one an element.
    """
    clear(sums)
    if is_body:
        clear_support(sums)
    i0, i1, j0, j1 = window
    n_j, next_ = j1 - j0 + 1, links.shape[0] - placed.shape[0]
    steep = math.cos(0.25 * math.pi + 0.5 * p.phi)
    n_placed = place_elements(
        p, tool, is_body, steep, h_x, h_y, rows, ground, frame, grid, corner, i0, i1, j0, j1, elements, range_, placed, links
    )
    if n_placed == 0:
        sums[SIDE_ALONG] = sums[SIDE_ACROSS] = sums[PUSHED_X] = sums[PUSHED_Y] = 0.0
        return
    r_0 = tool.r_0
    cell, l_x, l_y = p.cell, -h_y, h_x
    N_phi, density = flow_value(p.phi), density_of(p)
    damping = max(0.0, 1.0 - p.c_d * tool.v_0[2])  # Hunt & Crossley 1975, as in BCM
    per_root = nodes_per_root(p, tables[0])
    v_0 = tool.v_0
    speed, along = math.hypot(v_0[0], v_0[1]), v_0[0] * h_x + v_0[1] * h_y
    strength = strength_of(p, p.strength == CRITICAL_STATE, repose_of(p), width, length, sums[DEPTH], along)
    unloading = unloading_of(p)
    forward = 1.0 if along >= 0.0 else -1.0
    t_x, t_y = v_0[0] / max(speed, 1e-9), v_0[1] / max(speed, 1e-9)
    pushed = math.hypot(sums[PUSHED_X], sums[PUSHED_Y])
    m_x, m_y, push = displace(p, tool, strength.wall_modulus, sums, h_x, h_y, placed, n_placed)
    points = POINTS_OF_BODIES if is_body else POINTS
    n = 0
    for at in range((i1 - i0 + 1) * n_j):
        start = links[at]
        if start < 0:
            continue
        i, j = i0 + at // n_j, j0 + at % n_j
        row, a, b = row_of(grid, corner, i, j), in_tile(i), in_tile(j)
        fill = rows[row, FILL, a, b]
        surface = rows[row, BASE, a, b] + fill - r_0[2]
        d_x, d_y = i * cell - r_0[0], j * cell - r_0[1]
        kept, slope = rows[row, STAMP, a, b] == stamp - 1.0, 0.0
        floor, sinkage = floor_depth(rows, row, a, b), rows[row, SINKAGE, a, b]
        if not kept:
            slope = floor_slope(p, rows, grid, corner, i, j, h_x, h_y)
        tan_phi = friction(density, rows[row, COMPACTED, a, b], sinkage)
        borne = modulus * bearing_gain(density, tan_phi)
        j_x, j_y, path = sums[PUSHED_X], sums[PUSHED_Y], pushed
        if kept:
            j_x, j_y, path = rows[row, SHEAR_X, a, b], rows[row, SHEAR_Y, a, b], rows[row, SLIP, a, b]
        ahead, sideways = pushes(p.K, forward * h_x, forward * h_y, j_x, j_y)
        logs = log_of_push(tables[1], ahead), log_of_push(tables[1], -ahead), log_of_push(tables[1], abs(sideways))
        left = left_by_push(strength, logs[0], logs[1], logs[2])
        soft = softened(strength, path)
        lowest = lowest_bearing(steep, start, placed, links)
        for k in range(POINTS):
            cells[n, FIRST + k] = cells[n, _PLAN + k] = cells[n, SLOPE + k] = 0.0

        on_tips, covered, off_x, off_y = NOTHING, 0.0, 0.0, 0.0
        steep_plan, lowest_steep = 0.0, 1e300
        e = start
        while e >= 0:
            x, y, z = placed[e, X], placed[e, Y], placed[e, Z]
            n_x, n_y, n_z, area = placed[e, N_X], placed[e, N_Y], placed[e, N_Z], placed[e, AREA]
            place, wall = placed[e, AT] / cell, 0.0
            placed[e, AT] = -1.0
            if n_z <= -steep and placed[e, KIND] != FLANK and z < lowest + LAYER * cell:
                bears = bearing_share(is_body, steep, n_z)
                wall = 1.0 - bears
                plan, along, across = -n_z * area * bears, (x - d_x) * h_x + (y - d_y) * h_y, (x - d_x) * l_x + (y - d_y) * l_y
                k = min(max(int((place + 0.5) * points), 0), points - 1)
                if placed[e, KIND] == SURFACE:
                    # Its depth where the point is, on its plane.
                    rise_along, rise_across = -(n_x * h_x + n_y * h_y) / n_z, -(n_x * l_x + n_y * l_y) / n_z
                    z_k = z + ((_place_of(k, points) * cell - along) * rise_along - across * rise_across)
                    cells[n, FIRST + k] += plan * (surface - z_k)
                    cells[n, _PLAN + k] += plan
                    cells[n, SLOPE + k] += plan * rise_along
                    placed[e, AT], placed[e, PLAN] = k, plan
                    covered, off_x, off_y = covered + plan, off_x + plan * (x - d_x), off_y + plan * (y - d_y)
                else:
                    depth = surface - z
                    before = (
                        sinkage * _before(rows, row, a, b, k, points) if kept else max(floor + slope * _place_of(k, points) * cell, 0.0)
                    )
                    if depth > before:
                        dense = borne * power(tables[0], per_root, p.n, depth)
                        rise = (n_x * h_x + n_y * h_y) / -n_z
                        plastic = yield_pressure(strength, dense, depth, fill, soft, _escape(strength, forward * rise, left))
                        sigma, rise = pressure(unloading_stiffness(unloading, depth, dense, before), p.n, depth - before, depth, plastic)
                        on_tips = pressed_with(on_tips, x, y, z, n_x, n_y, n_z, plan, sigma, rise)
            elif placed[e, KIND] == FLANK or abs(n_z) < steep:
                wall = wall_share(is_body, steep, n_z)
                if n_z < 0.0:
                    steep_plan, lowest_steep = steep_plan - n_z * area, min(lowest_steep, z)
            share = (m_x * n_x + m_y * n_y) * push
            if wall > 0.0 and share > 0.0:
                f = wall * area * strength.wall * passive(p, N_phi, r_0, x, y, z, n_x, n_y, stamp, rows, grid, corner)
                add(sums, h_x, h_y, x, y, z, -f * share * n_x, -f * share * n_y, -f * share * n_z)
                sums[K_X] += whole(f * push * (n_x * h_x + n_y * h_y) ** 2)
                sums[K_Y] += whole(f * push * (n_x * l_x + n_y * l_y) ** 2)
                if is_body:
                    resist_aside(sums, f * push, n_x, n_y, n_z, x, y, z)
            e = links[next_ + e]

        # Elements around a point press together, as one would: their depths differ by more than soil yields elastically.
        new_floor, n_points, total, stiffness = 0.0, 0, 0.0, 0.0
        for k in range(points):
            plan, sigma = cells[n, _PLAN + k], 0.0
            before = sinkage * _before(rows, row, a, b, k, points) if kept else max(floor + slope * _place_of(k, points) * cell, 0.0)
            after = before
            if plan > 0.0:
                depth = cells[n, FIRST + k] / plan
                if depth > before:
                    dense = borne * power(tables[0], per_root, p.n, depth)
                    k_u = unloading_stiffness(unloading, depth, dense, before)
                    share = _escape(strength, forward * cells[n, SLOPE + k] / plan, left)
                    plastic = yield_pressure(strength, dense, depth, fill, soft, share)
                    sigma, rise = pressure(k_u, p.n, depth - before, depth, plastic)
                    after = max(before, depth - sigma / k_u)
                    total, stiffness = total + plan * sigma, stiffness + plan * rise
                new_floor, n_points = new_floor + after, n_points + 1
            cells[n, FIRST + k], cells[n, _SIGMA + k] = after, sigma

        if on_tips[TOTAL] > 0.0:
            bear(p, tool, is_body, h_x, h_y, damping, tan_phi, on_tips, j_x, j_y, path, 0.0, 0.0, sums)
        if total <= 0.0:
            if is_body and covered == 0.0 and steep_plan >= LEAST_COVER * cell * cell:
                covered, lowest = steep_plan, lowest_steep  # soil that was laid around it does not slide into its place
            gap = lowest - surface + sinkage
            if covered > 0.0 and gap < CLEARANCE * cell:
                cells[n, ROW], cells[n, A], cells[n, B] = row, a, b
                cells[n, FLOOR] = BARE if gap < p.transport_depth else OFF
                n += 1
            continue
        new_floor /= n_points
        if points < POINTS:
            cells[n, FIRST + 3] = cells[n, FIRST + 2] = cells[n, FIRST + 1]
            cells[n, FIRST + 1] = cells[n, FIRST]
        on_surface = (0.0, 0.0, stiffness, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        e = start
        while e >= 0:
            k = int(placed[e, AT])
            if k >= 0 and cells[n, _SIGMA + k] > 0.0:
                n_x, n_y, n_z = placed[e, N_X], placed[e, N_Y], placed[e, N_Z]
                x, y, z, plan = placed[e, X], placed[e, Y], placed[e, Z], placed[e, PLAN]
                on_surface = pressed_with(on_surface, x, y, z, n_x, n_y, n_z, plan, cells[n, _SIGMA + k], 0.0)
            e = links[next_ + e]
        held = rows[row, HELD, a, b] * covered if is_body and kept else 0.0
        j_x, j_y, path, share, u_x, u_y, grip = bear(
            p, tool, is_body, h_x, h_y, damping, tan_phi, on_surface, j_x, j_y, path, held, tool.time, sums
        )
        cover, along = min(covered / (cell * cell), 1.0), d_x * h_x + d_y * h_y
        laid = base_height(p, ground, frame, i, j) - rows[row, BASE, a, b] if is_body else 0.0
        sums[DEEPEST] = max(sums[DEEPEST], new_floor - fill + laid)
        sums[ALONG_MIN], sums[ALONG_MAX] = min(sums[ALONG_MIN], along), max(sums[ALONG_MAX], along)
        cells[n, ROW], cells[n, A], cells[n, B] = row, a, b
        cells[n, FLOOR], cells[n, MEAN] = new_floor, cover * new_floor
        cells[n, J_X], cells[n, J_Y], cells[n, PATH], cells[n, FRICTION] = j_x, j_y, path, grip / covered
        sums[PRESSURE] += whole(total)
        sums[PUSH_SPEED] += whole(total * (u_x * t_x + u_y * t_y))
        sums[PUSH_AHEAD] += whole(total * max(ahead, 0.0))
        sums[PUSH_ACROSS] += whole(total * forward * sideways)
        cells[n, ALONG], cells[n, ACROSS] = along, (d_x + off_x / covered) * l_x + (d_y + off_y / covered) * l_y
        dragged = layer * tool.time / cell * share * cover
        cells[n, FLUX_X], cells[n, FLUX_Y] = dragged * u_x, dragged * u_y
        n += 1
    sums[CELLS] = n
    push_ahead(p, tool, tool.time, sums)


@kernel(inline=True)
def _escape(strength, rise, left):
    """``escape`` of a surface that rises by ``rise`` [1] ahead."""
    cos = 1.0 / math.sqrt(1.0 + rise * rise)
    return escape(strength, angle(rise * cos, cos), rise * cos, left[0], left[1], left[2])


@kernel(inline=True)
def _place_of(k, points):
    """Distance of a cell's point, one of so many, from its node along the heading, in cells."""
    return (k + 0.5) / points - 0.5


@kernel(inline=True)
def _before(rows, row, a, b, k, points):
    """Share of a cell's sinkage at its point."""
    first, last = POINT + k * (POINTS // points), POINT + (k + 1) * (POINTS // points) - 1
    return 0.5 * (rows[row, first, a, b] + rows[row, last, a, b])
