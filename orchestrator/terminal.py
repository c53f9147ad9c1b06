"""What commands show in a terminal: tables, and how a run comes along."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from rich.box import SIMPLE
from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, SpinnerColumn, Task, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

_PLAIN_WIDTH = 200  # columns where there is no terminal: lines stay whole for grep
_EVERY = 5.0  # s between two lines of progress


def output() -> Console:
    """Console on stdout that prints text as it is: square brackets belong to FMI names here."""
    return Console(markup=False, highlight=False, emoji=False, width=None if sys.stdout.isatty() else _PLAIN_WIDTH)


def table(*columns: str, right: Iterable[str] = (), title: str | None = None, caption: str | None = None) -> Table:
    """Table with these columns, those in ``right`` aligned to the right."""
    made = Table(
        box=SIMPLE, padding=(0, 0, 0, 1), title=title, caption=caption, title_justify="left", caption_justify="left", title_style="bold"
    )
    for column in columns:
        made.add_column(column, justify="right" if column in right else "left", overflow="fold")
    return made


@dataclass(frozen=True)
class Display:
    """Callbacks of a run: ``status(text)`` before it, ``progress(t, stop)`` [s] during it."""

    status: Callable[[str], None] = lambda text: None
    progress: Callable[[float, float], None] = lambda t, stop: None


@contextmanager
def follow(quiet: bool, run: str = "") -> Iterator[Display]:
    """Show a run on stderr: a spinner and a bar, or a line every few seconds where there is no terminal; nothing if quiet.

    ``run`` is said before everything, where several runs follow one another.
    """
    console = Console(stderr=True, markup=False, highlight=False)
    label = run and f"{run}: "
    if quiet:
        yield Display()
    elif console.is_terminal:
        with _bar(console, label) as display:
            yield display
    else:
        yield _lines(label)


@contextmanager
def _bar(console: Console, label: str = "") -> Iterator[Display]:
    spinner = Progress(SpinnerColumn(), TextColumn(label + "{task.description}"), TimeElapsedColumn(), console=console, transient=True)
    # Drawn by the run's own calls: a thread that refreshes would take its time from the run.
    bar = Progress(
        TextColumn(label + "{task.completed:.2f} of {task.total:g} s"),
        BarColumn(),
        _Speed(),
        TimeRemainingColumn(),
        console=console,
        auto_refresh=False,
        transient=True,
    )

    def status(text: str) -> None:
        if not spinner.tasks:
            spinner.add_task(text)
            spinner.start()
        spinner.update(spinner.tasks[0].id, description=text)

    def progress(t: float, stop: float) -> None:
        if not bar.tasks:
            spinner.stop()
            bar.start()
            bar.add_task("", total=stop, completed=t)
        bar.update(bar.tasks[0].id, completed=t, refresh=True)

    try:
        yield Display(status, progress)
    finally:
        spinner.stop()
        bar.stop()


class _Speed(ProgressColumn):
    """Simulated seconds per second."""

    def render(self, task: Task) -> Text:
        speed = task.finished_speed or task.speed
        return Text("" if speed is None else _speed(speed))


def _lines(label: str = "") -> Display:
    first: list[float] = []
    shown = 0.0

    def say(text: str) -> None:
        print(label + text, file=sys.stderr, flush=True)

    def progress(t: float, stop: float) -> None:
        nonlocal shown
        now = time.perf_counter()
        if not first:
            first[:] = t, now
            shown = now
        elif now - shown > _EVERY:
            shown = now
            speed = (t - first[0]) / (now - first[1])
            say(f"{t:.2f} of {stop:g} s, {_speed(speed)}, {duration((stop - t) / speed)} left")

    return Display(say, progress)


def stages(status: Callable[[str], None], what: str) -> Callable[[str, float], None]:
    """Progress of something that has stages, told to ``status`` in words every few seconds, with the time left of the stage it is in."""
    began: dict[str, float] = {}
    shown = -math.inf

    def progress(stage: str, share: float) -> None:
        nonlocal shown
        now = time.perf_counter()
        spent = now - began.setdefault(stage, now)
        if now - shown < _EVERY:
            return
        shown = now
        left = f", {duration(spent * (1.0 / share - 1.0))} left" if share > 0.05 and spent > 0.0 else ""
        status(f"{what}: {stage}, {max(share, 0.0):.0%}{left}")

    return progress


def _speed(speed: float) -> str:
    """Simulated seconds per second, of which slow runs keep two digits."""
    return f"{speed:.1f} x real time" if speed >= 1.0 else f"{speed:.2g} x real time"


def duration(seconds: float) -> str:
    """A time [s] in the units that people tell it in: ``45 s``, ``12 min``, ``3 h 05 min``."""
    minutes = round(seconds / 60.0)
    if seconds < 100.0:
        return f"{seconds:.0f} s"
    return f"{minutes} min" if minutes < 100 else f"{minutes // 60} h {minutes % 60:02} min"
