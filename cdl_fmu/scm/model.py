"""The SCM model: records, checks and step."""

from __future__ import annotations

import math
from dataclasses import replace

from ..contact import WHEEL_EVENTS
from ..slave.interface import (
    ENVIRONMENT,
    body_pose,
    body_support,
    body_wrench,
    contact_jacobian,
    diagnostics,
    patch_out,
    trailing_in,
    wheel_active,
    wheel_pose,
    wheel_wrench,
)
from ..slave.kernel import MOST_THREADS
from ..slave.model import Event, KernelModel, ModelError, Rule
from ..slave.records import Array, Choice, Real, Record
from ..soil import BEARING_RULES, RHO_RULE, SOIL
from ..strength import STRENGTH, STRENGTHS
from ..terrain.raster import load_raster
from ..unloading import UNLOADING
from ..wheel import WHEEL, WHEEL_RULES
from .bodies import BODY_NO_DATA, BODY_OUTSIDE, BODY_STILL_NO_DATA, BODY_THROUGH, NO_MESH
from .columns import SETTLED, WIDTH
from .density import COMPRESSIBLE, DENSITY_RULE
from .erosion import repose_of
from .meshes import PER_CELL, PER_CELL_OF_BODIES, load_meshes
from .pool import SoilPool, resize
from .step import ARGUMENTS, FULL, NO_ROOM_TO_SLIDE, OUTSIDE, PATCH_OUTSIDE, THROUGH, initialise, step_kernels
from .tiles import LONGEST_QUEUE

_MAP = "map_min, map_max ({p.map_min[0]:g} to {p.map_max[0]:g} m in x, {p.map_min[1]:g} to {p.map_max[1]:g} m in y) and the base raster"

#: A patch reaches this many nodes from the wheel's centre to its nearer edges, and has to reach this far, in radii of the wheel.
_HALF_PATCH, _SHORTEST_CONTACT = 3.5, 0.75
_REACHING = Rule(
    "patch_spacing = {p.patch_spacing:g} m: a patch of 13 x 9 nodes does not reach around the contact of a wheel of r_w = {p.r_w:g} m; "
    "use at least {least:.3g} m",
    lambda p: p.patch_spacing < _SHORTEST_CONTACT * p.r_w / _HALF_PATCH,
    dict(least=lambda p: _SHORTEST_CONTACT * p.r_w / _HALF_PATCH),
)


class SCM(KernelModel):
    """Soil contact model: wheels and other bodies on sand that deforms, keeps ruts and slides down slopes.

    The soil is a height map in cells. Each cell under a tool bears an elastic-plastic pressure by its depth and what pressed it before, and
    shear by the displacement of the tool against it; soil that is sheared, pushed along or heaped up bears less (see ``strength``). What is
    pressed down is compacted or flows out beside the tool, the tool drags a layer along, and slopes slide down to the angle of repose
    (sections 8.3.12 to 8.3.15 of the chapter). If it is ``compressible``, soil that is compacted again gets denser and stronger.

    Bodies lie on the soil or in it: around one that begins in it the soil is laid (see ``embedding``). Beside the wrench they get stiffness
    and damping of the soil below them, as ``support``.

    Args:
        n_wheels: Number of wheels.
        n_patches: Number of wheels of other tiers that get the heights around them.
        n_bodies: Number of other bodies, such as footpads, bellies and rocks; each needs a mesh.
        n_compacted: 0, or n_patches: the patches say what pressed the soil before, beside its heights.
    """

    parameters = (
        ENVIRONMENT
        | SOIL
        | WHEEL
        | STRENGTH
        | UNLOADING
        | COMPRESSIBLE
        | Record(
            ground_z=Real(
                0.0, "m", "Height of the undisturbed ground, from which sinkage counts; a base raster has heights of its own", (), -1e6, 1e6
            ),
            cell=Real(0.01, "m", "Size of a cell of the soil (Table 8.2)", min=1e-4, max=1.0),
            pressure_model=Choice("Plastic pressure", bekker="(k_c/b + k_phi) z^n", reece="(c k_c_1 + rho g b k_phi_1) (z/b)^n"),
            k_c_1=Real(50.0, "1", "Reece's k'_c; used by reece", min=0.0, max=1e6),
            k_phi_1=Real(1000.0, "1", "Reece's k'_phi; used by reece", min=0.0, max=1e6),
            strength=STRENGTHS.starting_with("critical_state"),
            tau_r=Real(0.1, "s", "Time by which the shear velocity adds to the shear displacement", min=0.0, max=10.0),
            c_d=Real(1.9, "s/m", "Normal damping: pressure grows by this times the wheel's sinking speed", min=0.0, max=1e3),
            kappa_q=Real(0.0, "1", "Share of the rim's pressure that surcharges grouser faces", min=0.0, max=1.0),
            plasticity=Real(0.6, "1", "Share of the plastically displaced volume that flows out; the rest is compacted", min=0.0, max=1.0),
            ahead=Real(0.25, "1", "Share of the outflow that goes where friction pushes the soil, ahead or aside", min=0.0, max=1.0),
            transport_depth=Real(
                0.0005,
                "m",
                "Depth of the layer that a slipping smooth tool drags along; grousers add the wedges ahead of them",
                min=0.0,
                max=1.0,
            ),
            repose=Real(0.0, "rad", "Angle of repose, below 90 deg; 0 = phi, as of loose dry sand", min=0.0, max=1.55),
            erosion_interval=Real(1e-3, "s", "Simulated time between two sweeps of landslides", min=1e-6, max=10.0),
            erosion_sweeps=Real(4.0, "1", "Most sweeps in one step", min=0.0, max=1e4),
            layer_depth=Real(10.0, "m", "Depth of the soil's layer above what cannot be pressed", min=1e-3, max=1e4),
            patch_spacing=Real(0.03, "m", "Distance of nodes in the patches for other tiers (section 8.4.2)", min=1e-4, max=1.0),
            map_min=Real(-1e6, "m", "Least x and y of the map", (2,), -1e6, 1e6),
            map_max=Real(1e6, "m", "Largest x and y of the map", (2,), -1e6, 1e6),
            threads=Real(1.0, "1", "Threads that work on tools and landslides at once; no result depends on it", min=1.0, max=256.0),
            max_tiles=Real(200_000.0, "1", "Most tiles of 16 x 16 cells (31 kB each) that may be touched", min=1.0, max=1e8),
        )
    )
    rules = (
        Rule(
            "cell = {p.cell:g} m: larger than a third of the wheel's width b_w = {p.b_w:g} m; use at most {most:.3g} m",
            lambda p: p.cell > p.b_w / 3.0,
            dict(most=lambda p: p.b_w / 3.0),
        ),
        *WHEEL_RULES,
        RHO_RULE,
        Rule(
            "slope = {p.slope:g} rad: steeper than the soil's angle of repose, {repose:.4g} rad, it slides down by itself; "
            "use at most {repose:.4g} rad, or raise repose (0 = phi)",
            lambda p: p.slope > repose_of(p),
            dict(repose=repose_of),
        ),
        Rule(
            "erosion_sweeps = {p.erosion_sweeps:g}: it must be a whole number", lambda p: p.erosion_sweeps != math.floor(p.erosion_sweeps)
        ),
        Rule("max_tiles = {p.max_tiles:g}: it must be a whole number", lambda p: p.max_tiles != math.floor(p.max_tiles)),
        Rule(
            "map_min = {p.map_min[0]:g} m along x: it must be less than map_max, which is {p.map_max[0]:g} m",
            lambda p: p.map_min[0] >= p.map_max[0],
        ),
        Rule(
            "map_min = {p.map_min[1]:g} m along y: it must be less than map_max, which is {p.map_max[1]:g} m",
            lambda p: p.map_min[1] >= p.map_max[1],
        ),
        *(replace(rule, applies=lambda p: p.pressure_model == 1.0) for rule in BEARING_RULES),
        DENSITY_RULE,
    )
    events = WHEEL_EVENTS | {
        OUTSIDE: Event(
            "wheel {i}, at ({wheel.r_0[0]:.4g}, {wheel.r_0[1]:.4g}) m, leaves the map: keep it, half a wheel's length inside, "
            f"within {_MAP}"
        ),
        THROUGH: Event(
            "wheel {i} is pressed through the soil's layer, layer_depth = {p.layer_depth:g} m: "
            "raise layer_depth, lighten the wheel or take a stronger soil"
        ),
        FULL: Event(
            "the soil's pool is full, max_tiles = {p.max_tiles:.0f} of 16 x 16 cells of {p.cell:g} m: "
            "raise max_tiles, coarsen cell or shorten the drive"
        ),
        PATCH_OUTSIDE: Event(
            "patch[{i}] reaches beyond the map: keep trailing[{i}].r_0, now ({trailing.r_0[0]:.4g}, {trailing.r_0[1]:.4g}) m, "
            f"half a patch inside {_MAP}"
        ),
        NO_ROOM_TO_SLIDE: Event(
            f"soil that should slide stays where it is: it is on more than {LONGEST_QUEUE} tiles at once, or they are more than "
            "max_tiles = {p.max_tiles:.0f}; raise max_tiles, coarsen cell, or take a base raster that is less steep than the angle of "
            "repose, repose = {p.repose:.3g} rad (0 = phi, {p.phi:.3g} rad)",
            is_error=False,
        ),
        BODY_NO_DATA: Event("body {i} has no pose yet (T is no rotation or nothing was ever set): no force", is_error=False),
        BODY_STILL_NO_DATA: Event("body[{i}] still has no pose after 2 steps: connect body[{i}].r_0, T, v_0, w_0"),
        BODY_OUTSIDE: Event(
            f"body {{i}}, at ({{body.r_0[0]:.4g}}, {{body.r_0[1]:.4g}}) m, leaves the map: keep the box around its mesh within {_MAP}"
        ),
        BODY_THROUGH: Event(
            "body {i} is pressed through the soil's layer, layer_depth = {p.layer_depth:g} m: "
            "raise layer_depth, lighten the body or take a stronger soil"
        ),
        NO_MESH: Event("body[{i}].mesh names no file: give the path of a closed mesh (.stl, .obj or .ply, in metres)"),
    }
    pool_class = SoilPool
    arguments = ARGUMENTS
    initialise_kernel = staticmethod(initialise)
    resize_kernel = staticmethod(resize)
    gains_from_vectors = True

    def __init__(self, n_wheels: int = 1, n_patches: int = 0, n_bodies: int = 0, n_compacted: int = 0):
        if n_compacted not in (0, n_patches):
            raise ValueError(
                f"n_compacted = {n_compacted}: choose 0 or n_patches, which is {n_patches}: all patches carry compaction, or none"
            )
        super().__init__(n_wheels=n_wheels, n_patches=n_patches, n_bodies=n_bodies, n_compacted=n_compacted)
        sizes = {"p": n_patches, "b": n_bodies, "c": n_compacted}
        self.identifier = f"cdl_scm_w{n_wheels}" + "".join(f"{letter}{size}" for letter, size in sizes.items() if size)
        b = Real(0.0, "m", "Width b of Bekker's law; 0 = 2 A / L of the mesh's projection on its x-y plane", min=0.0, max=100.0)
        settled = Real(
            0.0, "m", "Depth by which a body that begins in the soil has pressed what is below it before; 0 = not at all", min=0.0, max=10.0
        )
        self.parameters = SCM.parameters | Record(body=Array(n_bodies, Record(b=b, settled=settled)))
        self.files = {
            "base": "Raster of heights of the undisturbed ground (.npz, .asc or .tif); none = flat at ground_z",
            "wheel_mesh": "Closed mesh of the wheels (.stl, .obj or .ply, in metres, y is the axle); none = cylinder with grousers",
            **{f"body[{i + 1}].mesh": "Closed mesh of the body (.stl, .obj or .ply, in metres)" for i in range(n_bodies)},
        }
        self.needed_files = tuple(f"body[{i + 1}].mesh" for i in range(n_bodies))
        self.inputs = wheel_pose(n_wheels) | wheel_active(n_wheels) | trailing_in(n_patches) | body_pose(n_bodies)
        side = Real(0.0, "m", "Displacement of steep faces against the soil beside them, along and across", (2,))
        pushed = Real(0.0, "m", "Displacement of the soil that it pushes ahead, in world axes", (2,))
        laid = Real(0.0, "1", "1 from its first step with a pose on: the soil was laid around it then, where it began below the surface")
        held = body_wrench(1).fields["body"].record | body_support(1).fields["support"].record
        rest = Record(
            steps=Real(0.0, "1", "Steps since its contact was worked out last"),
            since=Real(0.0, "s", "Time since then"),
            soil=Real(0.0, "m", "What tells the soil that it was worked out on from other soil"),
            farthest=Real(0.0, "m", "Motion of its surface from then on over which its force hardly changes"),
            held=held,  # what was found then, if in_contact
            seat=Record(r_0=Real(0.0, "m", "Position by which it is seated", (3,)), T=Real(0.0, "1", "Rotation", (3, 3))),
        )
        self.state = Record(
            stamp=Real(0.0, "1", "Number of the step"),
            sweep_time=Real(0.0, "s", "Time since the last sweep of landslides"),
            compacted=Real(0.0, "m", "Volume compacted so far, as height on one cell"),
            powers=Real(0.0, "1", "Table of depth^n, constant during a run", (2, 257)),
            pushes=Real(0.0, "1", "Table of what pushes leave of the soil's strength, constant during a run", (257,)),
            wheel=Array(n_wheels, Record(silent=Real(0.0, "1", "Steps without a pose"), side=side, pushed=pushed)),
            body=Array(n_bodies, Record(silent=Real(0.0, "1", "Steps without a pose"), side=side, pushed=pushed, laid=laid) | rest),
        )
        self.outputs = (
            wheel_wrench(n_wheels)
            | contact_jacobian(n_wheels)
            | diagnostics(n_wheels)
            | patch_out(n_patches, n_compacted > 0)
            | body_wrench(n_bodies)
            | body_support(n_bodies)
        )
        self.step_kernel, self.parallel_step_kernel = step_kernels(n_compacted > 0)
        if n_patches:
            self.rules = (*SCM.rules, _REACHING)

    def check(self, p) -> None:
        super().check(p)
        if p.threads != math.floor(p.threads) or p.threads > MOST_THREADS:
            raise ModelError(
                f"threads = {p.threads:g}: it must be a whole number, on this machine at most {MOST_THREADS}; "
                "numba's variable NUMBA_NUM_THREADS allows more"
            )

    def make_pool(self, p, files) -> SoilPool:
        n_wheels, n_bodies = self.sizes["n_wheels"], self.sizes["n_bodies"]
        names = ["wheel_mesh"] * n_wheels + [f"body[{i + 1}].mesh" for i in range(n_bodies)]
        widths = [p.b_w] * n_wheels + [p.body[i].b for i in range(n_bodies)]
        per_cell = [PER_CELL] * n_wheels + [PER_CELL_OF_BODIES] * n_bodies
        meshes = load_meshes(names, files, widths, per_cell, p.cell)
        meshes.shapes[n_wheels:, SETTLED] = [p.body[i].settled for i in range(n_bodies)]
        for name, width in zip(names, meshes.shapes[:, WIDTH]):
            if p.pressure_model == 1.0 and width > 0.0 and p.k_c / width + p.k_phi <= 0.0:
                raise ModelError(
                    f"{name} = {files[name].name}: its width b = {width:.4g} m gives k_c/b + k_phi <= 0; "
                    f"give {name.replace('mesh', 'b')} above {-p.k_c / p.k_phi:.4g} m, or another soil"
                )
        try:
            base = load_raster(files["base"]) if "base" in files else None
        except ModelError as error:
            raise ModelError(f"base = {error}") from None
        return SoilPool(p, n_wheels + n_bodies, base, meshes)

    def built_in(self, files) -> tuple[str, ...]:
        meshed = any(name.endswith("mesh") for name in files)
        return ("r_w", "b_w", "h_g", "cell", "max_tiles", "body") if meshed else ()
