"""One soil on three tiers: particles, SCM and BCM under a wheel on the testbed, Bekker's parameters from the particles' own plates."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from .experiment import load_experiment
from .run import RunError
from .single_wheel import Sweep, run_sweep
from .virtual import SOIL_FILE, VirtualSoil, run_virtual_tests

TIERS = ("DEM", "SCM", "BCM")
SLIPS = (-0.5, -0.2, 0.0, 0.1, 0.3, 0.5, 0.7, 0.9)
TABLE = "README.md"
#: The wheel, smooth as that of the CMU tests, and how it is tested: quickly, as particles cost minutes a second.
WHEEL = {"wheel.r_w": 0.058, "wheel.b_w": 0.05, "wheel.n_g": 0, "load_N": 24.0, "carriage_speed": 0.1, "travel": 0.15}
TESTBED = {"carriage.lowering_time": 0.4, "carriage.start_ramp": 0.2}
#: A bed 2.2 wheels wide and 1.4 radii deep: 25 000 particles move.
GRAINS = {"dem.d": 0.0045, "dem.depth": 0.08, "dem.fine_depth": 0.0, "dem.box_length": 0.2, "dem.box_width": 0.11}
_COLUMNS = {"sinkage_m": ("sinkage [mm]", 1e3), "drawbar_pull_N": ("pull [N]", 1.0), "torque_Nm": ("torque [N m]", 1.0)}


@dataclass(frozen=True, eq=False)
class Study:
    """What a study left in its folder: the virtual tests' results and the sweep's points."""

    out: Path
    soil: VirtualSoil
    sweep: Sweep

    def table(self) -> str:
        """Sinkage, pull and torque of the tiers at each slip, and what a point cost, in Markdown."""
        rows = {(row["tier"], row["slip"]): row for row in self.sweep.rows}
        head = ["slip", *(f"{tier} {heading}" for heading, _ in _COLUMNS.values() for tier in TIERS)]
        lines = [f"| {' | '.join(head)} |", f"|{'---|' * len(head)}"]
        for slip in self.sweep.keys["slip"]:
            cells = [f"{slip:g}"]
            for key, (_, factor) in _COLUMNS.items():
                for tier in TIERS:
                    row = rows.get((tier, slip))
                    cells.append(f"{factor * row[key]:.3g} ± {factor * row[f'{key}_std']:.2g}" if row else "-")
            lines.append(f"| {' | '.join(cells)} |")
        walls = {tier: sum(row["wall_s"] for key, row in rows.items() if key[0] == tier) for tier in TIERS}
        lines += ["", "Wall time of all points: " + ", ".join(f"{tier} {wall:.3g} s" for tier, wall in walls.items()) + "."]
        return "\n".join(lines)


def study_tiers(
    given: Mapping[str, float],
    out: Path,
    *,
    slips: Sequence[float] = SLIPS,
    overrides: Mapping[str, object] | None = None,
    processes: int | None = None,
    status: Callable[[str], None] = lambda text: None,
) -> Study:
    """Test a soil of particles virtually, then drive the wheel over it on all tiers; leaves a figure, a table and all runs in a folder.

    Args:
        given: phi [rad], c [Pa], rho [kg/m3] and porosity of the soil.
        out: Folder.
        slips: Slips of the wheel.
        overrides: Values of the experiment ``single_wheel`` in place of the study's.
        processes: Processes side by side; one for each core by default.
        status: Called with what is being done.

    Raises:
        ModelError, ExperimentError: see ``run_virtual_tests`` and :func:`orchestrator.simulate`.
        RunError: Points failed; those that did not are in the folder.
    """
    for slip in slips:  # what no run allows is said before minutes are spent
        load_experiment("single_wheel", overrides={**WHEEL, **TESTBED, **(overrides or {}), "slip": slip})
    soil = run_virtual_tests(given, out, seeds=0, status=status)
    grains = {f"dem.grain.{name}": value for name, value in soil.grains.items()}
    common = {**WHEEL, **TESTBED, **GRAINS, **grains, "dem.grains": "given", "dem.porosity": given["porosity"], **(overrides or {})}
    keys = {"slip": list(slips), "tier": list(TIERS)}
    sweep = run_sweep(keys, "single_wheel", out, soil=str(out / SOIL_FILE), overrides=common, processes=processes, status=status)
    sweep.draw(None)
    study = Study(out, soil, sweep)
    (out / TABLE).write_text(study.table() + "\n", encoding="utf-8")
    (out / "soil.json").write_text(json.dumps(soil.facts(), indent=1), encoding="utf-8")
    if sweep.failed:
        raise RunError("\n".join(sweep.failures()))
    return study
