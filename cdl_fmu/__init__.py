"""Open Contact Dynamics Library: wheel-ground contact for planetary rovers."""

from .bcm import BCM
from .slave.model import Instance
from .soil import load_soil

__all__ = ["BCM", "Instance", "load_soil"]
