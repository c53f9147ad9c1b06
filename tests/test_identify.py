"""Soil identification: measured plates, made-up tests whose soil is known, what bad files are told, and the command."""

import json
import math
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from cdl_fmu.soil import SOIL, SoilError, load_soil, usable_widths
from cdl_fmu.soil.identify import identify
from cdl_fmu.soil.measurements import IdentifyError, read_plates, read_shear
from cdl_fmu.soil.shear import fit_shear
from cdl_fmu.soil.sinkage import fit_sinkage
from orchestrator import cli
from orchestrator.validate.cmu import PLATES as CMU

LAW = dict(k_c=-3e4, k_phi=2.5e6, n=1.1)


def write_plates(path, law=LAW, diameters=(60, 100, 160), offset_mm=0.0, noise=0.0, rows=(100, 40, 200), before=0):
    """One test for each plate, with ``rows`` rows; z in the file is ``offset_mm`` where the plate touches, ``before`` rows come earlier."""
    rng = np.random.default_rng(1)
    lines = ["test,plate_diam_mm,z_mm,p_Pa"]
    for i, (diameter, n) in enumerate(zip(diameters, rows), 1):
        lines += [f"{i},{diameter},{0.01 * (k + 1)!r},{5.0 + rng.random()!r}" for k in range(before)]
        for z in np.linspace(1.0, 40.0, n):
            p = (law["k_c"] / (5e-4 * diameter) + law["k_phi"]) * (1e-3 * z) ** law["n"]
            lines.append(f"{i},{diameter},{float(z) + offset_mm!r},{float(p * (1.0 + noise * rng.standard_normal()))!r}")
    path.write_text("\n".join(lines) + "\n")
    return path


def write_shear(path, c=200.0, phi=0.6, K=0.018, pressures=(2e3, 5e3, 10e3, 20e3), end=6.0, noise=0.0):
    rng = np.random.default_rng(2)
    lines = ["test,p_Pa,j_mm,tau_Pa"]
    for i, p in enumerate(pressures, 1):
        for j in np.linspace(0.0, end * K, 150):
            tau = (c + p * math.tan(phi)) * (1.0 - math.exp(-j / K) + noise * rng.standard_normal())
            lines.append(f"{i},{p},{1e3 * float(j)!r},{float(tau)!r}")
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.fixture
def plates(tmp_path):
    return write_plates(tmp_path / "plates.csv")


# -- sinkage


def test_measured_plates_of_cmu():
    """Nine tests of Carnegie Mellon University, see SOURCES.md beside the file; the shipped set has Wong's fit of them from elsewhere."""
    fit, notes = fit_sinkage(read_plates(CMU)[0])
    shipped = load_soil("cmu_sand")
    for key in LAW:
        assert getattr(fit, key) == pytest.approx(shipped[key], rel=0.03)
    assert (fit.k_c, fit.k_phi, fit.n) == pytest.approx((-2.337e5, 1.221e7, 1.373), rel=1e-3)
    assert (fit.offset, notes) == (0.0, [])
    assert {round(plate.goodness, 2) for plate in fit.plates} >= {0.87, 0.97}
    assert all(0.87 < plate.goodness < 0.98 and plate.goodness < plate.goodness_own for plate in fit.plates)
    assert fit.correlation == pytest.approx(0.996, abs=1e-3)
    assert fit.b_crit == pytest.approx(19.1e-3, rel=0.01)
    assert fit.widths == pytest.approx((2 * fit.b_crit, 0.1))
    assert fit.z_window == pytest.approx((1.5e-3, 38.306e-3)) and fit.p_window == pytest.approx((327.9, 58845.4))
    # Rows of a curve are not independent: whole tests scatter several times as much as they say.
    assert (fit.over_tests > 5.0 * fit.standard_errors).all()
    assert {plate.test.name: plate.outliers.tolist() for plate in fit.plates if plate.outliers.size} == {
        "4": [721, 722, 723, 724],
        "7": [1310, 1311],
    }


def test_the_offset_of_cmus_plates_is_less_certain_than_it_is_large():
    fit, _ = fit_sinkage(read_plates(CMU)[0], with_offset=True)
    assert fit.offset == pytest.approx(-2.31e-3, abs=2e-5) and fit.n == pytest.approx(1.591, abs=2e-3)
    assert 0.5 < -fit.over_tests[3] / fit.offset < 1.5


@pytest.mark.parametrize("law", [LAW, dict(k_c=5e3, k_phi=8e5, n=0.8), dict(k_c=-2.86e6, k_phi=2.47e8, n=2.49)])
@pytest.mark.parametrize("diameters", [(60, 100, 160), (100, 100, 60), (60, 60, 60)])
def test_what_was_put_in_comes_out(tmp_path, law, diameters):
    tests, notes = read_plates(write_plates(tmp_path / "plates.csv", law, diameters))
    fit, more = fit_sinkage(tests, k_c=law["k_c"] if len({*diameters}) == 1 else None)
    assert (fit.k_c, fit.k_phi, fit.n) == pytest.approx(tuple(law.values()), rel=1e-7)
    assert (fit.goodness, notes, more) == (pytest.approx(1.0), [], [])
    assert all(plate.outliers.size == 0 for plate in fit.plates)


def test_each_test_counts_the_same_however_many_rows_it_has():
    """Two measured tests with all their rows, and with every tenth row of one of them."""
    tests, _ = read_plates(CMU)
    few, many = tests[3], tests[4]
    thinned = [type(t)(t.name, t.b, t.lines[::step], t.z[::step], t.p[::step]) for t, step in ((few, 1), (many, 10))]
    (all_rows, _), (some_rows, _) = (fit_sinkage(chosen, k_c=0.0) for chosen in ((few, many), thinned))
    assert some_rows.n == pytest.approx(all_rows.n, abs=0.01)
    assert some_rows.k_phi == pytest.approx(all_rows.k_phi, rel=0.03)
    between = sorted(math.log(plate.k) for plate in all_rows.plates)
    assert between[0] < math.log(all_rows.k_phi) < between[1]


def test_the_weights_undo_the_logarithm():
    """An error of all rows by the same pressure moves n much less than in a fit of logarithms without weights."""
    z = np.linspace(1e-3, 0.04, 100)
    p = 1e6 * z**1.2 + np.where(np.arange(100) % 2, 150.0, -150.0)
    test = type(read_plates(CMU)[0][0])("1", 0.05, np.arange(100), z, p)
    fit, _ = fit_sinkage([test], k_c=0.0)
    plain = np.polyfit(np.log(z), np.log(p), 1)[0]
    assert abs(fit.n - 1.2) < 0.005 < abs(plain - 1.2) / 4


def test_standard_errors_cover_what_was_put_in(tmp_path):
    fit, _ = fit_sinkage(read_plates(write_plates(tmp_path / "plates.csv", noise=0.05))[0])
    errors = np.array([fit.k_c, fit.k_phi, fit.n]) - list(LAW.values())
    assert (np.abs(errors) < 3.0 * fit.standard_errors).all()
    assert (np.abs(errors) > 0.0).all() and fit.n == pytest.approx(1.1, abs=0.05)
    assert fit.covariance == pytest.approx(fit.covariance.T)


@pytest.mark.parametrize(("offset_mm", "before"), [(0.5, 0), (-0.4, 0), (2.0, 5)])
def test_an_offset_is_found_and_taken_only_if_asked_for(tmp_path, offset_mm, before):
    path = write_plates(tmp_path / "plates.csv", offset_mm=offset_mm, before=before)
    found, applied = identify(path), identify(path, apply_offset=True)
    assert found.sinkage.offset == 0.0 and found.values["n"].value == found.sinkage.n
    assert abs(found.sinkage.n - 1.1) > 0.005
    assert found.other.offset == pytest.approx(1e-3 * offset_mm, abs=1e-8)
    assert applied.sinkage.offset == found.other.offset and applied.other.n == found.sinkage.n
    for key, value in LAW.items():
        assert applied.values[key].value == pytest.approx(value, rel=1e-5)
    assert f"z counted from {offset_mm:g} mm" in applied.values["n"].source
    assert applied.fit()["offset_is_applied"] and not found.fit()["offset_is_applied"]


def test_plates_of_one_size_need_k_c(tmp_path):
    path = write_plates(tmp_path / "plates.csv", diameters=(80, 82), rows=(50, 50))
    said = (
        "plates.csv: all plates have one size, 80 mm and 82 mm in diameter: k_c cannot be told from k_phi; test a second size, best one "
        "with the wheel's width as radius, or give --k-c 0, which takes the soil to bear all widths alike and is good for wheels about as "
        "wide as the plate's radius, 40 mm"
    )
    with pytest.raises(IdentifyError, match=f"^{re.escape(said)}$"):
        identify(path)
    found = identify(path, k_c=0.0)
    assert found.values["k_c"].value == 0.0 and found.values["k_c"].source == "given, --k-c"
    assert found.values["k_phi"].value == pytest.approx(-3e4 / 0.0405 + 2.5e6, rel=0.02)
    assert found.sinkage.widths == pytest.approx((0.04 / 1.25, 0.041 * 1.25))
    assert "k_c = 0 N/m^(n+1) is given and wins over the tests" in found.notes
    with pytest.raises(IdentifyError, match=r"k_c = -2e\+06 N/m\^\(n\+1\) has the soil bear nothing below .* give one nearer to 0"):
        identify(path, k_c=-2e6)


def test_k_phi_does_not_become_negative(tmp_path):
    """Clay: pressure falls with the plate's size faster than any k_phi >= 0 allows."""
    found = identify(write_plates(tmp_path / "plates.csv", dict(k_c=1e5, k_phi=-2e5, n=0.7)))
    assert found.values["k_phi"].value == 0.0 and "set to 0" in found.values["k_phi"].source
    assert 7e4 < found.values["k_c"].value < 1e5
    assert re.search(r"k_phi = -2e\+05 N/m\^\(n\+2\) from the fit: wide wheels would sink without end; fitted again", found.notes[0])


# -- shear


@pytest.mark.parametrize(("noise", "share"), [(0.0, 0.01), (0.02, 0.05)])
def test_shear_gives_back_its_soil(tmp_path, noise, share):
    fit, notes = fit_shear(read_shear(write_shear(tmp_path / "shear.csv", noise=noise))[0])
    assert notes == []
    assert fit.phi == pytest.approx(0.6, rel=0.02)
    assert fit.c == pytest.approx(200.0, rel=0.1)
    assert pytest.approx(0.018, rel=share) == fit.K
    assert all(pytest.approx(0.018, rel=2 * share) == one.K for one in fit.tests)
    if noise:
        assert 0.0 < fit.c_error < 40.0 and 0.0 < fit.phi_error < 0.02 and 0.0 < fit.K_error < 1e-3


def test_sand_without_cohesion_has_its_line_through_the_origin(tmp_path):
    path = write_shear(tmp_path / "shear.csv", c=-80.0)
    fit, notes = fit_shear(read_shear(path)[0])
    assert fit.c == 0.0 and 0.57 < fit.phi < 0.6
    assert re.fullmatch(r"the shear tests have c = -79.77 Pa: set to 0, and phi fitted again through the origin", notes[0])


def test_what_is_given_wins_and_the_rest_is_fitted_with_it(tmp_path, plates):
    shear = write_shear(tmp_path / "shear.csv")
    alone, given = identify(plates, shear), identify(plates, shear, c=0.0, K=0.025, rho=1600.0)
    assert alone.missing == given.missing == []
    assert given.values["phi"].value > alone.values["phi"].value + 0.01
    assert {key: given.values[key].value for key in ("c", "K", "rho")} == {"c": 0.0, "K": 0.025, "rho": 1600.0}
    assert "K = 0.025 m is given and wins over the tests" in given.notes
    assert identify(plates, shear, phi=0.55).values["c"].value > alone.values["c"].value + 100.0
    assert identify(plates, phi=0.5).missing == ["c", "K"]
    assert identify(plates).values["rho"].sentence.startswith("assumption: poured dry sand; not measured, give --rho")


def test_tests_at_one_pressure_need_c_or_phi(tmp_path, plates):
    shear = write_shear(tmp_path / "shear.csv", pressures=(5e3, 5.1e3))
    with pytest.raises(IdentifyError, match=r"shear.csv: all shear tests have one normal pressure, 5050 Pa: c and phi .* or give --c"):
        identify(plates, shear)
    assert identify(plates, shear, c=200.0).values["phi"].value == pytest.approx(0.6, rel=0.01)
    with pytest.raises(IdentifyError, match=r"shear.csv: c = 9000 Pa is more than the shear tests' strength, 36\d\d Pa and more"):
        identify(plates, shear, c=9000.0)


def test_a_shear_test_that_ends_early_is_told(tmp_path):
    _, notes = fit_shear(read_shear(write_shear(tmp_path / "shear.csv", end=1.0))[0])
    assert re.fullmatch(r"shear test 1 ends at 2\.?\d* K: its strength may not have been reached; shear to 3 K at least", notes[0])


# -- files


def test_files_as_people_write_them(tmp_path, plates):
    """Semicolons and decimal commas, a byte order mark, other units and order, more columns, empty lines."""
    rows = [line.split(",") for line in plates.read_text().splitlines()[1:]]
    lines = ["p_kPa;remark;test;z_cm;plate_diam_m"]
    lines += [f"{float(p) / 1e3!r};dry;{test};{float(z) / 10!r};{float(d) / 1e3!r}".replace(".", ",") + "\n" for test, d, z, p in rows]
    other = tmp_path / "other.csv"
    other.write_text("\n".join(lines), encoding="utf-8-sig")
    assert identify(other).values["k_c"].value == pytest.approx(identify(plates).values["k_c"].value, rel=1e-9)


def test_numbers_of_tests_may_start_anew_with_each_plate(plates):
    text = plates.read_text()
    plates.write_text(text.replace("\n2,", "\n1,").replace("\n3,", "\n1,"))
    tests, _ = read_plates(plates)
    assert [(test.name, round(test.b, 9), len(test.z)) for test in tests] == [("1", 0.03, 100), ("1", 0.05, 40), ("1", 0.08, 200)]


def test_rows_without_sinkage_or_pressure_are_left_out_and_counted(tmp_path, plates):
    lines = plates.read_text().splitlines()
    lines[1:1] = ["1,60,-0.2,3.0", "1,60,0.0,5.0"]
    lines[20:20] = ["1,60,5.0,0"]
    plates.write_text("\n".join(lines))
    found = identify(plates)
    assert found.notes[0] == "plates.csv: rows without sinkage or without pressure left out, 3 of 343: lines 2-3, 21"
    assert found.values["n"].value == pytest.approx(1.1, rel=1e-7)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("z_mm", "depth", "plates.csv has no column z_mm (sinkage; or z_cm, z_m); its columns are test, plate_diam_mm, depth, p_Pa"),
        ("test,", "run,", "plates.csv has no column test, which tells the tests apart; its columns are run, plate_diam_mm, z_mm, p_Pa"),
        ("p_Pa", "load_N", "plates.csv has no column p_Pa (normal pressure; or p_kPa, p_MPa); its columns are"),
        ("test,plate", "z_cm,plate", "plates.csv has the columns z_cm, z_mm: keep one of them"),
        ("1,60,2.0,200", "1,60,deep,200", "plates.csv, line 3: z_mm = 'deep': a number in mm is needed (sinkage)"),
        ("1,60,2.0,200", "1,60,2.0,", "plates.csv, line 3: p_Pa is empty: a number in Pa is needed (normal pressure)"),
        ("1,60,2.0,200", "1,60,2.0,nan", "plates.csv, line 3: p_Pa = nan: it must be finite (normal pressure in Pa)"),
        ("1,60,2.0,200", "1,60,2.0", "plates.csv, line 3: 3 values under 4 columns: give one for each"),
        ("1,60,2.0,200", "1,0,2.0,200", "plates.csv, line 3: plate_diam_mm = 0: it must be positive"),
        (
            "1,60,1.0,100\n1,60,2.0,200\n",
            "1,60,1.0,100\n",
            "plates.csv: test 1 has 2 rows with z > 0 and p > 0, and 3 are needed: add rows",
        ),
        (
            "1,60,2.0,200\n1,60,3.0,300",
            "1,60,1.0,200\n1,60,1.0,300",
            "plates.csv: test 1 has one sinkage alone, z = 0.001 m: give its whole",
        ),
        (
            "1,60,1.0,100\n1,60,2.0,200",
            "1,60,-1.0,100\n1,60,-2.0,200",
            "plates.csv, line 2: z_mm = -1, and of test 1 2 of 3 rows are negative: sinkage is positive here; turn its sign",
        ),
        (
            "z_mm",
            "z_m",
            "plates.csv: z_m is at most 3 m, and a sinkage of 0.001 to 1 m is expected: it is most likely in mm; name the column z_mm",
        ),
        (
            "p_Pa",
            "p_MPa",
            "plates.csv: p_MPa is at most 300 MPa, and a normal pressure of 0.0001 to 10 MPa is expected: it is most likely in Pa",
        ),
        (
            "plate_diam_mm",
            "plate_diam_m",
            "plates.csv: plate_diam_m is at most 60 m, and a diameter of the plate of 0.005 to 2 m is expected",
        ),
        ("1,60,1.0,100\n1,60,2.0,200\n1,60,3.0,300\n", "", "plates.csv has no rows below its header: give one for each reading"),
    ],
)
def test_bad_plates_are_told_what_to_change(tmp_path, old, new, said):
    text = "test,plate_diam_mm,z_mm,p_Pa\n1,60,1.0,100\n1,60,2.0,200\n1,60,3.0,300\n"
    assert old in text
    path = tmp_path / "plates.csv"
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(IdentifyError, match=re.escape(said)):
        read_plates(path)


def test_sinkage_in_metres_under_a_name_of_millimetres(tmp_path):
    path = tmp_path / "plates.csv"
    path.write_text("test,plate_diam_mm,z_mm,p_Pa\n" + "".join(f"1,60,{1e-3 * z:g},{100 * z}\n" for z in range(1, 40)))
    said = "z_mm is at most 0.039 mm, and a sinkage of 1 to 1000 mm is expected: it is most likely in m; name the column z_m"
    with pytest.raises(IdentifyError, match=re.escape(said)):
        read_plates(path)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("j_mm", "s_mm", "shear.csv has no column j_mm (shear displacement; or j_cm, j_m); its columns are test, p_Pa, s_mm, tau_Pa"),
        ("1,5000,20,2400", "1,-5000,20,2400", "shear.csv, line 4: p_Pa = -5000: the normal pressure must be positive"),
        ("1,5000,20,2400", "1,5000,20,strong", "shear.csv, line 4: tau_Pa = 'strong': a number in Pa is needed (shear stress)"),
        ("20,2400\n1,5000,40,2900", "-20,2400\n1,5000,-40,2900", "shear.csv: test 1 has 2 rows with j >= 0, and 3 are needed: add rows"),
    ],
)
def test_bad_shear_tests_are_told_what_to_change(tmp_path, old, new, said):
    text = "test,p_Pa,j_mm,tau_Pa\n1,5000,0,0\n1,5000,10,1500\n1,5000,20,2400\n1,5000,40,2900\n"
    assert old in text
    path = tmp_path / "shear.csv"
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(IdentifyError, match=re.escape(said)):
        read_shear(path)


def test_shear_without_a_rise_and_with_a_pressure_that_varies(tmp_path, plates):
    path = tmp_path / "shear.csv"
    path.write_text("test,p_Pa,j_mm,tau_Pa\n" + "".join(f"1,{5000 + 100 * j},{j},3000\n" for j in range(20)))
    assert read_shear(path)[1] == ["shear.csv: p of test 1 varies from 5000 to 6900 Pa; its mean, 5950 Pa, is taken"]
    with pytest.raises(
        IdentifyError, match=r"shear.csv: shear test 1 has no rise of tau from 0 to 3000 Pa that tells K: give the rows from"
    ):
        identify(plates, path, c=0.0)


def test_given_values_are_bounded_and_degrees_are_recognised(plates):
    with pytest.raises(IdentifyError, match=r"--phi: phi = 29 rad: it must be at most 1.3 rad .*; 29 deg are 0.5061 rad"):
        identify(plates, phi=29.0)
    with pytest.raises(IdentifyError, match=r"--rho: rho = nan kg/m3: it must be finite"):
        identify(plates, rho=math.nan)


def test_pressure_that_falls_is_no_law_of_soil(tmp_path):
    path = write_plates(tmp_path / "plates.csv", dict(k_c=0.0, k_phi=1e4, n=-0.2))
    with pytest.raises(IdentifyError, match=r"plates.csv: the tests give n = -0.2: it must be at least 0 .*; check the columns"):
        identify(path)


# -- the soil file and the command


def test_the_soil_file_is_a_soil(tmp_path, plates):
    found = identify(plates, write_shear(tmp_path / "shear.csv"), rho=1600.0)
    found.write(tmp_path / "soil.toml")
    assert load_soil(tmp_path / "soil.toml") == {key: value.value for key, value in found.values.items()}  # to the same bits
    assert usable_widths(tmp_path / "soil.toml") == found.sinkage.widths
    tables = tomllib.loads((tmp_path / "soil.toml").read_text(encoding="utf-8"))
    assert tables["title"] == "Soil identified from plates.csv and shear.csv"
    assert tables["fit"] == json.loads(json.dumps(found.fit()))
    for key, words in {
        "n": "plates.csv: Wong's weighted fit of 3 plate tests (60, 100, 160 mm); standard error",
        "rho": "given, --rho",
    }.items():
        assert tables[key]["source"].startswith(words)


def test_what_no_test_tells_is_missing_until_it_is_set(tmp_path, plates):
    identify(plates, c=0.0, K=0.02).write(tmp_path / "soil.toml")
    with pytest.raises(
        SoilError, match=r"soil.toml has no value for phi \(Angle of internal friction, in rad\): give --set soil.phi=<number>"
    ):
        load_soil(tmp_path / "soil.toml")
    assert tomllib.loads((tmp_path / "soil.toml").read_text())["phi"].keys() == {"unit", "source"}
    assert load_soil(tmp_path / "soil.toml", given=["phi"]).keys() == SOIL.fields.keys() - {"phi"}


def cdl(*arguments):
    """Run a command; a bug's exception comes through."""
    done = CliRunner().invoke(cli.app, [str(a) for a in arguments], env={"COLUMNS": "200"})
    if done.exception and not isinstance(done.exception, SystemExit):
        raise done.exception
    return done


def test_the_command_from_plates_to_a_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = cdl("identify", CMU)
    assert done.exit_code == 0 and done.stderr == ""
    assert {path.name for path in tmp_path.iterdir()} == {"soil.toml", "soil.png"}
    assert re.search(
        r"^ +k_c +-233745 +3.31e\+04 +5.49e\+03 +N/m\^\(n\+1\) +cmu_plates.csv: Wong's weighted fit of 9 plate", done.stdout, re.M
    )
    assert re.search(r"^ +9 +80 +184 +1.474 +0.909 +0.966", done.stdout, re.M)
    assert "good for wheels 38.3 to 100 mm wide; bears nothing below b_crit = 19.1 mm" in done.stdout
    assert "touched at z = -2.31 mm (+- 2.1 mm by tests); not applied (--apply-offset); with it, n = 1.591, goodness 0.919" in done.stdout
    assert "note: cmu_plates.csv: test 4 has outliers, 3 robust standard deviations off its own law, kept: lines 721-724" in done.stdout
    assert done.stdout.splitlines()[-3:] == [
        "soil.toml",
        "soil.png",
        "a run on it needs what is missing: --set soil.set=soil.toml --set soil.c=... --set soil.phi=... --set soil.K=...",
    ]
    run = ["run", "two_wheel", "--stop-time", 0, "--out", "out", "--set", "soil.set=soil.toml"]
    refused = cdl(*run, "--set", "soil.c=0", "--set", "soil.K=0.02")
    assert refused.exit_code == 2
    assert (
        "error: --set soil.set: soil.toml has no value for phi (Angle of internal friction, in rad): give --set soil.phi" in refused.stderr
    )
    done = cdl(*run, "--set", "soil.c=0", "--set", "soil.K=0.02", "--set", "soil.phi=0.5061")
    assert done.exit_code == 0
    assert "wheel.b_w = 0.125 m: the soil's plate tests are good for wheels 0.0383 to 0.1 m wide" in done.stderr


def test_json_holds_all_of_it(tmp_path, plates):
    done = cdl("identify", plates, "--shear", write_shear(tmp_path / "shear.csv"), "--json", "-o", tmp_path / "new" / "sand.toml")
    facts = json.loads(done.stdout)
    assert facts.keys() == {"soil", "picture", "values", "fit", "notes"}
    assert Path(facts["picture"]) == tmp_path / "new" / "sand.png" and Path(facts["picture"]).stat().st_size > 1e4
    assert facts["values"].keys() == SOIL.fields.keys()
    assert facts["values"]["n"]["value"] == pytest.approx(1.1) and facts["values"]["rho"]["value"] == 1400.0
    assert {"goodness", "covariance", "b_crit", "widths", "with_offset", "shear_tests"} <= facts["fit"].keys()
    assert load_soil(facts["soil"])["K"] == facts["values"]["K"]["value"]


def test_refusals_of_the_command_leave_nothing(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty.csv").touch()
    for arguments, said in (
        (
            ["empty.csv"],
            "error: empty.csv has no column plate_diam_mm (diameter of the plate; or plate_diam_cm, plate_diam_m); its columns are none",
        ),
        (["nowhere.csv"], "error: nowhere.csv: No such file or directory"),
        ([CMU, "-o", "sand.csv"], "choose a name that ends in .toml"),
    ):
        done = cdl("identify", *arguments)
        assert done.exit_code == 2 and said in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["empty.csv"]
