"""The SCM model: records, checks and step."""

from __future__ import annotations

import math
from functools import cache

from ..contact import NO_DATA, WHEEL_EVENTS, has_pose, refusal, sees
from ..slave.interface import (
    ENVIRONMENT,
    body_pose,
    body_wrench,
    contact_jacobian,
    diagnostics,
    patch_in,
    trailing_in,
    wheel_active,
    wheel_pose,
    wheel_wrench,
)
from ..slave.kernel import kernel
from ..slave.model import STATUS_SPAN, Event, KernelModel, ModelError
from ..slave.records import Array, Choice, Real, Record
from ..soil import SOIL
from ..terrain.raster import load_raster
from ..wheel import WHEEL
from .bodies import (
    BODY_NO_DATA,
    BODY_OUTSIDE,
    BODY_STILL_NO_DATA,
    BODY_THROUGH,
    NO_MESH,
    answer_body,
    approach_with_mesh,
    body_contact,
    half_sizes,
    rearrange_body,
    refused_body,
    wheel_contact_with_mesh,
)
from .cloud import WIDTH
from .erosion import settle, slide
from .flow import press
from .heights import fill_patch, height_at, is_set
from .meshes import load_meshes
from .pool import SoilPool
from .stress import pressure_modulus, tabulate
from .tiles import SLIDING
from .tools import answer, approach, diagnose, patch_inside, rearrange, wheel_inside
from .wheel import CELLS, DEEPEST, deepest_of_table, wheel_contact

_OUTSIDE, _THROUGH, _FULL, _PATCH_OUTSIDE = 5, 6, 7, 8


class SCM(KernelModel):
    """Soil contact model: wheels and other bodies on sand that deforms, keeps ruts and slides down slopes.

    The soil is a height map in cells. Each cell under a tool bears an elastic-plastic pressure by its depth and what pressed it before, and
    shear by the displacement of the tool against it; what is pressed down is compacted or flows out beside the tool, the tool drags a
    layer along, and slopes slide down to the angle of repose (sections 8.3.12 to 8.3.15 of the chapter).

    Args:
        n_wheels: Number of wheels.
        n_patches: Number of wheels of other tiers that get the heights around them.
        n_bodies: Number of other bodies, such as footpads, bellies and rocks; each needs a mesh.
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
        BODY_NO_DATA: Event("body {i} has no pose yet (T is no rotation or nothing was ever set): no force", is_error=False),
        BODY_STILL_NO_DATA: Event("body[{i}] still has no pose after 2 steps: connect body[{i}].r_0, T, v_0, w_0"),
        BODY_OUTSIDE: Event("body {i} leaves the map: keep the box around its mesh within map_min, map_max and the base raster"),
        BODY_THROUGH: Event("body {i} is pressed through the soil's layer: raise layer_depth, lighten the body or take a stronger soil"),
        NO_MESH: Event("body[{i}].mesh names no file: give the path of a closed mesh (.stl, .obj or .ply, in metres)"),
    }
    pool_class = SoilPool

    def __init__(self, n_wheels: int = 1, n_patches: int = 0, n_bodies: int = 0):
        super().__init__(n_wheels=n_wheels, n_patches=n_patches, n_bodies=n_bodies)
        self.identifier = f"cdl_scm_w{n_wheels}" + (f"p{n_patches}" if n_patches else "") + (f"b{n_bodies}" if n_bodies else "")
        b = Real(0.0, "m", "Width b of Bekker's law; 0 = 2 A / L of the mesh's projection on its x-y plane", min=0.0, max=100.0)
        self.parameters = SCM.parameters | Record(body=Array(n_bodies, Record(b=b)))
        self.files = {
            "base": "Raster of heights of the undisturbed ground (.npz, .asc or .tif); none = flat at ground_z",
            "wheel_mesh": "Closed mesh of the wheels (.stl, .obj or .ply, in metres, y is the axle); none = cylinder with grousers",
            **{f"body[{i + 1}].mesh": "Closed mesh of the body (.stl, .obj or .ply, in metres)" for i in range(n_bodies)},
        }
        self.inputs = wheel_pose(n_wheels) | wheel_active(n_wheels) | trailing_in(n_patches) | body_pose(n_bodies)
        side = Real(0.0, "m", "Displacement of steep faces against the soil beside them, along and across", (2,))
        self.state = Record(
            stamp=Real(0.0, "1", "Number of the step"),
            sweep_time=Real(0.0, "s", "Time since the last sweep of landslides"),
            compacted=Real(0.0, "m", "Volume compacted so far, as height on one cell"),
            powers=Real(0.0, "1", "Table of depth^n, constant during a run", (2, 257)),
            wheel=Array(n_wheels, Record(silent=Real(0.0, "1", "Steps without a pose"), side=side)),
            body=Array(n_bodies, Record(silent=Real(0.0, "1", "Steps without a pose"), side=side)),
        )
        self.outputs = (
            wheel_wrench(n_wheels) | contact_jacobian(n_wheels) | diagnostics(n_wheels) | patch_in(n_patches) | body_wrench(n_bodies)
        )
        self.initialise_kernel = _initialise_with_bodies if n_bodies else _initialise
        self.step_kernel = _step_kernel(n_patches > 0, n_bodies > 0)

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
        n_wheels, n_bodies = self.sizes["n_wheels"], self.sizes["n_bodies"]
        names = ["wheel_mesh"] * n_wheels + [f"body[{i + 1}].mesh" for i in range(n_bodies)]
        widths = [p.b_w] * n_wheels + [p.body[i].b for i in range(n_bodies)]
        meshes = load_meshes(names, files, widths, p.cell)
        for name, width in zip(names, meshes.shapes[:, WIDTH]):
            if p.pressure_model == 1.0 and width > 0.0 and p.k_c / width + p.k_phi <= 0.0:
                raise ModelError(
                    f"{name} = {files[name].name}: its width b = {width:.4g} m gives k_c/b + k_phi <= 0; "
                    f"give {name.replace('mesh', 'b')} above {-p.k_c / p.k_phi:.4g} m, or another soil"
                )
        reach = math.hypot(p.r_w + p.h_g + 0.5 * p.b_w + 4.0 * p.cell, p.b_w + 4.0 * p.cell)
        try:
            base = load_raster(files["base"]) if "base" in files else None
        except ModelError as error:
            raise ModelError(f"base = {error}") from None
        return SoilPool(p.cell, max(reach, meshes.reach + 5.0 * p.cell), n_wheels + n_bodies, int(p.max_tiles), base, meshes)


@kernel
def _initialise(t, p, x, y, *arrays):
    x.stamp = 0.0
    x.sweep_time = 0.0
    x.compacted = 0.0
    tabulate(p.n, deepest_of_table(p), x.powers)
    for i in range(len(x.wheel)):
        x.wheel[i].silent = x.wheel[i].side[0] = x.wheel[i].side[1] = 0.0


@kernel
def _initialise_with_bodies(t, p, x, y, *arrays):
    _initialise(t, p, x, y, *arrays)
    for i in range(len(x.body)):
        x.body[i].silent = x.body[i].side[0] = x.body[i].side[1] = 0.0


@cache
def _step_kernel(patches: bool, bodies: bool):
    """The step of a model with or without patches and bodies: the records of one without them have no such fields."""

    @kernel
    def step(t, h, p, u, x, y, *arrays):
        rows, marks, head, ground, frame, elements, ranges, shapes = arrays[:8]
        grid, corner, cells, sums, blocks, outflow, placed, links, around, moved, boxes = arrays[8:]
        n_wheels = len(u.wheel)
        # Refuse before anything changes, so that the state of a refused step is the old one.
        for i in range(n_wheels):
            wheel = u.wheel[i]
            surface = height_at(p, rows, marks, head, ground, frame, wheel.r_0[0], wheel.r_0[1])
            refused = refusal(p, wheel, x.wheel[i].silent, surface)
            if refused:
                return refused + STATUS_SPAN * i
            if wheel.active > 0.0 and has_pose(wheel) and not wheel_inside(p, ground, frame, wheel):
                return _OUTSIDE + STATUS_SPAN * i
        if bodies:
            for i in range(len(u.body)):
                k = n_wheels + i
                refused = refused_body(p, ground, frame, u.body[i], x.body[i].silent, ranges[k, 1] - ranges[k, 0], shapes[k])
                if refused:
                    return refused + STATUS_SPAN * i
        if patches:
            for i in range(len(u.trailing)):
                if is_set(u.trailing[i].r_0) and not patch_inside(p, ground, frame, u.trailing[i].r_0, y.patch[i]):
                    return _PATCH_OUTSIDE + STATUS_SPAN * i

        for k in range(len(sums)):
            sums[k, CELLS] = -1.0  # not near the ground
        for i in range(n_wheels):
            wheel = u.wheel[i]
            if wheel.active > 0.0 and has_pose(wheel):
                if ranges[i, 1] > ranges[i, 0]:
                    done = approach_with_mesh(p, wheel, shapes[i], rows, marks, head, ground, frame, grid[i], corner[i], sums[i])
                else:
                    done = approach(p, wheel, rows, marks, head, ground, frame, grid[i], corner[i], sums[i])
                if not done:
                    return _FULL
        if bodies:
            for i in range(len(u.body)):
                k, body = n_wheels + i, u.body[i]
                if has_pose(body):
                    done = approach_with_mesh(p, body, shapes[k], rows, marks, head, ground, frame, grid[k], corner[k], sums[k])
                    if not done:
                        return _FULL

        # Stresses, all on the soil as it was at the step's begin.
        x.stamp += 1.0
        for i in range(n_wheels):
            wheel, side, modulus = u.wheel[i], x.wheel[i].side, pressure_modulus(p, p.b_w)
            if sums[i, CELLS] < 0.0:
                side[0] = side[1] = 0.0
            elif ranges[i, 1] > ranges[i, 0]:
                wheel_contact_with_mesh(
                    p,
                    x,
                    h,
                    wheel,
                    side,
                    modulus,
                    shapes[i],
                    elements,
                    ranges[i],
                    rows,
                    grid[i],
                    corner[i],
                    placed[i],
                    links[i],
                    cells[i],
                    sums[i],
                )
            else:
                side[1] = wheel_contact(
                    p, wheel, side[1], x.powers, modulus, h, x.stamp, rows, grid[i], corner[i], blocks[i], cells[i], sums[i]
                )
        if bodies:
            for i in range(len(u.body)):
                k, body, side = n_wheels + i, u.body[i], x.body[i].side
                if sums[k, CELLS] < 0.0:
                    side[0] = side[1] = 0.0
                else:
                    body_contact(
                        p,
                        x,
                        h,
                        body,
                        side,
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
        for k in range(len(sums)):
            if sums[k, CELLS] > 0.0 and sums[k, DEEPEST] > p.layer_depth:
                x.stamp -= 1.0
                return _THROUGH + STATUS_SPAN * k if k < n_wheels else BODY_THROUGH + STATUS_SPAN * (k - n_wheels)

        status = 0
        for i in range(n_wheels):
            wheel = u.wheel[i]
            if sees(wheel, x.wheel[i], y.wheel[i], y.contact[i], y.diagnostics[i]):
                if sums[i, CELLS] >= 0.0:
                    answer(p, wheel, sums[i], y.wheel[i], y.contact[i])
                diagnose(p, ground, frame, wheel, sums[i], y.wheel[i], y.diagnostics[i])
            elif x.wheel[i].silent > 0.0:
                status = NO_DATA + STATUS_SPAN * i
        if bodies:
            for i in range(len(u.body)):
                if not answer_body(u.body[i], x.body[i], sums[n_wheels + i], y.body[i]):
                    status = BODY_NO_DATA + STATUS_SPAN * i

        # The soil's turn.
        for k in range(len(sums)):
            if sums[k, CELLS] > 0.0:
                x.compacted += press(p, sums[k], cells[k], x.stamp, rows, marks)
        for i in range(n_wheels):
            if sums[i, CELLS] > 0.0:
                half, half_length = half_sizes(p, ranges[i], shapes[i])
                rearrange(
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
                k = n_wheels + i
                if sums[k, CELLS] > 0.0:
                    rearrange_body(
                        p, u.body[i], shapes[k], x.stamp, rows, marks, head, ground, frame, grid[k], corner[k], cells[k], sums[k]
                    )
        x.sweep_time += h
        sweeps = 0
        while x.sweep_time >= p.erosion_interval * (1.0 - 1e-9):
            x.sweep_time -= p.erosion_interval
            if sweeps < p.erosion_sweeps and head[SLIDING] > 0:
                for k in range(head[SLIDING]):
                    slide(p, rows, marks, head, ground, frame, x.stamp, k, around[k], moved[k])
                settle(p, rows, marks, head, ground, frame, moved, boxes)
                sweeps += 1
        if patches:
            for i in range(len(u.trailing)):
                fill_patch(p, rows, marks, head, ground, frame, u.trailing[i].r_0, y.patch[i])
        return status

    return step
