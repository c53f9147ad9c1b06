"""A system's slaves, instantiated, ordered, connected and initialised, behind one coupling scheme."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import pairwise

import numpy as np

from .fmu import Slave, SlaveError, revision_of
from .program import Program, can_be_compiled
from .schemes import SCHEMES, Exchange
from .ssp import System
from .stability import StabilityGuard

_CONTACT_FORCE = re.compile(r"contact\[(\d+)\]\.F\[1\]")
_WHEEL_FORCE = re.compile(r"wheel\[(\d+)\]\.f_0\[1\]")
_COUPLING = re.compile(r"(contact|support|pair|anchor|patch)\[\d+\]\.|inverse_inertia\[|free_twist\[")
_GUARD_EVERY = 20  # steps between two checks of an explicit scheme's stability


def is_recorded(variable: str) -> bool:
    """Whether an output belongs into a result: those that only carry the coupling do not."""
    return not _COUPLING.match(variable)


class Master:
    """Runs a system step by step.

    Args:
        system: From :func:`orchestrator.ssp.read_system`.
        scheme: One of :data:`orchestrator.schemes.SCHEMES`.
        stop_time: Told to the slaves [s]; None = open.
        warn: Called with each warning.
    """

    def __init__(self, system: System, scheme: str = "ij", stop_time: float | None = None, warn=print):
        if scheme not in SCHEMES:
            raise ValueError(f"scheme {scheme!r} is unknown: choose one of {', '.join(SCHEMES)}")
        self.system = system
        self._warn = warn
        kind = SCHEMES[scheme]
        slaves: dict[str, Slave] = {}
        try:
            for name, component in system.components.items():
                slaves[name] = Slave(name, component.model_description, component.directory, lambda text, n=name: warn(f"{n}: {text}"))
            self.slaves = [slaves[name] for name in system.stepping_order()]
            self._connections = [c for c in system.connections if kind.sends(c.target_variable)]
            exchange = self._connect(slaves, explicit=kind.explicit)
            done: set[str] = set()
            for slave in map(slaves.get, system.initialising_order()):
                parameters = dict(system.components[slave.name].parameters)
                if kind.explicit and "with_inverse_inertia" in slave.variables:
                    parameters["with_inverse_inertia"] = 2  # on: the guard needs it
                exchange.route(slave)
                fed_by = {c.source_component for c in self._connections if c.target_component == slave.name}
                slave.initialise(system.start_time, stop_time, parameters, send_inputs=fed_by <= done)
                slave.get(system.start_time)
                done.add(slave.name)
            self.scheme = kind(exchange)
            if scheme == "jacobi":
                for rigid in {c.target_component for c in self._connections if c.target_variable == "free_twist[1]"}:
                    warn(f"{rigid}: impulses of rigid contacts act a step late under scheme jacobi and throw bodies about; use scheme ij")
            self._guard = self._stability_guard(slaves) if kind.explicit else None
            sequence = self.scheme.sequence()
            self._program = Program(sequence, exchange) if sequence and can_be_compiled(self.slaves) else None
        except BaseException:
            self.slaves = list(slaves.values())
            self.close()
            raise
        self._steps = 0

    def step(self, t: float, h: float) -> None:
        """Advance all slaves from t by h [s]; raises SlaveError with the instance, the variable and who sent it."""
        with self._naming_senders():
            self.scheme.step(t, h)
        self._check_outputs(t)
        if self._guard is not None and self._steps % _GUARD_EVERY == 0:
            self._guard.check(t, h)
        self._steps += 1

    def advance(self, start: float, h: float, k: int, rows: np.ndarray, columns: np.ndarray) -> tuple[int, SlaveError | None]:
        """Do steps k, k + 1, ... of length h [s], counted from ``start``, as many as there are rows; each gets the outputs ``columns``.

        Returns the number of steps done, and the error that ended them, if any.
        """
        done = 0
        try:
            if self._program is not None:
                done, fail = self._program.run(start, h, k, columns, rows)
                with self._naming_senders():
                    fail()
                if done < len(rows):
                    self._check_outputs(start + (k + done) * h)
            else:
                for row in rows:
                    self.step(start + (k + done) * h, h)
                    row[:] = self.outputs[columns]
                    done += 1
        except SlaveError as error:
            return done, error
        return done, None

    def close(self) -> None:
        """End all instances."""
        for slave in self.slaves:
            with suppress(Exception):
                slave.close()

    # -- checkpoints

    def save(self) -> dict[str, np.ndarray]:
        """Everything that a run needs to go on with the same bits: the slaves' states and the exchanged values."""
        for slave in self.slaves:
            if not slave.can_serialise:
                raise SlaveError(f"{slave.name}: its FMU cannot serialise its state, so a run with it has no checkpoints")
        states = {f"state.{s.name}": np.frombuffer(s.to_bytes(), dtype=np.uint8) for s in self.slaves}
        return {"inputs": self.inputs.copy(), "outputs": self.outputs.copy(), **states}

    def restore(self, saved) -> None:
        """Go back to what ``save`` returned."""
        for slave in self.slaves:
            slave.from_bytes(saved[f"state.{slave.name}"].tobytes())
        self.inputs[:] = saved["inputs"]
        self.outputs[:] = saved["outputs"]
        self.scheme.resumed = True
        if self._program is not None:
            self._program.forget()

    # -- construction

    def _connect(self, slaves: dict[str, Slave], explicit: bool) -> Exchange:
        inputs: dict[str, list] = {name: [] for name in slaves}
        sources: dict[str, set] = {name: set() for name in slaves}
        for connection in self._connections:
            inputs[connection.target_component].append(connection)
            sources[connection.source_component].add(connection.source_variable)
        outputs = {}
        for name, slave in slaves.items():
            offered = [v for v in slave.variables.values() if v.causality == "output" and v.type != "String"]
            guard = re.compile(r"contact\[\d+\]\.(axes|K|D|point_0)\[|inverse_inertia\[") if explicit else re.compile("$^")
            wanted = sources[name] | {revision_of(source) for source in sources[name]}
            outputs[name] = [v.name for v in offered if v.name in wanted or is_recorded(v.name) or guard.match(v.name)]
        self.inputs = np.zeros(sum(map(len, inputs.values())))
        self.outputs = np.zeros(sum(map(len, outputs.values())))
        keys = [(name, variable) for name in slaves for variable in outputs[name]]
        self.output_index = {key: i for i, key in enumerate(keys)}
        routes: dict[str, tuple] = {}
        start_u = start_y = 0
        for name, slave in slaves.items():
            # In the order of the sources, so that few runs of memory hold them.
            connections = sorted(inputs[name], key=lambda c: self.output_index[c.source_component, c.source_variable])
            u = self.inputs[start_u : start_u + len(connections)]
            y = self.outputs[start_y : start_y + len(outputs[name])]
            slave.connect([c.target_variable for c in connections], u, outputs[name], y)
            start_u, start_y = start_u + u.size, start_y + y.size
            source = np.array([self.output_index[c.source_component, c.source_variable] for c in connections], dtype=int)
            factor, offset = np.array([c.factor for c in connections]), np.array([c.offset for c in connections])
            plain = bool(np.all(factor == 1.0) and np.all(offset == 0.0))
            routes[name] = (_runs(self.outputs, source, u), *((None, None) if plain else (factor, offset)))
        return Exchange(self.slaves, self.inputs, self.outputs, routes)

    def _stability_guard(self, slaves: dict[str, Slave]) -> StabilityGuard | None:
        rover = next((s for s in self.slaves if "inverse_inertia[1]" in s.variables), None)
        contacts = []
        for connection in self._connections:
            source = slaves[connection.source_component]
            wheel = _WHEEL_FORCE.fullmatch(connection.target_variable)
            at_source = _WHEEL_FORCE.fullmatch(connection.source_variable)
            if wheel and at_source and rover and connection.target_component == rover.name:
                number = int(at_source[1])
                if f"contact[{number}].K[1]" in source.variables:
                    contacts.append((source, number, int(wheel[1])))
        return StabilityGuard(rover, contacts, self._warn) if contacts else None

    def _check_outputs(self, t: float) -> None:
        # One dot product finds any NaN or infinity among the outputs.
        if not math.isfinite(self.outputs.dot(self.outputs)) and (found := self._not_finite()):
            raise SlaveError(f"output {found} is not finite after the step at t = {t:.6g} s; correct the FMU that gives it")

    @contextmanager
    def _naming_senders(self) -> Iterator[None]:
        try:
            yield
        except SlaveError as error:
            raise SlaveError(f"{error}{self._senders(str(error))}") from error

    def _senders(self, refusal: str) -> str:
        """Who sent the input that a slave refuses: by the input's name if the slave says it, as ours do, else by the value."""
        sent = (c for c in self._connections if f"{c.target_component}: input {c.target_variable} = " in refusal)
        found = ", ".join(f"{c.source_component}.{c.source_variable}" for c in sent) or self._not_finite()
        return f"; it came from {found}" if found else ""

    def _not_finite(self) -> str:
        found = [f"{name}.{variable}" for (name, variable), i in self.output_index.items() if not np.isfinite(self.outputs[i])]
        return ", ".join(found[:3]) + (" and others" if len(found) > 3 else "")


def _runs(outputs: np.ndarray, source: np.ndarray, u: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Pairs of slices (source, target) that bring ``outputs[source]`` into u: one for each run of consecutive sources."""
    breaks = np.flatnonzero(np.diff(source) != 1) + 1
    bounds = [0, *breaks.tolist(), len(source)] if source.size else []
    return [(outputs[source[a] : source[a] + b - a], u[a:b]) for a, b in pairwise(bounds)]
