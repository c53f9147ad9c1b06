"""Models: records plus initialise and step; and an instance of one, which owns the memory the records lie in."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Container, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path

import numba
import numpy as np

from .kernel import MOST_THREADS, array_entry, compiled, kernel
from .library import Library
from .pieces import Piece, piece
from .pool import Pool
from .records import Array, Choice, Record, Scalar
from .state import State


class ModelError(Exception):
    """A model refuses a value or cannot go on; the message names the variable, its value, unit and bound, and the remedy."""


@dataclass(frozen=True)
class Event:
    """What a step's status number means.

    ``text`` is a format that may use ``{i}``, the number from 1 of the wheel, patch or body concerned, the parameters as in ``{p.r_w:g}``,
    and that wheel's, patch's or body's inputs as in ``{wheel.r_0[2]:.4g}``.
    """

    text: str
    is_error: bool = True


@dataclass(frozen=True)
class Rule:
    """What parameters keep together, beyond the bounds of each.

    Native FMUs have it compiled, so ``broken`` and ``numbers`` are arithmetic on the fields of p alone.

    Attributes:
        text: Format of what is said where it is broken, ``name = value unit: why; remedy``, of p (``{p.r_w:g}``) and of the numbers.
        broken: True for parameters p that break it.
        numbers: What the text tells beside the parameters: name -> value for p.
        applies: True for parameters p to which it applies; None: to all.
    """

    text: str
    broken: Callable[[np.recarray], bool]
    numbers: Mapping[str, Callable[[np.recarray], float]] = field(default_factory=dict)
    applies: Callable[[np.recarray], bool] | None = None


#: Largest time [s] that is taken for one: beyond, a step of a millisecond leads nowhere.
LATEST = 1e9

#: A step returns ``status + STATUS_SPAN * index``: the number of an event, and the index from 0 of what it is about.
STATUS_SPAN = 256


class Model:
    """Records and two functions. A subclass sets the records in ``__init__`` from its sizes, which are build-time constants.

    Attributes:
        identifier: FMI model identifier; sizes are part of it.
        sizes: The keyword arguments that built this model.
        parameters, inputs, state, outputs: Records p, u, x, y.
        rules: What parameters have to keep, in the order in which they are looked at.
        events: Meaning of the status numbers that ``step`` returns (0 = fine).
        feedthrough: False if no output at t depends on an input at t, so that a master may break a cycle here.
        files: Parameters that name a file, with their descriptions; they are strings and live beside the records.
        needed_files: Those of them without which it makes no step.
        pool_class: Class of the pools that ``make_pool`` makes, None without.
        needs_python: What keeps it from becoming a native FMU; "" if nothing does.
    """

    identifier: str
    parameters: Record
    inputs: Record
    state: Record
    outputs: Record
    rules: tuple[Rule, ...] = ()
    events: dict[int, Event] = {}
    feedthrough = True
    files: dict[str, str] = {}
    needed_files: tuple[str, ...] = ()
    pool_class: type[Pool] | None = None
    needs_python: str = "its step is written in Python"

    def __init__(self, **sizes: int):
        self.sizes = sizes

    def check(self, p: np.recarray) -> None:
        """Raise ModelError for parameters that are within their bounds but break a rule."""
        for rule in self.rules:
            if (rule.applies is None or rule.applies(p)) and rule.broken(p):
                raise ModelError(rule.text.format(p=p, **{name: number(p) for name, number in rule.numbers.items()}))

    def prepare(self, p: np.recarray, files: dict[str, Path], progress: Callable[[str, float], None]) -> None:
        """Make what takes minutes, once for these parameters: kept on this machine, ``make_pool`` finds it there. Arguments as there.

        Args:
            progress: Called now and then with what is being done, and the share done of it.
        """

    def make_pool(self, p: np.recarray, files: dict[str, Path]) -> Pool | None:
        """A new pool, None for a model that has its records alone.

        Args:
            p: The parameters, which are within their bounds and fit together.
            files: Path of each file that is given, by the parameter's name; the files exist.

        Raises:
            ModelError: A file does not hold what it should.
        """

    def bind(self, instance: Instance):
        """Return the pair ``(initialise(t), step(t, h) -> status)`` that works on the instance's memory."""
        raise NotImplementedError

    @cached_property
    def scalars(self) -> dict[str, list[Scalar]]:
        """Scalars of each record; offsets count from the start of that record."""
        return {part: getattr(self, _PARTS[part]).scalars() for part in _PARTS}


_PARTS = {"p": "parameters", "u": "inputs", "x": "state", "y": "outputs"}


class KernelModel(Model):
    """A model whose functions are kernels ``initialise_kernel(t, p, x, y)`` and ``step_kernel(t, h, p, u, x, y) -> status``.

    Where the model has a pool, the pool's arrays follow: ``step_kernel(t, h, p, u, x, y, *arrays)``.

    Kernels are compiled anew for records of other sizes. A model spares itself that with ``arguments``, what its kernels take instead:
    ``"x.wheel"`` is an array of records, of any length, ``"u.hard.wheel"`` one with a row for each record that has such an array in turn,
    ``"x"`` one of length one, of the record's fields before the first such array, and the pool's arrays are one tuple.
    ``initialise_kernel`` gets those that are no inputs, or all if ``starts_from_inputs``. A model that has a parameter ``threads`` has a
    twin of its step for several threads, ``parallel_step_kernel``, and ``arguments``, as numba's prange hands no records to its threads.

    A native FMU holds the pool as it was made when the FMU was built (see ``built_in``). Where the extents of arrays hang on parameters
    that may change after that, ``resize_kernel(p, extents, growth)`` writes them over those of then: of all arrays in their order, and
    the numbers ``per_step`` and ``limit`` of a RowPool. If it ``gains_from_vectors``, there are twins of its kernels for newer processors.
    The C library that kernels call, if they call one, is named in ``library``.
    """

    initialise_kernel: object
    step_kernel: object
    parallel_step_kernel: object | None = None
    arguments: tuple[str, ...] | None = None
    resize_kernel: object | None = None
    gains_from_vectors = False
    needs_python: str = ""
    library: Library | None = None
    starts_from_inputs = False

    def built_in(self, files: Container[str]) -> tuple[str, ...]:
        """Parameters, by their names or the name of the array of records that holds them, for which a native FMU's pool is made.

        Those on which the content of the pool with these files depends, and the extents of its arrays, unless ``resize_kernel`` knows them.
        """
        return ()

    def pieces(self) -> list[Piece]:
        """What the kernels take of the block, in their order."""
        starts, start = {}, 0
        for part in _PARTS:
            starts[part], start = start, start + len(getattr(self, _PARTS[part]))
        if self.arguments is None:
            return [Piece(part.upper(), starts[part], getattr(self, _PARTS[part]).dtype, (1,)) for part in _PARTS]
        return [piece(argument, getattr(self, _PARTS[argument[0]]), starts[argument[0]]) for argument in self.arguments]

    def at_start(self, pieces: Mapping[str, object]) -> list:
        """Of what is given for each piece, by its name, that which ``initialise_kernel`` takes."""
        return [given for name, given in pieces.items() if self.starts_from_inputs or name[0] not in "uU"]

    def bind(self, instance: Instance):
        views = {piece.name: piece.view(instance.block) for piece in self.pieces()}
        kept = self.at_start(views)
        pool, views = instance.pool, tuple(views.values())
        threads = 1 if self.parallel_step_kernel is None else int(instance.p.threads) or MOST_THREADS
        several = threads > 1
        initialise, step = self.initialise_kernel, self.parallel_step_kernel if several else self.step_kernel
        if self.arguments is None:
            more = "".join(f", a{i}" for i in range(len(pool.arrays if pool else ())))
            initialise, step = array_entry(initialise, f"t, P, X, Y{more}"), array_entry(step, f"t, h, P, U, X, Y{more}")

        def arrays():  # as they are at the time of the call: growth replaces them
            return () if pool is None else pool.arrays if self.arguments is None else (pool.arrays,)

        initialise, step = compiled(initialise, 0.0, *kept, *arrays()), compiled(step, 0.0, 0.0, *views, *arrays())

        def step_on(t, h):
            if several:
                numba.set_num_threads(threads)  # a setting of the calling thread, which other instances share
            return step(t, h, *views, *arrays())

        return lambda t: initialise(t, *kept, *arrays()), step_on


class Instance:
    """One instance of a model: the block of float64 ``[p|u|x|y]``, the pool if the model has one, and the functions that work on both.

    ``p, u, x, y`` are NumPy records that read and write the block: ``instance.u.wheel[0].r_0[2] = 0.1``.

    Args:
        model: The model.
        name: Name used in messages.
        resources: Folder in which files are looked for before the working directory.
        **parameters: Start values, a Choice by its option's name, a file by its path.
    """

    def __init__(self, model: Model, name: str = "", resources: Path | None = None, **parameters):
        self.model = model
        self.name = name or model.identifier
        records = [getattr(model, part) for part in _PARTS.values()]
        self.block = np.concatenate([r.starts() for r in records])
        ends = np.cumsum([0, *map(len, records)])
        self.slices = {part: slice(int(a), int(b)) for part, a, b in zip(_PARTS, ends, ends[1:])}
        self.arrays = tuple(self.block[self.slices[part]].view(r.dtype) for part, r in zip(_PARTS, records))
        self.p, self.u, self.x, self.y = (a.view(np.recarray)[0] for a in self.arrays)
        self.warnings: list[str] = []
        self._warned: set[int] = set()
        self._x = self.block[self.slices["x"]]
        self._bounds = {part: (self.block[self.slices[part]], *_bounds(model.scalars[part])) for part in ("p", "u")}
        self._first_outside = {part: partial(compiled(_first_outside, *b), *b) for part, b in self._bounds.items()}
        #: Path of each file parameter, "" for none; a path that is not absolute is looked for when the instance is initialised.
        self.files = dict.fromkeys(model.files, "")
        self._resources = resources
        self.pool: Pool | None = None
        self._made_for: tuple | None = None  # parameters and files that the pool was made for
        self._functions = None
        for key, value in parameters.items():
            self.set_parameter(key, value)

    def set_parameter(self, name: str, value) -> None:
        """Set a parameter by its FMI name, or a whole array by the array's; a Choice by its option's name, a file by its path.

        Raises ModelError for an unknown name or a value of another type; bounds and files are checked when the instance is initialised.
        """
        if name in self.files:
            if not isinstance(value, (str, Path)):
                raise ModelError(f"{name} = {value!r}: the path of a file is needed ({self.model.files[name]})")
            self.files[name] = str(value)
            return
        array = [s for s in self.model.scalars["p"] if s.name == name or s.name.startswith(f"{name}[")]
        if not array:
            names = ", ".join([*(s.name for s in self.model.scalars["p"]), *self.files])
            raise ModelError(f"{self.name} has no parameter {name!r}; it has {names}")
        for scalar, one in zip(array, np.broadcast_to(np.asarray(value, dtype=object), len(array))):
            self.block[scalar.offset] = parse_value(scalar, one)

    def set_starts(self, starts: Mapping[str, float | str]) -> None:
        """Set parameters and inputs to start values given by FMI name, as they are stored."""
        offsets = {s.name: self.slices[part].start + s.offset for part in ("p", "u") for s in self.model.scalars[part]}
        for name, value in starts.items():
            if name in self.files:
                self.files[name] = value
            else:
                self.block[offsets[name]] = value

    def changed_starts(self) -> dict[str, float]:
        """Start values of parameters and inputs that differ from the records', by FMI name, for an FMU."""
        offsets = {s.name: (self.slices[part].start + s.offset, s.start) for part in ("p", "u") for s in self.model.scalars[part]}
        return {name: float(self.block[i]) for name, (i, start) in offsets.items() if self.block[i] != start}

    def initialise(self, t: float = 0.0) -> None:
        """Check the parameters and set state and outputs at time t [s], the outputs for the inputs as they are now."""
        self._check_time(t)
        self.check()
        self._make_pool()
        self._functions[0](t)
        if self.model.feedthrough:
            # A step of no length gives the outputs at t; it leaves no trace in the state, and what is missing yet may still come.
            state, pooled = self._x.copy(), self._save_pool()
            self._check("u", "input", t)
            if self.pool is not None:
                self.pool.reserve(self.u)
            status = self._functions[1](t, 0.0)
            if status and self.model.events[status % STATUS_SPAN].is_error:
                self._report(status, t)
            self._x[:] = state
            if pooled is not None:
                self.pool.restore(pooled)

    def check(self) -> None:
        """Raise ModelError for parameters that are out of bounds or do not fit together; what is warned of is in ``warnings``."""
        self._check("p", "parameter")
        with self._listening():
            self.model.check(self.p)

    def prepare(self, progress: Callable[[str, float], None]) -> None:
        """What ``Model.prepare`` does, for the parameters and files as they are now; what is warned of is in ``warnings``."""
        with self._listening():
            self.model.prepare(self.p, {name: self._found(name) for name, path in self.files.items() if path}, progress)

    @contextmanager
    def _listening(self) -> Iterator[None]:
        """Warnings that a model gives as Python does: from within a FMU they reach nobody but through its log."""
        with warnings.catch_warnings(record=True) as heard:
            warnings.simplefilter("always", UserWarning)
            yield
        for warning in heard:
            text = f"{self.name}: {warning.message}"
            if not issubclass(warning.category, UserWarning):
                warnings.warn_explicit(warning.message, warning.category, warning.filename, warning.lineno)
            elif text not in self.warnings:  # a model is initialised several times before its first step
                self.warnings.append(text)

    def _make_pool(self) -> None:
        """Make the pool anew for the parameters and files as they are now, and the functions for it."""
        files = {name: self._found(name) for name, path in self.files.items() if path}
        with self._listening():
            self.pool = self.model.make_pool(self.p, files)
        self._made_for = self._parameters()
        if self.pool is not None or self._functions is None:
            self._functions = self.model.bind(self)

    def _save_pool(self) -> object | None:
        return None if self.pool is None else self.pool.save()

    def _parameters(self) -> tuple:
        return self.block[self.slices["p"]].tobytes(), self.files.copy()

    def _found(self, name: str) -> Path:
        path, here = Path(self.files[name]), Path.cwd()
        for folder in filter(None, (self._resources, here)):
            if (folder / path).is_file():  # whatever the folder, if the path is absolute
                return (folder / path).absolute()
        if path.is_absolute():
            where, remedy = "", "correct the path"
        else:
            where = f" in the FMU's resources or in {here}" if self._resources else f" in {here}"
            remedy = "put the file there, or give its absolute path"
        raise ModelError(f"{self.name}: {name} = '{path}': no such file{where}; {remedy} ({self.model.files[name]})")

    def step(self, t: float, h: float) -> None:
        """Advance from t by h [s] with the inputs in ``u``; raises ModelError, in which case the state is as before."""
        if not 0.0 <= h < math.inf:
            raise ModelError(f"{self.name}: step length h = {h:g} s at t = {t:.6g} s: it must be finite and not negative")
        self._check_time(t)
        self._check("u", "input", t)
        if self.pool is not None:
            self.pool.reserve(self.u)
        status = self._functions[1](t, h)
        if status:
            self._report(status, t)

    def save(self) -> State:
        """The whole state: a copy of the block, and the pool at a cost in proportion to what changed in it since the last save."""
        return State(self.block.copy(), self.files.copy(), self._save_pool())

    def restore(self, saved: State) -> None:
        """Go back to a saved state, to the same bits."""
        self.block[:] = saved.block
        self.files.update(saved.files)
        if saved.pool is not None:
            if self.pool is None or self._made_for != self._parameters():
                self._make_pool()
            self.pool.restore(saved.pool)
        elif self.pool is not None:  # saved before the instance was initialised
            self.pool = self._functions = None

    def _check_time(self, t: float) -> None:
        if not abs(t) <= LATEST:
            raise ModelError(f"{self.name}: t = {t:g} s: it must be within {LATEST:g} s of 0")

    def _check(self, part: str, kind: str, t: float | None = None) -> None:
        i = self._first_outside[part]()
        if i >= 0:
            value, when = self._bounds[part][0][i], "" if t is None else f" at t = {t:.6g} s"
            raise ModelError(f"{self.name}: {kind} {describe_violation(self.model.scalars[part][i], value)}{when}")

    def _report(self, status: int, t: float) -> None:
        event = self.model.events[status % STATUS_SPAN]
        index = status // STATUS_SPAN
        fields = self.model.inputs.fields.items()
        inputs = {name: getattr(self.u, name)[index] for name, field in fields if isinstance(field, Array) and index < field.n}
        text = f"{self.name}: {event.text.format(i=index + 1, p=self.p, **inputs)} (t = {t:.6g} s)"
        if event.is_error:
            raise ModelError(text)
        if status not in self._warned:
            self._warned.add(status)
            self.warnings.append(text)


def parse_value(scalar: Scalar, value) -> float:
    """The float64 that stands for a value given by a person: a number, or a name. Raises ModelError for anything else."""
    field = scalar.field
    if isinstance(field, Choice):
        if value not in field.options:
            raise ModelError(f"{scalar.name} = {value!r}: choose one of {', '.join(field.options)} ({field.description})")
        return field.value(value)
    if isinstance(value, str) and field.names:
        named = {name.lower(): number for name, number in field.names.items()}
        if value.lower() not in named:
            known = ", ".join(f"{name} ({number:g})" for name, number in field.names.items())
            raise ModelError(f"{scalar.name} = {value!r}: use {known} or a number in {field.unit} ({field.description})")
        return named[value.lower()]
    if isinstance(value, (bool, str)) or not isinstance(value, (int, float, np.number)):
        unit = "" if field.unit == "1" else f" in {field.unit}"
        raise ModelError(f"{scalar.name} = {value!r}: a number{unit} is needed ({field.description})")
    return float(value)


def describe_violation(scalar: Scalar, value: float) -> str:
    """Name, value, unit, bound and remedy of a value outside its declaration."""
    field = scalar.field
    if isinstance(field, Choice):
        return f"{scalar.name} = {value:g} is no item of {', '.join(f'{i + 1} {o}' for i, o in enumerate(field.options))}"
    unit = "" if field.unit == "1" else f" {field.unit}"
    if not math.isfinite(value):
        remedy = "it must be finite"
    elif value < field.min:
        remedy = f"it must be at least {field.min:g}{unit}"
    else:
        remedy = f"it must be at most {field.max:g}{unit}"
    return f"{scalar.name} = {value:g}{unit}: {remedy} ({field.description})"


def _bounds(scalars: list[Scalar]) -> tuple[np.ndarray, np.ndarray]:
    # An infinite bound becomes the largest finite number, so that one comparison also refuses infinities and NaN.
    big = np.finfo(float).max
    lower = np.array([max(s.field.min, -big) for s in scalars])
    upper = np.array([min(s.field.max, big) for s in scalars])
    return lower, upper


@kernel
def _first_outside(values, lower, upper):
    for i in range(values.size):
        if not (lower[i] <= values[i] <= upper[i]):
            return i
    return -1
