"""BxB, SxB, SxB+ and SxS side by side: what is run, what is measured, what is written and printed."""

import json
import re

import numpy as np
import pytest
from made_up_drives import made_up_drive
from typer.testing import CliRunner

from fmus import CLAIMS
from orchestrator import cli, terminal
from orchestrator.claims import load_claims
from orchestrator.compare import DRIVES, compare
from orchestrator.results import Channel, ResultError, ResultWriter
from orchestrator.run import Outcome, RunError

#: Wall times of the loops [s].
WALL = {"BxB": 2.0, "SxB": 3.0, "SxB+": 3.2, "SxS": 4.6}


def save(drive, path):
    """Write a result as a run does."""
    path.parent.mkdir(parents=True)
    channels = [Channel(str(name), str(drive.unit.values[i]), "") for i, name in enumerate(drive.channel.values)]
    with ResultWriter(path, channels, drive.attrs) as writer:
        for t, row in zip(drive.time.values, drive.series.values):
            writer.append(t, row)


@pytest.fixture
def stage(monkeypatch):
    """Drives that take the place of real ones, by run; what was asked of each is collected in ``stage.asked``."""

    class Stage:
        asked = []
        drives = {run: {"end": 0.4, "front_sinkage": 0.02} for run in DRIVES}
        status = "complete"

    def simulate(source, out, *, tiers, progress, status, **options):
        stage.asked.append((str(source), out.name, tiers, options))
        status("loading models")
        save(made_up_drive(tiers=tiers, **stage.drives[out.name]), out / "result.nc")
        warnings = ["it is late"] if out.name == "SxB" else []
        return Outcome(out / "result.nc", 17.0, WALL[out.name], stage.status, "ij", 1e-3, warnings)

    def write(runs, out):
        assert list(runs) == list(DRIVES) and out.is_dir()
        return [out / "fig_8_12.png"]

    stage = Stage()
    monkeypatch.setattr("orchestrator.compare.simulate", simulate)
    monkeypatch.setattr("orchestrator.pictures.write", write)
    return stage


def cdl(*arguments):
    done = CliRunner().invoke(cli.app, [str(a) for a in arguments], env={"COLUMNS": "200"})
    if done.exception and not isinstance(done.exception, SystemExit):
        raise done.exception
    return done


def test_drives_that_differ_in_their_tiers_and_in_what_wheels_feel(tmp_path, stage):
    compare("two_wheel", tmp_path, overrides={"soil.phi": 0.6}, stop_time=9.0)
    tiers = {"BxB": ("BCM", "BCM"), "SxB": ("SCM", "BCM"), "SxB+": ("SCM", "BCM"), "SxS": ("SCM", "SCM")}
    own = {"BxB": {"bcm.compaction": False}, "SxB": {"bcm.compaction": False}, "SxB+": {"bcm.compaction": True}}
    options = {run: {"soil": None, "overrides": {"soil.phi": 0.6} | own.get(run, {}), "stop_time": 9.0} for run in tiers}
    assert stage.asked == [("two_wheel", run, tiers[run], options[run]) for run in tiers]


def test_values_of_a_tier_go_to_the_drives_that_have_it(tmp_path, stage):
    compare("two_wheel", tmp_path, overrides={"scm.cell": 0.02, "bcm.eta": 0.3, "soil.phi": 0.6})
    given = [set(options["overrides"]) for *_, options in stage.asked]
    mixed = {"scm.cell", "bcm.eta", "soil.phi"}
    assert given == [{"bcm.eta", "soil.phi", "bcm.compaction"}, *[mixed | {"bcm.compaction"}] * 2, {"scm.cell", "soil.phi"}]


def test_facts_are_numbers_by_run_and_signal(tmp_path, stage):
    stage.drives["SxB"] |= {"front_F_x": 3.0, "rear_z": 0.098, "rear_y": lambda x: np.where(x > 0.2, 0.01, 0.0), "front_y": 0.02}
    facts = compare("two_wheel", tmp_path).facts()
    assert json.loads((tmp_path / "comparison.json").read_text()) == json.loads(json.dumps(facts))
    assert facts["time_factors"] == pytest.approx({"BxB": 1.0, "SxB": 1.5, "SxB+": 1.6, "SxS": 2.3})
    assert {run: run_facts["result"] for run, run_facts in facts["runs"].items()} == {run: f"{tmp_path}/{run}/result.nc" for run in DRIVES}
    assert set(facts["runs"]["BxB"]) == {"simulated_s", "wall_s", "scheme", "step_s", "result", "wheels"}
    assert [wheel["tier"] for wheel in facts["runs"]["SxB"]["wheels"]] == ["SCM", "BCM"]
    assert facts["span_m"] == pytest.approx([0.0, 0.4])
    assert list(facts["rms"]) == ["BxB", "SxB", "SxB+"] and not any(facts["rms"]["BxB"].values())
    rms = {name: value for name, value in facts["rms"]["SxB"].items() if value}
    half_way = 0.01 * np.sqrt(0.5)
    expected = {"front.F_x": 3.0, "rear.z": 2e-3, "rear.y": half_way, "rear.path": half_way, "front.y": 0.02, "front.path": 0.02}
    assert rms == pytest.approx(expected, rel=5e-3)
    assert {facts["rms_units"][name] for name in ("front.F_x", "rear.F_y")} == {"N"} and facts["rms_units"]["rear.path"] == "m"


def test_the_distance_of_paths_is_square_to_the_path(tmp_path, stage):
    stage.drives["SxS"] |= {"rear_y": lambda x: x}
    stage.drives["BxB"] |= {"rear_y": lambda x: x + 0.01}
    rms = compare("two_wheel", tmp_path).rms["BxB"]
    assert rms["rear.y"] == pytest.approx(0.01, rel=1e-2)
    assert rms["rear.path"] == pytest.approx(0.01 / np.sqrt(2), rel=1e-2)


def test_each_claim_says_what_was_measured(tmp_path, stage):
    stage.drives["BxB"] |= {"rear_F_z": 300.0}
    claims = {claim["id"]: claim for claim in compare("two_wheel", tmp_path).facts()["claims"]}
    assert list(claims) == [claim.id for claim in load_claims(CLAIMS)]
    shifted = claims["start_load_shift"]
    assert (shifted["holds"], shifted["must"], shifted["unit"], shifted["relation"]) == (False, True, "N", "SxS > BxB")
    assert (shifted["measured"], shifted["left"], shifted["right"]) == pytest.approx((-35.0, 0.0, 35.0))
    assert (shifted["threshold"], shifted["noise"]) == pytest.approx((2.6, 0.0))
    assert shifted["place"] == "8.5.1, 0-0.1 m" and shifted["text"].endswith(".")
    assert claims["time_order"]["holds"] is True
    unreached = claims["end_stationary"]
    assert {unreached[key] for key in ("holds", "measured", "threshold", "noise", "relation")} == {None}


def test_tables_for_people(tmp_path, stage):
    stage.drives["SxB"] |= {"rear_z": 0.0985, "rear_F_x": -12.0}
    compare("two_wheel", tmp_path)
    text = (tmp_path / "comparison.md").read_text()
    assert "| rear.z | 0 mm | 1.5 mm | 0 mm |" in text and "| rear.F_x | 0 N | 12 N | 0 N |" in text
    assert "| SxB | 3 s | 1.50 | 1.5 |" in text and "| SxB+ | 3.2 s | 1.60 |  |" in text and "for 17 simulated s each" in text
    assert re.search(r"## Statements of section 8.5: \d+ of 20 that must hold do, and \d+ of 50 others", text)
    assert re.search(r"\| must \| BxB < SxB \| 1 \| 1.5 \| -0.5 \| 0.05 \| yes \|", text)
    assert re.search(r"After 1.6 m the forces are stationary .* \| must \|  \|  \|  \|  \|  \| not reached \|", text)
    assert "![fig_8_12](fig_8_12.png)" in text


def test_a_drive_that_never_moves_reaches_nothing(tmp_path, stage):
    stage.drives = {run: {"x": [0.0]} for run in DRIVES}
    comparison = compare("two_wheel", tmp_path)
    assert comparison.span is None and comparison.rms == {"BxB": {}, "SxB": {}, "SxB+": {}}
    assert {verdict.claim.id for verdict in comparison.verdicts if verdict.holds is not None} == {"time_order", "time_SxS", "time_SxB"}
    assert "over nothing: the rear wheel did not move" in (tmp_path / "comparison.md").read_text()


def test_an_interrupt_ends_the_comparison(tmp_path, stage):
    stage.status = "interrupted"
    done = cdl("compare", "two_wheel", "--out", tmp_path)
    assert (done.exit_code, done.stderr.splitlines()[-1], len(stage.asked)) == (130, "interrupted", 1)


def test_what_cannot_be_compared_is_refused(tmp_path, stage):
    with pytest.raises(RunError, match=r"rover.ssp is a finished system, .* compare an experiment, such as two_wheel"):
        compare("rover.ssp", tmp_path)
    text = "single_wheel has the wheel wheel: a comparison needs a front and a rear wheel, as two_wheel has them"
    with pytest.raises(RunError, match=text):
        compare("single_wheel", tmp_path)
    with pytest.raises(RunError, match=r"--set bcm.compaction: a comparison runs both, SxB without and SxB\+ with it; leave it out"):
        compare("two_wheel", tmp_path, overrides={"bcm.compaction": True})
    assert not stage.asked
    stage.drives["BxB"] |= {"names": ("left", "right")}
    with pytest.raises(ResultError, match="the result has the wheels left, right: a comparison needs a front and a rear one"):
        compare("two_wheel", tmp_path)
    assert len(stage.asked) == 1


# -- the command


def test_json_is_one_object_and_failing_claims_are_no_failure(tmp_path, stage):
    done = cdl("compare", "two_wheel", "--json", "--out", tmp_path, "--set", "soil.phi=0.6", "--stop-time", 3)
    facts = json.loads(done.stdout)
    assert done.exit_code == 0 and done.stderr == "warning: SxB: it is late\n"
    assert {"runs", "time_factors", "rms", "claims"} <= set(facts)
    assert False in [claim["holds"] for claim in facts["claims"]]
    assert stage.asked[3][3] == {"soil": None, "overrides": {"soil.phi": 0.6}, "stop_time": 3.0}


def test_tables_and_progress_of_each_run(tmp_path, stage):
    done = cdl("compare", "two_wheel", "--out", tmp_path)
    assert [line for line in done.stderr.splitlines() if "loading" in line] == [f"{run}: loading models" for run in DRIVES]
    assert re.search(r"SxS +4.6 s +2.30 +2.3", done.stdout)
    assert re.search(r"BxB is fastest and SxS slowest. +must +BxB < SxB +1 +1.5 +-0.5 +0.05 +yes", done.stdout)
    assert done.stdout.splitlines()[-3:] == [str(tmp_path / name) for name in ("comparison.json", "comparison.md", "fig_8_12.png")]


def test_results_go_where_the_experiment_says(tmp_path, stage, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert cdl("compare", "two_wheel").exit_code == 0
    assert (tmp_path / "results" / "compare_two_wheel" / "comparison.json").exists()


def test_the_command_refuses_what_cannot_be_compared():
    done = cdl("compare", "rover.ssp")
    assert done.exit_code == 2 and done.stderr.startswith("error: rover.ssp is a finished system")
    assert cdl("compare", "single_wheel").stderr.startswith(
        "error: single_wheel has the wheel wheel: a comparison needs a front and a rear"
    )
    text = "error: no experiment 'nowhere': use one of rocks_in_sand, single_wheel, two_wheel or the path of a .toml file"
    assert text in cdl("compare", "nowhere").stderr


def test_lines_of_progress_name_their_run(capsys):
    with terminal.follow(quiet=False, run="SxB") as display:
        display.status("loading models")
    assert capsys.readouterr().err == "SxB: loading models\n"
