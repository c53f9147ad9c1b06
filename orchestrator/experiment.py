"""Experiments: TOML files that people write, checked against the models' records."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from cdl_fmu.slave.interface import ENVIRONMENT
from cdl_fmu.slave.model import Instance, ModelError
from cdl_fmu.soil import SOIL, SoilError, load_soil, plates_gravity, usable_widths
from cdl_fmu.unloading import UNLOADING
from cdl_fmu.wheel import WHEEL
from fmus import ROCK_TIERS, SOIL_OWNERS, TIERS, contacts

from . import soil_range
from .assemble import assemble
from .keys import flat
from .rigs import ROVER, TESTBED, Rig
from .rocks import MESH, ROCK, ROCKS, Rock, hard_keys, make_rock
from .schemes import SCHEMES
from .sections import RUN, files_in, models_of, sections_of, takes_one
from .tables import ExperimentError, read_tables
from .terminal import stages
from .written import Written


@dataclass(frozen=True)
class Settings:
    """The [run] section: times in s, the scheme by name; no stop time where nothing ends the run."""

    stop_time: float | None
    step: float
    record_interval: float
    scheme: str


def load_experiment(
    source: str | Path,
    *,
    tiers: Sequence[str] | None = None,
    soil: str | Path | None = None,
    overrides: Mapping[str, object] | None = None,
) -> Experiment:
    """Read an experiment: the name of a shipped one or the path of a TOML file.

    Args:
        source: Name or path.
        tiers: Tier of each wheel, front first, in place of the file's.
        soil: Name of a soil set or path of its TOML file, in place of the file's [soil] section.
        overrides: ``{"soil.phi": 0.6}``; values in place of the file's and of the soil's.

    Raises:
        ExperimentError: the file or a value is wrong.
    """
    return Experiment(*read_tables(source, tiers, soil, overrides or {}))


def swept_keys(
    source: str | Path,
    *,
    tiers: Sequence[str] | None = None,
    soil: str | Path | None = None,
    overrides: Mapping[str, object] | None = None,
) -> dict[str, list]:
    """Keys of a testbed's experiment that have one value and are given a list: those of ``overrides`` first, as given, then the file's.

    Arguments are those of :func:`load_experiment`. No other experiment is swept.

    Raises:
        ExperimentError: the file is wrong, or a list is empty or has a value twice.
    """
    *_, tables, options, rig = read_tables(source, tiers, soil, overrides or {})
    if rig is not TESTBED:
        return {}
    lists = {key: value for key, value in flat(tables) if isinstance(value, list) and takes_one(key, rig)}
    for key, values in lists.items():
        if not values or any(value in values[:i] for i, value in enumerate(values)):
            what = "a value is given twice" if values else "there is no value"
            raise ExperimentError(f"{options.get(key, Path(source).name)}: {key} = {values!r}: {what}; a sweep needs each value once")
    return {key: lists[key] for key in [*(key for key in overrides or {} if key in lists), *lists]}


def wheels_in(source: str | Path) -> list[str]:
    """Names of an experiment's wheels. Raises ExperimentError if its file is wrong."""
    *_, rig = read_tables(source, None, None, {})
    return list(rig.tiers)


def meant_for(tiers: Iterable[str], others: Iterable[str], overrides: Mapping[str, object] | None) -> dict[str, object]:
    """``overrides`` of a run with wheels on ``tiers``, without those that are for other tiers, on which only other runs of a series are."""
    elsewhere = {str(tier).lower() for tier in others} - {str(tier).lower() for tier in tiers}
    return {key: value for key, value in (overrides or {}).items() if key.partition(".")[0] not in elsewhere}


class Experiment:
    """An experiment whose every value has been checked against the records of its models.

    Attributes:
        name, title, text: File name without ending, title, and the file as written.
        settings: The [run] section.
        rig: What moves its wheels.
        tiers: Wheel -> tier.
        rocks, rock_tier: Rocks, and the tier on which they meet wheels and each other.
    """

    def __init__(self, path: Path, text: str, tables: Mapping, options: Mapping[str, str], rig: Rig):
        self.name, self.text = path.stem, text
        self._written = Written(path.name, path.parent, text, options)
        self.rig = rig
        outside = {"title", *rig.tiers.values(), *rig.keys.fields, "rock"}  # of all sections
        for key, value in tables.items():
            if key not in outside and not isinstance(value, Mapping):
                raise ExperimentError(
                    f"{self._written.place('', key)}: {key} = {value!r} is in no section; give a value in one, such as soil.phi"
                )
        self.title = tables.get("title", self.name)
        self.tiers = self._tiers(tables)
        if len(owners := [tier for tier in SOIL_OWNERS if tier in self.tiers.values()]) > 1:
            raise ExperimentError(
                f"{self._written.place('tiers', '')}: wheels on {' and on '.join(owners)}: each tier owns the soil under all wheels; put "
                "the others on BCM or VEM, which share it"
            )
        self.rocks, self.rock_tier = self._rocks(tables)
        n = len(self.rocks)
        #: part -> its model
        self._models = {part: kind() for part, kind in rig.parts.items()}
        tables, self._compaction = self._structure(tables)
        on_mesh = self._on_mesh(tables)
        self._models |= {tier.lower(): model for tier, model in contacts(self.tiers.values(), self._compaction, n, on_mesh).items()}
        if n:
            self._models[rig.mover] = rig.parts[rig.mover](len(rig.tiers), n, 1)
            self._models[ROCKS] = ROCK_TIERS[self.rock_tier](len(rig.tiers), n)
        models = models_of(rig) | self._models
        self._records = sections_of(rig, models)
        tables = {key: value for key, value in tables.items() if key not in ("rock", "rocks")}
        self._written.refuse_unknown(tables, "", {*outside, *(path.split(".")[0] for path in rig.tiers.values()), *self._records})
        tables = dict(tables, soil=self._soil(dict(tables.get("soil", {}))))
        #: section -> FMI name -> value as it is stored
        self._values = {
            section: self._written.section(section, record, files_in(section, models), tables.get(section, {}))
            for section, record in self._records.items()
        }
        keys = self._written.section("", rig.keys, {}, {key: tables[key] for key in rig.keys.fields if key in tables})
        r_w = self._values["wheel"].get("r_w", WHEEL.fields["r_w"].start)
        try:
            self._values[rig.mover] |= rig.mover_values(keys, r_w)
        except ModelError as error:
            raise ExperimentError(f"{self._written.place('', str(error).split(' = ')[0])}: {error}") from None
        mover = Instance(self._models[rig.mover])
        mover.set_starts(self._values[rig.mover])
        run = {s.name: s.start for s in RUN.scalars()} | rig.run_values(keys, mover, r_w) | self._values["run"]
        scheme = list(SCHEMES)[int(run.pop("scheme")) - 1]
        self.settings = Settings(scheme=scheme, **run)
        self._warned_before: list[str] = []  # by what makes what is kept

    def instances(self) -> dict[str, Instance]:
        """A new instance of each part by name, with the experiment's parameters; the rover is where the user or the record puts it.

        Raises ExperimentError if the parameters of a part, each within its bounds, do not fit together.
        """
        shared = {**self._values["environment"], **self._values["soil"], **self._values["wheel"]}
        made = {}
        for name, model in self._models.items():
            made[name] = Instance(model, name)
            own = {s.name for s in model.scalars["p"]}
            made[name].set_starts({k: v for k, v in (shared | self._values.get(name, {})).items() if k in own or k in model.files})
            if name == ROCKS:
                tier = {k: v for k, v in self._values[self.rock_tier.lower()].items() if k in own or k in model.files}
                made[name].set_starts(tier)
                for j, rock in enumerate(self.rocks, 1):
                    made[name].set_starts(rock.hard_values(j, model.parameters.fields["body"].record))
            for j, rock in enumerate(self.rocks, 1):
                if f"body[{j}].mesh" in model.files:
                    made[name].set_starts({f"body[{j}].mesh": str(rock.path)})
            try:
                made[name].check()
            except ModelError as error:
                key = str(error).split(" = ")[0]
                sections = (self.rock_tier.lower() if name == ROCKS else name, "soil", "wheel", "environment")
                section = next((s for s in sections if key in (x.name for x in self._records[s].scalars())), sections[0])
                raise ExperimentError(f"{self._written.place(section, key.split('[')[0])}: {section}.{error}") from error
        return made

    @property
    def warnings(self) -> list[str]:
        """What the user should know of values that are all allowed, and of what was made by ``prepare``."""
        of_values = self._idle_options(), self._laws_apart(), self._width_outside(), self._gravity_outside()
        return [*(text for texts in of_values for text in texts), *self._warned_before]

    @property
    def start_is_given(self) -> bool:
        """True if the user places the wheels, so that they are not put on the ground."""
        return not self.rig.start.isdisjoint(self._values[self.rig.mover])

    def prepare(self, status: Callable[[str], None]) -> None:
        """Make what takes minutes and is kept on this machine, such as a bed of particles; ``status`` is called with how it comes along.

        Raises ExperimentError as ``write_system``.
        """
        told = stages(status, "settling the bed of particles, once for these parameters")
        for name, instance in self.instances().items():
            try:
                instance.warnings.clear()  # what its FMU will say
                instance.prepare(told)
                self._warned_before += instance.warnings
            except ModelError as error:
                raise ExperimentError(f"{self._written.name}: {name}.{error}") from error

    def write_system(self, path: Path, native: bool = False) -> None:
        """Write the experiment as an SSP package, with ``native`` of native FMUs, where there are such.

        Raises ExperimentError if its values, each within its bounds, do not fit together.
        """
        try:
            self._warned_before += assemble(self).write(path, native)
        except ModelError as error:
            raise ExperimentError(f"{self._written.name}: {error}") from error

    # -- checks

    def _idle_options(self) -> list[str]:
        """Options that set a value of a tier without wheel; the file's own sections may wait for one."""
        used = {*self.tiers.values(), *([self.rock_tier] if self.rocks else [])}
        idle = {tier.lower(): tier for tier in (*TIERS, *ROCK_TIERS) if tier not in used}
        on = ", ".join(dict.fromkeys([*self.tiers.values(), *([self.rock_tier] if self.rocks else [])]))
        found = []
        if self._compaction and "bcm" in self._models and not self._models["bcm"].sizes["n_compacted"]:
            place = self._written.place("bcm", "compaction")
            found.append(f"{place}: bcm.compaction has no effect: no wheel on SCM presses the soil that wheels on BCM stand on")
        return (
            found
            + [
                f"{option}: it has no effect: no wheel is on {idle[section]}, only on {on}"
                for key, option in self._written.options.items()
                if (section := key.partition(".")[0]) in idle
            ]
            + self._idle_of_rocks()
        )

    def _idle_of_rocks(self) -> list[str]:
        """Options that set what the rocks' tier does not ask for."""
        if not self.rocks:
            return []
        model, tier = self._models[ROCKS], self.rock_tier
        asked, hard = model.parameters.fields["body"].record.fields, set(hard_keys())
        found = []
        for key, option in self._written.options.items():
            section, _, name = key.partition(".")
            if section.startswith("rock[") and name in hard and name not in asked:
                found.append(f"{option}: it has no effect: rocks are on {tier}, which does not ask for it")
            elif section == tier.lower() and tier not in self.tiers.values() and name not in {**model.parameters.fields, **model.files}:
                remedy = f"; give rock[1].{name} and so on" if name in asked else ""
                found.append(f"{option}: it has no effect: no wheel stands on {tier}'s own ground{remedy}")
        return found

    def _laws_apart(self) -> list[str]:
        if not self._compaction or not {"bcm", "scm"} <= set(self._models):
            return []
        scm, bcm = self._values["scm"], self._values["bcm"]
        unloading = {name: (f.unit, scm.get(name, f.start), bcm.get(name, f.start)) for name, f in UNLOADING.fields.items()}
        return [f"{self._written.name}: {text}" for text in soil_range.laws_apart(unloading, scm_scales=self._scm_scales())]

    def _rocks(self, tables: Mapping) -> tuple[list[Rock], str]:
        """The rocks, and the tier on which they meet wheels."""
        given, section = tables.get("rock", []), tables.get("rocks", {})
        if not isinstance(given, list):
            raise ExperimentError(f"{self._written.place('rock', '')}: write each rock as a section [[rock]], with two brackets")
        self._written.refuse_unknown(section, "rocks", ["tier"])
        tier = section.get("tier", next(iter(ROCK_TIERS)))
        if tier not in ROCK_TIERS:
            where = self._written.place("rocks", "tier")
            raise ExperimentError(f"{where}: rocks.tier = {tier!r} is unknown; use one of {', '.join(ROCK_TIERS)}")
        if given and "DEM" in self.tiers.values():
            raise ExperimentError(
                f"{self._written.place('rock[1]', '')}: rocks lie in SCM's soil, not in particles: put the wheels on SCM, BCM or VEM"
            )
        if given and self.rig is not ROVER:
            raise ExperimentError(
                f"{self._written.place('rock[1]', '')}: rocks need a rover; a testbed's carriage has a single wheel on soil"
            )
        rocks = []
        for j, table in enumerate(given, 1):
            name = f"rock[{j}]"
            values = self._written.section(name, ROCK, MESH, {key: _choice(value) for key, value in table.items()})
            mesh = str(values.pop("mesh", ""))
            try:
                rocks.append(make_rock(values, mesh))
            except ModelError as error:
                raise ExperimentError(f"{self._written.place(name, str(error).split(' = ')[0])}: {name}.{error}") from None
            is_fixed = rocks[-1].values["fixed"] == ROCK.fields["fixed"].value("on")
            if "SCM" not in self.tiers.values() and not is_fixed:
                raise ExperimentError(
                    f"{self._written.place(name, 'fixed')}: {name}.fixed = false: no wheel is on SCM, "
                    "so there is no soil to bear the rock; set fixed = true, or put a wheel on SCM"
                )
        return rocks, tier

    def _structure(self, tables: Mapping) -> tuple[dict, bool]:
        """Tables without what decides which models are taken, ``bcm.compaction``, and that."""
        wanted = (section := tables.get("bcm", {})).get("compaction", False)
        if not isinstance(wanted, bool):
            where = self._written.place("bcm", "compaction")
            raise ExperimentError(f"{where}: bcm.compaction = {wanted!r}: use true (wheels feel what pressed the soil before) or false")
        return dict(tables, bcm={key: value for key, value in section.items() if key != "compaction"}), wanted

    def _on_mesh(self, tables: Mapping) -> set[str]:
        """Tiers whose ground is a mesh."""
        found = {tier for tier in self.tiers.values() if tables.get(tier.lower(), {}).get("ground")}
        if found and (owner := next((tier for tier in SOIL_OWNERS if tier in self.tiers.values()), None)):
            section = min(found).lower()
            where = self._written.place(section, "ground")
            instead = "give scm.base, or " if owner == "SCM" else "put "
            raise ExperimentError(
                f"{where}: {section}.ground: all wheels stand on the soil of the one on {owner}; {instead}no wheel on {owner}"
            )
        return found

    def _width_outside(self) -> list[str]:
        width = self._values["wheel"].get("b_w", WHEEL.fields["b_w"].start)
        return [f"{self._written.place('wheel', 'b_w')}: {text}" for text in soil_range.width_outside(width, self._usable_widths)]

    def _gravity_outside(self) -> list[str]:
        gravity = self._values["environment"].get("gravity", ENVIRONMENT.fields["gravity"].start)
        on_bcm = "bcm" in self._models
        found = soil_range.gravity_outside(gravity, self._plates_gravity, on_bcm=on_bcm, scm_scales=self._scm_scales())
        return [f"{self._written.place('environment', 'gravity')}: {text}" for text in found]

    def _scm_scales(self) -> bool:
        """Whether SCM's pressure grows with gravity, by Reece's law."""
        return self._values["scm"].get("pressure_model") == TIERS["SCM"].parameters.fields["pressure_model"].value("reece")

    def _tiers(self, tables: Mapping) -> dict[str, str]:
        section = next(iter(self.rig.tiers.values())).rpartition(".")[0]
        keys = {wheel: path.rpartition(".")[2] for wheel, path in self.rig.tiers.items()}
        given = tables.get(section, {}) if section else tables
        if section:
            self._written.refuse_unknown(given, section, set(keys.values()))
        for wheel, key in keys.items():
            named = f"wheel {wheel}" if len(keys) > 1 else "the wheel"
            if key not in given:
                raise ExperimentError(f"{self._written.place(section, '')}: {named} has no tier; use one of {', '.join(TIERS)}")
            if given[key] not in list(TIERS):
                where = self._written.place(section, key)
                hint = ' ("RBC" is for rocks: rocks.tier)' if given[key] in list(ROCK_TIERS) else ""
                raise ExperimentError(f"{where}: tier {given[key]!r} of {named} is unknown; use one of {', '.join(TIERS)}{hint}")
        return {wheel: given[key] for wheel, key in keys.items()}

    def _soil(self, table: dict) -> dict:
        chosen = str(table.pop("set", "mss_d"))
        if chosen.endswith(".toml") and "soil.set" not in self._written.options:
            chosen = self._written.folder / chosen  # as the file means it, wherever the command is given
        self._written.refuse_unknown(table, "soil", SOIL.fields)  # before what it may have been meant for is missed
        try:
            known = load_soil(chosen, given=table.keys())
            # Who changes the law of sinkage answers for its range.
            as_tested = table.keys().isdisjoint(("k_c", "k_phi", "n"))
            self._usable_widths = usable_widths(chosen) if as_tested else None
            self._plates_gravity = plates_gravity(chosen) if as_tested else None
            return {**known, **table}
        except SoilError as error:
            raise ExperimentError(f"{self._written.place('soil', 'set')}: {error}") from None


def _choice(value):
    """``true`` and ``false`` of a file as choices have them."""
    return {True: "on", False: "off"}[value] if isinstance(value, bool) else value
