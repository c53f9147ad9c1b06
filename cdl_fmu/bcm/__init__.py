"""BCM, the Bekker based contact model: one plane, one wheel, stresses integrated over the rim (section 8.3.10 of the chapter)."""

from .model import BCM

__all__ = ["BCM"]
