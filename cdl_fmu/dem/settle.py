"""Making a bed: particles are laid in loose layers, fall gently, are compacted to their porosity, levelled, and come to rest.

Porosity is set by friction during the preparation: with that of the material the bed settles loosest. Then all friction is lowered evenly
with time, and the bed compacts throughout, until its bulk has the porosity asked for; without friction it is densest. With the material's
friction back it stands at once.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..slave.model import ModelError
from .bed import Bed, BedKey, porosity_between, surface_of
from .contacts import Contacts, contacts_among, contacts_of, no_contacts, normal_forces, overlaps_of
from .material import Material
from .memory import check_memory
from .particles import V_X, W_X, M, R, X
from .scaling import check_overlap
from .simulation import Simulation

Progress = Callable[[str, float], None]

#: What a bed reached: its porosity is within this of the one asked for.
TOLERANCE = 0.003
#: At rest: kinetic energy of a particle over m g d, and mean force left on a particle over the mean normal force of a contact.
MOST_ENERGY, MOST_UNBALANCE = 1e-6, 1e-3

# Own choices: by how fast beds of 5 to 10 mm settle, and what they are like.
_LAID = 0.35  # solid share of the volume of the grid in which particles are laid
_JITTER = 0.05  # by which they are moved in it at random to each side, in distances of the grid
_SOFT = 1e-3  # share of their stiffness with which those that overlap as they are laid are moved apart
_APART = 0.01  # overlap over the mean diameter, at most, when they are
_OVERFILL = 2.0  # diameters of the largest that are laid above the surface, to be taken away
_RESTITUTION = 0.1  # of settling, at most
_FALLEN = 2e-2  # kinetic energy over m g d below which all have fallen
_CALM = 5e-4  # and below which the loose bed stands
_SHARE = 0.9  # of the longest stable time step
_RAMP, _STAGES = 3.0, 75  # time in which friction falls to 0, in sqrt(depth / g), and its steps
_RAMPS = 8  # as many times as that, after which a bed that is not as dense as asked for never will be
_BEGIN = 0.75  # share of friction from which it falls: above, nothing moves
_FALL, _STAND = 1.0, 0.3  # time in which drag stops particles that fall, and that come to stand, in sqrt(d / g)
_SUBSTEPS = 20  # substeps from drag to drag
_FREE = 2.0  # time for which it stays there without drag, in sqrt(d / g)
_LONGEST = 25.0  # time after which a bed that is not at rest never will be, in sqrt(depth / g)


def settle(key: BedKey, progress: Progress = lambda stage, share: None) -> Bed:
    """Make a bed: equal keys give equal bits.

    Args:
        key: What to make it from.
        progress: Called now and then with what is done now ("falling", "compacting", "coming to rest") and the share done of it.

    Raises:
        ModelError: The porosity is out of reach, the bed does not come to rest (as on a slope above its angle of repose), or there is not
            enough memory.
    """
    return _Settling(key, progress).bed()


class _Settling:
    def __init__(self, key: BedKey, progress: Progress):
        self.key, self.progress = key, progress
        self.gravity = math.hypot(*key.gravity)
        self.periods = tuple(key.column * count for count in key.counts)
        self.time, self.short_time = math.sqrt(key.depth / self.gravity), math.sqrt(key.diameter / self.gravity)
        check_overlap(key.material, (1.0 - key.porosity) * key.material.density * self.gravity * key.depth)

    def bed(self) -> Bed:
        key = self.key
        # Grains with a shape tremble where their figures lose energy: they settle on figures that do not.
        shape = key.material.shape and replace(key.material.shape, returned=1.0)
        calm = replace(key.material, e=min(key.material.e, _RESTITUTION), shape=shape)
        simulation = self._simulation(*self._laid(), no_contacts(), np.zeros((0, 4)), calm, (0.0, 0.0, -self.gravity))
        self._part(simulation, calm)
        self._fall(simulation)
        self._compact(simulation, calm)
        positions, radii, contacts, orientations = self._levelled(simulation)
        simulation = self._simulation(positions, radii, contacts, orientations, calm, key.gravity)
        self._rest(simulation)
        positions, contacts = self._positions(simulation), contacts_of(simulation)
        surface = surface_of(key, positions, radii, self.periods, key.column)
        positions[:, 2] -= surface
        bed = Bed(key, positions, radii, self.periods, key.counts, -surface, contacts, self._orientations(simulation))
        if abs(bed.porosity - key.porosity) > TOLERANCE:
            warnings.warn(f"the bed's porosity is {bed.porosity:.4f}, {key.porosity:g} was asked for", stacklevel=3)
        return bed

    def _laid(self) -> tuple[np.ndarray, np.ndarray]:
        """Centres [m] and radii [m] of particles in a loose grid, from the floor up, the coarsest below."""
        key, rng = self.key, np.random.default_rng(self.key.seed)
        area = self.periods[0] * self.periods[1]
        layers, numbers = key.layers[::-1], []
        for layer in layers:
            thick = layer.top - layer.bottom + (_OVERFILL * key.scale * key.sizes.d_max if layer is layers[-1] else 0.0)
            numbers.append(math.ceil((1.0 - key.porosity) * area * thick / (layer.factor**3 * key.sizes.mean_volume)))
        check_memory(sum(numbers), shape=key.material.shape)
        positions, radii, z = [], [], 0.0
        for layer, n in zip(layers, numbers):
            pitch = layer.factor * (key.sizes.mean_volume / _LAID) ** (1.0 / 3.0)
            n_x, n_y = (math.ceil(period / pitch) for period in self.periods)
            k = np.arange(n)
            grid = np.stack([k % n_x, k // n_x % n_y, k // (n_x * n_y)], axis=1) + 0.5 + rng.uniform(-_JITTER, _JITTER, (n, 3))
            positions.append(grid * [self.periods[0] / n_x, self.periods[1] / n_y, pitch] + [0.0, 0.0, z])
            radii.append(0.5 * layer.factor * key.sizes.draw(n, rng))
            z += pitch * math.ceil(n / (n_x * n_y))
        return np.concatenate(positions), np.concatenate(radii)

    def _simulation(self, positions, radii, contacts: Contacts, orientations, material: Material, gravity) -> Simulation:
        key = replace(self.key, material=material, gravity=gravity)
        dt = _SHARE * material.largest_time_step(radii.min())
        return Bed(key, positions, radii, self.periods, key.counts, 0.0, contacts, orientations).simulation(dt=dt)

    def _part(self, simulation: Simulation, calm: Material) -> None:
        """Particles that were laid into each other are moved apart."""
        gravity, dt = simulation.gravity, simulation.dt
        simulation.gravity = np.zeros(3)
        simulation.material = simulation.tools[0].material = replace(calm, E=_SOFT * calm.E, mu=0.0, mu_r=0.0, cohesion=0.0)
        simulation.dt = dt / math.sqrt(_SOFT)
        began, overlaps = simulation.time, np.ones(1)
        while overlaps.max(initial=0.0) > _APART * self.key.diameter:
            simulation.step(_SUBSTEPS * simulation.dt)
            simulation.bodies[:, V_X : V_X + 3] = simulation.bodies[:, W_X : W_X + 3] = 0.0
            overlaps = overlaps_of(simulation)
            self._check_time(simulation, began)
        simulation.gravity, simulation.dt = gravity, dt
        simulation.material = simulation.tools[0].material = calm

    def _fall(self, simulation: Simulation) -> None:
        """All particles fall and stand."""
        highest = self._fall_left(simulation)
        began = simulation.time
        while simulation.time - began < 2.0 * self.short_time or self._energy(simulation) > _FALLEN:
            self._drag(simulation, 0.2 * self.time, _FALL)
            self._check_time(simulation, began)
            self.progress("falling", 1.0 - self._fall_left(simulation) / highest)
        self._stand(simulation)

    def _stand(self, simulation: Simulation) -> None:
        """Particles that move come to stand, with a drag."""
        began = simulation.time
        while self._energy(simulation) > _CALM:
            self._drag(simulation, 0.02 * self.time, _STAND)
            self._check_time(simulation, began)

    def _compact(self, simulation: Simulation, calm: Material) -> None:
        """Friction falls until the bulk has its porosity."""
        key = self.key
        loosest = now = self._porosity(simulation)
        if loosest < key.porosity - TOLERANCE:
            raise ModelError(
                f"porosity = {key.porosity:g}: these particles settle to at most {loosest:.3f}; ask for less, or raise mu = "
                f"{key.material.mu:g}, mu_r = {key.material.mu_r:g} or cohesion = {key.material.cohesion:g} Pa"
            )
        stage, k = _RAMP * self.time / _STAGES, 0
        while now > key.porosity:
            k += 1
            share = _BEGIN * max(1.0 - k / _STAGES, 0.0)
            simulation.material = replace(calm, mu=share * calm.mu, mu_r=share * calm.mu_r)
            simulation.tools[0].material = simulation.material
            before = now
            simulation.step(stage)
            now = self._porosity(simulation)
            self.progress("compacting", min((loosest - now) / (loosest - key.porosity), 1.0))
            stuck = before - now < 1e-4 and self._energy(simulation) < 10.0 * _CALM
            if share == 0.0 and k % _STAGES == 0 and (stuck or k >= _RAMPS * _STAGES):
                pull = f", or lower cohesion = {key.material.cohesion:g} Pa, which holds them apart" if key.material.cohesion > 0.0 else ""
                raise ModelError(
                    f"porosity = {key.porosity:g}: these particles settle to between {now:.3f} and {loosest:.3f}; ask for one within, or "
                    f"for sizes that vary more{pull}"
                )
        simulation.material = simulation.tools[0].material = calm
        self._stand(simulation)

    def _levelled(self, simulation: Simulation) -> tuple[np.ndarray, np.ndarray, Contacts, np.ndarray]:
        """What is left where all above a height is taken away, so that the mean surface is at the depth wanted."""
        key, positions, radii = self.key, self._positions(simulation), self._radii(simulation)
        orientations = self._orientations(simulation)
        tops = positions[:, 2] + radii
        low, high = key.depth - 2.0 * key.diameter, key.depth + _OVERFILL * key.diameter
        for _ in range(20):
            middle = 0.5 * (low + high)
            kept = tops < middle
            below = surface_of(key, positions[kept], radii[kept], self.periods, key.column) < key.depth
            low, high = (middle, high) if below else (low, middle)
        of_kept = orientations[kept] if len(orientations) else orientations
        return positions[kept], radii[kept], contacts_among(contacts_of(simulation), kept), of_kept

    def _rest(self, simulation: Simulation) -> None:
        """The bed comes to rest with a drag, and stays there without: single grains that hang on others fall meanwhile."""
        first, unrest = 0.0, math.inf
        while unrest > 1.0:
            while unrest > 1.0:
                self._drag(simulation, 0.1 * self.time, _STAND)
                self._check_time(simulation, 0.0)
                unrest = self._unrest(simulation)
                first = first or max(math.log(unrest), 1e-3)
                self.progress("coming to rest", min(max(1.0 - math.log(unrest) / first, 0.0), 1.0))
            simulation.step(_FREE * self.short_time)
            unrest = self._unrest(simulation)

    def _unrest(self, simulation: Simulation) -> float:
        """How far the particles are from rest; at rest below 1."""
        energy, unbalance = rest_of(simulation, self.key.diameter)
        return max(energy / MOST_ENERGY, unbalance / MOST_UNBALANCE)

    def _drag(self, simulation: Simulation, h: float, stopped_in: float) -> None:
        """Go on by about h [s] with a drag on all particles that stops them in this time, in sqrt(d / g)."""
        interval = _SUBSTEPS * simulation.dt
        kept = math.exp(-interval / (stopped_in * self.short_time))
        for _ in range(math.ceil(h / interval)):
            simulation.step(interval)
            simulation.bodies[:, V_X : V_X + 3] *= kept
            simulation.bodies[:, W_X : W_X + 3] *= kept

    def _check_time(self, simulation: Simulation, began: float) -> None:
        if simulation.time - began > _LONGEST * self.time:
            slope = math.degrees(math.acos(-self.key.gravity[2] / self.gravity))
            raise ModelError(
                f"the bed is not at rest after {simulation.time:.3g} s: on its slope of {slope:.3g} deg it flows; tilt gravity less, or "
                f"raise mu = {self.key.material.mu:g} or mu_r = {self.key.material.mu_r:g}"
            )

    def _energy(self, simulation: Simulation) -> float:
        """Kinetic energy of the particles over m g d."""
        return simulation.kinetic_energy / (simulation.bodies[:, M].sum() * self.gravity * self.key.diameter)

    def _fall_left(self, simulation: Simulation) -> float:
        """Height [m] of the centre of mass above that of the bed wanted."""
        mass = simulation.bodies[:, M]
        return max(float(mass @ simulation.bodies[:, X + 2]) / mass.sum() - 0.5 * self.key.depth, 0.0)

    def _porosity(self, simulation: Simulation) -> float:
        """Porosity of the bulk."""
        positions, radii = self._positions(simulation), self._radii(simulation)
        surface = min(surface_of(self.key, positions, radii, self.periods, self.key.column), self.key.depth)
        bulk = self.key.bulk(0.0, surface)
        return float(porosity_between(positions[:, 2], radii, self.periods, np.array(bulk))[0])

    def _positions(self, simulation: Simulation) -> np.ndarray:
        """Centres [m] by their numbers, within the periods."""
        positions = np.empty((len(simulation.ident), 3))
        positions[simulation.ident] = simulation.bodies[:, X : X + 3]
        positions[:, :2] %= self.periods
        return positions

    def _orientations(self, simulation: Simulation) -> np.ndarray:
        """Orientations by the particles' numbers, none of spheres."""
        found = np.empty_like(simulation.orientations)
        found[simulation.ident[: len(found)]] = simulation.orientations
        return found

    def _radii(self, simulation: Simulation) -> np.ndarray:
        """Radii [m] by their numbers."""
        radii = np.empty(len(simulation.ident))
        radii[simulation.ident] = simulation.bodies[:, R]
        return radii


def rest_of(simulation: Simulation, diameter: float) -> tuple[float, float]:
    """How far particles are from rest: mean kinetic energy over m g d, and mean force left over the mean normal force of a contact.

    It makes a substep, after which velocities tell the forces.

    Args:
        simulation: Particles on their floor.
        diameter: d [m].
    """
    before = np.empty((len(simulation.ident), 3))
    before[simulation.ident] = simulation.bodies[:, V_X : V_X + 3]
    simulation.step(simulation.dt)
    bodies = simulation.bodies
    left = bodies[:, M] * np.linalg.norm(bodies[:, V_X : V_X + 3] - before[simulation.ident], axis=1) / simulation.dt
    forces = normal_forces(simulation)
    energy = simulation.kinetic_energy / (bodies[:, M].sum() * np.linalg.norm(simulation.gravity) * diameter)
    return energy, float(left.mean() / forces.mean()) if len(forces) else math.inf
