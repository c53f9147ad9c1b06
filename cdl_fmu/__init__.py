"""Open Contact Dynamics Library: wheel-ground contact for planetary rovers."""

from .bcm import BCM
from .scm import SCM
from .slave.model import Instance
from .soil import load_soil

__all__ = ["BCM", "SCM", "Instance", "load_soil"]
