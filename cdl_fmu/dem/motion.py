"""Motion of the particles by the forces on them."""

from __future__ import annotations

from ..slave.kernel import kernel
from .particles import FREE, SIDE, STALE, V_X, V_Y, V_Z, W_X, W_Y, W_Z, M, R, X, Y, Z
from .shape import turn


@kernel
def move_particles(grains, dt, gravity, slab):
    """Move the particles of a slab by a step dt [s] (semi-implicit Euler, i.e. leapfrog) and clear their forces.

    Says in ``count[STALE]`` if one of them has moved by more than its list allows.
    """
    body, force, built = grains.body[grains.count[SIDE]], grains.force, grains.built
    g_x, g_y, g_z = gravity[0] * dt, gravity[1] * dt, gravity[2] * dt
    orientation = grains.orientation[grains.count[SIDE]]
    shaped = len(orientation) > 0
    stale = False
    for i in range(grains.slabs[slab], grains.slabs[slab + 1]):
        if body[i, FREE] > 0.0:
            per_mass = dt / body[i, M]
            per_inertia = 2.5 * per_mass / (body[i, R] * body[i, R])  # of a solid sphere
            body[i, V_X] += force[i, 0] * per_mass + g_x
            body[i, V_Y] += force[i, 1] * per_mass + g_y
            body[i, V_Z] += force[i, 2] * per_mass + g_z
            body[i, W_X] += force[i, 3] * per_inertia
            body[i, W_Y] += force[i, 4] * per_inertia
            body[i, W_Z] += force[i, 5] * per_inertia
            body[i, X] += body[i, V_X] * dt
            body[i, Y] += body[i, V_Y] * dt
            body[i, Z] += body[i, V_Z] * dt
            if shaped:
                turn(orientation[i], body[i, W_X], body[i, W_Y], body[i, W_Z], dt)
            d_x, d_y, d_z = body[i, X] - built[i, 0], body[i, Y] - built[i, 1], body[i, Z] - built[i, 2]
            margin = built[i, 3] - body[i, R]
            stale |= not d_x * d_x + d_y * d_y + d_z * d_z <= margin * margin  # no number: the next list says so
        for k in range(6):
            force[i, k] = 0.0
    if stale:
        grains.count[STALE] = 1
