"""Hard ground in the validation: every row that has a bar keeps it, and MuJoCo computes nearly the same."""

from orchestrator.validate import hard


def test_hard_ground_keeps_its_bars():
    findings = hard.check(None)  # it runs nothing on the testbed
    judged = [row for row in findings.rows if row.bar is not None]
    assert {row.model for row in judged} == {"RBC", "VEM"} and len(judged) >= 10
    assert [row.cells() for row in judged if not row.passed] == []
    assert all(abs(row.error) < 0.05 for row in findings.rows if row.model == "MuJoCo")
    assert "elliptic friction cone" in findings.note
