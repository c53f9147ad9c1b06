"""Contact plane of a wheel on uneven ground, as in Fig. 8.4 of the chapter.

Rays along the search direction (downwards) run through the wheel's body and end on its rim. Where one meets the soil within the
body, it gives a contact point, the soil's normal there and the wheel's normal; a plane is fitted to them by least squares.
"""

from __future__ import annotations

import math

from ..frames import cross, dot
from ..mesh.ray import highest
from ..slave.kernel import kernel
from .patch import add_sinkage, surface

RAYS_ALONG, RAYS_ACROSS = 9, 7  # a ray for each cell of the wheel's plan view, in its middle
_FULL_WEIGHT = 0.010  # [m] penetration from which a ray counts fully, so that a new one does not jerk the plane
_NORMALS = 0.1  # weight of a normal against that of a point one radius off the plane


@kernel
def ray(patch, wheel, radius, width, i, j, sinkage=None, ground=None):
    """One ray: along index i in 0..8, across index j in 0..6; the other arguments are those of ``contact_plane``.

    Returns:
        weight (0 = no hit), hit point [m] relative to the wheel's centre (3), the soil's normal (3), rim point relative to the centre (3).
    """
    T, r = wheel.T, wheel.r_0
    a_x, a_y, a_z = T[1, 0], T[1, 1], T[1, 2]
    level = math.sqrt(a_x * a_x + a_y * a_y)
    h_x, h_y = a_y / level, -a_x / level  # heading, horizontal
    up_x, up_y, up_z = cross(h_x, h_y, 0.0, a_x, a_y, a_z)
    sin = (2.0 * i + 1.0) / RAYS_ALONG - 1.0
    cos = math.sqrt(1.0 - sin * sin)
    xi = 0.5 * width * ((2.0 * j + 1.0) / RAYS_ACROSS - 1.0)
    out_x, out_y, out_z = sin * h_x - cos * up_x, sin * h_y - cos * up_y, -cos * up_z
    x, y, z = radius * out_x + xi * a_x, radius * out_y + xi * a_y, radius * out_z + xi * a_z
    hit, height, n_x, n_y, n_z = False, 0.0, 0.0, 0.0, 1.0
    # numba leaves out what is None.
    if patch is not None:
        hit, height, slope_x, slope_y = surface(patch, r[0] + x, r[1] + y)
        if sinkage is not None and hit:
            height, slope_x, slope_y = add_sinkage(patch, sinkage, r[0] + x, r[1] + y, height, slope_x, slope_y)
        scale = 1.0 / math.sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
        n_x, n_y, n_z = -slope_x * scale, -slope_y * scale, scale
    if ground is not None:
        met, height_g, g_x, g_y, g_z = highest(ground, r[0] + x, r[1] + y, r[2] + radius)
        if met and not (hit and height_g <= height):
            hit, height, n_x, n_y, n_z = True, height_g, g_x, g_y, g_z
    z_hit = height - r[2]
    weight = 0.0
    if hit and z_hit > z:
        facing = -dot(out_x, out_y, out_z, n_x, n_y, n_z)  # the wheel's normal points into the wheel
        weight = max(0.0, facing) * min((z_hit - z) / _FULL_WEIGHT, 1.0)
    return weight, x, y, z_hit, n_x, n_y, n_z, z


@kernel
def contact_plane(patch, wheel, radius, width, sinkage=None, ground=None):
    """Plane fitted to all rays that hit.

    Minimises over the unit normal n: sum w [n (x - mean x)]^2 / radius^2 - _NORMALS sum w (n n_i)^2, so n is the eigenvector of the
    smallest eigenvalue of a symmetric matrix.

    Args:
        patch: Heights on which rays end; None = there are only meshes.
        wheel: Record with r_0 [m] and T, world to body.
        radius, width: Of the wheel [m].
        sinkage: That of the patch's nodes [m]: then rays end on the level from which it counts, not on the surface.
        ground: ``mesh.ray.MeshGround`` on which rays end, too, from the height of the wheel's top; of all surfaces the highest counts.

    Returns:
        found (False if no ray hits), n (3), a point of the plane [m] relative to the wheel's centre (3).
    """
    total = m_x = m_y = m_z = 0.0
    c_xx = c_xy = c_xz = c_yy = c_yz = c_zz = 0.0
    n_xx = n_xy = n_xz = n_yy = n_yz = n_zz = 0.0
    for i in range(RAYS_ALONG):
        for j in range(RAYS_ACROSS):
            w, x, y, z, n_x, n_y, n_z, _ = ray(patch, wheel, radius, width, i, j, sinkage, ground)
            if w <= 0.0:
                continue
            total += w
            m_x, m_y, m_z = m_x + w * x, m_y + w * y, m_z + w * z
            c_xx, c_xy, c_xz = c_xx + w * x * x, c_xy + w * x * y, c_xz + w * x * z
            c_yy, c_yz, c_zz = c_yy + w * y * y, c_yz + w * y * z, c_zz + w * z * z
            n_xx, n_xy, n_xz = n_xx + w * n_x * n_x, n_xy + w * n_x * n_y, n_xz + w * n_x * n_z
            n_yy, n_yz, n_zz = n_yy + w * n_y * n_y, n_yz + w * n_y * n_z, n_zz + w * n_z * n_z
    if total <= 0.0:
        return False, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0
    m_x, m_y, m_z = m_x / total, m_y / total, m_z / total
    per = 1.0 / (total * radius * radius)
    share = _NORMALS / total
    n_x, n_y, n_z = smallest_eigenvector(
        (c_xx - total * m_x * m_x) * per - share * n_xx,
        (c_xy - total * m_x * m_y) * per - share * n_xy,
        (c_xz - total * m_x * m_z) * per - share * n_xz,
        (c_yy - total * m_y * m_y) * per - share * n_yy,
        (c_yz - total * m_y * m_z) * per - share * n_yz,
        (c_zz - total * m_z * m_z) * per - share * n_zz,
    )
    if n_z < 0.0:
        n_x, n_y, n_z = -n_x, -n_y, -n_z
    return True, n_x, n_y, n_z, m_x, m_y, m_z


@kernel
def smallest_eigenvector(xx, xy, xz, yy, yz, zz):
    """Unit eigenvector of the smallest eigenvalue of a symmetric 3 x 3 matrix, by cyclic Jacobi rotations."""
    ux, uy, uz = 1.0, 0.0, 0.0  # columns u, v, w of the eigenvectors
    vx, vy, vz = 0.0, 1.0, 0.0
    wx, wy, wz = 0.0, 0.0, 1.0
    for _ in range(10):
        if xy * xy + xz * xz + yz * yz <= 1e-34 * (xx * xx + yy * yy + zz * zz):
            break
        c, s, t = _jacobi(xx, yy, xy)
        xx, yy, xy = xx - t * xy, yy + t * xy, 0.0
        xz, yz = c * xz - s * yz, s * xz + c * yz
        ux, vx, uy, vy, uz, vz = c * ux - s * vx, s * ux + c * vx, c * uy - s * vy, s * uy + c * vy, c * uz - s * vz, s * uz + c * vz
        c, s, t = _jacobi(xx, zz, xz)
        xx, zz, xz = xx - t * xz, zz + t * xz, 0.0
        xy, yz = c * xy - s * yz, s * xy + c * yz
        ux, wx, uy, wy, uz, wz = c * ux - s * wx, s * ux + c * wx, c * uy - s * wy, s * uy + c * wy, c * uz - s * wz, s * uz + c * wz
        c, s, t = _jacobi(yy, zz, yz)
        yy, zz, yz = yy - t * yz, zz + t * yz, 0.0
        xy, xz = c * xy - s * xz, s * xy + c * xz
        vx, wx, vy, wy, vz, wz = c * vx - s * wx, s * vx + c * wx, c * vy - s * wy, s * vy + c * wy, c * vz - s * wz, s * vz + c * wz
    if xx <= yy and xx <= zz:
        return ux, uy, uz
    return (vx, vy, vz) if yy <= zz else (wx, wy, wz)


@kernel
def _jacobi(pp, qq, pq):
    """Cosine, sine and tangent of the rotation that removes the element pq (Golub & Van Loan, symmetric Schur)."""
    if pq == 0.0:
        return 1.0, 0.0, 0.0
    tau = 0.5 * (qq - pp) / pq
    t = math.copysign(1.0, tau) / (abs(tau) + math.sqrt(1.0 + tau * tau))
    c = 1.0 / math.sqrt(1.0 + t * t)
    return c, t * c, t
