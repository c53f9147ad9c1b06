"""Beds that were settled before, kept in the user's cache."""

from __future__ import annotations

import warnings
from pathlib import Path

from ..slave.kernel import cache_folder
from ..slave.model import ModelError
from .bed import Bed, BedKey
from .bed_files import key_hash, read_bed, write_bed
from .settle import Progress, settle


class Library:
    """A folder of beds, each under the hash of what it was made from; several processes may use it at once.

    Args:
        folder: Where beds are kept, made if it is missing; None: the user's cache.
    """

    def __init__(self, folder: str | Path | None = None):
        self.folder = cache_folder("beds") if folder is None else Path(folder)
        self.folder.mkdir(parents=True, exist_ok=True)

    def path(self, key: BedKey) -> Path:
        """Where the arrays of this bed are or would be."""
        return self.folder / f"{key_hash(key)}.npz"

    def get(self, key: BedKey, progress: Progress = lambda stage, share: None) -> Bed:
        """The bed of this key: the one kept, or else settled now and kept. A damaged one is settled anew, with a warning.

        Arguments and errors as of ``settle``.
        """
        path = self.path(key)
        if path.exists():
            try:
                bed = read_bed(path)
                if key_hash(bed.key) == path.stem:
                    return bed
                reason = "it was made from something else"
            except ModelError as error:
                reason = str(error)
            warnings.warn(f"{path}: {reason}; the bed is settled anew", stacklevel=2)
        bed = settle(key, progress)
        write_bed(bed, path)
        return bed
