"""The table of the FMUs' variables is that of the models."""

from cdl_fmu.bcm import BCM
from cdl_fmu.slave.description import value_references
from fmus import SHIPPED
from fmus.tables import COMMAND, FILE, fmu_tables


def test_the_file_is_up_to_date():
    assert FILE.read_text(encoding="utf-8") == fmu_tables(), f"the models declare something else than {FILE.name} says: run {COMMAND}"


def test_it_tells_every_shipped_fmu_with_the_numbers_of_its_variables():
    rows = [line.split(" | ") for line in fmu_tables().splitlines() if line.startswith("| `cdl_")]
    assert [row[0] for row in rows] == [f"| `{model.identifier}`" for model in SHIPPED]
    for row, model in zip(rows, SHIPPED):
        assert sum(map(int, row[1:4])) == len(value_references(model)) + len(model.files)


def test_a_row_has_what_the_record_declares():
    (table,) = (part for part in fmu_tables().split("\n## ") if part.startswith(f"`{BCM(1).identifier}`"))
    rows = [line for line in table.splitlines() if line.startswith("| `")]
    assert "| `rho` | parameter | kg/m3 | 1896 | 0 | 10000 | Bulk density |" in rows
    assert any(
        row.startswith("| `normal_model` | parameter | choice | bekker |  |  | Normal stress over the rim. `bekker`: ") for row in rows
    )
    assert any(row.startswith("| `wheel[i].T[3,3]` | input | 1 | identity | -1.001 | 1.001 | ") for row in rows)
    assert "| `wheel[i].f_0[3]` | output | N |  |  |  | Contact force on the wheel, resolved in world |" in rows
    # What only larger sizes have follows once.
    assert sum(row.startswith("| `patch[i].z[13,9]` | input |") for row in rows) == 1
    assert sum(row.startswith("| `ground` | parameter | file |") for row in rows) == 1
