"""The tables of an experiment's file, with the values of the command line's options in place."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path

from fmus import EXPERIMENTS

from .rigs import rig_of


class ExperimentError(ValueError):
    """An experiment cannot be run as written; the message names file, line, key, value, unit and remedy."""


def read_tables(source: str | Path, tiers: Sequence[str] | None, soil: str | Path | None, overrides: Mapping[str, object]) -> tuple:
    """File, its text, its tables with the options' values in place, key -> the command line's option that gave it, kind of experiment."""
    path = EXPERIMENTS.get(str(source), Path(source))
    if not path.is_file():
        raise ExperimentError(f"no experiment {str(source)!r}: use one of {', '.join(EXPERIMENTS)} or the path of a .toml file")
    try:
        text = path.read_text(encoding="utf-8-sig")  # Windows' editors write a byte order mark
        tables = tomllib.loads(text)
    except UnicodeDecodeError as error:
        raise ExperimentError(f"{path.name} is no text in UTF-8 ({error}): give an experiment's .toml file") from None
    except tomllib.TOMLDecodeError as error:
        raise ExperimentError(f"{path.name}: {error}") from None
    rig = rig_of(tables)
    options = {}  # key -> the command line's option that gave it

    def put(key: str, value: object, option: str) -> None:
        *sections, last = key.split(".")
        table = tables
        for section in sections:
            table = _table_of(table, section, option)
        table[last] = value
        options[key] = option

    if tiers is not None:
        option = f"--tiers {','.join(tiers)}"
        if len(tiers) != len(rig.tiers):
            number = "1 tier" if len(rig.tiers) == 1 else f"{len(rig.tiers)} tiers"
            raise ExperimentError(f"{option}: give {number}, {','.join(rig.tiers).upper()}")
        for key, tier in zip(rig.tiers.values(), tiers):
            put(key, tier, option)
    if soil is not None:
        tables["soil"] = {}
        put("soil.set", str(soil), f"--soil {soil}")
    for key, value in overrides.items():
        put(key, value, f"--set {key}")
    return path, text, tables, options, rig


def _table_of(table: dict, section: str, option: str) -> dict:
    """The section of a table, made if there is none; ``rock[2]`` is the second [[rock]]."""
    if counted := re.fullmatch(r"(\w+)\[(\d+)\]", section):
        each = table.get(counted[1], [])
        if not isinstance(each, list) or not 0 < int(counted[2]) <= len(each):
            raise ExperimentError(f"{option}: there is no [[{counted[1]}]] of number {counted[2]} in the experiment")
        return each[int(counted[2]) - 1]
    found = table.setdefault(section, {})
    if not isinstance(found, dict):
        raise ExperimentError(f"{option}: {section} is a value, not a section")
    return found
