"""Claims on drives: what can be said, how it is measured, when it holds, and that the shipped ones say what section 8.5 does."""

import numpy as np
import pytest
from made_up_drives import made_up_drive

from fmus import CLAIMS
from orchestrator.claims import RUNS, ClaimError, judge, load_claims
from orchestrator.courses import SIGNALS, Course
from orchestrator.results import ResultError

RIPPLE = 2.0  # N, with a wavelength of 4 mm: noise, whose rms is RIPPLE / sqrt(2)


def ripple(x):
    return RIPPLE * np.sin(2 * np.pi * x / 4e-3)


def write(path, quantity, compare, size=2.6, **changes):
    """A file with one claim and an effect of this size [N]; ``changes`` are lines of the record as TOML has them, None to leave one out."""
    quantity = quantity if isinstance(quantity, dict) else {"": quantity}
    lines = {"id": "'it'", "place": "'8.5.1'", "text": "'Something.'", "effect": "'force'"}
    lines |= {f"quantity.{name}" if name else "quantity": f"'{text}'" for name, text in quantity.items()}
    lines |= {"compare": [compare] if isinstance(compare, str) else compare} | changes
    record = "".join(f"{key} = {text}\n" for key, text in lines.items() if text is not None)
    path.write_text(f"[effect.force]\nvalue = {size}\nunit = 'N'\nreason = '1 %'\n\n[[claim]]\n{record}")
    return path


@pytest.fixture
def verdict(tmp_path):
    """The verdict on one claim, for drives by the run's name (the same drive for all runs if only one is given)."""

    def of(quantity, compare, drives, size=2.6, times=(1.0, 1.5, 2.3)):
        claims = load_claims(write(tmp_path / "claims.toml", quantity, compare, size))
        drives = drives if isinstance(drives, dict) else dict.fromkeys(RUNS, drives)
        (found,) = judge(claims, {run: Course(drive) for run, drive in drives.items()}, dict(zip(RUNS, times)))
        return found

    return of


# -- courses


def test_signals_are_those_of_the_place_whatever_the_speed():
    slow, fast = (Course(made_up_drive(np.linspace(0, 0.2, n), rear_F_x=lambda x: 10 * x)) for n in (3001, 401))
    assert np.array_equal(slow.x, fast.x)
    for course in (slow, fast):
        assert course.signal("rear.F_x")[1:] == pytest.approx(10 * course.x[1:])


def test_what_a_wheel_did_where_it_stands_or_slides_back_is_kept_and_the_row_of_the_start_left_out():
    x = [0.0, 0.0, 0.001, 0.0005, 0.001, 0.002]
    course = Course(made_up_drive(x, rear_F_x=lambda x: np.array([99.0, 99.0, 1.0, 5.0, 5.0, 2.0])))
    assert course.x == pytest.approx([0.0, 0.5e-3, 1e-3, 1.5e-3, 2e-3])
    assert course.signal("rear.F_x") == pytest.approx([1.0, 1.0, 1.0, 1.5, 2.0])


def test_signals_of_both_wheels():
    course = Course(
        made_up_drive(end=1.0, front_F_x=30.0, rear_F_x=-40.0, rear_F_y=30.0, front_y=lambda x: 0.1 + 0 * x, rear_y=lambda x: 0.2 * x)
    )
    at_08 = {name: course.signal(name)[..., course.window(0.8, 0.83)][..., 0] for name in SIGNALS}
    expected = {"shift.F_x": -70, "sum.F_x": -10, "larger.F_x": 40, "rear.F_xy": 50, "rear.offset": 0.06, "rover.yaw": np.atan2(-0.06, 0.6)}
    assert {name: float(at_08[name]) for name in expected} == pytest.approx(expected)
    assert at_08["total.F"] == pytest.approx(np.hypot(10, 30))
    # With the rover turned to the right, left of it is forward too.
    yaw = expected["rover.yaw"]
    assert at_08["rear.F_across"] == pytest.approx(30 * np.cos(yaw) + 40 * np.sin(yaw))
    assert at_08["all.F"] == pytest.approx([30, 0, -40, 30])
    assert at_08["both.y"] == pytest.approx([0.1, 0.16])


def test_a_rise_and_a_bend_are_no_noise_but_a_ripple_is():
    course = Course(made_up_drive(rear_F_x=lambda x: 200 * x + 800 * x**2 + ripple(x)))
    noise = course.signal("rear.F_x") - course.smooth("rear.F_x")
    assert np.sqrt(np.mean(noise[40:-40] ** 2)) == pytest.approx(RIPPLE / np.sqrt(2), rel=0.1)
    smooth = Course(made_up_drive(rear_F_x=lambda x: 200 * x + 800 * x**2))
    assert smooth.smooth("rear.F_x")[40:] == pytest.approx(smooth.signal("rear.F_x")[40:])


def test_a_result_with_other_wheels_is_refused():
    with pytest.raises(ResultError, match="the result has the wheels left, right: a comparison needs a front and a rear one"):
        Course(made_up_drive(names=("left", "right")))


def test_a_drive_that_has_not_begun_reaches_nothing():
    assert Course(made_up_drive([0.0])).window(0.0, 0.1) is None


# -- statistics


@pytest.mark.parametrize(
    "statistic, value",
    [("mean", 20), ("min", 10), ("max", 30), ("first", 10), ("last", 30), ("change", 20), ("swing", 20), ("noise", 0)],
)
def test_statistics_of_a_rise(verdict, statistic, value):
    found = verdict(f"{statistic} of rear.F_x over 0.1 to 0.3 m", "SxB > 0", made_up_drive(rear_F_x=lambda x: 100 * x))
    assert found.finding.left == pytest.approx(value, abs=1e-9)
    assert found.finding.noise == pytest.approx(0.0, abs=1e-9)


def test_extremes_and_ends_are_those_of_the_smoothed_signal(verdict):
    rippled = made_up_drive(rear_F_x=lambda x: 100 * x + ripple(x))
    for statistic, value in (("max", 30), ("first", 10)):
        finding = verdict(f"{statistic} of rear.F_x over 0.1 to 0.3 m", "SxB > 0", rippled).finding
        assert finding.left == pytest.approx(value, abs=0.3 * RIPPLE)


def test_noise_can_be_measured(verdict):
    finding = verdict("noise of rear.F_x over 0.1 to 0.3 m", "SxB > 0", made_up_drive(rear_F_x=ripple)).finding
    assert finding.left == pytest.approx(RIPPLE / np.sqrt(2), rel=0.1)


def test_distance_from_another_run(verdict):
    drives = {"BxB": made_up_drive(rear_F_x=5.0), "SxB": made_up_drive(rear_F_x=2.0, front_F_y=8.0), "SxS": made_up_drive()}
    assert verdict("rms from BxB of rear.F_x over 0.1 to 0.3 m", "SxB > 0", drives).finding.left == pytest.approx(3.0)
    of_four = np.sqrt((3.0**2 + 8.0**2) / 4)
    assert verdict("rms from BxB of all.F over 0.1 to 0.3 m", "SxB > 0", drives).finding.left == pytest.approx(of_four)


def test_time_factors_have_no_window(verdict):
    drive = made_up_drive([0.0])
    assert verdict("time factor", "BxB < SxB < SxS", drive, size=0.05).holds is True
    assert verdict("time factor", "SxB < (BxB + SxS) / 2", drive, size=0.05).finding.right == pytest.approx(1.65)
    assert verdict("time factor", "SxB < (BxB + SxS) / 2", drive, size=0.05, times=(1.0, 1.9, 2.3)).holds is False


# -- when a claim holds


@pytest.mark.parametrize(
    "compare, difference, holds",
    [
        ("SxB > BxB", 2.7, True),
        ("SxB > BxB", 2.5, False),
        ("SxB > BxB", -9.0, False),
        ("SxB < BxB", -2.7, True),
        ("SxB < BxB", -2.5, False),
        ("SxB ~ BxB", -2.5, True),
        ("SxB ~ BxB", 2.7, False),
        ("SxB > 0", 2.7, True),
        ("SxB - BxB < -5", -7.7, True),
    ],
)
def test_a_difference_counts_from_the_smallest_effect_on(verdict, compare, difference, holds):
    drives = {"BxB": made_up_drive(), "SxB": made_up_drive(rear_F_x=difference), "SxS": made_up_drive()}
    found = verdict("mean of rear.F_x over 0.1 to 0.3 m", compare, drives)
    assert found.holds is holds
    assert found.finding.threshold == 2.6


def test_the_threshold_is_twice_the_noise_of_the_difference_where_that_is_more(verdict):
    noisy = made_up_drive(rear_F_x=lambda x: 4.0 + ripple(x))
    drives = {"BxB": noisy, "SxB": made_up_drive(rear_F_x=lambda x: 7.0 + ripple(x)), "SxS": noisy}
    single = verdict("first of rear.F_x over 0.1 to 0.3 m", "SxB > BxB", drives, size=0.1)
    assert single.finding.noise == pytest.approx(np.sqrt(2) * RIPPLE / np.sqrt(2), rel=0.1)
    assert single.finding.threshold == pytest.approx(2 * single.finding.noise)
    assert single.holds is False
    # A mean over 0.2 m has ten independent values.
    mean = verdict("mean of rear.F_x over 0.1 to 0.3 m", "SxB > BxB", drives, size=0.1)
    assert mean.finding.noise == pytest.approx(single.finding.noise / np.sqrt(10))
    assert mean.holds is True


def test_noise_can_be_taken_where_the_signal_is_calm(verdict):
    drive = made_up_drive(rear_F_x=lambda x: np.where(x > 0.2, ripple(x), 0.0))
    assert verdict("mean of rear.F_x over 0.3 to 0.4 m", "SxB > 0", drive).finding.noise > 0.1
    assert verdict("mean of rear.F_x over 0.3 to 0.4 m, noise over 0.05 to 0.15 m", "SxB > 0", drive).finding.noise == pytest.approx(0.0)


def test_noise_goes_through_expressions(verdict):
    drives = dict.fromkeys(RUNS, made_up_drive(rear_F_x=ripple))
    once = verdict("first of rear.F_x over 0.1 to 0.3 m", "SxB > 0", drives).finding.noise
    assert verdict("first of rear.F_x over 0.1 to 0.3 m", "3 * SxB > 0", drives).finding.noise == pytest.approx(3 * once)
    # What is on both sides is one value, with one noise.
    assert verdict("first of rear.F_x over 0.1 to 0.3 m", "SxB > -SxB", drives).finding.noise == pytest.approx(2 * once)
    assert verdict("first of rear.F_x over 0.1 to 0.3 m", "SxB > SxB", drives).finding.noise == pytest.approx(0.0)


def test_all_comparisons_must_hold_and_the_weakest_is_shown(verdict):
    drives = {"BxB": made_up_drive(), "SxB": made_up_drive(rear_F_x=50.0), "SxS": made_up_drive(rear_F_x=51.0)}
    quantity = "mean of rear.F_x over 0.1 to 0.3 m"
    assert verdict(quantity, ["SxB > BxB", "SxS > BxB"], drives).holds is True
    chain = verdict(quantity, "BxB < SxB < SxS", drives)
    assert (chain.holds, str(chain.finding.relation), chain.finding.measured) == (False, "SxB < SxS", pytest.approx(-1.0))


def test_every_stands_for_each_run(verdict):
    drives = {"BxB": made_up_drive(rear_F_x=9.0), "SxB": made_up_drive(rear_F_x=1.0), "SxS": made_up_drive(rear_F_x=9.0)}
    quantities = {"early": "mean of rear.F_x over 0.1 to 0.2 m", "late": "mean of front.F_x over 0.2 to 0.3 m"}
    found = verdict(quantities, "every.early > every.late", drives)
    assert (found.holds, str(found.finding.relation)) == (False, "SxB.early > SxB.late")


def test_a_window_that_one_run_does_not_reach_leaves_the_claim_open(verdict):
    drives = {"BxB": made_up_drive(), "SxB": made_up_drive(end=0.25), "SxS": made_up_drive()}
    quantity = "mean of rear.F_x over 0.1 to 0.3 m"
    assert verdict(quantity, "SxB > BxB", drives).holds is None
    assert verdict(quantity, ["SxS > BxB", "SxB > BxB"], drives).holds is None
    assert verdict("rms from SxB of rear.F_x over 0.1 to 0.3 m", "BxB > 0", drives).holds is None
    assert verdict(quantity, "SxS > BxB", drives).holds is False


# -- files


@pytest.mark.parametrize(
    "quantity, compare, changes, message",
    [
        ("mean of rear.F_w over 0 to 0.1 m", "SxB > 0", {}, r"'mean of rear.F_w over 0 to 0.1 m': unknown signal 'rear.F_w'; use one of "),
        ("mode of rear.z over 0 to 0.1 m", "SxB > 0", {}, r"unknown statistic 'mode'; use one of mean, min, .*, rms from SxS"),
        ("mean of all.F over 0 to 0.1 m", "SxB > 0", {}, r"all.F has several parts, so only rms from BxB or .* can be taken of it"),
        ("mean rear.z", "SxB > 0", {}, r"quantity 'mean rear.z': write 'mean of rear.F_x over 0.1 to 0.35 m' or 'time factor'"),
        ("mean of rear.z over 0.3 to 0.31 m", "SxB > 0", {}, r"the window is 0.01 m long; it must be at least 0.03 m"),
        ("mean of rear.z over 0 to 0.1 m", "SxV > 0", {}, r"compare 'SxV > 0': unknown run 'SxV'; use BxB, SxB, SxS or every"),
        ("mean of rear.z over 0 to 0.1 m", "SxB.a > 0", {}, r"there is no quantity for SxB.a; this record has SxB"),
        ({"a": "mean of rear.z over 0 to 0.1 m"}, "SxB > 0", {}, r"there is no quantity for SxB; this record has SxB.a"),
        ("mean of rear.z over 0 to 0.1 m", "SxB", {}, r"compare 'SxB': write two sides with <, > or ~ between them, such as 'SxB > BxB'"),
        ("mean of rear.z over 0 to 0.1 m", "SxB > max(1)", {}, r"'max\(1\)' is no expression of numbers, runs and runs' quantities"),
        ("mean of rear.z over 0 to 0.1 m", "SxB > ", {}, r"'' is no expression: write for example 'SxB.late - SxB.early'"),
        ("mean of rear.z over 0 to 0.1 m", "SxB > 0", {"place": None}, r"place missing: a record has compare, effect, id, "),
        ("mean of rear.z over 0 to 0.1 m", "SxB > 0", {"id": None}, r"\(without id\)': id missing"),
        ("mean of rear.z over 0 to 0.1 m", "SxB > 0", {"musst": "true"}, r"unknown key musst: a record has .*, must, "),
        ("mean of rear.z over 0 to 0.1 m", "SxB > 0", {"effect": "'z'"}, r"unknown effect 'z': use one of force or add \[effect.z\]"),
    ],
)
def test_a_record_that_is_wrong_is_refused_with_its_name(tmp_path, quantity, compare, changes, message):
    with pytest.raises(ClaimError, match=r"claims.toml: claim .*" + message):
        load_claims(write(tmp_path / "claims.toml", quantity, compare, **changes))


def test_an_effect_needs_a_size_and_a_reason(tmp_path):
    path = write(tmp_path / "claims.toml", "mean of rear.F_x over 0 to 0.1 m", "SxB > 0", size=0.0)
    with pytest.raises(ClaimError, match="effect 'force': value = 0 N: it must be positive"):
        load_claims(path)
    path.write_text(path.read_text().replace("reason = '1 %'\n", ""))
    with pytest.raises(ClaimError, match="effect 'force' has no reason: each has a value > 0, a unit and a reason"):
        load_claims(path)


def test_ids_are_unique(tmp_path):
    path = write(tmp_path / "claims.toml", "mean of rear.F_x over 0 to 0.1 m", "SxB > 0")
    record = path.read_text().partition("[[claim]]")[2]
    path.write_text(f"{path.read_text()}[[claim]]{record}")
    with pytest.raises(ClaimError, match="claim 'it': there is another record with this id: rename one of them"):
        load_claims(path)


# -- the shipped claims


def test_every_paragraph_of_section_8_5_1_is_covered():
    claims = load_claims(CLAIMS)
    windows = ("0-0.1", "0.1-0.35", "0.35-0.65", "0.65-0.9", "0.9-1", "1-1.1", "1.1-1.2", "1.2-1.4", "1.4-1.6", ">1.6")
    places = {claim.place for claim in claims}
    assert {f"8.5.1, {window} m" for window in windows} | {"8.5.1, Table 8.4"} <= places
    assert any(place.startswith("8.5, ") for place in places) and any(place.startswith("8.5.2, ") for place in places)
    assert len(claims) >= 30
    assert 15 <= sum(claim.must for claim in claims) < len(claims)


def test_claims_are_measured_in_the_unit_of_their_effect():
    for claim in load_claims(CLAIMS):
        units = {"1" if quantity.signal is None else SIGNALS[quantity.signal].unit for quantity in claim.quantities.values()}
        is_ratio = any("/" in str(relation) for relation in claim.relations)
        assert units == {claim.unit} or is_ratio, claim.id


def test_a_drive_to_1_8_m_reaches_all_claims_and_a_short_one_the_first_of_them():
    claims = load_claims(CLAIMS)
    times = dict(zip(RUNS, (1.0, 1.5, 2.3)))
    whole = judge(claims, dict.fromkeys(RUNS, Course(made_up_drive(end=1.801, front_sinkage=0.02))), times)
    assert all(verdict.holds is not None for verdict in whole)
    short = judge(claims, dict.fromkeys(RUNS, Course(made_up_drive(end=0.2))), times)
    reached = {verdict.claim.place for verdict in short if verdict.holds is not None}
    assert reached == {"8.5.1, 0-0.1 m", "8.5.1, Table 8.4"}
