"""RBC: rigid body contact, impulses and a linear complementarity problem, for wheels on rock."""

from .model import RBC

__all__ = ["RBC"]
