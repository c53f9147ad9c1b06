"""Rigid bodies in contact, as matrices: what the tests of rigid contact start from."""

from dataclasses import dataclass

import numpy as np

from cdl_fmu.rbc.solve import scratch, solve

#: Normal and tangents of a contact on level ground, one a row.
LEVEL = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
GROUND = -1


@dataclass
class Scene:
    """Contacts between bodies, each with the velocities v_0, w_0 at its centre of mass.

    Attributes:
        J: Velocities of the contacts by those of the bodies, shape [3 contacts, 6 bodies].
        per_mass: Inverse of the bodies' masses [1/kg] and moments of inertia [1/(kg.m2)], shape [6 bodies].
    """

    J: np.ndarray
    per_mass: np.ndarray

    @property
    def G(self) -> np.ndarray:
        return self.J * self.per_mass @ self.J.T

    def energy(self, velocities) -> float:
        """Kinetic energy [J] of velocities of the bodies."""
        return 0.5 * float(np.sum(velocities**2 / self.per_mass))


def scene(bodies, contacts) -> Scene:
    """Bodies (mass, moments of inertia) and contacts (body, point, other body or GROUND, point on it, axes [3, 3])."""
    per_mass = np.concatenate([[1.0 / mass] * 3 + [1.0 / i for i in inertia] for mass, inertia in bodies])
    J = np.zeros((3 * len(contacts), 6 * len(bodies)))
    for c, (body, point, other, point_other, axes) in enumerate(contacts):
        for who, r, sign in ((body, point, 1.0), (other, point_other, -1.0)):
            if who != GROUND:
                J[3 * c : 3 * c + 3, 6 * who : 6 * who + 3] = sign * axes
                J[3 * c : 3 * c + 3, 6 * who + 3 : 6 * who + 6] = sign * np.cross(r, axes)
    return Scene(J, per_mass)


def random_scene(rng, n_contacts: int, n_bodies: int, decades: float = 0.0) -> Scene:
    """Contacts anywhere between bodies with masses within a factor 10^decades of 1 kg to either side."""
    mass = 10.0 ** rng.uniform(-decades, decades, n_bodies)
    bodies = [(m, 0.01 * m * rng.uniform(0.5, 2.0, 3)) for m in mass]
    contacts = []
    for _ in range(n_contacts):
        body = int(rng.integers(n_bodies))
        other = int(rng.choice([k for k in range(GROUND, n_bodies) if k != body]))
        axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        contacts.append((body, rng.uniform(-0.2, 0.2, 3), other, rng.uniform(-0.2, 0.2, 3), axes))
    return scene(bodies, contacts)


def stack(n_boxes: int, mass: float, side: float = 0.2) -> Scene:
    """Cubes one on the other, the lowest on the ground, with contacts 4 k .. 4 k + 3 at the corners below box k."""
    half = 0.5 * side
    corners = [(x, y) for x in (-half, half) for y in (-half, half)]
    contacts = [(k, np.array([x, y, -half]), k - 1, np.array([x, y, half]), LEVEL) for k in range(n_boxes) for x, y in corners]
    return scene([(mass, (mass * side**2 / 6.0,) * 3)] * n_boxes, contacts)


def of_each(value, n: int) -> np.ndarray:
    """A number of each contact, given for all or one by one."""
    return np.broadcast_to(np.asarray(value, float), n).copy()


def solved(G, b, mu, target=0.0, *, n_directions=8, tolerance=1e-8, max_sweeps=1000, p=None):
    """Impulses, velocities, status, sweeps and residual of the contacts."""
    n = len(b) // 3
    p, v = np.zeros(3 * n) if p is None else p.copy(), np.zeros(3 * n)
    G, b = np.ascontiguousarray(G, float), np.asarray(b, float)
    result = solve(np.int64(n), G, b, of_each(target, n), of_each(mu, n), p, v, tolerance, np.int64(max_sweeps), *scratch(n, n_directions))
    return p, v, *result


def violation(G, b, mu, target, p, n_directions: int) -> float:
    """Largest violation [m/s] of the conditions of Stewart & Trinkle 1996, by all lambda and sigma, apart from the kernels."""
    n, sector = len(b) // 3, 2.0 * np.pi / n_directions
    v, worst = b + G @ p, 0.0
    directions = np.array([(np.cos(k * sector), np.sin(k * sector)) for k in range(n_directions)])
    for c in range(n):
        normal, tangential = v[3 * c] - of_each(target, n)[c], directions @ v[3 * c + 1 : 3 * c + 3]
        g_n, g_t = G[3 * c, 3 * c], 0.5 * (G[3 * c + 1, 3 * c + 1] + G[3 * c + 2, 3 * c + 2])
        bound = of_each(mu, n)[c] * p[3 * c]
        k = int(np.floor(np.arctan2(p[3 * c + 2], p[3 * c + 1]) / sector + 1e-9)) % n_directions
        shares, pair = np.zeros(n_directions), [k, (k + 1) % n_directions]
        shares[pair] = np.linalg.solve(directions[pair].T, p[3 * c + 1 : 3 * c + 3])
        sigma = max(0.0, -tangential.min())
        slack = bound - shares.sum()
        worst = max(worst, -normal, -g_n * p[3 * c], min(normal, g_n * p[3 * c]))
        worst = max(worst, -g_t * shares.min(), np.minimum(g_t * shares, tangential + sigma).max(), -g_t * slack, min(sigma, g_t * slack))
    return worst
