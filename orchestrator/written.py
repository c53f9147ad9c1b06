"""What people wrote of an experiment, in its file and on the command line: values, and messages that name the place."""

from __future__ import annotations

import difflib
import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cdl_fmu.slave.model import ModelError, describe_violation, parse_value
from cdl_fmu.slave.records import Record, Scalar

from .keys import flat, joined, within
from .tables import ExperimentError


@dataclass(frozen=True)
class Written:
    """The text of an experiment and the options beside it.

    Attributes:
        name, folder: Name of the file, and where it lies: paths in it count from there.
        text: The file.
        options: Key -> the option of the command line that set it.
    """

    name: str
    folder: Path
    text: str
    options: Mapping[str, str]

    def section(self, section: str, record: Record, files: Mapping[str, str], table: Mapping) -> dict[str, float | str]:
        """Values of a section by FMI name, as they are stored, each checked against the record; files as absolute paths."""
        values: dict[str, float | str] = {}
        scalars = record.scalars()
        for key, value in flat(table):
            if key in files:
                values[key] = self._path(section, key, value, files[key])
                continue
            array = [s for s in scalars if s.name == key or s.name.startswith(f"{key}[")]
            if not array:
                self.refuse_unknown({key: value}, section, {*(s.name.split("[")[0] for s in scalars), *files})
            each = list(value) if isinstance(value, (list, tuple, np.ndarray)) else [value] * len(array)
            if len(each) != len(array):
                number = f"{len(array)} values" if len(array) > 1 else "one value"
                raise ExperimentError(f"{self.place(section, key)}: {joined(section, key)} needs {number}, not {len(each)}")
            try:
                for scalar, one in zip(array, each):
                    values[scalar.name] = self._checked(scalar, one)
            except ModelError as error:
                raise ExperimentError(f"{self.place(section, key)}: {joined(section, str(error))}") from None
        return values

    def _path(self, section: str, key: str, value, description: str) -> str:
        """Path of a file that a model reads, "" for none: relative to the experiment's file, in an option to the working directory."""
        if not isinstance(value, str):
            raise ExperimentError(f"{self.place(section, key)}: {section}.{key} = {value!r}: the path of a file is needed ({description})")
        if not value:
            return ""
        folder = Path() if f"{section}.{key}" in self.options else self.folder
        path = (folder / value).absolute()
        if not path.is_file():
            where = self.place(section, key)
            raise ExperimentError(f"{where}: {section}.{key} = '{value}': no such file; correct the path {path} ({description})")
        return str(path)

    @staticmethod
    def _checked(scalar: Scalar, value) -> float:
        number = parse_value(scalar, value)
        if not scalar.field.min <= number <= scalar.field.max or not np.isfinite(number):
            raise ModelError(describe_violation(scalar, number))
        return number

    def refuse_unknown(self, table: Mapping, section: str, known: Iterable[str]) -> None:
        """Raise ExperimentError for a key of a section that is not known."""
        for key in table:
            if key not in known:
                near = difflib.get_close_matches(key, known, 1)
                remedy = f"did you mean {near[0]}?" if near else f"use one of {', '.join(sorted(known))}"
                raise ExperimentError(f"{self.place(section, key)}: {joined(section, key)} is unknown; {remedy}")

    def place(self, section: str, key: str) -> str:
        """The command line's option that set a key, or its file and line; of a whole section without a key."""
        path = joined(section, key)
        for given, option in self.options.items():
            if within(given, path) or within(path, given):
                return option
        current = ""
        seen = Counter()
        for number, line in enumerate(self.text.splitlines(), 1):
            if header := re.match(r"\s*\[+([^\[\]]+)\]", line):
                current = header[1]
                if line.lstrip().startswith("[["):
                    seen[current] += 1
                    current = f"{current}[{seen[current]}]"
                found = within(current, path)
            elif assigned := re.match(r"\s*([\w.\"]+)\s*=", line):
                given = f"{current}.{assigned[1]}".lstrip(".")
                found = within(given, path) or within(path, given)  # the latter in an inline table
            else:
                continue
            if found:
                return f"{self.name}, line {number}"
        return self.name
