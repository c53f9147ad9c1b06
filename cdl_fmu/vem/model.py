"""The VEM model: records, checks and step."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..mesh.pool import CANDIDATES, mesh_pool, tool_surfaces
from ..mesh.tools import BODY, TOOL_EVENTS, TOOLS, tool_files, tool_inputs
from ..slave.interface import contact_jacobian, diagnostics, pair_contacts, patch_in, wheel_active, wheel_pose, wheel_wrench
from ..slave.model import KernelModel
from ..slave.pool import ConstantPool
from ..slave.records import Array, Choice, Real, Record
from ..soil import BEARING_RULES, SOIL
from ..terrain.follow import TAU_N
from ..terrain.stand import (
    GROUND,
    STAND_EVENTS,
    check_grounds,
    ground_pool,
    initialise_flat,
    initialise_planes,
    stand_state,
    step_on_flat,
    step_on_mesh,
    step_on_patches,
)
from ..wheel import WHEEL, WHEEL_RULES
from .several import ARGUMENTS, initialise_bodies, step_on_bodies
from .single import LINEAR, contact_with_plane

_FURTHER = 0.02  # [m] own choice: as rays are 30 mm apart on the wheel of Table 8.2, that many lie within slopes of 25 degrees

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
        n_grounds: 1 if the ground is a mesh, in which the contact plane is fitted alike.
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
    rules = (*WHEEL_RULES, *(replace(rule, applies=lambda p: p.normal_model != LINEAR) for rule in BEARING_RULES))
    events = STAND_EVENTS

    def __init__(self, n_wheels: int = 1, n_patches: int = 0, n_bodies: int = 0, n_grounds: int = 0):
        check_grounds(n_wheels, n_patches, n_grounds)
        if n_bodies and (n_patches or n_grounds):
            raise ValueError(f"n_bodies = {n_bodies}: wheels stand on bodies, on patches or on a mesh of the ground; choose one")
        super().__init__(n_wheels=n_wheels, n_patches=n_patches, n_bodies=n_bodies, n_grounds=n_grounds)
        sizes = {"p": n_patches, "b": n_bodies, "g": n_grounds}
        self.identifier = f"cdl_vem_w{n_wheels}" + "".join(f"{letter}{size}" for letter, size in sizes.items() if size)
        if n_bodies:
            self._meet(n_wheels, n_bodies)
            return
        self.inputs = wheel_pose(n_wheels) | wheel_active(n_wheels) | patch_in(n_patches)
        self.state = stand_state(n_wheels, n_patches, n_grounds)
        self.outputs = wheel_wrench(n_wheels) | contact_jacobian(n_wheels) | diagnostics(n_wheels)
        self.initialise_kernel = initialise_planes if n_patches or n_grounds else initialise_flat
        if n_patches:
            self.step_kernel = step_on_patches(contact_with_plane, further=_FURTHER)
        else:
            self.step_kernel = step_on_mesh(contact_with_plane, further=_FURTHER) if n_grounds else step_on_flat(contact_with_plane)
        if n_grounds:
            self.files, self.needed_files, self.pool_class = GROUND, tuple(GROUND), ConstantPool

    def _meet(self, n_wheels: int, n_bodies: int) -> None:
        """Declare a model whose wheels meet bodies."""
        flat = ("ground_z", "tau_n", "k", "damping_ratio", "mu", "mu_static")  # of the ground, or each body's own
        own = {name: VEM.parameters.fields[name] for name in ("k", "damping_ratio", "mu_static")}
        others = {name: field for name, field in VEM.parameters.fields.items() if name not in flat and name not in TOOLS.fields}
        self.parameters = TOOLS | Record(**others) | Record(body=Array(n_bodies, BODY | Record(**own)))
        self.files = tool_files(n_bodies)
        self.needed_files = tuple(f"body[{j + 1}].mesh" for j in range(n_bodies))
        self.events = TOOL_EVENTS
        self.pool_class = ConstantPool
        self.inputs = tool_inputs(n_wheels, n_bodies)
        self.state = Record(wheel=Array(n_wheels, Record(silent=Real(0.0, "1", "Steps without a pose"))))
        self.outputs = pair_contacts(n_wheels, n_bodies) | diagnostics(n_wheels)
        self.arguments = ARGUMENTS
        self.initialise_kernel, self.step_kernel = initialise_bodies, step_on_bodies

    def make_pool(self, p, files) -> ConstantPool | None:
        if self.sizes["n_bodies"]:
            return mesh_pool(tool_surfaces(p, self.sizes["n_bodies"], files), (np.zeros(CANDIDATES),))
        return ground_pool(files) if self.sizes["n_grounds"] else None

    def built_in(self, files) -> tuple[str, ...]:
        return tuple(WHEEL.fields) if self.sizes["n_bodies"] else ()
