"""Soil sets: every value with unit and source, and what a wrong file is told."""

import math

import pytest

from cdl_fmu.soil import SOIL, SoilError, load_soil, shipped_soils


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
        ("[c]\nvalue = 66.5\n", "[c]\n", r"sand.toml: c has no value: write \[c\] with value"),
        ('source = "a test"', "", "sand.toml: k_c has no source"),
        ('"kg/m3"', '"g/cm3"', "sand.toml: rho has the unit 'g/cm3': convert the value to 'kg/m3'"),
        ("66.5", '"soft"', "sand.toml: c = 'soft' is no number"),
        ("66.5", "-1.0", "sand.toml: c = -1 Pa: it must be between 0 and 1e"),
        ("66.5", "nan", "sand.toml: c = nan Pa: it must be between"),
        ("66.5", "66.5.5", "sand.toml is no TOML file: .*line"),
    ],
)
def test_a_wrong_file_is_told_what_to_change(soil_file, old, new, text):
    with pytest.raises(SoilError, match=text):
        load_soil(soil_file(old, new))


def test_a_missing_value_is_named(soil_file, tmp_path):
    path = soil_file()
    path.write_text(path.read_text().split("[rho]")[0])
    with pytest.raises(SoilError, match=r"sand.toml: rho \(Bulk density\) is missing: write \[rho\] with value"):
        load_soil(path)


def test_an_unknown_set_lists_the_known_ones():
    with pytest.raises(SoilError, match=r"no soil set 'moon': use one of .*mss_d.* or the path of a .toml file"):
        load_soil("moon")
