"""The SCM model: records, checks and step."""

from __future__ import annotations

import math

from ..contact import NO_DATA, SLIP_FLOOR, WHEEL_EVENTS, anchor_here, lowest_point, refusal, sees, show
from ..slave.interface import ENVIRONMENT, contact_jacobian, diagnostics, patch_in, trailing_in, wheel_active, wheel_pose, wheel_wrench
from ..slave.kernel import kernel
from ..slave.model import STATUS_SPAN, Event, KernelModel, ModelError
from ..slave.records import Array, Choice, Real, Record
from ..soil import SOIL
from ..terramechanics import slip_ratio
from ..wheel import WHEEL
from .erosion import settle, slide
from .flow import heave, press, transport
from .heights import fill_patch, height_at, is_set
from .pool import SoilPool
from .stress import pressure_modulus, tabulate
from .tiles import SLIDING, base_height, let_slide, look_up, nearest, tile_of, touch
from .wheel import (
    ALONG_MAX,
    ALONG_MIN,
    CELLS,
    D_Z,
    DEEPEST,
    F_X,
    F_Y,
    F_Z,
    K_X,
    K_Y,
    K_Z,
    T_X,
    T_Y,
    T_Z,
    clear,
    deepest_of_table,
    wheel_contact,
)

_OUTSIDE, _THROUGH, _FULL, _PATCH_OUTSIDE = 5, 6, 7, 8
_NEAR = 0.03  # [m] above the ground from which on a wheel's tiles are made ready


class SCM(KernelModel):
    """Soil contact model: wheels and other bodies on sand that deforms, keeps ruts and slides down slopes.

    The soil is a height map in cells. Each cell under a tool bears an elastic-plastic pressure by its depth and what pressed it before, and
    shear by the displacement of the tool against it; what is pressed down is compacted or flows out beside the tool, the tool drags a
    layer along, and slopes slide down to the angle of repose (sections 8.3.12 to 8.3.15 of the chapter).

    Args:
        n_wheels: Number of wheels.
        n_patches: Number of wheels of other tiers that get the heights around them.
    """

    parameters = (
        ENVIRONMENT
        | SOIL
        | WHEEL
        | Record(
            ground_z=Real(
                0.0, "m", "Height of the undisturbed ground, where it is flat; sinkage counts from the undisturbed ground", (), -1e6, 1e6
            ),
            cell=Real(0.01, "m", "Size of a cell of the soil (Table 8.2)", min=1e-4, max=1.0),
            pressure_model=Choice("Plastic pressure", bekker="(k_c/b + k_phi) z^n", reece="(c k_c_1 + rho g b k_phi_1) (z/b)^n"),
            k_c_1=Real(50.0, "1", "Reece's k'_c; used by reece", min=0.0, max=1e6),
            k_phi_1=Real(1000.0, "1", "Reece's k'_phi; used by reece", min=0.0, max=1e6),
            k_e=Real(2e8, "Pa/m", "Elastic stiffness of soil that is unloaded and loaded again", min=1e3, max=1e12),
            K=Real(0.02, "m", "Shear displacement modulus of Janosi and Hanamoto", min=1e-6, max=10.0),
            tau_r=Real(0.1, "s", "Time by which the shear velocity adds to the shear displacement", min=0.0, max=10.0),
            c_d=Real(1.9, "s/m", "Normal damping: pressure grows by this times the wheel's sinking speed", min=0.0, max=1e3),
            kappa_q=Real(0.0, "1", "Share of the rim's pressure that surcharges grouser faces", min=0.0, max=1.0),
            plasticity=Real(0.6, "1", "Share of the plastically displaced volume that flows out; the rest is compacted", min=0.0, max=1.0),
            ahead=Real(0.1, "1", "Share of the outflow that goes ahead of the tool", min=0.0, max=1.0),
            mound_strength=Real(0.2, "1", "Share of a mound's height that counts as depth for the pressure", min=0.0, max=1.0),
            transport_depth=Real(0.003, "m", "Depth of the layer that a slipping tool drags along", min=0.0, max=1.0),
            repose=Real(0.640535835481919, "rad", "Angle of repose, above 0 and below 90 deg (36.7 deg: phi of MSS-D)", min=0.01, max=1.55),
            erosion_interval=Real(1e-3, "s", "Simulated time between two sweeps of landslides", min=1e-6, max=10.0),
            erosion_sweeps=Real(4.0, "1", "Most sweeps in one step", min=0.0, max=1e4),
            layer_depth=Real(10.0, "m", "Depth of the soil's layer above what cannot be pressed", min=1e-3, max=1e4),
            patch_spacing=Real(0.03, "m", "Distance of nodes in the patches for other tiers (section 8.4.2)", min=1e-4, max=1.0),
            map_min=Real(-1e6, "m", "Least x and y of the map", (2,), -1e6, 1e6),
            map_max=Real(1e6, "m", "Largest x and y of the map", (2,), -1e6, 1e6),
            max_tiles=Real(200_000.0, "1", "Most tiles of 16 x 16 cells (14 kB each) that may be touched", min=1.0, max=1e8),
        )
    )
    events = WHEEL_EVENTS | {
        _OUTSIDE: Event("wheel {i} leaves the map: keep it, half a wheel's length inside, within map_min, map_max and the base raster"),
        _THROUGH: Event("wheel {i} is pressed through the soil's layer: raise layer_depth, lighten the wheel or take a stronger soil"),
        _FULL: Event("the soil's pool is full: raise max_tiles, coarsen cell or shorten the drive"),
        _PATCH_OUTSIDE: Event("patch[{i}] reaches beyond the map: keep trailing[{i}].r_0 within map_min, map_max and the base raster"),
    }
    pool_class = SoilPool

    def __init__(self, n_wheels: int = 1, n_patches: int = 0):
        super().__init__(n_wheels=n_wheels, n_patches=n_patches)
        self.identifier = f"cdl_scm_w{n_wheels}" + (f"p{n_patches}" if n_patches else "")
        self.inputs = wheel_pose(n_wheels) | wheel_active(n_wheels) | trailing_in(n_patches)
        self.state = Record(
            stamp=Real(0.0, "1", "Number of the step"),
            sweep_time=Real(0.0, "s", "Time since the last sweep of landslides"),
            compacted=Real(0.0, "m", "Volume compacted so far, as height on one cell"),
            powers=Real(0.0, "1", "Table of depth^n, constant during a run", (2, 257)),
            wheel=Array(
                n_wheels,
                Record(
                    silent=Real(0.0, "1", "Steps without a pose"),
                    side=Real(0.0, "m", "Displacement of the sides against the soil beside them, to the left"),
                ),
            ),
        )
        self.outputs = wheel_wrench(n_wheels) | contact_jacobian(n_wheels) | diagnostics(n_wheels) | patch_in(n_patches)
        self.initialise_kernel = _initialise
        self.step_kernel = _step_patches if n_patches else _step

    def check(self, p) -> None:
        if p.cell > p.b_w / 3.0:
            raise ModelError(
                f"cell = {p.cell:g} m: larger than a third of the wheel's width b_w = {p.b_w:g} m; use at most {p.b_w / 3.0:.3g} m"
            )
        if p.n_g != math.floor(p.n_g):
            raise ModelError(f"n_g = {p.n_g:g}: the number of grousers must be whole")
        if p.pressure_model == 1.0 and p.k_c / p.b_w + p.k_phi <= 0.0:
            raise ModelError(
                f"k_c = {p.k_c:g} N/m^{p.n + 1:.4g}: k_c/b + k_phi <= 0 for wheel width b = {p.b_w:g} m; use a wider wheel or another soil"
            )

    def make_pool(self, p, files=None) -> SoilPool:
        reach = math.hypot(p.r_w + p.h_g + 0.5 * p.b_w + 4.0 * p.cell, p.b_w + 4.0 * p.cell)
        return SoilPool(p.cell, [reach] * self.sizes["n_wheels"], int(p.max_tiles), None, (0.0, 0.0, 1.0))


@kernel
def _initialise(t, p, x, y, rows, marks, head, ground, frame, grid, corner, cells, sums, outflow, around, moved, boxes):
    x.stamp = 0.0
    x.sweep_time = 0.0
    x.compacted = 0.0
    tabulate(p.n, deepest_of_table(p), x.powers)
    for i in range(len(x.wheel)):
        x.wheel[i].silent = 0.0
        x.wheel[i].side = 0.0


@kernel
def _step_patches(t, h, p, u, x, y, rows, marks, head, ground, frame, grid, corner, cells, sums, outflow, around, moved, boxes):
    for k in range(len(u.trailing)):
        r_0, patch = u.trailing[k].r_0, y.patch[k]
        half = 0.5 * p.patch_spacing
        reach_x, reach_y = (patch.z.shape[0]) * half, (patch.z.shape[1]) * half
        inside = _inside(p, ground, frame, r_0[0] - reach_x, r_0[1] - reach_y) and _inside(
            p, ground, frame, r_0[0] + reach_x, r_0[1] + reach_y
        )
        if is_set(r_0) and not inside:
            return _PATCH_OUTSIDE + STATUS_SPAN * k
    status = _step(t, h, p, u, x, y, rows, marks, head, ground, frame, grid, corner, cells, sums, outflow, around, moved, boxes)
    for k in range(len(u.trailing)):
        fill_patch(p, rows, marks, head, ground, frame, u.trailing[k].r_0, y.patch[k])
    return status


@kernel
def _step(t, h, p, u, x, y, rows, marks, head, ground, frame, grid, corner, cells, sums, outflow, around, moved, boxes):
    # Refuse before anything changes, so that the state of a refused step is the old one.
    for i in range(len(u.wheel)):
        wheel = u.wheel[i]
        surface = height_at(p, rows, marks, head, ground, frame, wheel.r_0[0], wheel.r_0[1])
        refused = refusal(p, wheel, x.wheel[i].silent, surface)
        if refused:
            return refused + STATUS_SPAN * i
        if wheel.active > 0.0 and not _wheel_inside(p, ground, frame, wheel):
            return _OUTSIDE + STATUS_SPAN * i
    for i in range(len(u.wheel)):
        clear(sums[i])
        sums[i, CELLS] = -1.0  # not near the ground
        wheel = u.wheel[i]
        if wheel.active > 0.0 and _is_near(p, rows, marks, head, ground, frame, wheel):
            if not _prepare(p, wheel, rows, marks, head, ground, frame, grid[i], corner[i]):
                return _FULL
            sums[i, CELLS] = 0.0
    x.stamp += 1.0
    modulus = pressure_modulus(p, p.b_w)
    for i in range(len(u.wheel)):
        if sums[i, CELLS] >= 0.0:
            x.wheel[i].side = wheel_contact(
                p, u.wheel[i], x.wheel[i].side, x.powers, modulus, h, x.stamp, rows, grid[i], corner[i], cells[i], sums[i]
            )
        else:
            x.wheel[i].side = 0.0
    status = 0
    for i in range(len(u.wheel)):
        if sums[i, DEEPEST] > p.layer_depth:
            x.stamp -= 1.0
            return _THROUGH + STATUS_SPAN * i
    for i in range(len(u.wheel)):
        wheel = u.wheel[i]
        if sees(wheel, x.wheel[i], y.wheel[i], y.contact[i], y.diagnostics[i]):
            if sums[i, CELLS] >= 0.0:
                _answer(p, wheel, sums[i], y.wheel[i], y.contact[i])
            _diagnose(p, ground, frame, wheel, sums[i], y.wheel[i], y.diagnostics[i])
        elif x.wheel[i].silent > 0.0:
            status = NO_DATA + STATUS_SPAN * i
    for i in range(len(u.wheel)):
        if sums[i, CELLS] > 0.0:
            x.compacted += press(p, sums[i], cells[i], x.stamp, rows, marks, 0.5 * p.b_w, p.r_w, outflow[i])
    for i in range(len(u.wheel)):
        if sums[i, CELLS] > 0.0:
            _rearrange(p, u.wheel[i], x.stamp, rows, marks, head, ground, frame, grid[i], corner[i], cells[i], sums[i], outflow[i])
    x.sweep_time += h
    sweeps = 0
    while x.sweep_time >= p.erosion_interval * (1.0 - 1e-9):
        x.sweep_time -= p.erosion_interval
        if sweeps < p.erosion_sweeps and head[SLIDING] > 0:
            for k in range(head[SLIDING]):
                slide(p, rows, marks, head, ground, frame, x.stamp, k, around[k], moved[k])
            settle(p, rows, marks, head, ground, frame, moved, boxes)
            sweeps += 1
    return status


@kernel
def _inside(p, ground, frame, x, y):
    """Whether a point lies on the map and, where there is one, on the base raster."""
    if not (p.map_min[0] <= x <= p.map_max[0] and p.map_min[1] <= y <= p.map_max[1]):
        return False
    if ground.shape[0] < 2:
        return True
    last_x, last_y = frame[0] + (ground.shape[0] - 1) * frame[2], frame[1] + (ground.shape[1] - 1) * frame[2]
    return frame[0] <= x <= last_x and frame[1] <= y <= last_y


@kernel
def _wheel_inside(p, ground, frame, wheel):
    reach = p.r_w + p.h_g
    return _inside(p, ground, frame, wheel.r_0[0] - reach, wheel.r_0[1] - reach) and _inside(
        p, ground, frame, wheel.r_0[0] + reach, wheel.r_0[1] + reach
    )


@kernel
def _span(p, wheel):
    """Half extents [m] along the world's x and y of the soil that a wheel works on: its footprint and the ground that heaves around it."""
    level = math.sqrt(wheel.T[1, 0] ** 2 + wheel.T[1, 1] ** 2)
    along = p.r_w + p.h_g + 0.5 * p.b_w + 4.0 * p.cell
    across = p.b_w + 4.0 * p.cell
    l_x, l_y = abs(wheel.T[1, 0] / level), abs(wheel.T[1, 1] / level)
    return along * l_y + across * l_x, along * l_x + across * l_y


@kernel
def _is_near(p, rows, marks, head, ground, frame, wheel):
    """Whether a wheel is close to the ground: its lowest point against the surface on a coarse raster below it."""
    if wheel.T[1, 0] ** 2 + wheel.T[1, 1] ** 2 == 0.0:
        return False
    lowest = lowest_point(p, wheel) - p.h_g - _NEAR
    reach = p.r_w + p.h_g
    for i in range(-2, 3):
        for j in range(-2, 3):
            x, y = wheel.r_0[0] + 0.5 * i * reach, wheel.r_0[1] + 0.5 * j * reach
            if height_at(p, rows, marks, head, ground, frame, x, y) > lowest:
                return True
    return False


@kernel
def _prepare(p, wheel, rows, marks, head, ground, frame, grid, corner):
    """Allocate and look up the tiles around a wheel; False if the pool is full."""
    s_x, s_y = _span(p, wheel)
    r_0 = wheel.r_0
    i0, i1 = nearest(r_0[0] - s_x, p.cell), nearest(r_0[0] + s_x, p.cell)
    j0, j1 = nearest(r_0[1] - s_y, p.cell), nearest(r_0[1] + s_y, p.cell)
    for a in range(tile_of(i0), tile_of(i1) + 1):
        for b in range(tile_of(j0), tile_of(j1) + 1):
            if touch(p, rows, marks, head, ground, frame, a, b) < 0:
                return False
    look_up(marks, head, grid, corner, i0, i1, j0, j1)
    return True


@kernel
def _rearrange(p, wheel, stamp, rows, marks, head, ground, frame, grid, corner, cells, sums, outflow):
    """Soil dragged along and soil that heaves, and what may slide after it."""
    transport(sums, cells, stamp, rows, marks, grid, corner)
    heave(p, sums, wheel, 0.5 * p.b_w, p.r_w, outflow, rows, grid, corner)
    s_x, s_y = _span(p, wheel)
    r_0 = wheel.r_0
    # Work on the part of the wheel's surroundings that its footprint, the heave and their neighbours fill.
    level = math.sqrt(wheel.T[1, 0] ** 2 + wheel.T[1, 1] ** 2)
    l_x, l_y = wheel.T[1, 0] / level, wheel.T[1, 1] / level
    middle, length = 0.5 * (sums[ALONG_MAX] + sums[ALONG_MIN]), 0.5 * (sums[ALONG_MAX] - sums[ALONG_MIN])
    x, y = r_0[0] + middle * l_y, r_0[1] - middle * l_x
    along, across = length + 0.5 * p.b_w + 4.0 * p.cell, p.b_w + 4.0 * p.cell
    s_x, s_y = along * abs(l_y) + across * abs(l_x), along * abs(l_x) + across * abs(l_y)
    let_slide(
        p,
        rows,
        marks,
        head,
        ground,
        frame,
        nearest(x - s_x, p.cell),
        nearest(x + s_x, p.cell),
        nearest(y - s_y, p.cell),
        nearest(y + s_y, p.cell),
    )


@kernel
def _answer(p, wheel, sums, wrench, contact):
    """Wrench and interface Jacobian from the sums of a wheel."""
    T = wheel.T
    level = math.sqrt(T[1, 0] ** 2 + T[1, 1] ** 2)
    l_x, l_y = T[1, 0] / level, T[1, 1] / level
    weight = wheel.active
    for k in range(3):
        contact.F[k] = weight * sums[F_X + k]
        contact.axes[0, k] = contact.axes[1, k] = contact.axes[2, k] = 0.0
        contact.point_0[k] = wheel.r_0[k]
    contact.axes[0, 0], contact.axes[0, 1] = l_y, -l_x
    contact.axes[1, 0], contact.axes[1, 1] = l_x, l_y
    contact.axes[2, 2] = 1.0
    contact.point_0[2] -= p.r_w
    wrench.f_0[0] = weight * (sums[F_X] * l_y + sums[F_Y] * l_x)
    wrench.f_0[1] = weight * (sums[F_Y] * l_y - sums[F_X] * l_x)
    wrench.f_0[2] = weight * sums[F_Z]
    wrench.t_0[0] = weight * (sums[T_X] * l_y + sums[T_Y] * l_x)
    wrench.t_0[1] = weight * (sums[T_Y] * l_y - sums[T_X] * l_x)
    wrench.t_0[2] = weight * sums[T_Z]
    contact.K[0], contact.K[1], contact.K[2] = weight * sums[K_X], weight * sums[K_Y], weight * sums[K_Z]
    contact.D[0], contact.D[1], contact.D[2] = p.tau_r * contact.K[0], p.tau_r * contact.K[1], weight * sums[D_Z]
    contact.in_contact = 1.0 if sums[F_Z] > 0.0 else 0.0
    anchor_here(wheel, contact)


@kernel
def _diagnose(p, ground, frame, wheel, sums, wrench, shown):
    T, v, w = wheel.T, wheel.v_0, wheel.w_0
    level = math.sqrt(T[1, 0] ** 2 + T[1, 1] ** 2)
    v_x = (v[0] * T[1, 1] - v[1] * T[1, 0]) / level
    rim = p.r_w * (w[0] * T[1, 0] + w[1] * T[1, 1] + w[2] * T[1, 2])
    low = nearest(wheel.r_0[0], p.cell), nearest(wheel.r_0[1], p.cell)
    sinkage = base_height(p, ground, frame, low[0], low[1]) - lowest_point(p, wheel)
    front = back = 0.0
    if sums[CELLS] > 0.0:
        half = 0.5 * p.cell
        front = math.asin(min(1.0, max(-1.0, (sums[ALONG_MAX] + half) / p.r_w)))
        back = math.asin(min(1.0, max(-1.0, (sums[ALONG_MIN] - half) / p.r_w)))
    entry, exit_ = (front, back) if v_x + rim >= 0.0 else (back, front)
    torque = -(wrench.t_0[0] * T[1, 0] + wrench.t_0[1] * T[1, 1] + wrench.t_0[2] * T[1, 2])
    show(wheel, sinkage, slip_ratio(v_x, rim, SLIP_FLOOR), entry, exit_, wrench.f_0, torque, shown)
