"""A bed of particles and tools that move as they are told: for virtual tests, for settling beds, and for use from Python."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numba
import numpy as np

from ..mesh.surface import Surface, join, nothing
from ..slave.kernel import MOST_THREADS
from ..slave.model import ModelError
from .advance import advance, advance_in_parallel
from .material import Material
from .particles import SIDE, V_X, W_X, M, N, particles_of
from .tools import CONTACTS, FORCE, MESH, PLANE, POSITION, ROTATION, SHAPE, TORQUE, WHEEL, mesh_shape, tools_of, wheel_shape


@dataclass(eq=False)
class Tool:
    """A plane, wheel or body. It moves evenly to where ``r_0`` and ``T`` say in each step.

    Attributes:
        material: Its contact with particles.
        surface: The mesh of a body, in its own frame; None: a plane through its origin, z outwards, or a wheel.
        wheel: r_w, b_w, n_g, h_g, t_g of a wheel, as in ``cdl_fmu.wheel.WHEEL``.
        r_0: Position [m].
        T: Rotation from the world.
        f_0, t_0: Force [N] and torque about its origin [N.m], resolved in the world, means over the last step.
        contacts: Number of particles that touch it, mean over the last step.
    """

    material: Material
    surface: Surface | None = None
    wheel: tuple[float, ...] | None = None
    r_0: np.ndarray = field(default_factory=lambda: np.zeros(3))
    T: np.ndarray = field(default_factory=lambda: np.eye(3))
    f_0: np.ndarray = field(default_factory=lambda: np.zeros(3))
    t_0: np.ndarray = field(default_factory=lambda: np.zeros(3))
    contacts: float = 0.0

    @property
    def kind(self) -> int:
        return MESH if self.surface else WHEEL if self.wheel else PLANE

    @property
    def shape(self) -> np.ndarray:
        return mesh_shape(self.surface) if self.surface else wheel_shape(*self.wheel) if self.wheel else np.zeros(SHAPE)


def check_threads(threads: int) -> None:
    """Raise ModelError for more threads than this machine has."""
    if threads > MOST_THREADS:
        raise ModelError(f"threads = {threads}: on this machine at most {MOST_THREADS}; numba's variable NUMBA_NUM_THREADS allows more")


class Simulation:
    """Particles and tools.

    Args:
        positions: Centres of the particles [m], [n, 3].
        radii: [m], [n].
        material: Of the particles.
        tools: Tools, at the poses where they begin.
        dt: Longest substep [s]; None: as ``Material.time_step`` says.
        gravity: Acceleration [m/s2], (3).
        periods: Lengths after which the bed repeats itself along x and y [m]; 0 = not at all.
        threads: Number of threads.
        precision: Of contacts, float64 or float32.

    Raises:
        ModelError: Arrays do not fit together, dt is above the stability limit, or there are more threads than the machine has.
    """

    def __init__(
        self,
        positions: np.ndarray,
        radii: np.ndarray,
        material: Material,
        tools: Sequence[Tool] = (),
        *,
        dt: float | None = None,
        gravity: tuple[float, float, float] = (0.0, 0.0, -9.81),
        periods: tuple[float, float] = (0.0, 0.0),
        threads: int = 1,
        precision=np.float64,
    ):
        self.material, self.tools, self.gravity, self.threads, self.precision = material, list(tools), np.array(gravity), threads, precision
        if np.shape(positions) != (len(radii), 3):
            raise ModelError(f"positions have the shape {np.shape(positions)}: ({len(radii)}, 3) is needed, a row for each of the radii")
        check_threads(threads)
        smallest = float(np.min(radii))
        material.check_step(dt or 0.0, smallest)
        self.dt = dt or material.time_step(smallest)
        self.time = 0.0
        self.particles = particles_of(positions, radii, material.density, periods=periods, precision=precision, shape=material.shape)
        bodies = [tool.surface for tool in self.tools if tool.surface]
        self._meshes = join(bodies) if bodies else nothing()
        roots, k = [], 0
        for tool in self.tools:
            roots.append(self._meshes.roots[k] if tool.surface else -1)
            k += tool.surface is not None
        laws = np.zeros((len(self.tools), len(material.law(1.0))), precision)
        self._tools = tools_of([t.kind for t in self.tools], [t.shape for t in self.tools], roots, laws, len(radii))
        for k, tool in enumerate(self.tools):
            self._tools.poses[k, POSITION : POSITION + 3], self._tools.poses[k, ROTATION : ROTATION + 9] = tool.r_0, np.ravel(tool.T)

    @property
    def bodies(self) -> np.ndarray:
        """Records of the particles, see ``particles``; a view, in an order that changes."""
        count = self.particles.count
        return self.particles.body[count[SIDE], : count[N]]

    @property
    def ident(self) -> np.ndarray:
        """Numbers of the particles in the present order: where they were in ``positions``."""
        count = self.particles.count
        return self.particles.ident[count[SIDE], : count[N]]

    @property
    def orientations(self) -> np.ndarray:
        """Quaternions of particles with a shape, in the present order, [n, 4]; none of spheres."""
        count = self.particles.count
        return self.particles.orientation[count[SIDE], : count[N]]

    def step(self, h: float) -> None:
        """Advance by h [s]; the tools move to ``r_0``, ``T`` meanwhile.

        Raises RuntimeError if particles are lost or have more contacts than there is room for: nothing of this is of use then.
        """
        n = max(math.ceil(h / self.dt - 1e-9), 1)
        dt = h / n
        for k, tool in enumerate(self.tools):
            self._tools.goals[k, POSITION : POSITION + 3], self._tools.goals[k, ROTATION : ROTATION + 9] = tool.r_0, np.ravel(tool.T)
            self._tools.laws[k] = tool.material.law(dt)
        function = advance_in_parallel if self.threads > 1 else advance
        numba.set_num_threads(self.threads)
        law = self.material.law(dt).astype(self.precision)
        if not function(tuple(self.particles), tuple(self._tools), self._meshes, law, self.gravity, dt, n):
            raise RuntimeError("particles are lost or pressed together beyond all bounds: check dt and how tools move")
        for tool, felt in zip(self.tools, self._tools.sums):
            tool.f_0, tool.t_0, tool.contacts = felt[FORCE : FORCE + 3].copy(), felt[TORQUE : TORQUE + 3].copy(), float(felt[CONTACTS])
        self.time += h

    @property
    def kinetic_energy(self) -> float:
        """Of all particles [J]."""
        b = self.bodies
        square = (b[:, V_X : V_X + 3] ** 2).sum(axis=1) + 0.4 * b[:, 3] ** 2 * (b[:, W_X : W_X + 3] ** 2).sum(axis=1)
        return float(0.5 * b[:, M] @ square)
