"""What panels of all our diagrams have alike."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import cycle

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D


def frame(ax: Axes) -> None:
    """Axes to the left and below, and a faint grid behind."""
    ax.spines[["top", "right"]].set_visible(False)
    ax.grid(True, lw=0.4, color="0.87")
    ax.set_axisbelow(True)
    ax.tick_params(labelsize=9)


def widen(ax: Axes, least: float) -> None:
    """Show at least this span, so that rounding around a constant does not fill a panel."""
    low, high = ax.get_ylim()
    if high - low < least:
        ax.set_ylim((low + high - least) / 2, (low + high + least) / 2)


def legend(figure: Figure, labels: Sequence[str]) -> None:
    """Colours and what they stand for, above all panels."""
    lines = [Line2D([], [], color=colour, label=label) for colour, label in zip(colours(), labels)]
    figure.legend(handles=lines, loc="outside upper center", ncols=min(len(lines), 4), frameon=False, fontsize=9)


def colours() -> Iterator[str]:
    """Colours of lines, over and over."""
    return cycle(("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000"))  # Okabe & Ito 2008, for all eyes
