"""Validation: how a row is judged and shown, what checks make of what is measured, and the report."""

import json
import math
import re

import numpy as np
import pytest
from matplotlib.figure import Figure
from test_cli import cdl

from orchestrator import side_by_side, validate
from orchestrator.measurement import QUANTITIES
from orchestrator.side_by_side import Crew
from orchestrator.validate import (
    bench,
    closed_forms,
    cmu,
    identification,
    multipass,
    predictions,
    repetitive,
    scm,
    sensitivities,
    single_wheel,
    slopes,
)
from orchestrator.validate.report import Report
from orchestrator.validate.rows import COLUMNS, Findings, Row, Table, absolute, limited, relative, rms


class MadeUp:
    """A bench on which each point measures what ``answer`` says of it."""

    def __init__(self, answer, quick=False):
        self.answer, self.quick, self.asked = answer, quick, []

    def measure(self, points):
        self.asked += points
        return [{**dict.fromkeys(QUANTITIES, 0.0), "stationary": True} | self.answer(point) for point in points]


def as_measured(point, sinkage=1.0, pull=0.0):
    """The mean of the trials at a point's slip, sinkage times a factor, and drawbar pull with so many loads more."""
    level = cmu.level_at(point["slip"])
    return {"sinkage_m": sinkage * level.sinkage, "drawbar_pull_N": (level.pull + pull) * level.load}


# -- rows


@pytest.mark.parametrize(
    "error, bar, passed, text",
    [
        (0.1, None, None, ""),
        (0.1, (-0.15, 0.15), True, "within 15 %"),
        (-0.16, (-0.15, 0.15), False, "within 15 %"),
        (0.1, (None, 0.1), True, "at most 10 %"),
        (0.04, (0.05, None), False, "at least 5 %"),
        (3.0, (0.4, 2.5), False, "40 % to 250 %"),
        (0.0, (0.0, 0.0), True, "within 0 %"),
        (math.nan, (None, 0.1), False, "at most 10 %"),
        (None, (None, 0.1), False, "at most 10 %"),
    ],
)
def test_a_row_is_judged_by_its_bar(error, bar, passed, text):
    row = Row("SCM", "tests", "sinkage", error=error, error_unit="share", bar=bar)
    assert row.passed is passed and row.facts()["passed"] is passed
    verdict = {True: "pass", False: "miss", None: ""}[passed] if error is None or math.isfinite(error) else "not run"
    assert row.cells()[-2:] == [text, verdict]


def test_a_bar_may_ask_for_a_stationary_run():
    for stationary, steady, passed in ((False, False, True), (False, True, False), (True, True, True)):
        row = relative("SCM", "tests", "sinkage", 0.02, 0.021, "m", 0.1, stationary=stationary, steady=steady)
        assert row.passed is passed
        assert ("(!)" in row.cells()[4]) is not stationary and (row.cells()[6] == "within 10 %, steady") is steady


def test_cells_are_in_the_units_of_tables():
    cells = [
        relative("SCM", "tests", "sinkage", 0.02, 0.019, "m", 0.15).cells(),
        absolute("BCM", "tests", "pull", -0.5, -0.42, "W", 0.07).cells(),
        absolute("SCM", "heap", "slope", 0.5, 0.5 + math.radians(1), "rad", math.radians(2)).cells(),
        relative("BCM", "tests", "sinkage", 0.02, math.nan, "m", 0.15).cells(),
    ]
    assert cells[0] == ["SCM", "tests", "sinkage", "20 mm", "19 mm", "-5 %", "within 15 %", "pass"]
    assert cells[1][3:] == ["-0.5 W", "-0.42 W", "0.08 W", "within 0.07 W", "miss"]
    assert cells[2][5:] == ["1 deg", "within 2 deg", "pass"]
    assert cells[3][4:] == ["none", "none", "within 15 %", "not run"]
    assert rms([3.0, -4.0]) == pytest.approx(math.sqrt(12.5))


# -- runs


def test_each_point_is_run_once_and_one_that_fails_has_no_numbers(monkeypatch):
    def run(point):
        ran.append(point["slip"])
        if point["slip"] == 0.9:
            raise ValueError("too deep")
        return {"sinkage_m": point["slip"], "stationary": True}

    ran, said = [], []
    monkeypatch.setattr(bench, "measure", run)
    with Crew(1) as crew:
        made = bench.Bench(crew, status=said.append)
        made.about = "wheel"
        points = [{"tier": "SCM", "slip": slip, "load_N": 24.0} for slip in (0.1, 0.9, 0.1)]
        first, failed, again = made.measure(points)
        assert made.measure(points[:1]) == [first] == [again]
    assert ran == [0.1, 0.9] and first["sinkage_m"] == 0.1
    assert math.isnan(failed["sinkage_m"]) and not failed["stationary"]
    assert made.failed == ["wheel: slip=0.9: ValueError: too deep"]
    assert said[:2] == ["wheel: slip=0.1: started, 2 of 2 left", "wheel: slip=0.1: done, 1 of 2 left"]


def test_points_are_named_by_what_tells_them_apart():
    level = cmu.level_at(0.5)
    grousers = cmu.point("SCM", level, {"wheel.n_g": 24, "wheel.h_g": 0.005})
    names = bench._names([cmu.point("SCM", level), cmu.point("BCM", level), grousers])
    assert names == ["tier=SCM, wheel.n_g=0", "tier=BCM, wheel.n_g=0", "tier=SCM, wheel.n_g=24"]


def test_levels_are_the_means_of_the_trials_at_a_slip():
    levels = cmu.levels()
    assert [level.slip for level in levels] == [-1.0, -0.7, -0.5, -0.2, 0.0, 0.23, 0.5, 0.75, 0.9]
    assert {len(level.trials) for level in levels} == {3}
    first = cmu.level_at(-1.0)
    assert (first.load, first.sinkage, first.pull) == pytest.approx((19.5022, 0.0503139, -38.8447 / 19.5022), rel=1e-4)
    assert cmu.levels(quick=True) == [cmu.level_at(slip) for slip in (-1.0, -0.5, 0.0, 0.5, 0.9)]


# -- checks


def misses(findings):
    return [(row.model, row.quantity) for row in findings.rows if row.passed is False]


def test_a_model_that_is_as_measured_keeps_every_bar_of_the_single_wheel():
    made_up = MadeUp(as_measured)
    findings = single_wheel.check(made_up)
    assert misses(findings) == []
    assert len(made_up.asked) == 27
    assert {point["load_N"] for point in made_up.asked} == {level.load for level in cmu.levels()}
    skid = next(point for point in made_up.asked if point["slip"] == -1.0)
    assert skid["travel"] == 1.0 and skid["scm.cell"] == 0.005 and skid["soil.set"] == "cmu_sand"


def test_a_model_off_by_a_bar_misses_it():
    deep = single_wheel.check(MadeUp(lambda point: as_measured(point, sinkage=1.16)))  # BCM may be off by 30 %
    inside = ["-0.5", "-0.2", "0", "0.23", "0.5", "0.75", "0.9"]
    assert misses(deep) == [("SCM", f"sinkage, s = {slip}") for slip in inside] + [("SCM", "sinkage, rms over s = -0.5 to 0.9")]
    strong = misses(single_wheel.check(MadeUp(lambda point: as_measured(point, pull=0.05))))
    assert ("SCM", "drawbar pull, rms over s = 0 to 0.9") in strong and ("SCM", "drawbar pull, rms over s = -0.5 to 0.9") not in strong
    weak = misses(single_wheel.check(MadeUp(lambda point: as_measured(point, pull=-0.16 if point["tier"] == "BCM" else 0.0))))
    assert weak[0] == ("BCM", "drawbar pull, s = -0.5") and len(weak) == 7 + 1
    digging = single_wheel.check(MadeUp(lambda point: as_measured(point) | {"stationary": False}))
    assert misses(digging)[:2] == [("SCM", "sinkage, s = -1"), ("SCM", "sinkage, s = -0.7")] and len(misses(digging)) == 2


def test_a_law_of_slip_sinkage_has_rows_of_its_own(monkeypatch):
    monkeypatch.setattr(single_wheel, "_SLIP_SINKAGE", {"bcm.law": "on"})
    made_up = MadeUp(lambda point: as_measured(point, sinkage=1.2 if "bcm.law" in point else 1.0))
    findings = single_wheel.check(made_up)
    assert misses(findings) == [] and sum(row.model == "BCM, slip sinkage" for row in findings.rows) == 7
    assert {point["tier"] for point in made_up.asked if "bcm.law" in point} == {"BCM"}


def test_sensitivities_change_one_constant_at_a_time(monkeypatch):
    monkeypatch.setattr(sensitivities, "_CONSTANTS", (("scm.plasticity", True), ("soil.K", False)))
    made_up = MadeUp(lambda point: {"sinkage_m": 0.01 * (2.0 if "soil.K" in point else 1.0), "drawbar_pull_N": point.get("soil.K", 0.0)})
    (table,) = sensitivities.check(made_up).tables
    assert len(made_up.asked) == 4 * (1 + 2 * 2) and len(table.rows) == 8
    changed = [{key: point[key] for key in ("scm.plasticity", "soil.K") if key in point} for point in made_up.asked[::4]]
    assert [list(point) for point in changed] == [[], *[["scm.plasticity"]] * 2, *[["soil.K"]] * 2]
    assert [value for point in changed for value in point.values()] == pytest.approx([0.42, 0.78, 0.0147, 0.0273])
    assert [row[0] for row in table.rows[::4]] == ["scm.plasticity (fitted)", "soil.K"]
    assert table.rows[4][3:] == pytest.approx([100.0, 100.0, *(k / cmu.level_at(-0.5).load for k in (0.0147, 0.0273))])


def test_a_share_is_not_raised_above_one(monkeypatch):
    monkeypatch.setattr(sensitivities, "_value", lambda name: 0.9)
    assert sensitivities._changed("scm.plasticity", 0.3) == 1.0


def test_predictions_are_of_both_wheels_on_both_tiers():
    made_up = MadeUp(lambda point: {"lateral_force_N": -point["load_N"] * point["slip_angle"]})
    findings = predictions.check(made_up)
    assert len(made_up.asked) == 2 * 2 * 4 * 4 and not findings.rows
    (table,) = findings.tables
    assert table.rows[-1][:3] == ["24 grousers", 45.0, 0.9]
    assert table.rows[-1][5] == pytest.approx(-math.pi / 4)
    assert {point["wheel.h_g"] for point in made_up.asked if point["wheel.n_g"]} == {0.005}


def test_grids_are_compared_with_one_another():
    def finer_is_deeper(point):
        return {"sinkage_m": 0.02 * (1.04 if point["scm.cell"] == 0.0025 else 1.0 + 0.1 * ("carriage.heading" in point))}

    rows = scm.grid(MadeUp(finer_is_deeper)).rows
    assert len(rows) == 3 * (3 + 4 + 2)
    assert misses(Findings(rows)) == [
        ("SCM", f"sinkage, travel along 45 deg, CMU smooth wheel, s = {slip}") for slip in ("-0.5", "0", "0.5")
    ]


def test_heaps_and_plates_keep_their_bars():
    for findings in (scm.soil(None), identification.check(None)):
        assert findings.rows and all(row.passed for row in findings.rows)


def test_passes_are_judged_by_what_each_adds(monkeypatch):
    def findings(ruts, resistances, lost=0.0):
        passes = [multipass.Pass(1e-3 * rut + 1e-3, 1e-3 * rut, 8.0, resistance) for rut, resistance in zip(ruts, resistances)]
        monkeypatch.setattr(multipass, "_WHEELS", {"wheel": {"load_N": 10.0}})
        monkeypatch.setattr(multipass, "_SOILS", {"": {}})
        monkeypatch.setattr(multipass, "drive", lambda point, n: multipass.Rut(passes, lost, 0.0, 1.0))
        return multipass.check(MadeUp(None))

    found = findings([10, 13, 15], [3.0, 2.0, 2.0])
    assert not misses(found) and [row.error for row in found.rows[:3]] == pytest.approx([2e-3, -1e-3, -0.1])
    (table,) = found.tables
    assert table.rows[1][:2] == ["wheel", "2"] and table.rows[1][2:] == pytest.approx([14.0, 4.0, 13.0, 0.8, 0.2])
    digging = misses(findings([10, 12, 15], [2.0, 3.0, 3.0], 1e-20))
    assert [quantity.partition(",")[0] for _, quantity in digging] == [
        "depth that a pass adds less what the one before added",
        "resistance",
        "soil moved and compacted in 3 passes",
    ]
    assert [quantity for _, quantity in misses(findings([10, 9], [2.0, 1.0]))] == ["depth that a pass adds to the rut, least, wheel"]


def test_passes_in_compressible_soil_are_judged_by_the_first_and_by_soil_that_keeps_its_density(monkeypatch):
    def drive(point, n):
        ruts, pulls = ([10, 11, 11], [3, 2, 4]) if "scm.compressible" in point else ([10, 13, 15], [3, 2, 2])
        return multipass.Rut([multipass.Pass(1e-3, 1e-3 * rut, pull, 5.0 - pull) for rut, pull in zip(ruts, pulls)], 0.0, 1e-20, 1.01)

    monkeypatch.setattr(multipass, "_WHEELS", {"wheel": {"load_N": 10.0}})
    monkeypatch.setattr(multipass, "drive", drive)
    found = multipass.check(MadeUp(None))
    compressible = [row for row in found.rows if row.quantity.endswith("wheel, compressible")]
    assert [row.error for row in compressible[-4:]] == pytest.approx([-0.1, 0.2, -4e-3, 1.01])
    assert [row.passed for row in compressible[-5:]] == [False, False, True, True, False]
    assert [row[0] for row in found.tables[0].rows] == ["wheel"] * 3 + ["wheel, compressible"] * 3


def test_repetitive_loading_is_judged_by_branch():
    rows = repetitive.check(None).rows
    assert [row.quantity.partition(",")[2] for row in rows[:4]] == [
        f" {branch}, k_0 = 2e7 Pa/m" for branch in ("loading", "unloading", "reloading", "further loading")
    ]
    assert len(rows) == 3 * 5 and all(row.passed for row in rows if row.against != "Wong: p_u - k_u (z_u - z)")


def test_slopes_are_judged_by_equilibrium_and_by_the_wheel_on_level_ground(monkeypatch):
    def findings(more=0.0, slip=0.0):
        def drive(tier, degrees, uphill=0.0):
            angle = math.radians(degrees)
            along = math.sin(angle) * (math.cos(uphill) + more) * slopes._WEIGHT
            both, aside = (math.tan(angle) * math.cos(uphill) + slip,) * 2, -0.1 * math.sin(uphill)
            load = math.cos(angle) * slopes._WEIGHT
            side = math.sin(angle) * math.sin(uphill) * slopes._WEIGHT
            return slopes.Drive(along, side, load, both[0] - slip, both, (aside, aside), np.zeros((3, 2)), aside)

        monkeypatch.setattr(slopes, "drive", drive)
        monkeypatch.setattr(slopes, "_HEAPS", {True: ()})
        return slopes.check(MadeUp(lambda point: {"drawbar_pull_N": point["slip"] * point["load_N"]}, quick=True))

    found = findings()
    assert found.rows and not misses(found) and found.figure is not None
    (table,) = found.tables
    assert table.rows[-1][:3] == ["SCM", "across", 10.0] and table.rows[-1][-1] == pytest.approx(math.degrees(-0.1), abs=1e-3)
    assert misses(findings(more=0.1))[:2] == [("BCM", f"drawbar pull, both wheels, 10 deg {course}") for course in ("up", "down")]
    worse = [quantity for _, quantity in misses(findings(slip=0.03))]
    assert worse == [
        what for _ in "BS" for what in ("drawbar pull / load of the front wheel, 10 deg up", "slip, mean of the wheels, 10 deg up")
    ]


def test_bcms_closed_forms_hold_in_process():
    rows = [*(closed_forms._shallow(eta) for eta in (0.0, 1.0)), closed_forms._resistance(0.02)]
    assert all(row.passed for row in rows)
    assert closed_forms._at_rest(27.0 * 9.81) == pytest.approx(26.65e-3, rel=1e-3)


# -- the report


@pytest.fixture
def registry(monkeypatch):
    """A registry of two checks, one of which cannot be run."""

    def made_up(bench):
        """A made-up check"""
        rows = [
            relative("SCM", "tests | of a kind", "sinkage", 0.02, 0.03, "m", 0.15, stationary=False),
            limited("BCM", "tests", "pull, rms", 0.05, "W", (None, 0.08)),
            absolute("BCM", "tests", "pull", 0.1, math.nan, "W"),
        ]
        figure = Figure()
        figure.subplots()
        return Findings(rows, figure, [Table("Numbers", ["slip", "sinkage"], [[0.5, math.nan], [0.9, 12.3456]])], "What was run.")

    def broken(bench):
        """A check with a bug"""
        raise ZeroDivisionError("no wheel")

    monkeypatch.setattr(validate, "CHECKS", {"made_up": made_up, "broken": broken})
    monkeypatch.setattr(side_by_side, "cores", lambda: 1)


def test_a_report_has_table_figures_and_the_same_as_json(tmp_path, registry):
    said = []
    report = validate.validate(tmp_path / "new", status=said.append)
    assert {path.name for path in report.out.iterdir()} == {"README.md", "results.json", "made_up.png"}
    text = (report.out / "README.md").read_text()
    assert "Written by `cdl validate`; every number below is from that run. 1 of 2 bars are kept, 1 failed to run." in text
    assert f"| {' | '.join(COLUMNS)} |\n" in text
    assert "| SCM | tests \\| of a kind | sinkage | 20 mm | 30 mm (!) | 50 % | within 15 % | miss |\n" in text
    assert "## A made-up check\n\nWhat was run.\n\n![A made-up check](made_up.png)\n\n### Numbers\n" in text
    assert "| 0.5 | none |\n| 0.9 | 12.3 |" in text and "## Failed\n\n- broken: ZeroDivisionError: no wheel\n" in text
    facts = json.loads((report.out / "results.json").read_text(), parse_constant=lambda text: pytest.fail(f"{text} is no JSON"))
    assert facts == json.loads(json.dumps(report.facts()))
    row = facts["checks"]["made_up"]["rows"][0]
    assert (row["expected"], row["computed"], row["unit"], row["bar"], row["passed"]) == (0.02, 0.03, "m", [-0.15, 0.15], False)
    assert facts["checks"]["made_up"]["rows"][2]["computed"] is None and not facts["quick"]
    assert said == ["made_up: A made-up check", "broken: A check with a bug"]


def test_the_command_prints_the_table_and_fails_where_a_run_did(tmp_path, registry):
    done = cdl("validate", "--out", tmp_path)
    assert done.exit_code == 2 and done.stderr.splitlines()[-1] == "error: broken: ZeroDivisionError: no wheel"
    assert re.search(r"sinkage +20 mm +30 mm \(!\) +50 % +within 15 % +miss", done.stdout)
    lines = done.stdout.splitlines()
    assert lines[-4:] == [
        "1 of 2 bars are kept, 1 failed to run",
        *(f"{tmp_path}/{n}" for n in ("README.md", "results.json", "made_up.png")),
    ]
    as_json = cdl("validate", "--json", "--quick", "--out", tmp_path)
    assert json.loads(as_json.stdout) == json.loads((tmp_path / "results.json").read_text()) and json.loads(as_json.stdout)["quick"]


def test_results_go_into_the_checkout_and_quick_ones_elsewhere(tmp_path, registry, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("orchestrator.cli_validate.home", lambda: tmp_path / "checkout")
    cdl("validate")
    cdl("validate", "--quick")
    assert (tmp_path / "checkout" / "validation" / "README.md").exists() and (tmp_path / "results" / "validation" / "README.md").exists()


def test_every_check_has_a_title_of_its_own():
    titles = [check.__doc__.splitlines()[0] for check in validate.CHECKS.values()]
    assert len(set(titles)) == len(titles) and set(validate.CHECKS) > validate.SLOW


@pytest.mark.slow
def test_a_quick_validation_runs_and_what_must_hold_whatever_the_physics_holds(tmp_path):
    report = validate.validate(tmp_path, quick=True)
    assert isinstance(report, Report) and not report.failed
    assert set(report.findings) == set(validate.CHECKS) - validate.SLOW
    for name in ("scm_grid", "scm_soil", "multipass", "closed_forms", "identification"):
        assert all(row.passed is not False or row.against == "Holm 1969" for row in report.findings[name].rows)
    assert all(path.stat().st_size < 150e3 for path in report.pictures.values())
