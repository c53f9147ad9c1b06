"""The VEM model: records, checks and step."""

from __future__ import annotations

import numpy as np

from ..contact import NO_DATA, WHEEL_EVENTS, has_pose, refusal, release, sees
from ..mesh.pool import CANDIDATES, MeshPool, tool_surfaces
from ..mesh.tools import BODY, TOOL_EVENTS, TOOLS, tool_files, tool_inputs
from ..slave.interface import contact_jacobian, diagnostics, pair_contacts, patch_in, wheel_active, wheel_pose, wheel_wrench
from ..slave.kernel import kernel
from ..slave.model import STATUS_SPAN, Event, KernelModel
from ..slave.records import Array, Choice, Real, Record
from ..soil import SOIL, check_bearing
from ..terrain.follow import PLANE, TAU_N, follow_plane
from ..terrain.patch import surface
from ..wheel import WHEEL, check_wheel
from .several import ARGUMENTS, initialise_bodies, step_on_bodies
from .single import LINEAR, contact_with_plane

_OUTSIDE = 5

FRICTION = Record(
    mu=Real(0.6, "1", "Coefficient of sliding friction", min=0.0, max=10.0),
    mu_static=Real(0.0, "1", "Coefficient of static friction; below mu: as mu, there is none", min=0.0, max=10.0),
    v_static=Real(0.01, "m/s", "Sliding speed at which static friction has fallen by 63 % to sliding friction", min=1e-6, max=10.0),
    v_creep=Real(1e-4, "m/s", "Sliding speed below which friction falls: a contact at rest creeps below it", min=1e-9, max=1.0),
)


class VEM(KernelModel):
    """Visco-elastic model: a spring, a damper and Coulomb friction at each contact point, for wheels on rock.

    The spring is linear, or follows Bekker's law; its damping is a share of critical damping (Lehr's). A contact never pulls. Friction is
    a function of the sliding speed, with static friction if wanted; there are no further springs.

    Args:
        n_wheels: Number of wheels.
        n_patches: 0 for flat ground at ``ground_z``, or n_wheels: patch i is the ground of wheel i, and its contact plane is fitted
            in it as in Fig. 8.4.
        n_bodies: Number of bodies, such as rocks, that are met in several points, by wheels and by each other; then there is no ground.
    """

    parameters = (
        SOIL
        | WHEEL
        | Record(
            ground_z=Real(0.0, "m", "Height of flat ground; sinkage counts from it", min=-1e6, max=1e6),
            normal_model=Choice("Elastic force", linear="spring of stiffness k", bekker="Bekker's pressure below a symmetric contact"),
            k=Real(1e6, "N/m", "Stiffness of a contact; used by linear", min=1.0, max=1e12),
            damping_ratio=Real(1.0, "1", "Lehr's damping ratio of a contact; 1 = critical", min=0.0, max=100.0),
            effective_mass=Real(27.0, "kg", "What a wheel carries, its own mass included; used for damping", min=1e-3, max=1e5),
        )
        | FRICTION
        | Record(tau_n=TAU_N)
    )
    events = WHEEL_EVENTS | {
        _OUTSIDE: Event(
            "wheel {i}, at ({wheel.r_0[0]:.4g}, {wheel.r_0[1]:.4g}) m, is outside patch[{i}]: "
            "send the heights around the wheel's centre (origin, spacing, z)"
        ),
    }

    def __init__(self, n_wheels: int = 1, n_patches: int = 0, n_bodies: int = 0):
        if n_patches not in (0, n_wheels):
            raise ValueError(f"n_patches = {n_patches}: choose 0 (flat ground) or {n_wheels} (a patch for each wheel)")
        if n_patches and n_bodies:
            raise ValueError(f"n_patches = {n_patches}, n_bodies = {n_bodies}: wheels stand on patches or on bodies; choose one")
        super().__init__(n_wheels=n_wheels, n_patches=n_patches, n_bodies=n_bodies)
        sizes = {"p": n_patches, "b": n_bodies}
        self.identifier = f"cdl_vem_w{n_wheels}" + "".join(f"{letter}{size}" for letter, size in sizes.items() if size)
        if n_bodies:
            self._meet(n_wheels, n_bodies)
            return
        self.inputs = wheel_pose(n_wheels) | wheel_active(n_wheels) | patch_in(n_patches)
        self.state = Record(
            wheel=Array(n_wheels, Record(silent=Real(0.0, "1", "Steps without a pose"))),
            plane=Array(n_patches, PLANE),
        )
        self.outputs = wheel_wrench(n_wheels) | contact_jacobian(n_wheels) | diagnostics(n_wheels)
        self.initialise_kernel = _initialise_patches if n_patches else _initialise
        self.step_kernel = _step_on_patches if n_patches else _step

    def _meet(self, n_wheels: int, n_bodies: int) -> None:
        """Declare a model whose wheels meet bodies."""
        flat = ("ground_z", "tau_n", "k", "damping_ratio", "mu", "mu_static")  # of the ground, or each body's own
        own = {name: VEM.parameters.fields[name] for name in ("k", "damping_ratio", "mu_static")}
        others = {name: field for name, field in VEM.parameters.fields.items() if name not in flat and name not in TOOLS.fields}
        self.parameters = TOOLS | Record(**others) | Record(body=Array(n_bodies, BODY | Record(**own)))
        self.files = tool_files(n_bodies)
        self.events = TOOL_EVENTS
        self.pool_class = MeshPool
        self.inputs = tool_inputs(n_wheels, n_bodies)
        self.state = Record(wheel=Array(n_wheels, Record(silent=Real(0.0, "1", "Steps without a pose"))))
        self.outputs = pair_contacts(n_wheels, n_bodies) | diagnostics(n_wheels)
        self.arguments = ARGUMENTS
        self.initialise_kernel, self.step_kernel = initialise_bodies, step_on_bodies

    def make_pool(self, p, files) -> MeshPool | None:
        if self.sizes["n_bodies"]:
            return MeshPool(tool_surfaces(p, self.sizes["n_bodies"], files), (np.zeros(CANDIDATES),))
        return None

    def check(self, p) -> None:
        check_wheel(p)
        if p.normal_model != LINEAR:
            check_bearing(p)


@kernel
def _initialise(t, p, x, y):
    for i in range(len(y.wheel)):
        x.wheel[i].silent = 0.0
        release(y.wheel[i], y.contact[i], y.diagnostics[i])


@kernel
def _initialise_patches(t, p, x, y):
    for i in range(len(y.wheel)):
        x.wheel[i].silent = 0.0
        x.plane[i].known = 0.0
        release(y.wheel[i], y.contact[i], y.diagnostics[i])


@kernel
def _step(t, h, p, u, x, y):
    # Refuse before anything changes, so that the state of a refused step is the old one.
    for i in range(len(u.wheel)):
        refused = refusal(p, u.wheel[i], x.wheel[i].silent, p.ground_z)
        if refused:
            return refused + STATUS_SPAN * i
    status = 0
    for i in range(len(u.wheel)):
        wheel = u.wheel[i]
        if sees(wheel, x.wheel[i], y.wheel[i], y.contact[i], y.diagnostics[i]):
            contact_with_plane(p, wheel, 0.0, 0.0, 1.0, wheel.r_0[2] - p.ground_z, y.wheel[i], y.contact[i], y.diagnostics[i])
        elif x.wheel[i].silent > 0.0:
            status = NO_DATA + STATUS_SPAN * i
    return status


@kernel
def _step_on_patches(t, h, p, u, x, y):
    for i in range(len(u.wheel)):
        wheel, z = u.wheel[i], p.ground_z
        if wheel.active > 0.0 and u.patch[i].spacing > 0.0 and has_pose(wheel):
            inside, z, _, _ = surface(u.patch[i], wheel.r_0[0], wheel.r_0[1])
            if not inside:
                return _OUTSIDE + STATUS_SPAN * i
        refused = refusal(p, wheel, x.wheel[i].silent, z)
        if refused:
            return refused + STATUS_SPAN * i
    status = 0
    for i in range(len(u.wheel)):
        wheel = u.wheel[i]
        if sees(wheel, x.wheel[i], y.wheel[i], y.contact[i], y.diagnostics[i]):
            n_x, n_y, n_z, d = 0.0, 0.0, 1.0, wheel.r_0[2] - p.ground_z
            if u.patch[i].spacing > 0.0:
                n_x, n_y, n_z, d = follow_plane(p, wheel, u.patch[i], None, h, x.plane[i])
            contact_with_plane(p, wheel, n_x, n_y, n_z, d, y.wheel[i], y.contact[i], y.diagnostics[i])
        else:
            x.plane[i].known = 0.0
            if x.wheel[i].silent > 0.0:
                status = NO_DATA + STATUS_SPAN * i
    return status
