"""The DEM model: records, checks and step."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import asdict, replace

import numpy as np

from ..contact import WHEEL_EVENTS
from ..frames import vertical
from ..mesh.pool import surface_in
from ..mesh.surface import Meshes, join, nothing
from ..slave.interface import (
    ENVIRONMENT,
    body_pose,
    body_support,
    body_wrench,
    contact_jacobian,
    diagnostics,
    patch_in,
    patch_out,
    trailing_in,
    wheel_active,
    wheel_pose,
    wheel_wrench,
)
from ..slave.model import Event, KernelModel, ModelError
from ..slave.records import Array, Choice, Real, Record
from ..soil import RHO_RULE, SOIL
from ..wheel import WHEEL, WHEEL_RULES, tip_radius
from .apriori import grains_of
from .bed import Bed, BedKey
from .bed_files import load_bed
from .columns import Ground
from .law import STEP
from .library import Library
from .material import GRAIN, SURFACE, Material, material_of
from .memory import check_memory
from .pool import Box, GrainPool
from .scaling import check_box, check_feature, check_overlap
from .settle import TOLERANCE
from .simulation import check_threads
from .sizes import Uniform
from .step import (
    ARGUMENTS,
    BODY_NO_DATA,
    BODY_STILL_NO_DATA,
    BODY_TOO_DEEP,
    DEEP,
    FULL,
    NO_MESH,
    TOO_DEEP,
    initialise,
    parallel_step,
    step,
)
from .tools import AROUND, MESH, PLANE, POSITION, SHAPE, Tools, mesh_shape, tools_of, wheel_shape
from .tools import WHEEL as WHEEL_KIND

#: Own choices: sides of the tile in mean diameters; diameters of particles below ``fine_depth`` over those above; diameters of the largest
#: particle that move on all sides of a body.
TILE, COARSER, BESIDE = 24.0, 2.0, 10.0
#: Columns that are live beyond a box, at most: one on each side that is held, and those that it cuts.
_MARGINS = 4.0
#: How far values of a bed may be off those of the parameters, as a share.
_SAME = 1e-3

_MEASURED = {name: SOIL.fields[name] for name in ("phi", "c", "rho")}


class DEM(KernelModel):
    """Discrete element model: the soil as particles (sections 8.3.16 to 8.3.19 of the chapter).

    Particles touch each other, wheels and other bodies by the laws of ``cdl_fmu.dem.law``. The soil around each wheel moves, in a box that
    goes with it; elsewhere it is held and stored as it came to rest, and comes back so. The bed is settled once for its parameters and kept
    in the user's cache, or given as a file.

    Within a step the tools go evenly from their last poses to the new ones, and what is told of their wrench is the mean over the step.

    Args:
        n_wheels: Number of wheels.
        n_patches: Number of wheels of other tiers that get the heights around them.
        n_bodies: Number of other bodies, such as a cone, a plate or a mole; each needs a mesh.
    """

    parameters = (
        ENVIRONMENT
        | WHEEL
        | Record(
            ground_z=Real(0.0, "m", "Height of the undisturbed ground, from which sinkage counts", min=-1e6, max=1e6),
            contact_law=Choice("Normal force of contacts", hertz="Hertz-Mindlin", linear="Cundall and Strack's linear spring"),
            grains=Choice(
                "Where the parameters of the grains come from",
                soil="the soil's phi, c, rho and porosity, without calibration (cdl_fmu.dem.apriori)",
                given="grain.E, grain.mu and so on, as they are set here",
            ),
            **_MEASURED,
            porosity=Real(0.42, "1", "Porosity of the bed", min=0.3, max=0.6),
            grain=GRAIN,
            surface=SURFACE,
            d=Real(0.005, "m", "Mean diameter of the particles at the surface", min=1e-5, max=0.1),
            d_spread=Real(0.1, "1", "Largest deviation from the mean, as a share of it", min=0.0, max=0.5),
            depth=Real(0.165, "m", "Depth of the bed (1.2 radii of the wheel of Table 8.2, with grousers)", min=1e-3, max=10.0),
            fine_depth=Real(0.0, "m", "Depth from which on particles are coarser; 0 = nowhere", min=0.0, max=10.0),
            box_length=Real(0.4, "m", "Length of the box around a wheel in which the soil moves, along its heading", min=0.0, max=100.0),
            box_width=Real(0.25, "m", "Width of that box (2 widths of the wheel of Table 8.2)", min=0.0, max=100.0),
            dt=Real(0.0, "s", "Substep; 0 = the longest that is safely stable", min=0.0, max=1e-2),
            rest_speed=Real(2e-3, "m/s", "Speed, as way over 20 ms, below which particles outside the boxes are at rest", min=0.0, max=1.0),
            patch_spacing=Real(0.03, "m", "Distance of nodes in the patches for other tiers (section 8.4.2)", min=1e-3, max=1.0),
            seed=Real(1.0, "1", "Number of the bed, of those that differ by chance alone", min=0.0, max=1e6),
            threads=Real(1.0, "1", "Threads that share the particles, 0 = all of the machine; no result depends on it", min=0.0, max=256.0),
        )
    )
    rules = (*WHEEL_RULES, RHO_RULE)
    events = WHEEL_EVENTS | {
        FULL: Event(
            "the particles have more contacts than there is room for, or fly off: check the speed of wheels and bodies, "
            "dt = {p.dt:g} s and grain.E = {p.grain[E]:g} Pa"
        ),
        TOO_DEEP: Event(
            f"wheel {{i}}, at z = {{wheel.r_0[2]:.4g}} m, overlaps a particle by more than {DEEP:g} of its radius: it begins inside the "
            "bed, or jumped into it; start it above ground_z = {p.ground_z:g} m by r_w + h_g and a particle (d = {p.d:g} m)"
        ),
        BODY_NO_DATA: Event("body {i} has no pose yet (T is no rotation or nothing was ever set): no force", is_error=False),
        BODY_STILL_NO_DATA: Event("body[{i}] still has no pose after 2 steps: connect body[{i}].r_0, T, v_0, w_0"),
        BODY_TOO_DEEP: Event(
            f"body {{i}}, at z = {{body.r_0[2]:.4g}} m, overlaps a particle by more than {DEEP:g} of its radius: it begins inside the bed, "
            "or jumped into it; start it above ground_z = {p.ground_z:g} m, and let it down"
        ),
        NO_MESH: Event("body[{i}].mesh names no file: give the path of a closed mesh (.stl, .obj or .ply, in metres)"),
    }
    pool_class = GrainPool
    arguments = ARGUMENTS
    initialise_kernel = staticmethod(initialise)
    step_kernel = staticmethod(step)
    parallel_step_kernel = staticmethod(parallel_step)
    needs_python = "between steps Python puts particles into the boxes and takes them out, and settles the bed"

    def __init__(self, n_wheels: int = 1, n_patches: int = 0, n_bodies: int = 0):
        super().__init__(n_wheels=n_wheels, n_patches=n_patches, n_bodies=n_bodies)
        sizes = {"p": n_patches, "b": n_bodies}
        self.identifier = f"cdl_dem_w{n_wheels}" + "".join(f"{letter}{size}" for letter, size in sizes.items() if size)
        self.files = {
            "bed": "Bed of particles (.npz by cdl_fmu.dem.bed_files.write_bed); none = settled for these parameters, and kept",
            "wheel_mesh": "Closed mesh of the wheels (.stl, .obj or .ply, in metres, y is the axle); none = cylinder with grousers",
            **{f"body[{i + 1}].mesh": "Closed mesh of the body (.stl, .obj or .ply, in metres)" for i in range(n_bodies)},
        }
        self.inputs = wheel_pose(n_wheels) | wheel_active(n_wheels) | trailing_in(n_patches) | body_pose(n_bodies)
        silent = Record(silent=Real(0.0, "1", "Steps without a pose"))
        self.state = Record(wheel=Array(n_wheels, silent), body=Array(n_bodies, silent))
        self.outputs = (
            wheel_wrench(n_wheels)
            | contact_jacobian(n_wheels)
            | diagnostics(n_wheels)
            | patch_out(n_patches)
            | body_wrench(n_bodies)
            | body_support(n_bodies)
        )

    def check(self, p) -> None:
        super().check(p)
        _check_idle(p)
        if p.n_g > 0.0 and p.h_g > 0.0:
            check_feature("h_g", p.h_g, p.d)
        check_box(p.box_width, p.depth, p.b_w, tip_radius.py_func(p))
        self._check_memory(p)
        if p.box_length < 2.0 * tip_radius.py_func(p):
            raise ModelError(
                f"box_length = {p.box_length:g} m: shorter than the wheel of {2.0 * tip_radius.py_func(p):g} m; use 3 radii or more"
            )
        for name in ("seed", "threads"):
            if p[name] != math.floor(p[name]):
                raise ModelError(f"{name} = {p[name]:g}: it must be a whole number")
        check_threads(int(p.threads))

    def _check_memory(self, p) -> None:
        """Refuse boxes that hold more particles than this machine."""
        key = self.bed_key(p)
        over_area = sum((layer.top - layer.bottom) / layer.factor**3 for layer in key.layers) * (1.0 - key.porosity) / key.sizes.mean_volume
        area = (p.box_length + _MARGINS * key.column) * (p.box_width + _MARGINS * key.column)
        try:
            n = math.ceil(self.sizes["n_wheels"] * area * over_area)
            check_memory(n, 1 + sum(self.sizes.values()), shape=key.material.shape)
        except ModelError as error:
            raise ModelError(f"box_length = {p.box_length:g} m by box_width = {p.box_width:g} m: {error}") from None

    def prepare(self, p, files, progress) -> None:
        if "bed" not in files:
            self._settled(p, progress)

    def _settled(self, p, progress=lambda stage, share: None) -> Bed:
        """The bed for these parameters, which are refused before it is settled."""
        key = self.bed_key(p)
        key.material.check_step(float(p.dt), 0.5 * key.sizes.d_min)
        return Library().get(key, progress)

    def make_pool(self, p, files) -> GrainPool:
        bed = load_bed(files["bed"]) if "bed" in files else self._settled(p)
        _check_bed(p, bed)
        if "bed" in files:
            self._compare_grains(p, bed)
        material, smallest = bed.key.material, float(bed.radii.min())
        material.check_step(float(p.dt), smallest)
        law = material.law(material.largest_time_step(smallest))
        new_tools, meshes, boxes = self._tools(p, files, bed, law)
        settings = np.array([p.dt or material.time_step(smallest), *_gravity(p), 0.0])
        patches = (self.sizes["n_patches"], *patch_in(1).fields["patch"].record.fields["z"].shape), p.patch_spacing
        return GrainPool(Ground(bed, p.ground_z), new_tools, meshes, law, settings, boxes, patches, p.rest_speed)

    def _tools(self, p, files, bed: Bed, law: np.ndarray) -> tuple[Callable[[int], Tools], Meshes, list[Box]]:
        """What makes floor, wheels and bodies for a number of particles, their surfaces, and the boxes around wheels and bodies."""
        n_wheels, n_bodies = self.sizes["n_wheels"], self.sizes["n_bodies"]
        names = [*["wheel_mesh"] * n_wheels, *(f"body[{i + 1}].mesh" for i in range(n_bodies))]
        surfaces = [surface_in(name, files) for name in names]
        meshes = join(given) if (given := [surface for surface in surfaces if surface]) else nothing()
        roots, shapes, kinds = [-1], [np.zeros(SHAPE)], [PLANE]
        placed = iter(meshes.roots)
        for k, surface in enumerate(surfaces):
            roots.append(next(placed) if surface else -1)
            kinds.append(MESH if surface or k >= n_wheels else WHEEL_KIND)
            shapes.append(mesh_shape(surface) if surface else wheel_shape(p.r_w, p.b_w, p.n_g, p.h_g, p.t_g) if k < n_wheels else shapes[0])
        touching = replace(bed.key.material, **{name: float(p.surface[name]) for name in SURFACE.fields})
        laws = [law, *[touching.law(law[STEP])] * len(surfaces)]

        def new_tools(n: int) -> Tools:
            tools = tools_of(kinds, shapes, roots, laws, n)
            tools.poses[0, POSITION + 2] = tools.goals[0, POSITION + 2] = p.ground_z + bed.floor
            tools.present[1:] = 0
            return tools

        boxes = [Box(0.5 * p.box_length, 0.5 * p.box_width)] * n_wheels
        return new_tools, meshes, boxes + [Box(*[s[AROUND] + BESIDE * bed.key.largest] * 2) for s in shapes[1 + n_wheels :]]

    def bed_key(self, p) -> BedKey:
        """What the bed for these parameters is made from. Raises ModelError for parameters that no bed can have."""
        key = BedKey(
            material=self._material(p),
            sizes=Uniform(p.d * (1.0 - p.d_spread), p.d * (1.0 + p.d_spread)),
            porosity=float(p.porosity),
            depth=float(p.depth),
            size=(TILE * p.d, TILE * p.d),
            gravity=_gravity(p),
            seed=int(p.seed),
        )
        if p.fine_depth == 0.0:
            return key
        try:
            return replace(key, refinement=((float(p.fine_depth), COARSER),))
        except ModelError as error:
            raise ModelError(f"fine_depth = {p.fine_depth:g} m: {error}") from None

    def _material(self, p) -> Material:
        """The grains' material."""
        linear = p.contact_law == DEM.parameters.fields["contact_law"].value("linear")
        if p.grains == DEM.parameters.fields["grains"].value("given"):
            return material_of(p.grain, linear)
        return grains_of(phi=float(p.phi), c=float(p.c), rho=float(p.rho), porosity=float(p.porosity), linear=linear)

    def _compare_grains(self, p, bed: Bed) -> None:
        """Warn where a bed that was given has other grains than the parameters: its own are what counts."""
        wanted, has = asdict(self._material(p)), asdict(bed.key.material)
        texts = {name: [f"{x:g}" if isinstance(x, float) else f"{x}" for x in (has[name], wanted[name])] for name in has}
        if apart := [f"{name} = {own}, not {other}" for name, (own, other) in texts.items() if has[name] != wanted[name]]:
            warnings.warn(f"the bed that is given has grains of its own ({'; '.join(apart)}): these count", stacklevel=2)


def _gravity(p) -> tuple[float, float, float]:
    return tuple(-float(p.gravity) * axis for axis in vertical(p.slope, p.uphill))


def _check_idle(p) -> None:
    """Refuse grains that are set where those of the soil count."""
    if p.grains == DEM.parameters.fields["grains"].value("given"):
        return
    for name, field in GRAIN.fields.items():
        if p.grain[name] != field.start:
            raise ModelError(f"grain.{name} = {p.grain[name]:g}: grains are made from the soil; set grains = given, or leave it out")


def _check_bed(p, bed: Bed) -> None:
    """Refuse a bed that is another one than the parameters say, and warn of what is not as it was asked for."""
    gravity = float(np.linalg.norm(bed.key.gravity))
    for name, has, unit in (("d", bed.key.diameter, "m"), ("depth", bed.key.depth, "m"), ("gravity", gravity, "m/s2")):
        if abs(p[name] - has) > _SAME * has:
            raise ModelError(f"{name} = {p[name]:g} {unit}: the bed has {has:g} {unit}; give it that value, or another bed")
    if np.linalg.norm(np.subtract(bed.key.gravity, _gravity(p))) > _SAME * gravity:
        raise ModelError(
            f"slope = {p.slope:g} rad, uphill = {p.uphill:g} rad: the bed settled under a gravity of {bed.key.gravity} m/s2; give it that "
            "slope, or another bed"
        )
    if abs(bed.porosity - p.porosity) > TOLERANCE:
        warnings.warn(f"porosity = {p.porosity:g}: the bed has {bed.porosity:.4f}", stacklevel=2)
    check_overlap(bed.key.material, (1.0 - bed.porosity) * bed.key.material.density * gravity * bed.key.depth)
