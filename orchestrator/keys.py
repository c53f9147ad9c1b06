"""Dotted keys of experiments: ``soil.phi``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping


def joined(section: str, key: str) -> str:
    """A key with the section that it is in, if it is in one."""
    return ".".join(filter(None, (section, key)))


def within(path: str, outer: str) -> bool:
    """Whether a key is another one, or in the section of that name."""
    return f"{path}.".startswith(f"{outer}.")


def flat(table: Mapping, prefix: str = "") -> Iterator[tuple[str, object]]:
    """Keys of a table, those of its tables with them, and their values."""
    for key, value in table.items():
        if isinstance(value, Mapping):
            yield from flat(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value
