"""VEM: the visco-elastic model, springs and dampers with Coulomb friction, for wheels on rock."""

from .model import VEM

__all__ = ["VEM"]
