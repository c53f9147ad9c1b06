"""Contact plane of a wheel on uneven ground that follows the fitted one smoothly."""

from __future__ import annotations

import math

from ..frames import dot
from ..slave.kernel import kernel
from ..slave.records import Real, Record
from ..wheel import tip_radius
from .plane import contact_plane

#: Contact plane after the low-pass: points with normal . r_0 = offset.
PLANE = Record(
    known=Real(0.0, "1", "1 while rays of the wheel hit the patch"),
    normal=Real(0.0, "1", "Normal of the contact plane, resolved in world", (3,)),
    offset=Real(0.0, "m", "Distance of the plane from the world's origin along its normal"),
)
TAU_N = Real(0.02, "s", "Time constant of the low-pass on the contact plane; used on a patch", min=0.0, max=10.0)


@kernel
def follow_plane(p, wheel, patch, sinkage, ground, further, h, plane):
    """Fit the contact plane and low-pass it over h [s]; returns its normal and the height of the wheel's centre above it [m].

    Ground is what ``contact_plane`` takes: ``patch`` and ``sinkage``, or ``ground``. Rays reach ``further`` [m] than the rim: stiff
    contacts are flatter than the distance of rays, and want to know of ground before they touch it.
    """
    r, radius = wheel.r_0, tip_radius(p) + further
    found, n_x, n_y, n_z, m_x, m_y, m_z = contact_plane(patch, wheel, radius, p.b_w, sinkage, ground)
    if not found:
        plane.known = 0.0
        return 0.0, 0.0, 1.0, 2.0 * radius + p.b_w  # in the air
    offset = dot(n_x, n_y, n_z, r[0] + m_x, r[1] + m_y, r[2] + m_z)
    # Normal and offset in world axes: driving along one plane, however steep, has no lag.
    keep = math.exp(-h / p.tau_n) if plane.known > 0.0 and p.tau_n > 0.0 else 0.0
    normal = plane.normal
    n_x, n_y, n_z = n_x + keep * (normal[0] - n_x), n_y + keep * (normal[1] - n_y), n_z + keep * (normal[2] - n_z)
    offset += keep * (plane.offset - offset)
    plane.known = 1.0
    length = math.sqrt(dot(n_x, n_y, n_z, n_x, n_y, n_z))
    normal[0], normal[1], normal[2] = n_x / length, n_y / length, n_z / length
    plane.offset = offset / length
    return normal[0], normal[1], normal[2], dot(normal[0], normal[1], normal[2], r[0], r[1], r[2]) - plane.offset
