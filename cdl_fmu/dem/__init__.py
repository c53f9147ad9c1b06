"""Discrete element model: soil as particles."""

from .model import DEM

__all__ = ["DEM"]
