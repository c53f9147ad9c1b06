"""What an experiment can set: the sections of its file and the records that each holds."""

from __future__ import annotations

from collections.abc import Mapping

from cdl_fmu.slave.interface import ENVIRONMENT
from cdl_fmu.slave.model import Model
from cdl_fmu.slave.records import Choice, Real, Record
from cdl_fmu.soil import SOIL
from cdl_fmu.terrain.stand import GROUND
from cdl_fmu.wheel import WHEEL
from fmus import ROCK_TIERS, TIERS

from .rigs import Rig
from .schemes import SCHEMES

#: The [run] section.
RUN = Record(
    stop_time=Real(10.0, "s", "End of the run", min=0.0),
    step=Real(1e-3, "s", "Communication step", min=1e-6, max=1.0),
    record_interval=Real(1e-3, "s", "Time between two rows of the result; the nearest multiple of the step is taken", min=1e-6),
    scheme=Choice("Coupling scheme", **{name: (kind.__doc__ or "").split("\n")[0] for name, kind in SCHEMES.items()}),
)


def models_of(rig: Rig) -> dict[str, Model]:
    """A model of each part and of each tier, so that one file serves runs on any of them."""
    return {
        **{part: kind() for part, kind in rig.parts.items()},
        **{tier.lower(): kind(len(rig.tiers), 1) for tier, kind in ROCK_TIERS.items()},
        **{tier.lower(): kind() for tier, kind in TIERS.items()},
    }


def files_in(section: str, models: Mapping[str, Model]) -> Mapping[str, str]:
    """Files that a section can name, with their descriptions; those of bodies are named by each [[rock]]."""
    files = dict(models[section].files) if section in models else {}
    if section in ("bcm", "vem"):
        files |= GROUND
    if section == "vem":
        files |= _of_rocks("vem").files
    return {name: description for name, description in files.items() if not name.startswith("body[")}


def sections_of(rig: Rig, models: Mapping[str, Model]) -> dict[str, Record]:
    """Section -> what it holds; a tier that can be of rocks, too, has one section for both."""
    elsewhere = {*(ENVIRONMENT | SOIL | WHEEL).fields, *rig.given, "rock"}
    own = {}
    for part, model in models.items():
        fields = dict(model.parameters.fields)
        if part.upper() in ROCK_TIERS:
            fields |= _of_rocks(part).parameters.fields
            del fields["body"]
        own[part] = Record(**{name: field for name, field in fields.items() if name not in elsewhere})
    return {"run": RUN, "environment": ENVIRONMENT, "soil": SOIL, "wheel": WHEEL, **own}


def _of_rocks(part: str) -> Model:
    return ROCK_TIERS[part.upper()](1, 1)


def takes_one(key: str, rig: Rig) -> bool:
    """Whether a key has one value, not an array of them."""
    if key in rig.keys.fields or key in rig.tiers.values() or key == "soil.set":
        return True
    models, (section, _, name) = models_of(rig), key.partition(".")
    record = sections_of(rig, models).get(section, Record())
    return name in {s.name for s in record.scalars()} or name in files_in(section, models)
