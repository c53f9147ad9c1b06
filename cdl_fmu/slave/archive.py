"""The archive that an FMU is, and the files of the user that go into it."""

from __future__ import annotations

import hashlib
import os
import tempfile
import zipfile
from collections.abc import Mapping
from pathlib import Path

from .model import Model, ModelError


def checked_files(model: Model, files: Mapping[str, Path]) -> dict[str, Path]:
    """The files for a model's file parameters, all of which can be packed.

    Raises:
        ModelError: No such file parameter, a file that is missing, or two files of one name.
    """
    by_name: dict[str, tuple[str, Path]] = {}
    for name, path in files.items():
        if name not in model.files:
            raise ModelError(f"{model.identifier} has no file parameter {name!r}; it has {', '.join(model.files) or 'none'}")
        if not path.is_file():
            raise ModelError(f"{name} = '{path}': no such file; correct the path ({model.files[name]})")
        # Some systems take names for the same that differ in capitals.
        other, other_path = by_name.setdefault(path.name.casefold(), (name, path))
        if not path.samefile(other_path):
            raise ModelError(f"{name} = '{path}' and {other} = '{other_path}' have one name, and lie in one folder of the FMU: rename one")
    return dict(files)


def digest(path: Path) -> str:
    """Hash [hex] of a file's content."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def write_archive(path: Path, members: Mapping[str, bytes]) -> None:
    """Write files by their names into an archive, which appears at once or not at all.

    Sorted and without time stamps: the same files give the same bytes, whatever the system.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    # Beside the target: the finished FMU takes its name in one step, and another process sees it whole or not at all.
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=".build-") as folder:
        finished = Path(folder, "finished")
        with zipfile.ZipFile(finished, "w", zipfile.ZIP_DEFLATED) as archive:
            for name in sorted(members):
                info = zipfile.ZipInfo(name, date_time=(1980, 1, 1, 0, 0, 0))
                info.create_system = 3  # Unix, on Windows too
                info.external_attr = 0o644 << 16
                info.compress_type = zipfile.ZIP_DEFLATED
                archive.writestr(info, members[name])
        os.replace(finished, path)
