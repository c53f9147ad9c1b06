"""Coupling schemes: how the slaves of a system exchange values over one communication step H.

=========  ======================================================================================================================
ij         Gauss-Seidel order, interface Jacobian sent: the default, stable for stiff contacts
ij-free    as ij, but rigid contacts get the free twists of a step that is tried with this step's other forces, and taken back
gs-mid     Gauss-Seidel, contacts see the wheel's pose at mid-step; no Jacobian
gs         plain Gauss-Seidel, no Jacobian
jacobi     all slaves step at once on the values of t, as most tools do; Jacobian and anchors are sent
aitken     fixed point over the wrench, mean of the wrench at t and t + H, with rollback and Aitken relaxation; no Jacobian
=========  ======================================================================================================================

The interface Jacobian is known by its names, ``contact[i].*``, ``support[j].*`` and ``pair[k].*``, poses
by ``*.r_0, T, v_0, w_0``, free twists by ``free_twist[k]``, those of wheels, then bodies: the names are the contract.
"""

from __future__ import annotations

import re

import numpy as np

from .fmu import Slave, SlaveError

_JACOBIAN = re.compile(r"(^|\.)(contact|support|pair|anchor)\[\d+\]\.")
_ANCHOR = re.compile(r"(^|\.)((contact|support)\[\d+\]\.anchor\.|anchor\[\d+\]\.)")
_TOOL = re.compile(r"(wheel|body)\[\d+\]\.v_0\[1\]")
_POSE = re.compile(r"(.*\[\d+\]\.)r_0\[1\]")


class Exchange:
    """The slaves of a system, their order, and the memory their connected variables lie in."""

    def __init__(self, slaves: list[Slave], inputs: np.ndarray, outputs: np.ndarray, routes: dict[str, tuple]):
        self.slaves = slaves
        self.inputs = inputs
        self.outputs = outputs
        self.routes = routes

    def route(self, slave: Slave) -> None:
        """Bring the values connected to the slave's inputs into its input memory."""
        runs, factor, offset = self.routes[slave.name]
        for source, target in runs:
            target[:] = source
        if factor is not None:
            slave.u *= factor
            slave.u += offset

    def advance(self, slave: Slave, t: float, h: float) -> None:
        """Set, step and get one slave with its inputs as they are."""
        slave.set(t)
        slave.step(t, h)
        slave.get(t + h)


class GaussSeidel:
    """Slaves in dependency order, each with the newest values of those before it."""

    explicit = True
    resumed = False  # True once the outputs are those of an earlier step

    def __init__(self, exchange: Exchange):
        self.exchange = exchange

    @staticmethod
    def sends(variable: str) -> bool:
        """Whether values are sent to this input variable."""
        return not _JACOBIAN.search(variable)

    def sequence(self) -> list[tuple[str, Slave]] | None:
        """What every step consists of, "route" or "advance" and the slave; None: steps are not all alike, or something watches them."""

    def step(self, t: float, h: float) -> None:
        """One communication step from t to t + h [s]."""
        exchange = self.exchange
        for slave in exchange.slaves:
            exchange.route(slave)
            exchange.advance(slave, t, h)


class InterfaceJacobian(GaussSeidel):
    """Gauss-Seidel order with the interface Jacobian; here the anchor equals the receiver's own state, so it need not be sent."""

    explicit = False

    @staticmethod
    def sends(variable: str) -> bool:
        return not _ANCHOR.search(variable)

    def sequence(self) -> list[tuple[str, Slave]] | None:
        return [(act, slave) for slave in self.exchange.slaves for act in ("route", "advance")]


class TriedFreeTwist(InterfaceJacobian):
    """Interface Jacobian; slaves with inputs ``free_twist[k]``, the rigid contacts, step after all others have been tried without them.

    A multibody system predicts its free twist from the other contacts' forces of the last step. Here it makes the step with those of this
    step and none from rigid contacts, tells the twists that it arrives at, and goes back.
    """

    def __init__(self, exchange: Exchange):
        super().__init__(exchange)
        self._twists = {s.name: found for s in exchange.slaves if (found := _twist_indices(s))}
        self._rigid = [s for s in exchange.slaves if s.name in self._twists]
        self._movers = [s for s in exchange.slaves if not s.has_feedthrough] if self._rigid else []
        for slave in self._movers:
            if not slave.can_save:
                raise SlaveError(f"scheme ij-free steps back, but the FMU of {slave.name} cannot save its state; use ij")

    def sequence(self) -> None:
        return None

    def step(self, t: float, h: float) -> None:
        exchange = self.exchange
        for slave in exchange.slaves:
            if slave.has_feedthrough and slave not in self._rigid:
                exchange.route(slave)
                exchange.advance(slave, t, h)
        if self._rigid:
            self._try(t, h)
        for slave in exchange.slaves:
            if not slave.has_feedthrough:
                exchange.route(slave)
                exchange.advance(slave, t, h)

    def _try(self, t: float, h: float) -> None:
        """Step the movers without rigid contacts, then these by the twists reached, the movers being back where they were."""
        exchange = self.exchange
        outputs, saved = exchange.outputs.copy(), [(s, s.save()) for s in self._movers]
        for slave in self._rigid:
            slave.y[:] = 0.0
        for slave in self._movers:
            exchange.route(slave)
            exchange.advance(slave, t, h)
        free = []
        for slave in self._rigid:
            exchange.route(slave)
            free.append(slave.u[self._twists[slave.name][0]])
        for slave, state in saved:
            slave.restore(state)
            slave.free(state)
        exchange.outputs[:] = outputs
        for slave, twist in zip(self._rigid, free):
            exchange.route(slave)
            slave.u[self._twists[slave.name][1]] = twist
            exchange.advance(slave, t, h)


class MidStep(GaussSeidel):
    """Gauss-Seidel in which pose inputs are moved on by H/2 with their twist."""

    def __init__(self, exchange: Exchange):
        super().__init__(exchange)
        self._poses = {s.name: _pose_indices(exchange, s) for s in exchange.slaves}

    def step(self, t: float, h: float) -> None:
        exchange = self.exchange
        for slave in exchange.slaves:
            exchange.route(slave)
            for u, at in self._poses[slave.name]:
                _move_on(u, at, 0.5 * h)
            exchange.advance(slave, t, h)


class Jacobi:
    """All slaves step on the values of t."""

    explicit = False

    def __init__(self, exchange: Exchange):
        self.exchange = exchange

    @staticmethod
    def sends(variable: str) -> bool:
        return True

    def sequence(self) -> list[tuple[str, Slave]]:
        return [(act, slave) for act in ("route", "advance") for slave in self.exchange.slaves]

    def step(self, t: float, h: float) -> None:
        for slave in self.exchange.slaves:
            self.exchange.route(slave)
        for slave in self.exchange.slaves:
            self.exchange.advance(slave, t, h)


class Aitken(GaussSeidel):
    """Fixed point: the last slaves in the order (without feedthrough: the multibody system) see the mean of their inputs at t and t + H.

    The others are evaluated for the state at t + H. Iterations end when no input changes by more than ``TOLERANCE`` of the largest.
    """

    explicit = False
    ITERATIONS = 12
    TOLERANCE = 1e-6

    def __init__(self, exchange: Exchange):
        super().__init__(exchange)
        self.inertial = [s for s in exchange.slaves if not s.has_feedthrough]
        self.direct = [s for s in exchange.slaves if s.has_feedthrough]
        for slave in exchange.slaves:
            if not slave.can_save:
                raise SlaveError(f"scheme aitken steps back, but the FMU of {slave.name} cannot save its state; use gs-mid")

    def step(self, t: float, h: float) -> None:
        exchange = self.exchange
        if not self.resumed:  # the wrench at the start; from then on each step ends with the wrench at t + H
            self._advance_direct(t, h)
            self.resumed = True
        for slave in self.inertial:
            exchange.route(slave)
        start = self._inertial_inputs()
        guess, residual, relax = start.copy(), None, 1.0
        saved = [(s, s.save()) for s in exchange.slaves]
        outputs = exchange.outputs.copy()
        for iteration in range(self.ITERATIONS):
            if iteration:
                for slave, state in saved:
                    slave.restore(state)
                exchange.outputs[:] = outputs
            self._set_inertial_inputs(0.5 * (start + guess))
            for slave in self.inertial:
                exchange.advance(slave, t, h)
            self._advance_direct(t, h)
            for slave in self.inertial:
                exchange.route(slave)
            new = self._inertial_inputs() - guess
            if np.abs(new).max() <= self.TOLERANCE * max(np.abs(guess).max(), 1.0):
                break
            if residual is not None:
                change = new - residual
                relax = float(np.clip(-relax * (residual @ change) / max(change @ change, 1e-300), 0.05, 1.0))
            residual = new
            guess = guess + relax * new
        for slave, state in saved:
            slave.free(state)

    def _advance_direct(self, t: float, h: float) -> None:
        for slave in self.direct:
            self.exchange.route(slave)
            self.exchange.advance(slave, t, h)

    def _inertial_inputs(self) -> np.ndarray:
        return np.concatenate([s.u for s in self.inertial])

    def _set_inertial_inputs(self, values: np.ndarray) -> None:
        start = 0
        for slave in self.inertial:
            slave.u[:] = values[start : start + slave.u.size]
            start += slave.u.size


SCHEMES = {"ij": InterfaceJacobian, "ij-free": TriedFreeTwist, "gs-mid": MidStep, "gs": GaussSeidel, "jacobi": Jacobi, "aitken": Aitken}


def _twist_indices(slave: Slave) -> tuple[np.ndarray, np.ndarray] | None:
    """Where in a slave's inputs the twists of its tools are, wheels first, and where their free twists; None if it gets none."""
    index = {name: i for i, name in enumerate(slave.inputs)}
    if "free_twist[1]" not in index:
        return None
    tools = sorted(
        (name.removesuffix("v_0[1]") for name in index if _TOOL.fullmatch(name)),
        key=lambda tool: (not tool.startswith("wheel"), _number(tool)),
    )
    twists = [index[f"{tool}{part}[{k}]"] for tool in tools for part in ("v_0", "w_0") for k in (1, 2, 3)]
    return np.array(twists), np.array([index[f"free_twist[{k + 1}]"] for k in range(len(twists))])


def _number(tool: str) -> int:
    return int(re.search(r"\d+", tool)[0])


def _pose_indices(exchange: Exchange, slave: Slave) -> list[tuple]:
    index = {name: i for i, name in enumerate(slave.inputs)}
    found = []
    for name in slave.inputs:
        match = _POSE.fullmatch(name)
        if match is None:
            continue
        parts = [("r_0", 3), ("T", 9), ("v_0", 3), ("w_0", 3)]
        names = [f"{match[1]}{p}[{i}]" for p, n in parts if n == 3 for i in (1, 2, 3)]
        names += [f"{match[1]}T[{i},{j}]" for i in (1, 2, 3) for j in (1, 2, 3)]
        if all(n in index for n in names):
            r, v, w = (np.array([index[f"{match[1]}{p}[{i}]"] for i in (1, 2, 3)]) for p in ("r_0", "v_0", "w_0"))
            T = np.array([index[f"{match[1]}T[{i},{j}]"] for i in (1, 2, 3) for j in (1, 2, 3)])
            found.append((slave.u, (r, T, v, w)))
    return found


def _move_on(u: np.ndarray, at: tuple, dt: float) -> None:
    r, T, v, w = at
    u[r] += dt * u[v]
    # A body turned by the rotation vector a: T(t + dt) = T(t) exp(-[a]x), with Rodrigues' formula for the exponential.
    a = dt * u[w]
    angle = float(np.linalg.norm(a))
    cross = np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])
    sinc, cosc = (np.sin(angle) / angle, (1.0 - np.cos(angle)) / angle**2) if angle > 1e-9 else (1.0, 0.5)
    u[T] = (u[T].reshape(3, 3) @ (np.eye(3) - sinc * cross + cosc * cross @ cross)).ravel()
