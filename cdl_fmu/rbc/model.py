"""The RBC model: records, checks and memory."""

from __future__ import annotations

import math

import numpy as np

from ..mesh.contacts import CONTACT
from ..mesh.pool import mesh_pool, tool_surfaces
from ..mesh.tools import BODY, TOOL_EVENTS, TOOLS, tool_files, tool_inputs
from ..slave.interface import body_wrench, diagnostics, n_pairs, tool_twists, wheel_wrench
from ..slave.model import Event, KernelModel, Rule
from ..slave.pool import ConstantPool
from ..slave.records import Array, Real, Record
from ..wheel import WHEEL, WHEEL_RULES
from .solve import scratch
from .step import ARGUMENTS, GROWS, initialise, step


class RBC(KernelModel):
    """Rigid body contact: wheels and bodies that neither overlap nor pull, by impulses.

    All contacts of a step are one linear complementarity problem with a polyhedral friction cone (eqs. 8.1 to 8.4 in the form of Stewart &
    Trinkle 1996): it holds what rests and sticks, and reverses what comes on by its coefficient of restitution. The answer to an impulse,
    and where all go without any, comes from the multibody system: its inverse inertia at the tools, and their free twists. A system that
    tells neither is taken as a mass at each wheel, ``effective_mass``, which must not be more than 2 / (1 + restitution) of what the wheel
    carries, or impacts gain energy; take the wheel's own mass.

    The force is the impulse's mean over the step, so it depends on the step where there are impacts.

    Args:
        n_wheels: Number of wheels.
        n_bodies: Number of bodies, such as rocks and floors, that wheels touch, and each other.
    """

    rules = (
        *WHEEL_RULES,
        Rule("n_directions = {p.n_directions:g}: it must be a whole number", lambda p: p.n_directions != math.floor(p.n_directions)),
        Rule("max_sweeps = {p.max_sweeps:g}: it must be a whole number", lambda p: p.max_sweeps != math.floor(p.max_sweeps)),
        Rule(
            "n_directions = {p.n_directions:g}: it must be even, so that friction is the same both ways; use 8",
            lambda p: p.n_directions % 2.0 != 0.0,
        ),
    )
    events = TOOL_EVENTS | {
        GROWS: Event(
            "wheel {i} rebounds faster than it came: effective_mass = {p.effective_mass:g} kg is more than what it carries; lower it to "
            "the wheel's own mass, or connect inverse_inertia and free_twist",
            is_error=False,
        ),
    }
    pool_class = ConstantPool
    arguments = ARGUMENTS
    initialise_kernel = staticmethod(initialise)
    step_kernel = staticmethod(step)

    def __init__(self, n_wheels: int = 1, n_bodies: int = 1):
        if n_bodies < 1:
            raise ValueError(f"n_bodies = {n_bodies}: rigid wheels need a body to stand on; choose 1 or more")
        super().__init__(n_wheels=n_wheels, n_bodies=n_bodies)
        self.identifier = f"cdl_rbc_w{n_wheels}b{n_bodies}"
        restitution = Real(0.0, "1", "Coefficient of restitution of wheels on this body; bodies have the smaller one of both", (), 0.0, 1.0)
        self.parameters = (
            TOOLS
            | Record(
                n_directions=Real(8.0, "1", "Directions of the polyhedral friction cone, an even number", min=4.0, max=64.0),
                tolerance=Real(1e-5, "m/s", "Largest error of a velocity at a contact, at which sweeps end", min=1e-12, max=1.0),
                max_sweeps=Real(300.0, "1", "Most sweeps, after which Lemke's method takes over", min=1.0, max=1e5),
                rest_speed=Real(0.01, "m/s", "Impact speed up to which nothing rebounds", min=0.0, max=10.0),
                effective_mass=Real(
                    2.0, "kg", "What a wheel weighs; used where the multibody system does not tell its inverse inertia", min=1e-3, max=1e5
                ),
            )
            | Record(body=Array(n_bodies, BODY | Record(restitution=restitution)))
        )
        self.files = tool_files(n_bodies)
        self.needed_files = tuple(f"body[{j + 1}].mesh" for j in range(n_bodies))
        self.inputs = tool_twists(n_wheels, n_bodies) | tool_inputs(n_wheels, n_bodies)
        steps = "Steps with contacts"
        self.state = Record(
            steps=Real(0.0, "1", steps),
            pivoted=Real(0.0, "1", f"{steps} in which Lemke's method had to help"),
            unsolved=Real(0.0, "1", f"{steps} that ended above the tolerance"),
            wheel=Array(
                n_wheels,
                Record(
                    silent=Real(0.0, "1", "Steps without a pose"),
                    came=Real(0.0, "m/s", "Speed at which it came on to a contact in the last step, along the normal, in world", (3,)),
                ),
            ),
            kept=Array(
                n_pairs(n_wheels, n_bodies),
                Record(
                    on=Real(0.0, "1", "Tool on which the impulse acted in the last step, wheels first, from 1; 0 = none"),
                    against=Real(0.0, "1", "Tool on which its opposite acted"),
                    id=Real(0.0, "1", "Number of the features that touched"),
                    point_0=Real(0.0, "m", "Contact point, resolved in world", (3,)),
                    impulse_0=Real(0.0, "N.s", "Impulse, resolved in world", (3,)),
                ),
            ),
        )
        self.outputs = (
            Record(
                n_contacts=Real(0.0, "1", "Number of contacts in the last step"),
                sweeps=Real(0.0, "1", "Sweeps that it took"),
                residual=Real(0.0, "m/s", "Error of velocities that it left"),
                pivoted=Real(0.0, "1", "Share of the steps with contacts so far in which Lemke's method had to help"),
                unsolved=Real(0.0, "1", "Share of them that ended above the tolerance"),
            )
            | wheel_wrench(n_wheels)
            | body_wrench(n_bodies)
            | diagnostics(n_wheels)
        )

    def make_pool(self, p, files) -> ConstantPool:
        n_wheels, n_bodies = self.sizes["n_wheels"], self.sizes["n_bodies"]
        n, n_tools = n_pairs(n_wheels, n_bodies), n_wheels + n_bodies
        memory = (
            np.zeros((n, CONTACT)),  # rows: the contacts that are kept
            np.zeros((n, 3, 12)),  # lever
            np.zeros((6 * n_tools, 6 * n_tools)),  # mobility: inverse inertia at all tools
            np.zeros((3, 6 * n_tools)),  # mobile: twists of all tools per impulse
            np.zeros((3 * n, 3 * n)),  # G
            *(np.zeros(size * n) for size in (3, 1, 1, 3, 3)),  # b, target, mu, impulse, v
            np.zeros((n_tools, 6)),  # twist
            *scratch(n, int(p.n_directions)),
        )
        return mesh_pool(tool_surfaces(p, n_bodies, files), memory)

    def built_in(self, files) -> tuple[str, ...]:
        return (*WHEEL.fields, "n_directions")
