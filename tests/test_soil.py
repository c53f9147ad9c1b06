"""Soil sets: every value with unit and source, and what a wrong file is told."""

import math
import re

import pytest

from cdl_fmu.soil import SOIL, SoilError, load_soil, plates_gravity, shipped_soils, usable_widths


@pytest.mark.parametrize("name", shipped_soils())
def test_shipped_sets_load(name):
    assert load_soil(name).keys() == SOIL.fields.keys()


def test_table_8_2():
    expected = dict(k_c=-2.86e6, k_phi=2.47e8, n=2.49, c=66.5, phi=math.radians(36.7), K=0.02, rho=1896.0)
    assert load_soil("mss_d") == pytest.approx(expected, rel=1e-15)


@pytest.fixture
def soil_file(tmp_path):
    def write(old="", new=""):
        rows = "".join(f'[{k}]\nvalue = {f.start}\nunit = "{f.unit}"\nsource = "a test"\n' for k, f in SOIL.fields.items())
        assert old in rows
        path = tmp_path / "sand.toml"
        path.write_text(rows.replace(old, new, 1))
        return path

    return write


def test_a_users_file_loads(soil_file):
    assert load_soil(soil_file())["n"] == 2.49


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("[rho]", "[rhoo]", r"sand.toml: unknown key 'rhoo': did you mean rho\?"),
        ("[rho]", "[colour]", r"sand.toml: unknown key 'colour': remove it; a soil has k_c, k_phi, n, c, phi, K, rho"),
        ('source = "a test"', "", "sand.toml: k_c has no source"),
        ('"kg/m3"', '"g/cm3"', "sand.toml: rho has the unit 'g/cm3': convert the value to 'kg/m3'"),
        ("66.5", '"soft"', "sand.toml: c = 'soft' is no number"),
        ("66.5", "-1.0", "sand.toml: c = -1 Pa: it must be between 0 and 1e"),
        ("66.5", "nan", "sand.toml: c = nan Pa: it must be between"),
        ("value = 66.5", "vaule = 66.5", "sand.toml: c has an unknown part 'vaule': write .c. with value"),
        ("[k_c]", "fit = 1\n[k_c]", "sand.toml: fit = 1 is no table: write .fit. with what the identification found, or remove it"),
        ("66.5", "66.5.5", "sand.toml is no TOML file: .*line"),
    ],
)
def test_a_wrong_file_is_told_what_to_change(soil_file, old, new, text):
    with pytest.raises(SoilError, match=text):
        load_soil(soil_file(old, new))


def test_missing_values_are_named_at_once_and_may_be_given(soil_file):
    """A table without value, and no table."""
    path = soil_file("[phi]\nvalue", "[phi]\n# value")
    path.write_text(path.read_text().split("[rho]")[0])
    text = (
        "sand.toml has no value for phi (Angle of internal friction, in rad), rho (Bulk density, in kg/m3): "
        "give --set soil.phi=<number> --set soil.rho=<number>, write them into the file with unit and source, "
        "or measure by shear tests (cdl identify plates.csv --shear shear.csv) and by weighing a known volume"
    )
    with pytest.raises(SoilError, match=f"^{re.escape(text)}$"):
        load_soil(path)
    with pytest.raises(SoilError, match=r"no value for rho \(Bulk density, in kg/m3\): give --set soil.rho=.* or measure by weighing"):
        load_soil(path, given=["phi"])
    assert load_soil(path, given=["phi", "rho", "n"]).keys() == SOIL.fields.keys() - {"phi", "rho"}


def test_what_an_identification_found_may_stand_in_a_soil_file(soil_file):
    path = soil_file("[k_c]", "fit.widths = [0.04, 0.1]\nfit.anything = {a = 1}\n[k_c]")
    assert load_soil(path).keys() == SOIL.fields.keys()
    assert usable_widths(path) == (0.04, 0.1)
    assert usable_widths("mss_d") is None
    assert usable_widths(soil_file("[k_c]", 'fit.widths = "all"\n[k_c]')) is None


def test_an_unknown_set_lists_the_known_ones():
    with pytest.raises(SoilError, match=r"no soil set 'moon': use one of .*mss_d.* or the path of a .toml file"):
        load_soil("moon")


def test_a_file_may_say_at_which_gravity_its_plates_were_tested(soil_file):
    assert plates_gravity("mss_d") == plates_gravity(soil_file()) == 9.81
    given = '[gravity]\nvalue = {}\nunit = "m/s2"\nsource = "a test"\n[k_c]'
    assert plates_gravity(soil_file("[k_c]", given.format("1.62"))) == 1.62
    assert load_soil(soil_file("[k_c]", given.format("1.62"))).keys() == SOIL.fields.keys()
    with pytest.raises(SoilError, match=r"sand.toml: gravity = -1 m/s2: it must be between 0 and 100"):
        plates_gravity(soil_file("[k_c]", given.format("-1")))
