"""Unpacking of SSP packages and FMUs, which may come from anywhere, into a cache addressed by their content."""

from __future__ import annotations

import errno
import hashlib
import os
import shutil
import stat
import zlib
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from zipfile import ZIP_DEFLATED, ZIP_STORED, BadZipFile, ZipFile, ZipInfo

import platformdirs

#: Where this machine's runs unpack to, in the user's cache.
UNPACKED = platformdirs.user_cache_path("cdl-fmu", appauthor=False) / "unpacked"

MAX_ENTRIES = 20_000
MAX_BYTES = 4 * 2**30
# Own choice: text rarely packs better than 1:60, a bomb reaches 1:1000; small archives may do as they like.
MAX_RATIO = 200
RATIO_FREE_BYTES = 16 * 2**20


class SspError(Exception):
    """A package that cannot be used; the message names the file, the element and the remedy."""


def unpack(archive: Path | str, cache_dir: Path | str) -> Path:
    """Folder with the content of a ZIP archive (SSP or FMU), in ``cache_dir`` under the archive's SHA-256.

    An archive seen before is not unpacked again. Raises SspError for a missing file, for no ZIP archive, and for one that is too large or
    whose entries are encrypted, links, doubled, or point outside.
    """
    archive, cache_dir = Path(archive), Path(cache_dir)
    if not archive.is_file():
        raise SspError(f"{archive}: no such file; give the path of an existing package")
    with archive.open("rb") as stream:
        target = cache_dir / hashlib.file_digest(stream, "sha256").hexdigest()
        if target.is_dir():
            return target
        try:
            with ZipFile(stream) as package:
                files = _checked_files(archive, package.infolist())
                cache_dir.mkdir(parents=True, exist_ok=True)
                with TemporaryDirectory(dir=cache_dir, prefix=".unpack-") as staging:
                    _extract(package, files, Path(staging) / target.name)
                    _publish(Path(staging) / target.name, target)
        except (BadZipFile, zlib.error, EOFError, NotImplementedError, ValueError, OSError) as error:
            if isinstance(error, OSError) and error.errno != errno.EINVAL:  # EINVAL: a damaged offset; others are the disk's
                raise
            raise SspError(f"{archive}: no readable ZIP archive ({error or 'truncated'}); export or download it again") from error
    return target


def _checked_files(archive: Path, entries: list[ZipInfo]) -> dict[PurePosixPath, ZipInfo]:
    """Path inside the target folder of every file entry, all of them harmless."""
    total = sum(entry.file_size for entry in entries)
    if len(entries) > MAX_ENTRIES:
        raise SspError(
            f"{archive}: {len(entries)} entries, more than {MAX_ENTRIES}; a package needs far fewer, get it from a source you trust"
        )
    if total > MAX_BYTES:
        raise SspError(f"{archive}: unpacks to {total} bytes, more than {MAX_BYTES}; get it from a source you trust")
    packed = archive.stat().st_size
    if total > max(RATIO_FREE_BYTES, MAX_RATIO * packed):
        raise SspError(
            f"{archive}: {packed} bytes unpack to {total}, more than {MAX_RATIO} times as many (a ZIP bomb); get it from a source you trust"
        )
    files: dict[PurePosixPath, ZipInfo] = {}
    seen: set[str] = set()
    for entry in entries:
        name = entry.orig_filename  # `filename` is cut at a NUL
        path = PurePosixPath(name)
        if path.is_absolute() or ".." in path.parts or any(c in name for c in "\\:\0"):
            raise SspError(f"{archive}: entry {name!r} points outside the package; entries are relative paths with '/' and without '..'")
        if stat.S_IFMT(entry.external_attr >> 16) not in (0, stat.S_IFREG, stat.S_IFDIR):
            raise SspError(f"{archive}: entry {name!r} is a link or a special file; pack files only")
        if entry.flag_bits & 1:
            raise SspError(f"{archive}: entry {name!r} is encrypted; pack it without a password")
        if entry.compress_type not in (ZIP_STORED, ZIP_DEFLATED):
            raise SspError(f"{archive}: entry {name!r} has compression method {entry.compress_type}; pack it with deflate")
        if str(path).casefold() in seen:
            raise SspError(f"{archive}: entry {name!r} occurs twice, which file is meant is unclear; pack it once")
        seen.add(str(path).casefold())
        if not entry.is_dir():
            files[path] = entry
    for path in files:
        if inside := next((parent for parent in path.parents if parent in files), None):
            raise SspError(f"{archive}: entry {str(inside)!r} occurs twice, as a file and as the folder of {str(path)!r}; pack it once")
    return files


def _extract(package: ZipFile, files: dict[PurePosixPath, ZipInfo], folder: Path) -> None:
    folder.mkdir()
    for path, entry in files.items():
        destination = folder / path
        destination.parent.mkdir(parents=True, exist_ok=True)
        # A ZipFile entry never yields more than its declared size, so the limits above hold for what is written.
        with package.open(entry) as source, destination.open("xb") as sink:
            shutil.copyfileobj(source, sink)


def _publish(staging: Path, target: Path) -> None:
    """One atomic step: another run sees the folder whole or not at all."""
    try:
        os.rename(staging, target)
    except OSError:
        if not target.is_dir():  # else another run was faster, with the same content
            raise
