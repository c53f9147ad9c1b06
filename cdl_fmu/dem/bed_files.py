"""Beds as files: arrays in an .npz, with what they were made from as a text, in TOML with units; it lies beside it in a .toml, too.

The .toml is for people, and for beds that others made; an .npz with the text in it is enough, so that it can be packed into a FMU.
"""

from __future__ import annotations

import hashlib
import tempfile
import tomllib
import zipfile
import zlib
from dataclasses import asdict
from pathlib import Path

import numpy as np

from ..slave.model import ModelError
from .bed import COLUMN_DIAMETERS, Bed, BedKey
from .contacts import Contacts, no_contacts
from .material import GRAIN, SHAPE_FIELDS, Material
from .shape import Shape
from .sizes import Shares, Uniform

#: Version of how beds are made and stored: another one makes all beds anew.
VERSION = 2
#: Largest overlap of particles that a bed may have, over the smaller radius. Own choice: 5 times that of a bed at rest.
LARGEST_OVERLAP = 0.05

_UNITS = {
    "material": {
        (f"shape_{name}" if name in SHAPE_FIELDS else name): GRAIN.fields[name].unit for name in GRAIN.fields if name != "rotation"
    }
    | dict(linear="1"),
    "sizes": dict(d_min="m", d_max="m", shares="m, 1"),
    "bed": dict(porosity="1", depth="m", size="m", gravity="m/s2", refinement="m, 1", scale="1", seed="1"),
}


def key_text(key: BedKey) -> str:
    """The key as TOML: equal keys have equal texts."""
    sections = {name: asdict(getattr(key, name)) for name in ("material", "sizes")}
    shape = sections["material"].pop("shape")
    sections["material"] |= {f"shape_{name}": value for name, value in (shape or {}).items()}
    sections["bed"] = {name: getattr(key, name) for name in _UNITS["bed"]}
    lines = []
    for name, values in sections.items():
        lines.append(f"[{name}]")
        for parameter, value in values.items():
            lines.append(f'{parameter} = {{ value = {_value(value)}, unit = "{_UNITS[name][parameter]}" }}')
        lines.append("")
    return "\n".join(lines)


def key_hash(key: BedKey) -> str:
    """Name [hex] of the bed that this key makes."""
    return hashlib.sha256(f"{VERSION}\n{key_text(key)}".encode()).hexdigest()[:20]


def write_bed(bed: Bed, path: Path) -> None:
    """Write ``path`` (.npz) and the .toml beside it; such files are replaced only by complete ones."""
    arrays = dict(positions=bed.positions, radii=bed.radii, periods=bed.periods, counts=bed.counts, floor=bed.floor)
    if len(bed.orientations):
        arrays["orientations"] = bed.orientations
    text = (
        f"# Bed of particles; its arrays are in {path.name}.\n\n"
        f"{key_text(bed.key)}\n"
        "[reached]\n"
        f'n_particles = {{ value = {len(bed.radii)}, unit = "1" }}\n'
        f'porosity = {{ value = {bed.porosity:.4f}, unit = "1" }}\n'
        f'coordination = {{ value = {bed.coordination:.3f}, unit = "1" }}\n'
    )
    # In the same folder, so that they can be moved in one go.
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        partial = Path(folder) / path.name
        np.savez(partial, **arrays, **bed.contacts._asdict(), key=np.array(key_text(bed.key)))
        partial.with_suffix(".toml").write_text(text, encoding="utf-8")
        for file in (partial.with_suffix(".toml"), partial):  # where there are arrays, there is all
            file.replace(path.with_suffix(file.suffix))


def load_bed(path: str | Path) -> Bed:
    """Read a bed that anyone wrote: an .npz of arrays, and a .toml of the same name with what it was made from, as the library writes them.

    Where there is no .toml the array ``key`` must hold its text.

    Arrays are ``positions`` [n, 3], ``radii`` [n], ``periods`` [2], ``counts`` of columns [2] and ``floor``, as in ``Bed``; and all of
    ``Contacts``, or none of them: particles then begin without history.

    Raises:
        ModelError: A file is missing or damaged, an array has another shape or holds numbers that are not finite, columns are too small
            for the largest particle, or particles overlap by more than 5 % of the smaller radius.
    """
    path = Path(path)
    bed = read_bed(path)
    _check_bed(path.name, bed)
    return bed


def read_bed(path: Path) -> Bed:
    """Read a bed as ``load_bed`` does, but whether its particles fit each other is not looked at."""
    beside = path.with_suffix(".toml")
    if not path.is_file():
        raise ModelError(f"{path}: no such file; a bed is an .npz of arrays and a .toml beside it with what it was made from")
    try:
        with np.load(path, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
    except (OSError, ValueError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise ModelError(f"{path.name}: damaged, or no .npz ({error}); write it again") from None
    if not beside.is_file() and "key" not in arrays:
        raise ModelError(f"{beside}: no such file; a bed is an .npz of arrays and a .toml beside it with what it was made from")
    key = _read_key(beside) if beside.is_file() else _key_of(path.name, str(arrays["key"]))
    _check_arrays(path.name, arrays)
    contacts = Contacts(*(arrays.get(name, empty) for name, empty in no_contacts()._asdict().items()))
    orientations = arrays.get("orientations", np.zeros((0, 4)))
    if key.material.shape and not len(orientations):
        raise ModelError(f"{path.name} has no array orientations, [n, 4]: particles with a shape need one quaternion each")
    periods, counts = tuple(arrays["periods"].tolist()), tuple(arrays["counts"].tolist())
    return Bed(
        key,
        arrays["positions"].astype(float),
        arrays["radii"].astype(float),
        periods,
        counts,
        float(arrays["floor"]),
        contacts,
        orientations,
    )


def _value(value) -> str:
    """A value as TOML."""
    if isinstance(value, (tuple, list)):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, (bool, np.bool_)):
        return "true" if value else "false"
    return repr(int(value)) if isinstance(value, (int, np.integer)) else repr(float(value))


def _read_key(path: Path) -> BedKey:
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        raise ModelError(f"{path.name}: damaged, or no TOML ({error})") from None
    return _key_of(path.name, text)


def _key_of(where: str, text: str) -> BedKey:
    """The key that a text means, which lies in a file of this name."""
    try:
        sections = tomllib.loads(text)
    except ValueError as error:
        raise ModelError(f"{where}: damaged, or no TOML ({error})") from None
    read = {}
    for section, units in _UNITS.items():
        read[section] = {}
        for name, entry in sections.get(section, {}).items():
            if name not in units:
                raise ModelError(f"{where}: [{section}] {name} is not known; known are {', '.join(units)}")
            if not isinstance(entry, dict) or "value" not in entry or entry.get("unit") != units[name]:
                raise ModelError(f'{where}: [{section}] {name} must read {{ value = ..., unit = "{units[name]}" }}')
            read[section][name] = _tuples(entry["value"])
    for name, value in read["material"].items():
        field = GRAIN.fields.get(name)  # numbers of the shape, and linear, are looked at by what they are given to
        if field and not (isinstance(value, (int, float)) and field.min <= value <= field.max):
            raise ModelError(f"{where}: [material] {name} = {value!r}: a number from {field.min:g} to {field.max:g} {field.unit} is needed")
    sizes = read["sizes"]
    try:
        distribution = Shares(**sizes) if "shares" in sizes else Uniform(**sizes)
        material = read["material"]
        shape = {name: material.pop(f"shape_{name}") for name in SHAPE_FIELDS if f"shape_{name}" in material}
        return BedKey(Material(**material, shape=Shape(**shape) if shape else None), distribution, **read["bed"])
    except TypeError as error:
        raise ModelError(f"{where} lacks a value, or one is of a wrong kind ({error}); copy one from the library") from None


def _tuples(value):
    return tuple(map(_tuples, value)) if isinstance(value, list) else value


def _check_arrays(name: str, arrays: dict[str, np.ndarray]) -> None:
    """Raise ModelError for an array that is missing, of another shape, or not of finite numbers."""

    def length(array, unknown):
        return arrays[array].shape[0] if array in arrays and arrays[array].ndim else unknown

    n, m, k = length("radii", "n"), length("pairs", "m"), length("on_floor", "k")
    shapes = dict(positions=(n, 3), radii=(n,), periods=(2,), counts=(2,), floor=())
    history = dict(pairs=(m, 2), images=(m, 2), shear=(m, 3), roll=(m, 3), on_floor=(k,), floor_shear=(k, 3), floor_roll=(k, 3))
    if not history.keys().isdisjoint(arrays):
        shapes |= history
    if "orientations" in arrays:
        shapes["orientations"] = (n, 4)
    for array in shapes:
        if array not in arrays:
            raise ModelError(f"{name} has no array {array}: a bed needs {', '.join(shapes)}")
    for array, shape in shapes.items():
        if arrays[array].shape != shape:
            raise ModelError(f"{name}: {array} has the shape {arrays[array].shape}, {shape} is needed".replace("'", ""))
        if arrays[array].dtype.kind not in "iuf" or not np.isfinite(arrays[array]).all():
            raise ModelError(f"{name}: {array} holds what is no finite number; write the bed again")


def _check_bed(name: str, bed: Bed) -> None:
    """Raise ModelError for numbers that no bed can have."""
    least = int(np.argmin(bed.radii))
    if not bed.radii[least] > 0.0:
        raise ModelError(f"{name}: particle {least} has the radius {bed.radii[least]:g} m: it must be above 0 m")
    largest = 2.0 * bed.radii.max()
    for axis, period, count in zip("xy", bed.periods, bed.counts):
        if count < 1 or period / count < COLUMN_DIAMETERS * largest * (1.0 - 1e-9):
            raise ModelError(
                f"{name}: the period along {axis} is {period:g} m in {count} columns: a column must be at least "
                f"{COLUMN_DIAMETERS * largest:g} m wide, {COLUMN_DIAMETERS:g} diameters of the largest particle; make fewer columns, or a "
                "longer tile"
            )
    if bed.counts != tuple(map(round, bed.counts)):
        raise ModelError(f"{name}: counts = {bed.counts} of columns: they must be whole numbers")
    outside = ((bed.positions[:, :2] < 0.0) | (bed.positions[:, :2] >= bed.periods)).any(axis=1)
    if outside.any():
        worst = int(np.argmax(outside))
        x, y = bed.positions[worst, :2]
        raise ModelError(
            f"{name}: particle {worst} is at ({x:g}, {y:g}) m, outside the tile, which goes from 0 to its periods ({bed.periods[0]:g}, "
            f"{bed.periods[1]:g}) m: shift the bed, or wrap its positions"
        )
    d = bed.key.diameter
    if not 2.0 * bed.radii[least] <= d * (1.0 + 1e-6) <= largest * (1.0 + 1e-5):
        raise ModelError(
            f"{name}: its diameters are {2.0 * bed.radii[least]:g} to {largest:g} m, but [sizes] says {d:g} m at the surface; correct it"
        )
    if abs(bed.floor + bed.key.depth) > d:
        raise ModelError(
            f"{name}: the floor is at {bed.floor:g} m, but [bed] depth says {bed.key.depth:g} m below the surface at 0 m; correct one"
        )
    across = bed.periods[1] / bed.counts[1]
    if abs(across - bed.column) > 1e-6 * bed.column:
        raise ModelError(f"{name}: columns are {bed.column:g} m by {across:g} m: they must be squares; choose other counts or periods")
    n = len(bed.radii)
    for array, numbers in (("pairs", bed.contacts.pairs), ("on_floor", bed.contacts.on_floor)):
        if numbers.dtype.kind not in "iu" or (numbers.size and not 0 <= numbers.min() <= numbers.max() < n):
            raise ModelError(f"{name}: {array} must hold numbers of particles, whole and within 0 and {n - 1}")
    _check_overlaps(name, bed)


def _check_overlaps(name: str, bed: Bed) -> None:
    # It takes a part of a second to import, which beds just settled need not wait for.
    from scipy.spatial import cKDTree

    positions, radii = bed.positions.copy(), bed.radii
    deep = radii - (positions[:, 2] - bed.floor)
    worst = int(np.argmax(deep / radii))
    if deep[worst] > LARGEST_OVERLAP * radii[worst]:
        raise ModelError(
            f"{name}: particle {worst} is {deep[worst]:.3g} m deep in the floor at {bed.floor:g} m, above {100.0 * LARGEST_OVERLAP:g} % of "
            f"its radius ({radii[worst]:g} m): raise it, settle the bed, or raise E"
        )
    positions[:, :2] %= bed.periods
    tree = cKDTree(positions, boxsize=[*bed.periods, 0.0])  # 0: does not repeat itself
    a, b = tree.query_pairs(2.0 * radii.max(), output_type="ndarray").T
    away = positions[a] - positions[b]
    away[:, :2] -= np.rint(away[:, :2] / bed.periods) * bed.periods
    overlap = radii[a] + radii[b] - np.linalg.norm(away, axis=1)
    share = overlap / np.minimum(radii[a], radii[b])
    if len(share) and share.max() > LARGEST_OVERLAP:
        worst = int(np.argmax(share))
        i, j = sorted((int(a[worst]), int(b[worst])))
        raise ModelError(
            f"{name}: particles {i} and {j} (radii {radii[i]:g} m and {radii[j]:g} m) overlap by {overlap[worst]:.3g} m, "
            f"{100.0 * share[worst]:.3g} % of the smaller radius; at most {100.0 * LARGEST_OVERLAP:g} % are possible: move them apart, "
            "settle the bed, or raise E"
        )
