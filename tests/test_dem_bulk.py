"""Beds of particles against laws of granular matter: weight on the floor, slopes, Beverloo's hopper, Rankine's earth pressure."""

import math
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from grains import facing

from cdl_fmu.dem.material import Material
from cdl_fmu.dem.particles import FREE, V_X, W_X, M, R, X, Z
from cdl_fmu.dem.simulation import Simulation, Tool
from cdl_fmu.mesh.surface import surface_of

G, D = 9.81, 6e-3
SOFT = Material(E=2e6, mu=0.5, mu_r=0.1, e=0.5)
SMOOTH = replace(SOFT, mu=0.0, mu_r=0.0)
THIN = 4.0 * D  # period of beds that stand for slices of long ones


def layers(low, high, seed=1):
    """Centres and radii of spheres of 0.85 to 1 D on a grid in a box, a little at random."""
    random = np.random.default_rng(seed)
    axes = [np.arange(a + 0.52 * D, b - 0.52 * D + 1e-9, 1.04 * D) for a, b in zip(low, high)]
    centres = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    return centres + random.uniform(-0.02 * D, 0.02 * D, centres.shape), random.uniform(0.425 * D, 0.5 * D, len(centres))


def bulk_density(bodies, low, high):
    """Mass of the particles whose centres are in a box over its volume [kg/m3]."""
    inside = ((bodies[:, :3] > low) & (bodies[:, :3] < high)).all(axis=1)
    return bodies[inside, M].sum() / np.prod(np.subtract(high, low))


def hold_where(simulation, held):
    bodies = simulation.bodies
    bodies[held, FREE] = bodies[held, V_X : V_X + 3] = bodies[held, W_X : W_X + 3] = 0.0


def tilted(angle):
    """Gravity [m/s2] on a bed that falls along x by this angle [deg]."""
    return G * np.array([math.sin(math.radians(angle)), 0.0, -math.cos(math.radians(angle))])


def test_the_floor_carries_the_weight_of_the_bed():
    material = replace(SOFT, e=0.2)
    plate = Tool(material, surface=surface_of(trimesh.creation.box(bounds=[[-0.1, -0.1, -0.02], [0.2, 0.2, 0.0]])))
    centres, radii = layers((0.0, 0.0, 0.0), (0.05, 0.05, 0.06))
    s = Simulation(centres, radii, material, [plate], periods=(0.05, 0.05))
    s.step(1.0)
    weight = s.bodies[:, M].sum() * G
    s.step(0.5)
    assert plate.f_0 == pytest.approx([0.0, 0.0, -weight], abs=5e-3 * weight)
    assert bulk_density(s.bodies, (0.0, 0.0, 0.01), (0.05, 0.05, 0.04)) / material.density == pytest.approx(
        0.55, abs=0.05
    )  # a loose packing


def slope_left(material):
    """Slope [deg] that a bed on a rough base leaves as the wall in front of it moves away."""
    wall = facing((-1.0, 0.0, 0.0), SMOOTH, (0.1, 0.0, 0.0))
    centres, radii = layers((0.0, 0.0, 0.0), (0.1, THIN, 0.09))
    base = np.stack(np.meshgrid(np.arange(-0.5, 60.0) * D, np.arange(4.0) * D, [-0.45 * D], indexing="ij"), -1).reshape(-1, 3)
    base += np.random.default_rng(2).uniform(-0.15 * D, 0.15 * D, base.shape)
    held = np.arange(len(centres) + len(base)) >= len(centres)
    tools = [wall, facing((1.0, 0.0, 0.0), SMOOTH), Tool(material, r_0=np.array([0.0, 0.0, -D]))]
    s = Simulation(np.vstack([centres, base]), np.append(radii, np.full(len(base), 0.5 * D)), material, tools, periods=(0.0, THIN))
    hold_where(s, held)
    s.step(0.4)
    for k in range(100):
        wall.r_0 = np.array([0.1 + 0.0025 * (k + 1), 0.0, 0.0])
        s.step(0.015)
    b = s.bodies[s.bodies[:, FREE] > 0.0]
    columns = [(x, b[np.abs(b[:, X] - x) < D, Z]) for x in np.arange(0.0, 0.3, D)]
    surface = np.array([(x, z.max()) for x, z in columns if len(z)])
    top = surface[:, 1].max()
    steep = surface[(surface[:, 1] < 0.8 * top) & (surface[:, 1] > 0.25 * top)]
    return -math.degrees(math.atan(np.polyfit(*steep.T, 1)[0]))


@pytest.mark.slow
def test_slopes_are_as_steep_as_heaps_of_spheres_and_steeper_with_rolling_friction():
    slopes = [slope_left(replace(SOFT, mu_r=mu_r)) for mu_r in (0.0, 0.1, 0.4)]
    assert all(18.0 < slope < 32.0 for slope in slopes)
    assert min(slopes[1:]) > slopes[0]  # it grows little beyond mu_r = 0.1, where grains slide rather than roll


def discharge(opening, side=0.11):
    """Mass rate [kg/s] through an opening of this diameter [m] in the floor of a square box, and Beverloo's."""
    material = replace(SOFT, mu_r=0.0)
    centres, radii = layers((-0.5 * side, -0.5 * side, 0.0), (0.5 * side, 0.5 * side, 0.13))
    walls = [facing(n, material, -0.5 * side * n) for n in np.vstack([np.eye(3)[:2], -np.eye(3)[:2]])]
    plate = trimesh.creation.annulus(r_min=0.5 * opening, r_max=side, height=0.02, sections=48)
    plate.apply_translation((0.0, 0.0, -0.01))
    plug = Tool(material)
    s = Simulation(centres, radii, material, [plug, Tool(material, surface=surface_of(plate)), *walls])
    s.step(0.3)
    density = bulk_density(s.bodies, (-0.5 * side, -0.5 * side, 0.02), (0.5 * side, 0.5 * side, 0.07))
    plug.r_0 = np.array([0.0, 0.0, -0.12])  # the plug falls away, and catches what flows out
    s.step(0.01)
    s.step(0.14)
    left = [s.bodies[s.bodies[:, Z] > -0.01, M].sum()]
    s.step(0.2)
    left.append(s.bodies[s.bodies[:, Z] > -0.01, M].sum())
    d = 2.0 * s.bodies[:, R].mean()
    return (left[0] - left[1]) / 0.2, 0.58 * density * math.sqrt(G) * (opening - 1.4 * d) ** 2.5  # Beverloo et al. 1961


@pytest.mark.slow
def test_a_hopper_flows_after_beverloo():
    (small, small_law), (large, large_law) = discharge(0.04), discharge(0.055)
    assert small == pytest.approx(small_law, rel=0.15)
    assert large == pytest.approx(large_law, rel=0.15)
    assert large / small == pytest.approx(large_law / small_law, rel=0.1)  # the power of 5/2


LOW = replace(SOFT, mu=0.3, mu_r=0.0)


def friction_angle():
    """Angle [deg] at which a bed of ``LOW`` on a rough base begins to flow as it is tilted."""
    side = 7.5 * D
    centres, radii = layers((0.0, 0.0, 0.0), (side, THIN, 0.09))
    s = Simulation(centres, radii, LOW, [Tool(LOW)], periods=(side, THIN))
    s.step(0.4)
    hold_where(s, s.bodies[:, Z] < D)
    for angle in np.arange(12.0, 40.0, 0.5):
        s.gravity = tilted(angle)
        s.step(0.04)
        if s.bodies[:, V_X].mean() > 0.05:
            break
    return angle


def pressure_on_a_wall(direction, length, way):
    """Force on a smooth wall over that of water as heavy as the bed, mean of the second half of a way [heights of the bed]."""
    centres, radii = layers((0.0, 0.0, 0.0), (length, THIN, 0.12), seed=3)
    plate = Tool(SMOOTH, surface=surface_of(trimesh.creation.box(bounds=[[-0.05, -0.1, -0.03], [0.0, 0.1 + THIN, 0.3]])))
    s = Simulation(centres, radii, LOW, [Tool(LOW), plate, facing((-1.0, 0.0, 0.0), SMOOTH, (length, 0.0, 0.0))], periods=(0.0, THIN))
    s.step(0.4)
    near = s.bodies[s.bodies[:, X] < 0.1]
    density = bulk_density(near, (0.0, 0.0, 0.0), (0.1, THIN, 0.05))
    height = near[:, M].sum() / (density * 0.1 * THIN)
    forces = []
    for k in range(40):
        plate.r_0 = np.array([direction * way * height * (k + 1) / 40.0, 0.0, 0.0])
        s.step(way * height / 0.03 / 40.0)
        forces.append(-plate.f_0[0])
    return np.mean(forces[20:]) / (0.5 * density * G * height**2 * THIN)


@pytest.mark.slow
def test_a_wall_feels_rankines_active_and_passive_pressure():
    phi = math.radians(friction_angle())
    active, passive = pressure_on_a_wall(-1.0, 0.25, 0.06), pressure_on_a_wall(1.0, 0.25, 0.15)
    assert active == pytest.approx(math.tan(0.25 * math.pi - 0.5 * phi) ** 2, rel=0.25)  # Rankine 1857
    assert passive == pytest.approx(math.tan(0.25 * math.pi + 0.5 * phi) ** 2, rel=0.25)
    assert active * passive == pytest.approx(1.0, rel=0.25)  # whatever the angle is
