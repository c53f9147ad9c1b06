"""Rotation geometries: spheres that roll like grains (chapter, 8.3.18; Lichtenheldt & Schaefer 2013).

Particles stay spheres where they touch. About each axis of its own frame a particle has a plane figure, an ellipse or a regular polygon,
and where it touches, the normal force acts at that figure's support point instead of at the sphere's: off the line through the centre, by
the derivative of the figure's support function. With a constant normal force the grain's energy is F R* H, where H is the sum of

    (c_x^2 + c_y^2) (h(theta) - h(0)),   tan(theta) = c_y / c_x

over the three axes and c points from the centre to the contact, in the particle's frame. Own choices, which the source leaves open:

- The weight, the square of the normal's projection on the figure's plane. It is smooth where the normal lies along the figure's axis,
  and the torque is the gradient of one energy: it never drives a grain round and round, and has no part along the normal.
- A corner of the polygon, or the ellipse's long end, lies midway between two axes, so that h(0) = h(90 deg) and the three figures agree
  where their planes meet. Polygons of 4 corners then make a cube, ellipses a prolate grain whose long axis is that of (1, 1, 1).
- R*: of two spheres that roll on each other only the share R* / R of their relative rotation turns the normal in the particle's frame.
- The faces of a polygon bulge: the torque changes its sign within an angle, not at once.

Figures hold a grain on its face, but what it climbs it gets back as it falls: they lose no energy, which rolling friction beside them does.
Without it, sand that flows comes to rest at the slope of spheres (measured: hexagons 16.5 deg, spheres 16, spheres of mu_r = 0.1 22).
While a normal force changes, a figure may even add energy: at mu = 0.5 beds of 6 corners or more and of ellipses up to 1.2 come to rest by
themselves, ellipses of 1.5 want mu_r = 0.1 for it, 4 corners mu_r = 0.2; at mu = 1 cubes do not even then.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..slave.kernel import kernel
from ..slave.model import ModelError

#: Most corners of a polygon, and of an ellipse the largest aspect ratio: own choices; above them grains are balls or needles.
MOST_CORNERS, LARGEST_ASPECT = 16, 3.0
#: Places of a figure's numbers, lengths over the radius: how far off a polygon's corners are, 0 for an ellipse; what h is on the particle's
#: axes; squares of the ellipse's semi-axes; how much two corners' supports differ where a face begins to bulge; cosine and sine of the
#: angles of three mirrors of the polygon from its first corner; the next corner, along the first one and across.
CORNER, ON_AXIS, LONG, SHORT, BULGE, MIRRORS, NEXT, FIGURE = 0, 1, 2, 3, 4, 5, 11, 13

_BULGE = 0.02  # [rad] own choice: half the angle of a bulging face
_SLOW = 0.3  # [rad/s] own choice: see ``acting``
_TINY = 1e-30  # of the square of a projection: nothing is divided by 0 where the normal lies along the figure's axis
_ROOT_HALF = math.sqrt(0.5)


@dataclass(frozen=True)
class Shape:
    """The figure about each axis of a particle.

    Attributes:
        corners: Number of corners of a regular polygon around the sphere, even; 0: an ellipse.
        aspect: Long over short axis of an ellipse of the sphere's cross section.

    Raises:
        ModelError: It is neither, or both.
    """

    corners: int = 0
    aspect: float = 1.0

    def __post_init__(self):
        if self.corners and self.aspect != 1.0:
            raise ModelError(f"shape.corners = {self.corners} and shape.aspect = {self.aspect:g}: give one of both")
        if self.corners and not (4 <= self.corners <= MOST_CORNERS and self.corners % 2 == 0):
            raise ModelError(f"shape.corners = {self.corners}: give an even number from 4 to {MOST_CORNERS}, or 0 for an ellipse")
        if not self.corners and not 1.0 < self.aspect <= LARGEST_ASPECT:
            raise ModelError(f"shape.aspect = {self.aspect:g}: give more than 1 and at most {LARGEST_ASPECT:g}; shape = None is a sphere")

    def figure(self) -> np.ndarray:
        """The figure's numbers, [FIGURE]."""
        figure = np.zeros(FIGURE)
        figure[LONG], figure[SHORT], figure[BULGE] = self.aspect, 1.0 / self.aspect, 1.0
        if self.corners:
            half = math.pi / self.corners
            far = 1.0 / math.cos(half)
            figure[CORNER], figure[NEXT], figure[NEXT + 1] = far, far * math.cos(2.0 * half), far * math.sin(2.0 * half)
            figure[BULGE] = 2.0 * math.tan(half) * math.sin(_BULGE)
            # Mirrors lie half a face apart; each halves what the one before leaves of a right angle.
            wedges = self.corners // 2
            for k in range(MIRRORS, NEXT, 2):
                wedges = (wedges + 1) // 2
                figure[k], figure[k + 1] = math.cos(wedges * half), math.sin(wedges * half)
        figure[ON_AXIS] = support(figure, 1.0, 0.0)[0]
        return figure


def orientations(ident: np.ndarray, seed: int = 0) -> np.ndarray:
    """Random orientations of particles, uniform, of each by its number alone: quaternions from their frame to the world, [n, 4]."""
    u = np.empty((3, len(ident)))
    for k in range(3):
        # SplitMix64 (Steele et al. 2014), its state being the number of the draw.
        z = np.asarray(ident).astype(np.uint64) * np.uint64(3) + np.uint64(k + 1) + (np.uint64(seed) << np.uint64(40))
        z = z * np.uint64(0x9E3779B97F4A7C15)
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        u[k] = ((z ^ (z >> np.uint64(31))) >> np.uint64(11)) * 2.0**-53
    a, b = np.sqrt(1.0 - u[0]), np.sqrt(u[0])  # Shoemake 1992
    s, t = 2.0 * math.pi * u[1], 2.0 * math.pi * u[2]
    return np.stack([b * np.cos(t), a * np.sin(s), a * np.cos(s), b * np.sin(t)], axis=1)


@kernel(inline=True)
def support(figure, x, y):
    """Support function h of a figure in the unit direction x, y, and its derivative by the angle, both over the radius.

    h is how far the figure reaches; its derivative is the lever arm of the support point, counter-clockwise from the direction.
    """
    u, v = _ROOT_HALF * (x + y), _ROOT_HALF * (y - x)
    # An ellipse.
    root = math.sqrt(figure[LONG] * u * u + figure[SHORT] * v * v + _TINY)
    lever = (figure[SHORT] - figure[LONG]) * u * v / root
    # A polygon: mirrored until u, v lies between the corner on u and the middle of the next face.
    sign = 1.0 if u > 0.0 else -1.0
    sign = sign if v > 0.0 else -sign
    u, v = abs(u), abs(v)
    u, v, sign = _mirror(figure[MIRRORS], figure[MIRRORS + 1], u, v, sign)
    u, v, sign = _mirror(figure[MIRRORS + 2], figure[MIRRORS + 3], u, v, sign)
    u, v, sign = _mirror(figure[MIRRORS + 4], figure[MIRRORS + 5], u, v, sign)
    a, b_u, b_v = figure[CORNER], figure[NEXT], figure[NEXT + 1]
    rest = 1.0 - (a * u - b_u * u - b_v * v) / figure[BULGE]
    rest = rest if rest > 0.0 else 0.0
    ahead = a * u + 0.25 * figure[BULGE] * rest * rest
    arm = sign * (0.5 * rest * (u * b_v - v * b_u) - (1.0 - 0.5 * rest) * v * a)
    return (ahead, arm) if a > 0.0 else (root, lever)


@kernel(inline=True)
def _mirror(cosine, sine, u, v, sign):
    """Mirror u, v where it lies beyond the line at this angle; each time the sign changes."""
    beyond = cosine * v - sine * u
    sign = -sign if beyond > 0.0 else sign
    beyond = beyond if beyond > 0.0 else 0.0
    return u + 2.0 * beyond * sine, v - 2.0 * beyond * cosine, sign


@kernel
def energy(figure, x, y, z):
    """H, the energy over F R*, where the unit vector x, y, z of the particle's frame points to the contact."""
    return figure[ON_AXIS] + _part(figure, x, y)[0] + _part(figure, y, z)[0] + _part(figure, z, x)[0]


@kernel(inline=True)
def shape_torque(figure, q, n):
    """Torque on a particle over F R*, in the world.

    Args:
        figure: The figure's numbers (FIGURE).
        q: Quaternion from the particle's frame to the world (4).
        n: Unit normal towards the particle, in the world (3).
    """
    w, i, j, k = q
    n_x, n_y, n_z = n
    xx, xy, xz = 1.0 - 2.0 * (j * j + k * k), 2.0 * (i * j - w * k), 2.0 * (i * k + w * j)
    yx, yy, yz = 2.0 * (i * j + w * k), 1.0 - 2.0 * (i * i + k * k), 2.0 * (j * k - w * i)
    zx, zy, zz = 2.0 * (i * k - w * j), 2.0 * (j * k + w * i), 1.0 - 2.0 * (i * i + j * j)
    # To the contact, in the particle's frame.
    x = -(xx * n_x + yx * n_y + zx * n_z)
    y = -(xy * n_x + yy * n_y + zy * n_z)
    z = -(xz * n_x + yz * n_y + zz * n_z)
    _, a_x, a_y = _part(figure, x, y)
    _, b_y, b_z = _part(figure, y, z)
    _, c_z, c_x = _part(figure, z, x)
    g_x, g_y, g_z = a_x + c_x, a_y + b_y, b_z + c_z
    t_x, t_y, t_z = y * g_z - z * g_y, z * g_x - x * g_z, x * g_y - y * g_x  # -dH / d(rotation) = c x grad H
    return xx * t_x + xy * t_y + xz * t_z, yx * t_x + yy * t_y + yz * t_z, zx * t_x + zy * t_y + zz * t_z


@kernel(inline=True)
def acting(torque, w, returned):
    """What of a figure's torque acts: all of it while the grain climbs, a share while it falls, as only that of the energy comes back.

    Own choice, of an impact's share. Up to a rotation of ``_SLOW`` along the torque the loss grows evenly, so that torques at rest do not
    jump as the sign of the rotation changes.

    Args:
        torque: The figure's (3).
        w: Angular velocity of its particle against the other body [rad/s] (3).
        returned: Share of the energy that comes back.
    """
    x, y, z = torque
    driving = (x * w[0] + y * w[1] + z * w[2]) / (_SLOW * math.sqrt(x * x + y * y + z * z + _TINY))
    driving = min(max(driving, 0.0), 1.0)
    share = 1.0 - (1.0 - returned) * driving
    return share * x, share * y, share * z


@kernel(inline=True)
def _part(figure, x, y):
    """What the figure across one axis adds to H, and its derivatives by x and y."""
    square = x * x + y * y
    scale = 1.0 / math.sqrt(square + _TINY)
    h, lever = support(figure, x * scale, y * scale)
    h = h - figure[ON_AXIS]
    return square * h, 2.0 * h * x - lever * y, 2.0 * h * y + lever * x


@kernel
def turn(q, w_x, w_y, w_z, dt):
    """Turn a quaternion [4] by the angular velocity w [rad/s] of the world during dt [s]."""
    speed = math.sqrt(w_x * w_x + w_y * w_y + w_z * w_z)
    half = 0.5 * speed * dt
    c, s = math.cos(half), (math.sin(half) / speed if speed > 0.0 else 0.0)
    x, y, z = s * w_x, s * w_y, s * w_z
    a, i, j, k = q[0], q[1], q[2], q[3]
    w = c * a - x * i - y * j - z * k
    i, j, k = c * i + x * a + y * k - z * j, c * j + y * a + z * i - x * k, c * k + z * a + x * j - y * i
    scale = 1.0 / math.sqrt(w * w + i * i + j * j + k * k)
    q[0], q[1], q[2], q[3] = w * scale, i * scale, j * scale, k * scale
