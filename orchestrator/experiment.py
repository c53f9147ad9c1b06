"""Experiments: TOML files that people write, checked against the models' records."""

from __future__ import annotations

import difflib
import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cdl_fmu.slave.interface import ENVIRONMENT
from cdl_fmu.slave.model import Instance, ModelError, describe_violation, parse_value
from cdl_fmu.slave.records import Choice, Real, Record, Scalar
from cdl_fmu.soil import SOIL, SoilError, load_soil, usable_widths
from cdl_fmu.wheel import WHEEL
from fmus import EXPERIMENTS, TIERS, contacts
from mbs.driver import Driver
from mbs.rover import Rover

from .assemble import WHEELS, assemble
from .schemes import SCHEMES

#: The [run] section.
RUN = Record(
    stop_time=Real(10.0, "s", "End of the run", min=0.0),
    step=Real(1e-3, "s", "Communication step", min=1e-6, max=1.0),
    record_interval=Real(1e-3, "s", "Time between two rows of the result; the nearest multiple of the step is taken", min=1e-6),
    scheme=Choice("Coupling scheme", **{name: (kind.__doc__ or "").split("\n")[0] for name, kind in SCHEMES.items()}),
)


class ExperimentError(ValueError):
    """An experiment cannot be run as written; the message names file, line, key, value, unit and remedy."""


@dataclass(frozen=True)
class Settings:
    """The [run] section: times in s, the scheme by name."""

    stop_time: float
    step: float
    record_interval: float
    scheme: str


def load_experiment(source: str | Path, *, tiers: Sequence[str] | None = None, overrides: Mapping[str, object] | None = None) -> Experiment:
    """Read an experiment: the name of a shipped one or the path of a TOML file.

    Args:
        source: Name or path.
        tiers: Tier of each wheel, front first, in place of the file's.
        overrides: ``{"soil.phi": 0.6}``; values in place of the file's.

    Raises:
        ExperimentError: the file or a value is wrong.
    """
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
    options = {}  # key -> the command line's option that gave it
    if tiers is not None:
        if len(tiers) != len(WHEELS):
            raise ExperimentError(f"--tiers {','.join(tiers)}: give {len(WHEELS)} tiers, {','.join(WHEELS).upper()}")
        tables["tiers"] = dict(zip(WHEELS, tiers))
        options |= {f"tiers.{wheel}": f"--tiers {','.join(tiers)}" for wheel in WHEELS}
    for key, value in (overrides or {}).items():
        *sections, last = key.split(".")
        table = tables
        for section in sections:
            table = table.setdefault(section, {})
            if not isinstance(table, dict):
                raise ExperimentError(f"--set {key}: {section} is a value, not a section")
        table[last] = value
        options[key] = f"--set {key}"
    return Experiment(path, text, tables, options)


class Experiment:
    """An experiment whose every value has been checked against the records of its models.

    Attributes:
        name, title, text: File name without ending, title, and the file as written.
        settings: The [run] section.
        tiers: Wheel -> tier.
    """

    def __init__(self, path: Path, text: str, tables: Mapping, options: Mapping[str, str]):
        self.name, self.text = path.stem, text
        self._file, self._folder, self._options = path.name, path.parent, options
        for key, value in tables.items():
            if key != "title" and not isinstance(value, Mapping):
                raise ExperimentError(f"{self._place('', key)}: {key} = {value!r} is in no section; give a value in one, such as soil.phi")
        self.title = tables.get("title", self.name)
        self.tiers = self._tiers(tables)
        #: part -> its model
        self._models = {"rover": Rover(), "driver": Driver(), **{t.lower(): m for t, m in contacts(self.tiers.values()).items()}}
        # Sections of all tiers, so that one file serves runs on any of them.
        models = {tier.lower(): kind() for tier, kind in TIERS.items()} | self._models
        shared = ENVIRONMENT | SOIL | WHEEL
        self._records = {
            "run": RUN,
            "environment": ENVIRONMENT,
            "soil": SOIL,
            "wheel": WHEEL,
            **{part: _without(model.parameters, shared) for part, model in models.items()},
        }
        self._refuse_unknown(tables, "", {"title", "tiers", *self._records})
        tables = dict(tables, soil=self._soil(dict(tables.get("soil", {}))))
        #: section -> FMI name -> value as it is stored
        self._values = {
            section: self._section(section, record, models[section].files if section in models else {}, tables.get(section, {}))
            for section, record in self._records.items()
        }
        run = {s.name: self._values["run"].get(s.name, s.start) for s in RUN.scalars()}
        scheme = list(SCHEMES)[int(run.pop("scheme")) - 1]
        self.settings = Settings(scheme=scheme, **run)

    def instances(self) -> dict[str, Instance]:
        """A new instance of each part by name, with the experiment's parameters; the rover is where the user or the record puts it.

        Raises ExperimentError if the parameters of a part, each within its bounds, do not fit together.
        """
        shared = {**self._values["environment"], **self._values["soil"], **self._values["wheel"]}
        made = {}
        for name, model in self._models.items():
            made[name] = Instance(model, name)
            own = {s.name for s in model.scalars["p"]}
            made[name].set_starts({k: v for k, v in shared.items() if k in own} | self._values[name])
            try:
                model.check(made[name].p)
            except ModelError as error:
                key = str(error).split(" = ")[0]
                sections = (name, "soil", "wheel", "environment")
                section = next((s for s in sections if key in (x.name for x in self._records[s].scalars())), name)
                raise ExperimentError(f"{self._place(section, key.split('[')[0])}: {section}.{error}") from error
        return made

    @property
    def warnings(self) -> list[str]:
        """What the user should know of values that are all allowed."""
        if self._usable_widths is None:
            return []
        low, high = self._usable_widths
        width = self._values["wheel"].get("b_w", WHEEL.fields["b_w"].start)
        if low <= width <= high:
            return []
        return [
            f"{self._place('wheel', 'b_w')}: wheel.b_w = {width:g} m: the soil's plate tests are good for wheels {low:.3g} to {high:.3g} m "
            "wide (widths in its file); test plates whose radius is nearer to the wheel's width"
        ]

    @property
    def start_is_given(self) -> bool:
        """True if the user gives the rover's start height or pitch, so that it is not settled on its contacts."""
        return not {"start.z", "start.pitch"}.isdisjoint(self._values["rover"])

    def write_system(self, path: Path) -> None:
        """Write the experiment as an SSP package.

        Raises ExperimentError if its values, each within its bounds, do not fit together.
        """
        try:
            assemble(self).write(path)
        except ModelError as error:
            raise ExperimentError(f"{self._file}: {error}") from error

    # -- checks

    def _tiers(self, tables: Mapping) -> dict[str, str]:
        given = tables.get("tiers", {})
        self._refuse_unknown(given, "tiers", set(WHEELS))
        for wheel in WHEELS:
            if wheel not in given:
                raise ExperimentError(f"{self._place('tiers', '')}: wheel {wheel} has no tier; use one of {', '.join(TIERS)}")
            if given[wheel] not in list(TIERS):
                where = self._place("tiers", wheel)
                raise ExperimentError(f"{where}: tier {given[wheel]!r} of wheel {wheel} is unknown; use one of {', '.join(TIERS)}")
        return {wheel: given[wheel] for wheel in WHEELS}

    def _soil(self, table: dict) -> dict:
        chosen = str(table.pop("set", "mss_d"))
        if chosen.endswith(".toml") and "soil.set" not in self._options:
            chosen = self._folder / chosen  # as the file means it, wherever the command is given
        self._refuse_unknown(table, "soil", SOIL.fields)  # before what it may have been meant for is missed
        try:
            known = load_soil(chosen, given=table.keys())
            # Who changes the law of sinkage answers for its range.
            self._usable_widths = usable_widths(chosen) if table.keys().isdisjoint(("k_c", "k_phi", "n")) else None
            return {**known, **table}
        except SoilError as error:
            raise ExperimentError(f"{self._place('soil', 'set')}: {error}") from None

    def _section(self, section: str, record: Record, files: Mapping[str, str], table: Mapping) -> dict[str, float | str]:
        values: dict[str, float | str] = {}
        scalars = record.scalars()
        for key, value in _flat(table):
            if key in files:
                values[key] = self._path(section, key, value, files[key])
                continue
            array = [s for s in scalars if s.name == key or s.name.startswith(f"{key}[")]
            if not array:
                self._refuse_unknown({key: value}, section, {*(s.name.split("[")[0] for s in scalars), *files})
            each = list(value) if isinstance(value, (list, tuple, np.ndarray)) else [value] * len(array)
            if len(each) != len(array):
                number = f"{len(array)} values" if len(array) > 1 else "one value"
                raise ExperimentError(f"{self._place(section, key)}: {section}.{key} needs {number}, not {len(each)}")
            try:
                for scalar, one in zip(array, each):
                    values[scalar.name] = self._checked(scalar, one)
            except ModelError as error:
                raise ExperimentError(f"{self._place(section, key)}: {section}.{error}") from None
        return values

    def _path(self, section: str, key: str, value, description: str) -> str:
        """Path of a file that a model reads, "" for none: relative to the experiment's file, in an option to the working directory."""
        if not isinstance(value, str):
            raise ExperimentError(f"{self._place(section, key)}: {section}.{key} = {value!r}: the path of a file is needed ({description})")
        if not value:
            return ""
        folder = Path() if f"{section}.{key}" in self._options else self._folder
        path = (folder / value).absolute()
        if not path.is_file():
            where = self._place(section, key)
            raise ExperimentError(f"{where}: {section}.{key} = '{value}': no such file; correct the path {path} ({description})")
        return str(path)

    @staticmethod
    def _checked(scalar: Scalar, value) -> float:
        number = parse_value(scalar, value)
        if not scalar.field.min <= number <= scalar.field.max or not np.isfinite(number):
            raise ModelError(describe_violation(scalar, number))
        return number

    def _refuse_unknown(self, table: Mapping, section: str, known: Iterable[str]) -> None:
        for key in table:
            if key not in known:
                near = difflib.get_close_matches(key, known, 1)
                remedy = f"did you mean {near[0]}?" if near else f"use one of {', '.join(sorted(known))}"
                full = f"{section}.{key}" if section else key
                raise ExperimentError(f"{self._place(section, key)}: {full} is unknown; {remedy}")

    def _place(self, section: str, key: str) -> str:
        """The command line's option that set a key, or its file and line; of a whole section without a key."""
        path = ".".join(filter(None, (section, key)))
        for given, option in self._options.items():
            if _within(given, path) or _within(path, given):
                return option
        current = ""
        for number, line in enumerate(self.text.splitlines(), 1):
            if header := re.match(r"\s*\[([^\]]+)\]", line):
                current = header[1]
                found = _within(current, path)
            elif assigned := re.match(r"\s*([\w.\"]+)\s*=", line):
                given = f"{current}.{assigned[1]}".lstrip(".")
                found = _within(given, path) or _within(path, given)  # the latter in an inline table
            else:
                continue
            if found:
                return f"{self._file}, line {number}"
        return self._file


def _within(path: str, outer: str) -> bool:
    return f"{path}.".startswith(f"{outer}.")


def _flat(table: Mapping, prefix: str = ""):
    for key, value in table.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value


def _without(record: Record, other: Record) -> Record:
    return Record(**{name: field for name, field in record.fields.items() if name not in other.fields})
