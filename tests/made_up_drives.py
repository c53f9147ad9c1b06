"""Results of two-wheel drives that never were: signals given as functions of the rear wheel's x."""

import json

import numpy as np
import xarray as xr

import orchestrator.results  # noqa: F401, the accessor .cdl

_FORCES = {"F_x": "drawbar_pull", "F_y": "lateral_force", "F_z": "normal_load"}
_DIAGNOSTICS = _FORCES | {name: name for name in ("sinkage", "slip", "slip_angle")}
_WEIGHT = 265.0


def made_up_drive(x=None, *, end=0.5, tiers=("BCM", "BCM"), names=("front", "rear"), **signals):
    """A result with what a comparison asks for.

    Args:
        x: x of the rear wheel at each row [m], 1/8 mm apart by default; the first row is the start.
        end: Last x of the rear wheel [m] where ``x`` is not given.
        tiers, names: Of the front and the rear wheel.
        signals: ``front_F_x=lambda x: 3 * x`` or a number, by wheel and F_x, F_y, F_z [N], sinkage, y, z [m],
            slip, slip_angle [rad]. The wheels head along x.
    """
    x = np.arange(round(end / 1.25e-4) + 1) * 1.25e-4 if x is None else np.asarray(x, float)
    ones = np.ones_like(x)
    columns, wheels = {}, []
    for i, (name, tier, place) in enumerate(zip(names, tiers, ("front", "rear")), 1):
        instance = tier.lower()

        def value(signal, default=0.0, place=place):
            given = signals.pop(f"{place}_{signal}", default)
            return given(x) if callable(given) else given * ones

        force = {signal: value(signal, _WEIGHT if signal == "F_z" else 0.0) for signal in _DIAGNOSTICS}
        columns |= {f"{instance}.diagnostics[{i}].{_DIAGNOSTICS[signal]}": values for signal, values in force.items()}
        columns |= {f"{instance}.wheel[{i}].f_0[{k}]": force[signal] for k, signal in enumerate(_FORCES, 1)}
        position = (x + 0.6 * (place == "front"), value("y"), value("z", 0.1))
        columns |= {f"rover.wheel[{i}].r_0[{k}]": values for k, values in enumerate(position, 1)}
        wheels.append({"name": name, "tier": tier, "instance": instance, "index": i, "rover_index": i})
    assert not signals, f"no such signals: {signals}"
    texts = {"unit": ("channel", ["1"] * len(columns)), "description": ("channel", [""] * len(columns))}
    return xr.Dataset(
        {"series": (("time", "channel"), np.column_stack(list(columns.values())))},
        {"time": np.arange(len(x)) * 1e-3, "channel": list(columns), **texts},
        {"wheels": json.dumps(wheels), "ground_z": 0.0, "scheme": "ij", "step_s": 1e-3},
    )
