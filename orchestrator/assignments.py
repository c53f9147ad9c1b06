"""Options of the command line that assign: ``KEY=VALUE``."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable

import typer


def assignment(text: str, option: str, example: str) -> tuple[str, str]:
    """Both sides of an option's ``KEY=VALUE``."""
    key, equals, value = text.partition("=")
    if not (key and equals):
        raise typer.BadParameter(f"{text!r}: write KEY=VALUE, e.g. {example}", param_hint=option)
    return key.strip(), value


def values_of(settings: Iterable[str] | None) -> dict[str, object]:
    """Values as TOML has them; bare words are text, so that options need no quotes."""
    values: dict[str, object] = {}
    for setting in settings or ():
        key, text = assignment(setting, "--set", "soil.phi=0.6")
        try:
            value = tomllib.loads(f"value = {text}")["value"]
        except tomllib.TOMLDecodeError:
            value = text
        values[key] = value
    return values
