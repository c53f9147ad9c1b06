"""Where a sphere touches the parametric wheel: a cylinder and its grousers, each of them convex and met once."""

from __future__ import annotations

import math

from ..slave.kernel import kernel
from .touch import DISTANCE, MOST, NORMAL


@kernel
def wheel_touches(x, y, z, reach, r_w, b_w, n_g, h_g, t_g, out):
    """Rows of a sphere on the wheel of ``cdl_fmu.wheel.WHEEL``, in the wheel's frame: its cylinder, and the plate on either side.

    Each part has one row, for its nearest point; or none where another part covers that point, as a plate covers the rim at its root, and
    the cylinder covers the plate's flat end, which lies in one plane with its own. A centre within the radius of the rim meets the
    cylinder alone, by the nearest of its faces.

    Parts keep their rows while a sphere moves, so that its history of contact can be kept by the row: 0 is the cylinder, 1 and 2 are plates
    of even and odd number, 3 is the last one of an odd number of plates. A row that is not met has the distance inf.

    Args:
        x, y, z: Centre of the sphere [m]; y is the axle.
        reach: Distance [m] below which a part is met, > 0: the sphere's radius and a margin.
        r_w, b_w, n_g, h_g, t_g: As in ``wheel_mesh``; plates may be without thickness.
        out: Rows that are written, [MOST, TOUCH].

    Returns:
        Number of rows to look at; 0 if no part is met.
    """
    axial, square = abs(y) - 0.5 * b_w, x * x + z * z
    tip = r_w + h_g if n_g >= 1.0 else r_w
    if axial >= reach or square >= (tip + reach) * (tip + reach):
        return 0
    rho = math.sqrt(square)
    e_x, e_z = (x / rho, z / rho) if rho > 0.0 else (0.0, -1.0)  # on the axle every direction is as good
    for row in range(MOST):
        out[row, DISTANCE] = math.inf
    n, covered = 0, False
    if tip > r_w and rho > r_w:
        n, covered = _plates(y, rho, e_x, e_z, axial, reach, r_w, n_g, tip, 0.5 * t_g, out)
    distance, of_rho, of_y, _ = _box(rho - r_w, axial, -math.inf)
    if covered or distance >= reach:
        return n
    _write(out, 0, distance, of_rho * e_x, math.copysign(of_y, y), of_rho * e_z)
    return max(n, 1)


@kernel
def _plates(y, rho, e_x, e_z, axial, reach, r_w, n_g, tip, half, out):
    """Rows of the plates on either side of a centre beyond the rim, in the direction (e_x, e_z); and whether one covers the rim there."""
    pitch = 2.0 * math.pi / n_g
    place = math.atan2(e_x, -e_z) / pitch  # plate 0 points along -z, the others follow towards +x
    before = math.floor(place)
    n, covered = 0, False
    for side in range(2 if n_g > 1.0 else 1):
        turn = (place - before - side) * pitch
        beside = abs(turn)
        # The sine's series, cut to lie below it: most plates are too far, and need no more than this.
        if rho * (beside - beside**3 / 6.0) - half >= reach:
            continue
        sin, cos = math.sin(turn), math.cos(turn)
        if cos <= 0.0:
            continue
        along, high = abs(rho * sin), rho * cos
        if r_w * along < half * rho:
            covered = True
        foot_along, foot_high = min(along, half), min(high, tip)
        if foot_along * foot_along + foot_high * foot_high <= r_w * r_w:
            continue  # within the rim
        distance, of_along, of_high, of_y = _box(along - half, high - tip, axial)
        if distance >= reach:
            continue
        of_along = math.copysign(of_along, sin)
        row = _row(before + side, n_g)
        # From the plate's axes, which are turned back from the direction of the centre.
        radial, tangential = of_along * sin + of_high * cos, of_along * cos - of_high * sin
        _write(out, row, distance, radial * e_x - tangential * e_z, math.copysign(of_y, y), radial * e_z + tangential * e_x)
        n = max(n, row + 1)
    return n, covered


@kernel(inline=True)
def _row(number, n_g):
    """Row of a plate: neighbours have different ones, all around the wheel."""
    number -= n_g * math.floor(number / n_g)
    if number == n_g - 1.0 and n_g % 2.0 == 1.0:
        return 3
    return 2 if number % 2.0 == 1.0 else 1


@kernel(inline=True)
def _box(a, b, c):
    """Distance and its slopes in a, b, c: from an edge or corner where two or three of these are above 0, else the largest."""
    u, v, w = max(a, 0.0), max(b, 0.0), max(c, 0.0)
    outside = math.sqrt(u * u + v * v + w * w)
    if outside > 0.0:
        return outside, u / outside, v / outside, w / outside
    if a >= b and a >= c:
        return a, 1.0, 0.0, 0.0
    return (b, 0.0, 1.0, 0.0) if b >= c else (c, 0.0, 0.0, 1.0)


@kernel(inline=True)
def _write(out, row, distance, n_x, n_y, n_z):
    out[row, DISTANCE] = distance
    out[row, NORMAL], out[row, NORMAL + 1], out[row, NORMAL + 2] = n_x, n_y, n_z
