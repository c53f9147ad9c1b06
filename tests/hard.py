"""Meshes of floors and rocks, and a rover coupled with a hard contact model on them in process."""

import trimesh

from orchestrator.validate.coupled import Coupled, instances

__all__ = ["Coupled", "export", "floor", "instances"]


def floor(path, length=8.0, width=2.0, thickness=0.2):
    """A slab whose upper face is z = 0."""
    box = trimesh.creation.box((length, width, thickness))
    box.apply_translation((0.0, 0.0, -0.5 * thickness))
    box.export(path)
    return path


def export(path, mesh):
    """Write a mesh and give its path."""
    mesh.export(path)
    return path
