"""What a run is warned of: wheels and gravity that a soil's plate tests are not good for, and tiers that see the soil differently."""

from __future__ import annotations

from collections.abc import Mapping

_SAME_GRAVITY = 0.01  # share by which gravity may differ from the tests'


def width_outside(width: float, usable: tuple[float, float] | None) -> list[str]:
    """A warning of a wheel's width [m] outside those for which the soil's fit is good, if these are known."""
    if usable is None or usable[0] <= width <= usable[1]:
        return []
    return [
        f"wheel.b_w = {width:g} m: the soil's plate tests are good for wheels {usable[0]:.3g} to {usable[1]:.3g} m wide (widths in its "
        "file); test plates whose radius is nearer to the wheel's width"
    ]


def gravity_outside(gravity: float, tested: float | None, *, on_bcm: bool, scm_scales: bool) -> list[str]:
    """A warning of wheels whose pressure stays as it was at another gravity.

    Args:
        gravity: Of the experiment [m/s2].
        tested: Of the soil's plate tests [m/s2], None if the soil is not as it was tested.
        on_bcm: Whether a wheel is on BCM, whose pressure does not hang on gravity.
        scm_scales: Whether SCM's does.
    """
    if tested is None or abs(gravity - tested) <= _SAME_GRAVITY * tested or (scm_scales and not on_bcm):
        return []
    tiers = "SCM for all wheels and " if on_bcm else ""
    return [
        f"environment.gravity = {gravity:g} m/s2: Bekker's k_c and k_phi of this soil are as measured at {tested:g} m/s2, and soil is "
        "weaker at less gravity, which a wheel whose weight is reduced on Earth does not show (Kobayashi et al. 2010, Wong 2012); use "
        f"{tiers}scm.pressure_model=reece (k_c_1, k_phi_1), whose pressure grows with gravity, or a soil tested at that gravity, with "
        "[gravity] in its file"
    ]


def laws_apart(unloading: Mapping[str, tuple[str, float, float]], *, scm_scales: bool) -> list[str]:
    """Warnings of laws by which SCM presses soil, and BCM bears on it by others.

    Args:
        unloading: Parameter of how soil is unloaded -> its unit, SCM's and BCM's value.
        scm_scales: Whether SCM's pressure is Reece's.
    """
    found = [
        f"bcm.{name} = {there:g} {unit}, but scm.{name} = {here:g} {unit}: with compaction both tiers press one soil; set both alike"
        for name, (unit, here, there) in unloading.items()
        if here != there
    ]
    if scm_scales:
        found.append("scm.pressure_model = reece: with compaction wheels on BCM bear by Bekker's law on soil that was pressed by Reece's")
    return found
