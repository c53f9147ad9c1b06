"""A rover, rocks and a hard contact model coupled in process, without FMUs and master."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from cdl_fmu.mesh.surface import load_surface
from cdl_fmu.slave.model import Instance, KernelModel
from mbs.rover import Rover

_POSE = ("r_0", "T", "v_0", "w_0")
#: Mesh and start values of a rock of the rover, ``{"x": 0.3, "fixed": "on"}``.
Placed = tuple[Path, Mapping[str, object]]


def rock_parameters(j: int, path: Path, density: float = 2700.0, **start) -> dict[str, object]:
    """Parameters of the rover for its rock j, counted from 1, with this mesh."""
    surface = load_surface(path)
    inertia = surface.inertia * density
    values = {"mass": surface.volume * density, "center": surface.centre, **start}
    values["inertia"] = [inertia[k] for k in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    return {f"rock[{j}].{name}": value for name, value in values.items()}


def instances(
    contact: KernelModel, rocks: Sequence[Placed], rover: Mapping | None = None, hard: Mapping | None = None
) -> tuple[Instance, Instance]:
    """The rover and a hard contact model that meet these rocks: mesh and start of each; and further parameters of both."""
    own, given = {}, {}
    for j, (path, start) in enumerate(rocks, 1):
        own |= rock_parameters(j, path, **start)
        given |= {f"body[{j}].mesh": path, f"body[{j}].mass": own[f"rock[{j}].mass"], f"body[{j}].fixed": start.get("fixed", "off")}
    n_wheels, n = contact.sizes["n_wheels"], contact.sizes["n_bodies"]
    mover = Instance(Rover(n_wheels, n, 1), **own, **(rover or {}), with_inverse_inertia="on")
    return mover, Instance(contact, **given, **(hard or {}))


class Coupled:
    """The rover FMU's model and a hard contact's.

    Args:
        contact: Model with bodies.
        rocks: Mesh and start of each of them.
        rover, hard: Parameters of both.
        h: Step [s].
        jacobi: Both step at once on the values of t, anchors are sent; else the contact comes first, as in the default scheme.
        tells: Whether the rover tells its inverse inertia and free twists to a contact that asks for them.
    """

    def __init__(
        self,
        contact: KernelModel,
        rocks: Sequence[Placed],
        rover: Mapping | None = None,
        hard: Mapping | None = None,
        h: float = 1e-3,
        jacobi: bool = False,
        tells: bool = True,
    ):
        self.rover, self.hard = instances(contact, rocks, rover, hard)
        self.h, self.t, self.jacobi, self.tells = h, 0.0, jacobi, tells
        self.rover.initialise()
        self._feed()
        self.hard.initialise()
        if jacobi:
            self._answer()

    def _feed(self) -> None:
        tools = (*self.rover.y.wheel, *self.rover.y.rock)
        for tool, port in zip(tools, (*self.hard.u.wheel, *self.hard.u.body)):
            for name in _POSE:
                port[name][...] = tool[name]
        if self.tells and "inverse_inertia" in self.hard.model.inputs.fields:
            self.hard.u.inverse_inertia[:] = self.rover.y.inverse_inertia
            self.hard.u.free_twist[:] = self.rover.y.free_twist

    def _answer(self) -> None:
        port = self.rover.u.hard[0]
        for name in ("wheel", "body", "pair", *(("anchor",) if self.jacobi else ())):
            if name in self.hard.model.outputs.fields:
                port[name][...] = self.hard.y[name]

    def step(self) -> None:
        """One step of both."""
        self._feed()
        self.hard.step(self.t, self.h)
        if not self.jacobi:
            self._answer()
        self.rover.step(self.t, self.h)
        if self.jacobi:
            self._answer()
        self.t += self.h

    def run(self, seconds: float, record: Callable[[Coupled], object] = lambda self: None) -> np.ndarray:
        """Records of all steps."""
        out = []
        for _ in range(round(seconds / self.h)):
            self.step()
            out.append(record(self))
        return np.array(out)
