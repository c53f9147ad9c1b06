"""Bodies with meshes, poses, and contact candidates by their definition."""

import numpy as np
import trimesh

from cdl_fmu.mesh.contacts import CONTACT, scratch_for
from cdl_fmu.mesh.pairs import mesh_contacts
from cdl_fmu.mesh.surface import join, surface_of
from cdl_fmu.mesh.wheel import wheel_contacts

POSE = np.dtype([("r_0", np.float64, 3), ("T", np.float64, (3, 3))], align=True)


def pose(r_0=(0.0, 0.0, 0.0), T=None):
    record = np.zeros(1, POSE)
    record["r_0"], record["T"] = r_0, np.eye(3) if T is None else T
    return record[0]


def random_rotation(random):
    q, r = np.linalg.qr(random.normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    return q * np.sign(np.linalg.det(q))


class Scene:
    """Bodies of these meshes, and the memory for their contacts."""

    def __init__(self, *meshes, most=1000):
        self.surfaces = [surface_of(mesh) for mesh in meshes]
        self.meshes = join(self.surfaces)
        self.scratch = scratch_for(self.meshes)
        self.rows = np.zeros((most, CONTACT))

    def pair(self, a, pose_a, b, pose_b, margin):
        n = mesh_contacts(self.meshes, a, pose_a, b, pose_b, margin, self.scratch, self.rows, 0)
        assert not self.scratch.marks.any()
        return self.rows[:n].copy()

    def wheel(self, radius, width, own, pose_wheel, j, pose_j, margin):
        n = wheel_contacts(7, radius, width, own, 0.002, pose_wheel, self.meshes, j, pose_j, margin, self.scratch, self.rows, 0)
        return self.rows[:n].copy()


def grid(height, n=21, size=1.0):
    """Open ground z = height(x, y)."""
    x, y = np.meshgrid(np.linspace(-size, size, n), np.linspace(-size, size, n), indexing="ij")
    at = np.arange(n * n).reshape(n, n)
    a, b, c, d = at[:-1, :-1].ravel(), at[1:, :-1].ravel(), at[1:, 1:].ravel(), at[:-1, 1:].ravel()
    vertices = np.stack([x, y, height(x, y) * np.ones_like(x)], axis=-1).reshape(-1, 3)
    return trimesh.Trimesh(vertices, np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]), process=False)


def placed(mesh, pose_):
    """Vertices in world axes."""
    return pose_["r_0"] + mesh.vertices @ pose_["T"]


def distance(mesh_a, pose_a, mesh_b, pose_b):
    """Least distance [m] of two meshes that do not overlap, from all their vertices, faces and edges."""
    a, b = placed(mesh_a, pose_a), placed(mesh_b, pose_b)
    return min(_to_faces(a, b[mesh_b.faces]), _to_faces(b, a[mesh_a.faces]), _of_edges(a[mesh_a.edges_unique], b[mesh_b.edges_unique]))


def _to_faces(points, triangles):
    p = np.repeat(points, len(triangles), axis=0)
    nearest = trimesh.triangles.closest_point(np.tile(triangles, (len(points), 1, 1)), p)
    return np.linalg.norm(p - nearest, axis=1).min()


def _of_edges(p, q):
    """Least distance of lines that are nearest to each other within both segments; others are nearest at a vertex."""
    d, e = p[:, None, 1] - p[:, None, 0], q[None, :, 1] - q[None, :, 0]
    r = p[:, None, 0] - q[None, :, 0]
    dd, ee, de, dr, er = (d * d).sum(-1), (e * e).sum(-1), (d * e).sum(-1), (d * r).sum(-1), (e * r).sum(-1)
    with np.errstate(all="ignore"):
        s, t = (de * er - dr * ee) / (dd * ee - de * de), (dd * er - de * dr) / (dd * ee - de * de)
    gaps = np.linalg.norm(r + s[..., None] * d - t[..., None] * e, axis=-1)
    return np.where((s > 0) & (s < 1) & (t > 0) & (t < 1), gaps, np.inf).min()
