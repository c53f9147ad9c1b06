"""A still of particles: the soil below each wheel, cut open along the wheel's heading."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from .particles import Instant, Wheel

#: What is seen around a wheel in its radii; how far behind the cut particles are drawn, in diameters of the largest, so that no gaps show.
_AHEAD, _DEEP = 2.2, 2.5
#: What colours tell: values, unit, its size in SI, colours, and the share of particles that the scale covers, for a few are far above.
_PANELS = {
    "speeds": ("speed of the particles [mm/s]", 1e-3, "viridis"),
    "pressures": ("mean stress in the particles [kPa]", 1e3, "magma_r"),
}
_COVERED = 99.0  # %


def particles_picture(seen: Instant) -> Figure:
    """Particles below each wheel, seen from its right, by their speed and by the mean stress in them."""
    figure = Figure(figsize=(7.5 * max(len(seen.wheels), 1), 9.2), dpi=200, layout="constrained")
    axes = figure.subplots(len(_PANELS), max(len(seen.wheels), 1), squeeze=False)
    for column, wheel in enumerate(seen.wheels):
        for ax, (name, (label, unit, colours)) in zip(axes[:, column], _PANELS.items()):
            shown = _section(ax, seen, wheel, getattr(seen, name) / unit, colours)
            figure.colorbar(shown, ax=ax, label=label, shrink=0.8)
        if len(seen.wheels) > 1:
            axes[0, column].set_title(f"wheel {column + 1}", fontsize=10)
    figure.suptitle(f"particles in the middle plane of the wheel, t = {seen.t:g} s", fontsize=10)
    return figure


def _section(ax: Axes, seen: Instant, wheel: Wheel, values: np.ndarray, colours: str) -> EllipseCollection:
    axle = wheel.axle[:2] / np.linalg.norm(wheel.axle[:2])
    heading = np.array([axle[1], -axle[0]])
    away = seen.centres[:, :2] - wheel.centre[:2]
    along, behind, z = away @ heading, away @ axle, seen.centres[:, 2]
    rim = np.stack([(wheel.triangles[..., :2] - wheel.centre[:2]) @ heading, wheel.triangles[..., 2]], axis=-1)
    reach = _AHEAD * float(abs(rim[..., 0]).max())
    near = np.flatnonzero((abs(along) < reach) & (behind >= 0.0) & (behind < _DEEP * 2.0 * seen.radii.max()))
    near = near[np.argsort(-behind[near])]  # what is in front is drawn last
    wide = 2.0 * seen.radii[near]
    top = float(np.percentile(values[near], _COVERED)) if len(near) else 0.0
    scale = Normalize(0.0, top if top > 0.0 else 1.0)
    shown = EllipseCollection(
        wide,
        wide,
        np.zeros(len(near)),
        units="xy",
        offsets=np.stack([along[near], z[near]], axis=1),
        offset_transform=ax.transData,
        array=values[near],
        cmap=colours,
        norm=scale,
        edgecolors="0.25",
        linewidths=0.2,
    )
    ax.add_collection(PolyCollection(rim, facecolors="0.8", edgecolors="0.8", linewidths=0.3))
    ax.add_collection(shown)
    low = float((z[near] - seen.radii[near]).min()) if len(near) else float(rim[..., 1].min())
    ax.set(xlim=(-reach, reach), ylim=(low, float(rim[..., 1].max())), aspect="equal", xlabel="ahead of the axle [m]", ylabel="z [m]")
    return shown
