"""SSP 1.0 packages of FMI 2.0 co-simulation FMUs: read, check, write."""

from .archive import UNPACKED, SspError, unpack
from .read import read_system
from .system import Component, Connection, System
from .write import write_system

__all__ = ["UNPACKED", "Component", "Connection", "SspError", "System", "read_system", "unpack", "write_system"]
