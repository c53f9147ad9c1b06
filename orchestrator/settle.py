"""Static equilibrium of a rover on its contacts, found before t = 0, so that a run starts at rest."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from cdl_fmu.frames import vertical
from cdl_fmu.slave.model import Instance, ModelError

from .ssp import Connection

_Z, _PITCH = 2, 4  # the coordinates of the rover's state q in which it settles; on a slope friction holds the others
_LOWERING = 2e-4  # [m], [rad]: largest move of one iteration
_SHARE = 0.7  # of a Newton step: a soil's force is no smooth function of the pose
_TOLERANCE = 1e-7  # [m/s2], [rad/s2] of acceleration, as a share of gravity; a soil in cells answers in steps of 1e-8 of the force
_ITERATIONS = 20_000
_H = 1e-6  # [s] step over which the rover's accelerations are observed


class Wires:
    """Brings outputs of instances to the inputs of others, as a master does."""

    def __init__(self, instances: Mapping[str, Instance], connections: Iterable[Connection]):
        self.instances, self.connections = instances, list(connections)
        self._wires: dict[str, list[tuple[np.ndarray, int, np.ndarray, int]]] = {name: [] for name in instances}
        at = {
            (name, part, s.name): i.slices[part].start + s.offset
            for name, i in instances.items()
            for part in "uy"
            for s in i.model.scalars[part]
        }
        routes: dict[tuple[str, str], list[tuple[int, int]]] = {}
        for c in self.connections:
            route = routes.setdefault((c.source_component, c.target_component), [])
            route.append((at[c.source_component, "y", c.source_variable], at[c.target_component, "u", c.target_variable]))
        for (source, target), pairs in routes.items():
            y, u = np.array(pairs).T
            self._wires[target].append((instances[source].block, y, instances[target].block, u))

    def feed(self, name: str) -> None:
        """Set the connected inputs of the instance of this name to the outputs as they are."""
        for source, y, target, u in self._wires[name]:
            target[u] = source[y]


def settle(rover: Instance, contacts: Mapping[str, tuple[Instance, list[int]]], wires: Wires) -> dict[str, float]:
    """Move ``rover`` until it rests on ``contacts``.

    A contact that remembers, such as a soil that was pressed, answers each pose as if it came from the start to that pose at once: so does
    a run's first step, which then finds the rover at rest. On a slope each wheel is held in proportion to its load: a run's first step
    finds the loads of a rover at rest, and friction comes with the first millimetres downhill.

    Args:
        rover: Instance with the interface of :class:`mbs.rover.Rover`, its start pose above the ground.
        contacts: Contact instances by name, each with the rover's wheel (from 0) at each of its own wheels; one that needs outputs of
            another comes after that.
        wires: Connections of all of them.

    Returns:
        Start values ``start.z`` [m] and ``start.pitch`` [rad] of the rover; ``rover.y`` holds the pose at rest.

    Raises:
        ModelError: it does not come to rest.
    """
    free = [_Z, _PITCH]
    rover.initialise()
    undisturbed = {}
    for name, (contact, _) in contacts.items():
        contact.initialise()
        undisturbed[name] = contact.save()
    n = len(rover.u["wheel"])
    q = np.array(rover.x["q"])
    unloaded = _accelerations(rover, q, np.zeros((n, 3)))[free]
    # What a vertical force on each wheel does to the free coordinates, and what these do to the wheels' heights.
    response, heights = np.empty((2, n)), np.empty((n, 2))
    for i in range(n):
        unit = np.zeros((n, 3))
        unit[i, 2] = 1.0
        response[:, i] = _accelerations(rover, q, unit)[free] - unloaded
    for column, k in enumerate(free):
        moved = q.copy()
        moved[k] += 1e-6
        z = []
        for at in (q, moved):
            _accelerations(rover, at, np.zeros((n, 3)))
            z.append(np.array(rover.y["wheel"]["r_0"][:, 2]))
        heights[:, column] = (z[1] - z[0]) / 1e-6
    gravity = max(float(rover.p.gravity), 1e-9)
    force, arms = np.zeros((2, n, 3))
    for _ in range(_ITERATIONS):
        acceleration = _accelerations(rover, q, force)[free]
        stiffness = np.zeros(n)
        for name, (contact, wheels) in contacts.items():
            contact.restore(undisturbed[name])
            wires.feed(name)
            contact.u["wheel"]["v_0"] = contact.u["wheel"]["w_0"] = 0.0
            try:
                contact.step(0.0, 1.0)  # 1 s: whatever the contact filters has settled
            except ModelError as error:
                raise ModelError(f"{rover.name} is not borne at rest: {error}; check mass, wheel, soil, gravity and slope") from error
            for i, j in enumerate(wheels):
                force[j] = contact.y["wheel"]["f_0"][i]
                stiffness[j] = contact.y["contact"]["K"][i, 2]
                arms[j] = contact.y["contact"]["point_0"][i] - contact.u["wheel"]["r_0"][i]
        _hold(rover, force, arms)
        acceleration = _accelerations(rover, q, force)[free]
        if np.abs(acceleration).max() <= _TOLERANCE * gravity:
            return {"start.z": float(q[_Z]), "start.pitch": float(q[_PITCH])}
        slope = response @ (stiffness[:, None] * heights)  # d(-acceleration)/dq
        if np.linalg.matrix_rank(slope) == 2:
            move = _SHARE * np.linalg.solve(slope, acceleration)
        elif acceleration[0] < 0.0 and not stiffness.any():  # in the air
            move = np.array([-_LOWERING, 0.0])
        else:  # not every wheel has met the ground, or its force does not grow with sinkage
            move = 1e-3 * acceleration
        q[free] += np.clip(move, -_LOWERING, _LOWERING)
    raise ModelError(f"{rover.name} does not come to rest on its contacts: check mass, soil, slope and ground_z, or give rover.start.z")


def _hold(rover: Instance, force: np.ndarray, arms: np.ndarray) -> None:
    """Add to the forces on the wheels what keeps the rover on a slope, at their contacts, which ``arms`` [m] lead to from their centres."""
    uphill = np.array(vertical(rover.p.slope, rover.p.uphill))
    held = np.maximum(force[:, 2:], 0.0) * (uphill / uphill[2]) * (1.0, 1.0, 0.0)
    centres = np.array(rover.y["wheel"]["r_0"])
    heading = centres[0] - centres[-1]
    # Drives that stand still pass a wheel's torque on to the body, where a couple of forces on the first wheel and the last does the same.
    torque = np.cross(arms, held).sum(axis=0)
    lift = (torque[1] * heading[0] - torque[0] * heading[1]) / (heading[:2] @ heading[:2])
    force += held
    force[0, 2] -= lift
    force[-1, 2] += lift


def _accelerations(rover: Instance, q: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Rates of q_dot of the rover at rest at q under forces [n_wheels, 3] on its wheels; its outputs then hold that pose."""
    rover.x["q"][:] = q
    rover.x["q_dot"][:] = 0.0
    rover.u["wheel"]["f_0"][:] = force
    rover.step(0.0, _H)
    return np.array(rover.x["q_dot"]) / _H
