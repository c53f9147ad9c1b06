"""Both tiers against closed forms of a smooth wheel in soil without shear strength."""

from __future__ import annotations

import math

import numpy as np
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.special import beta

from cdl_fmu.bcm import BCM
from cdl_fmu.slave.model import Instance
from cdl_fmu.soil import load_soil
from cdl_fmu.wheel import WHEEL

from .bench import ROVER_WHEEL_LOAD, Bench, Point
from .rows import Findings, Row, relative

# Bars: of BCM's forces, and of runs on the testbed.
_BETA, _RESISTANCE = 0.01, 1e-6
_REST, _RUN_RESISTANCE = 5e-3, 0.02

_SET = "mss_d"
_SOIL = load_soil(_SET)
_R, _B = WHEEL.fields["r_w"].start, WHEEL.fields["b_w"].start  # of Table 8.2
_N, _K_EQ = _SOIL["n"], _SOIL["k_c"] / _B + _SOIL["k_phi"]
_LOADS = (100.0, ROVER_WHEEL_LOAD)  # N
_WORK = "-b k z^(n+1) / (n+1)"
_SHALLOW = 0.02  # sinkage / diameter up to which the parabola of the Beta form is good for 1 %

#: A smooth wheel in soil that bears, shears nothing, and is compacted where it is pressed.
_BARE: Point = {"soil.set": _SET, "soil.phi": 0.0, "soil.c": 0.0, "soil.rho": 0.0, "wheel.n_g": 0, "slip": 0.0, "carriage_speed": 0.1}
_PLASTIC: Point = {"scm.plasticity": 0.0, "scm.transport_depth": 0.0, "scm.erosion_sweeps": 0, "scm.strength": "plates", "scm.k_0": 1e10}
_AT_REST: Point = {"carriage_speed": 0.0, "wheel_rate": 0.0, "run.stop_time": 3.0}


def check(bench: Bench) -> Findings:
    """Closed forms of a wheel in soil without shear strength"""
    runs = [{**_BARE, "tier": tier, "load_N": load, **(_PLASTIC if tier == "SCM" else {})} for tier in ("BCM", "SCM") for load in _LOADS]
    facts = bench.measure([*({**run, **_AT_REST} for run in runs), *runs])
    rows = [*(_shallow(eta) for eta in (0.0, 1.0)), *(_resistance(z) for z in (0.01, 0.03))]
    for run, rest, rolled in zip(runs, facts, facts[len(runs) :]):
        tier, where = run["tier"], f"on the testbed, {run['load_N']:.4g} N"
        sinkage, pull = rest["sinkage_m"], rolled["drawbar_pull_N"]
        rows.append(relative(tier, "Bekker's law over the rim", f"sinkage at rest {where}", _at_rest(run["load_N"]), sinkage, "m", _REST))
        work, more = -_work(rolled["sinkage_m"]), {"stationary": rolled["stationary"]}
        rows.append(relative(tier, _WORK, f"drawbar pull, rolling {where}", work, pull, "N", _RUN_RESISTANCE, **more))
    return Findings(
        rows,
        note="Smooth wheel of Table 8.2 on its soil without friction, cohesion and weight. What it loses a metre is the work of pressing "
        "the rut; a standing wheel is borne by Bekker's pressure over the whole rim, a rolling one in plastic soil by its front half.",
    )


def _shallow(eta: float) -> Row:
    """Sinkage of BCM under the load that the Beta form, in which the rim is a parabola, gives for a shallow one."""
    z = _SHALLOW * 2.0 * _R
    load = 0.5 * (1.0 + eta) * _B * _K_EQ * math.sqrt(2.0 * _R) * beta(_N + 1.0, 0.5) * z ** (_N + 0.5)
    found = brentq(lambda depth: _force(depth, eta)[2] - load, 0.5 * z, 2.0 * z)
    return relative("BCM", "Beta form", f"sinkage, {load:.3g} N, exit angle {eta:g} of the entry angle", z, found, "m", _BETA)


def _resistance(z: float) -> Row:
    return relative("BCM", _WORK, f"F_x, {1e3 * z:g} mm deep", -_work(z), float(_force(z, 0.0)[0]), "N", _RESISTANCE)


def _work(z: float) -> float:
    """Work [J/m] of pressing a rut of this depth [m]."""
    return _B * _K_EQ * z ** (_N + 1.0) / (_N + 1.0)


def _at_rest(load: float) -> float:
    """Sinkage [m] of a standing wheel under a load [N]."""

    def borne(z: float) -> float:
        theta_1 = math.acos(1.0 - z / _R)
        pressure = quad(lambda theta: (_R * (math.cos(theta) - math.cos(theta_1))) ** _N * math.cos(theta), 0.0, theta_1)[0]
        return 2.0 * _B * _R * _K_EQ * pressure

    return brentq(lambda z: borne(z) - load, 1e-4, 0.5 * _R)


def _force(z: float, eta: float) -> np.ndarray:
    """Force [N] of BCM on a wheel z [m] deep that moves forwards."""
    instance = Instance(BCM(), **_SOIL | dict(phi=0.0, c=0.0, rho=0.0, n_g=0.0, eta=eta))
    instance.initialise()
    wheel = instance.u.wheel[0]
    wheel.r_0[2], wheel.v_0[0] = _R - z, 1.0
    wheel["T"][:] = np.eye(3)
    instance.step(0.0, 1e-3)
    return instance.y.wheel[0].f_0.copy()
