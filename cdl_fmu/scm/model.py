"""The SCM model: records, checks and step."""

from __future__ import annotations

import math

from ..contact import NO_DATA, WHEEL_EVENTS, has_pose, refusal, sees
from ..slave.interface import ENVIRONMENT, contact_jacobian, diagnostics, patch_in, trailing_in, wheel_active, wheel_pose, wheel_wrench
from ..slave.kernel import kernel
from ..slave.model import STATUS_SPAN, Event, KernelModel, ModelError
from ..slave.records import Array, Choice, Real, Record
from ..soil import SOIL
from ..terrain.raster import load_raster
from ..wheel import WHEEL
from .erosion import settle, slide
from .flow import press
from .heights import fill_patch, height_at, is_set
from .pool import SoilPool
from .stress import pressure_modulus, tabulate
from .tiles import SLIDING
from .tools import answer, diagnose, inside, is_near, prepare, rearrange, wheel_inside
from .wheel import CELLS, DEEPEST, clear, deepest_of_table, wheel_contact

_OUTSIDE, _THROUGH, _FULL, _PATCH_OUTSIDE = 5, 6, 7, 8


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
                0.0, "m", "Height of the undisturbed ground, from which sinkage counts; a base raster has heights of its own", (), -1e6, 1e6
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
            transport_depth=Real(
                0.001, "m", "Depth of the layer that a slipping smooth tool drags along; grousers add their height", min=0.0, max=1.0
            ),
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
    files = {"base": "Raster of heights of the undisturbed ground (.npz, .asc or .tif); none = flat at ground_z"}
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

    def make_pool(self, p, files) -> SoilPool:
        reach = math.hypot(p.r_w + p.h_g + 0.5 * p.b_w + 4.0 * p.cell, p.b_w + 4.0 * p.cell)
        base = load_raster(files["base"]) if "base" in files else None
        return SoilPool(p.cell, [reach] * self.sizes["n_wheels"], int(p.max_tiles), base)


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
        on_map = inside(p, ground, frame, r_0[0] - reach_x, r_0[1] - reach_y) and inside(
            p, ground, frame, r_0[0] + reach_x, r_0[1] + reach_y
        )
        if is_set(r_0) and not on_map:
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
        if wheel.active > 0.0 and has_pose(wheel) and not wheel_inside(p, ground, frame, wheel):
            return _OUTSIDE + STATUS_SPAN * i
    for i in range(len(u.wheel)):
        clear(sums[i])
        sums[i, CELLS] = -1.0  # not near the ground
        wheel = u.wheel[i]
        if wheel.active > 0.0 and has_pose(wheel) and is_near(p, rows, marks, head, ground, frame, wheel):
            if not prepare(p, wheel, rows, marks, head, ground, frame, grid[i], corner[i]):
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
                answer(p, wheel, sums[i], y.wheel[i], y.contact[i])
            diagnose(p, ground, frame, wheel, sums[i], y.wheel[i], y.diagnostics[i])
        elif x.wheel[i].silent > 0.0:
            status = NO_DATA + STATUS_SPAN * i
    for i in range(len(u.wheel)):
        if sums[i, CELLS] > 0.0:
            x.compacted += press(p, sums[i], cells[i], x.stamp, rows, marks, 0.5 * p.b_w, p.r_w, outflow[i])
    for i in range(len(u.wheel)):
        if sums[i, CELLS] > 0.0:
            rearrange(p, u.wheel[i], x.stamp, rows, marks, head, ground, frame, grid[i], corner[i], cells[i], sums[i], outflow[i])
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
