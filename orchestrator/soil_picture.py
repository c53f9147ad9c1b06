"""Picture of an identified soil: what was measured, and the laws that were fitted to it."""

from __future__ import annotations

from itertools import cycle

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter

from cdl_fmu.soil.identify import Identification
from cdl_fmu.terramechanics import janosi_displacement

_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
_READINGS = {"ls": "", "marker": ".", "ms": 2.5, "alpha": 0.5}
_LAW = {"lw": 1.8}
_OTHER_LAW = {"lw": 1.0, "ls": (0, (4, 2))}


def figure(found: Identification) -> Figure:
    """Pressure over sinkage, logarithmic and linear, by the plates' diameters; shear stress and strength below, if there are such tests."""
    rows = 1 if found.shear is None else 2
    made = Figure(figsize=(12, 5.2 * rows), dpi=150, layout="constrained")
    axes = made.subplots(rows, 2, squeeze=False)
    for view in axes[0]:
        _plates(view, found)
    axes[0, 0].set(xscale="log", yscale="log", title=_law(found))
    for axis in (axes[0, 0].xaxis, axes[0, 0].yaxis):  # at most a decade or two: powers of ten alone would be too few labels
        axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(NullFormatter())
    low, high = (1e3 * width for width in found.sinkage.widths)
    axes[0, 1].set(
        xlim=(0, None), ylim=(0, None), title=f"goodness {found.sinkage.goodness:.3f}; for wheels {low:.3g} to {high:.3g} mm wide"
    )
    if found.shear is not None:
        _stress(axes[1, 0], found)
        _strength(axes[1, 1], found)
    made.suptitle(found.title)
    return made


def _law(found: Identification) -> str:
    fit = found.sinkage
    return f"$k_c$ = {fit.k_c:.4g} N/m$^{{n+1}}$, $k_\\phi$ = {fit.k_phi:.4g} N/m$^{{n+2}}$, n = {fit.n:.4g}"


def _plates(view: Axes, found: Identification) -> None:
    fit, handles = found.sinkage, []
    for b, colour in zip(fit.radii, cycle(_COLOURS)):
        tests = [plate.test for plate in fit.plates if plate.test.b == b]
        for test in tests:
            view.plot(1e3 * test.z, 1e-3 * test.p, color=colour, **_READINGS)
        z = np.geomspace(min(test.z.min() for test in tests), max(test.z.max() for test in tests), 200)
        view.plot(1e3 * z, 1e-3 * fit.pressure(b, z), color=colour, **_LAW)
        if found.other is not None:
            view.plot(1e3 * z, 1e-3 * found.other.pressure(b, z), color=colour, **_OTHER_LAW)
        label = f"{2e3 * b:g} mm plate, {len(tests)} test{'s' if len(tests) > 1 else ''}"
        handles.append(Line2D([], [], color=colour, marker=".", label=label))
    if found.other is not None:
        with_offset = fit if fit.has_offset else found.other
        said = "not applied: z counted" if with_offset is found.other else "z not counted"
        label = f"{said} from {1e3 * with_offset.offset:.3g} mm"
        handles.append(Line2D([], [], color="0.4", label=label, **_OTHER_LAW))
    view.legend(handles=handles, frameon=False)
    view.set(xlabel="z [mm]", ylabel="p [kPa]")
    view.grid(alpha=0.3, which="both")


def _stress(view: Axes, found: Identification) -> None:
    for one, colour in zip(found.shear.tests, cycle(_COLOURS)):
        view.plot(1e3 * one.test.j, 1e-3 * one.test.tau, color=colour, **_READINGS)
        j = np.linspace(0.0, one.test.j[-1], 200)
        law = one.tau_max * np.array([janosi_displacement(float(each), found.shear.K) for each in j])
        view.plot(1e3 * j, 1e-3 * law, color=colour, label=f"{one.test.name}: p = {1e-3 * one.test.p:.3g} kPa", **_LAW)
    view.legend(frameon=False, fontsize="small")
    view.set(xlim=(0, None), ylim=(0, None), xlabel="j [mm]", ylabel=r"$\tau$ [kPa]", title=f"K = {1e3 * found.shear.K:.3g} mm")
    view.grid(alpha=0.3)


def _strength(view: Axes, found: Identification) -> None:
    fit = found.shear
    p = np.array([one.test.p for one in fit.tests])
    for pressure, one, colour in zip(p, fit.tests, cycle(_COLOURS)):
        view.plot(1e-3 * pressure, 1e-3 * one.tau_max, "o", color=colour)
    along = np.array([0.0, 1.05 * p.max()])
    view.plot(1e-3 * along, 1e-3 * (fit.c + along * np.tan(fit.phi)), color="black", **_LAW)
    view.set(xlim=(0, None), ylim=(0, None), xlabel="p [kPa]", ylabel=r"$\tau_{max}$ [kPa]")
    view.set_title(f"c = {fit.c:.4g} Pa, $\\phi$ = {fit.phi:.4g} rad ({np.degrees(fit.phi):.3g} deg)")
    view.grid(alpha=0.3)
