"""SCM: soil that deforms, in cells."""

from .model import SCM

__all__ = ["SCM"]
