"""Particles for tests: in their first order, at random without overlap, in boxes of planes; and their law in plain Python."""

import math

import numpy as np

from cdl_fmu.dem.particles import FREE, V_X, W_X, M, R
from cdl_fmu.dem.simulation import Tool


def in_order(simulation):
    """Records of the particles in the order in which they were given; a copy."""
    return simulation.bodies[np.argsort(simulation.ident)]


def apart(random, n, radii, low, high):
    """Centres and radii of n spheres in a box that do not overlap; large ones are placed first."""
    radii = np.sort(random.choice(radii, n))[::-1]
    centres = np.zeros((0, 3))
    for r in radii:
        while True:
            c = random.uniform(np.add(low, r), np.subtract(high, r))
            if (np.linalg.norm(centres - c, axis=1) > radii[: len(centres)] + r).all():
                break
        centres = np.vstack([centres, c])
    return centres, radii


def facing(normal, material, r_0=(0.0, 0.0, 0.0)):
    """A plane through r_0 with this outward normal."""
    z = np.asarray(normal, float) / np.linalg.norm(normal)
    x = np.cross(z, (0.0, 0.0, 1.0) if abs(z[2]) < 0.9 else (1.0, 0.0, 0.0))
    x /= np.linalg.norm(x)
    return Tool(material, r_0=np.array(r_0, float), T=np.array([x, np.cross(z, x), z]))


def box(material, low, high):
    """Six planes around a box."""
    return [facing(sign * axis, material, corner) for sign, corner in ((1.0, low), (-1.0, high)) for axis in np.eye(3)]


def effective(material):
    """E* and G* of two equal bodies [Pa], and the share of critical damping by e."""
    e_modulus = material.E / (2.0 * (1.0 - material.nu**2))
    g_modulus = material.E / (2.0 * (1.0 + material.nu)) / (2.0 * (2.0 - material.nu))
    return e_modulus, g_modulus, -math.log(material.e) / math.hypot(math.log(material.e), math.pi)


def springs(material, overlap, r_eff, m_eff):
    """Elastic normal force [N], normal and tangential stiffness [N/m], and damping along both [N.s/m]."""
    e_modulus, g_modulus, beta = effective(material)
    if material.linear:
        k_n = 2.0 * e_modulus * r_eff
        k_t, f, c = k_n * 4.0 * g_modulus / e_modulus, k_n * overlap, 2.0 * beta * math.sqrt(k_n * m_eff)
    else:
        a = math.sqrt(r_eff * overlap)  # radius of the area of contact
        k_n, k_t, f = 2.0 * e_modulus * a, 8.0 * g_modulus * a, 4.0 / 3.0 * e_modulus * a * overlap
        c = 2.0 * math.sqrt(5.0 / 6.0) * beta * math.sqrt(k_n * m_eff)
    return f, k_n, k_t, c, c * math.sqrt(k_t / k_n)


def shortened(vector, longest):
    length = np.linalg.norm(vector)
    return vector * (longest / length) if length > longest else vector


def contact(material, overlap, r_eff, m_eff, n, u, w, shear, roll):
    """Force and rolling torque on the first of two bodies in contact, and the history that remains.

    Args:
        material: Of both.
        overlap, r_eff, m_eff: [m], [m], [kg].
        n: Unit normal towards the first.
        u: Velocity of its surface against the other's [m/s].
        w: Its angular velocity against the other's [rad/s].
        shear, roll: History, already moved on [m], [rad].
    """
    f, _, k_t, c_n, c_t = springs(material, overlap, r_eff, m_eff)
    f -= c_n * (u @ n)
    most, k_r = material.mu * max(f, 0.0), k_t * r_eff**2
    shear = shortened(k_t * shear, most) / k_t
    f_t = shortened(-k_t * shear - c_t * (u - n * (u @ n)), most)
    roll = shortened(k_r * roll, material.mu_r * r_eff * max(f, 0.0)) / k_r
    pull = material.cohesion * (4.0 * r_eff) ** 2
    return (f - pull) * n + f_t, -k_r * roll, shear, roll


def brute_forces(bodies, material, periods=(0.0, 0.0)):
    """Forces between particles without friction [N], from all pairs."""
    period = np.array([*periods, 0.0])
    forces = np.zeros((len(bodies), 3))
    for i, a in enumerate(bodies):
        d = a[:3] - bodies[:, :3]
        d -= np.where(period > 0.0, period * np.round(d / np.where(period > 0.0, period, 1.0)), 0.0)
        distance = np.linalg.norm(d, axis=1)
        for j in np.flatnonzero((distance < a[R] + bodies[:, R]) & (np.arange(len(bodies)) != i)):
            b, n = bodies[j], d[j] / distance[j]
            r_eff, m_eff = a[R] * b[R] / (a[R] + b[R]), a[M] * b[M] / (a[M] + b[M])
            f, _, _, c, _ = springs(material, a[R] + b[R] - distance[j], r_eff, m_eff)
            forces[i] += (f - c * ((a - b)[V_X : V_X + 3] @ n)) * n
    return forces


def elastic_energy(simulation, low=None, high=None):
    """Energy of the normal springs between the particles, and between them and a box of planes [J]."""
    bodies, e_modulus = simulation.bodies, effective(simulation.material)[0]
    r, x = bodies[:, R], bodies[:, :3]
    overlap = np.triu(r[:, None] + r - np.linalg.norm(x[:, None] - x, axis=2), 1)
    overlaps, r_effs = [overlap], [r[:, None] * r / (r[:, None] + r)]
    for axis in range(3) if low is not None else ():
        overlaps += [r - (x[:, axis] - low[axis]), r - (high[axis] - x[:, axis])]
        r_effs += [r, r]
    energy = 0.0
    for overlap, r_eff in zip(overlaps, r_effs):
        overlap = np.clip(overlap, 0.0, None)
        linear = simulation.material.linear
        energy += (e_modulus * r_eff * overlap**2 if linear else 8.0 / 15.0 * e_modulus * np.sqrt(r_eff) * overlap**2.5).sum()
    return energy


def hold(simulation, which):
    """Hold these particles, given by their number in the first order."""
    simulation.bodies[np.isin(simulation.ident, which), FREE] = 0.0


def spins(bodies):
    return bodies[:, W_X : W_X + 3]


def velocities(bodies):
    return bodies[:, V_X : V_X + 3]
