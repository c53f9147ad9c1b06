"""The handbook of the FMUs, ``fmus/*.md``: its tables are the models', its links lead somewhere, its Python runs."""

import re
from pathlib import Path

import pytest

from cdl_fmu.bcm import BCM
from cdl_fmu.slave.build import build_fmu
from cdl_fmu.slave.description import value_references
from fmus import SHIPPED, model_of
from fmus.tables import COMMAND, FILE, fmu_tables

FOLDER = FILE.parent
PAGES = [*FOLDER.glob("*.md"), *FOLDER.glob("tools/*.md")]


def test_the_tables_are_up_to_date():
    assert FILE.read_text(encoding="utf-8") == fmu_tables(), f"the models declare something else than {FILE.name} says: run {COMMAND}"


def test_they_tell_every_shipped_fmu_with_the_numbers_of_its_variables():
    rows = [line.split(" | ") for line in fmu_tables().splitlines() if line.startswith("| `cdl_")]
    assert [row[0] for row in rows] == [f"| `{model.identifier}`" for model in SHIPPED]
    for row, model in zip(rows, SHIPPED):
        assert sum(map(int, row[1:4])) == len(value_references(model)) + len(model.files)


def test_a_row_has_what_the_record_declares():
    (table,) = (part for part in fmu_tables().split("\n## ") if part.startswith(f"`{BCM(1).identifier}`"))
    rows = [line for line in table.splitlines() if line.startswith("| `")]
    assert "| `rho` | parameter | kg/m3 | 1896 | 0 | 10000 | Bulk density |" in rows
    choice = "| `normal_model` | parameter | choice | bekker |  |  | Normal stress over the rim. `bekker`: "
    assert any(row.startswith(choice) for row in rows)
    assert any(row.startswith("| `wheel[i].T[3,3]` | input | 1 | identity | -1.001 | 1.001 | ") for row in rows)
    assert "| `wheel[i].f_0[3]` | output | N |  |  |  | Contact force on the wheel, resolved in world |" in rows
    # What only larger sizes have follows once.
    assert sum(row.startswith("| `patch[i].z[13,9]` | input |") for row in rows) == 1
    assert sum(row.startswith("| `ground` | parameter | file |") for row in rows) == 1


def anchors(page):
    """What links may name behind a #: the headings, as GitHub spells them."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.M)
    return {re.sub(r"[^\w -]", "", heading).lower().replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_lead_to_files_and_headings_and_fmus_can_be_built(page):
    text = page.read_text(encoding="utf-8")
    for target in re.findall(r"\]\((?!https?:)([^)]+)\)", text):
        name, _, heading = target.partition("#")
        path = page.parent / name if name else page
        assert path.exists(), target
        headings = (
            {re.sub(r"[^\w -]", "", line.lstrip("# ")).lower().replace(" ", "-") for line in path.read_text().splitlines()}
            if heading
            else ()
        )
        assert not heading or heading in headings, target
    for identifier in set(re.findall(r"\bcdl_[a-z]+_(?:[a-z]\d+)+", text)):
        assert model_of(identifier).identifier == identifier


def test_the_code_for_fmpy_runs(tmp_path, monkeypatch, capsys):
    (code,) = re.findall(r"```python\n(.*?)```", (FOLDER / "tools" / "fmpy.md").read_text(encoding="utf-8"), re.S)
    Path(tmp_path, "fmus", "build").mkdir(parents=True)
    build_fmu(BCM(1), tmp_path / "fmus" / "build" / "cdl_bcm_w1.fmu")
    monkeypatch.chdir(tmp_path)
    values = {}
    exec(code, values)
    last = values["result"][-1]
    assert last["time"] == pytest.approx(1.0) and last["diagnostics[1].slip"] == pytest.approx(0.8, abs=0.01)
    assert last["wheel[1].f_0[1]"] > values["result"][0]["wheel[1].f_0[1]"] > 0.0
    assert "Bekker based contact model" in capsys.readouterr().out
