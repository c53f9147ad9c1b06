"""A wheel against a closed mesh: its smooth rim and the plates of its grousers, or a closed mesh of its own."""

from __future__ import annotations

from ..frames import resolve2
from ..slave.kernel import kernel
from .contacts import CONTACT, GAP, ID, KINDS, NORMAL, POINT, VERTEX_OF_A, WEIGHT, A
from .edges import taper
from .pairs import mesh_contacts
from .rim import rim_contacts


@kernel
def wheel_contacts(i, radius, width, own, thickness, pose_wheel, meshes, j, pose_j, margin, scratch, contacts, n):
    """Contact candidates between wheel i, body A, and the closed surface of body j, body B.

    Args:
        i: Index written as A.
        radius, width: Of the rim [m]; radius 0 = the wheel is the mesh ``own``.
        own: Index in ``meshes`` of the wheel's grouser plates (``wheel_mesh.grouser_plates``), or of its closed mesh; -1 = smooth rim.
        thickness: Of the plates [m]: what overlaps with one by more has the way out on another side of it, but for the plate's own corners.
            own choice: it counts in full up to half of that.
        pose_wheel, pose_j: Records with r_0 [m] and T, world to body.
        meshes, margin, scratch, contacts, n: As in ``pairs.mesh_contacts``.

    Returns:
        Rows that are taken now; one more than there are if some candidates did not fit.
    """
    if radius > 0.0:
        n = rim_contacts(i, radius, width, pose_wheel, meshes, j, pose_j, margin, scratch, contacts, n)
    if own < 0:
        return n
    first = n
    n = mesh_contacts(meshes, own, pose_wheel, j, pose_j, margin, scratch, contacts, n)
    last, overflow = min(n, contacts.shape[0]), n > contacts.shape[0]
    n = first
    for row in range(first, last):
        if radius > 0.0:
            if _within_rim(radius, pose_wheel, contacts, row):
                continue
            if int(contacts[row, ID]) % KINDS != VERTEX_OF_A:
                contacts[row, WEIGHT] *= taper(-2.0 * contacts[row, GAP] / thickness - 1.0)
                if contacts[row, WEIGHT] <= 0.0:
                    continue
        for k in range(CONTACT):
            contacts[n, k] = contacts[row, k]
        contacts[n, A] = i
        n += 1
    return contacts.shape[0] + 1 if overflow else n


@kernel(inline=True)
def _within_rim(radius, pose, contacts, row):
    """Whether the point on the plate lies within the cylinder: the rim is there, too."""
    half, r = 0.5 * contacts[row, GAP], pose.r_0
    x, _, z = resolve2(
        pose.T,
        contacts[row, POINT] + half * contacts[row, NORMAL] - r[0],
        contacts[row, POINT + 1] + half * contacts[row, NORMAL + 1] - r[1],
        contacts[row, POINT + 2] + half * contacts[row, NORMAL + 2] - r[2],
    )
    return x * x + z * z < radius * radius
