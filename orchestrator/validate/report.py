"""What a validation comes to: the table, a section for each check, and the same as JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from .rows import COLUMNS, Findings, Row, shown

#: Files of a report beside its pictures.
TABLE, RESULTS = "README.md", "results.json"


@dataclass(frozen=True)
class Report:
    """Findings of all checks.

    Attributes:
        out: Folder of the report.
        quick: Whether what takes long was left out.
        findings: Check -> what it found.
        titles: Check -> its title.
        failed: What could not be run, and why.
    """

    out: Path
    quick: bool
    findings: Mapping[str, Findings]
    titles: Mapping[str, str]
    failed: Sequence[str]

    @property
    def rows(self) -> list[Row]:
        """Of all checks."""
        return [row for found in self.findings.values() for row in found.rows]

    @property
    def tally(self) -> str:
        """How many bars are kept."""
        judged = [row.passed for row in self.rows if row.passed is not None]
        failed = f", {len(self.failed)} failed to run" if self.failed else ""
        return f"{sum(judged)} of {len(judged)} bars are kept{failed}"

    @property
    def pictures(self) -> dict[str, Path]:
        """Check -> picture of it, if it has one."""
        return {name: self.out / f"{name}.png" for name, found in self.findings.items() if found.figure is not None}

    def facts(self) -> dict[str, object]:
        """Everything, as ``results.json`` has it; SI units, angles in rad, shares as numbers, W the wheel's load."""
        checks = {
            name: {
                "title": self.titles[name],
                "rows": [row.facts() for row in found.rows],
                "tables": [table.facts() for table in found.tables],
            }
            for name, found in self.findings.items()
        }
        return {"version": version("cdl-fmu"), "quick": self.quick, "checks": checks, "failed": list(self.failed)}

    def write(self) -> None:
        """Write table, JSON and pictures."""
        self.out.mkdir(parents=True, exist_ok=True)
        (self.out / RESULTS).write_text(json.dumps(self.facts(), indent=1) + "\n", encoding="utf-8")
        (self.out / TABLE).write_text("\n".join(self._lines()) + "\n", encoding="utf-8")
        for name, path in self.pictures.items():
            self.findings[name].figure.savefig(path)

    def _lines(self) -> list[str]:
        command = "cdl validate --quick" if self.quick else "cdl validate"
        lines = [
            "# Validation",
            "",
            f"Written by `{command}`; every number below is from that run. {self.tally}.",
            "Errors are relative to what is expected, in its unit, or in wheel loads W. Nothing is asked of numbers without a bar. (!): "
            "the run did not become stationary, and the number is a mean over its last quarter.",
            "",
            *_markdown(COLUMNS, [row.cells() for row in self.rows]),
        ]
        if self.failed:
            lines += ["## Failed", "", *(f"- {text}" for text in self.failed), ""]
        for name, found in self.findings.items():
            lines += [f"## {self.titles[name]}", "", found.note, ""]
            if name in self.pictures:
                lines += [f"![{self.titles[name]}]({self.pictures[name].name})", ""]
            for table in found.tables:
                cells = [[shown(cell, digits=3) for cell in row] for row in table.rows]
                lines += [f"### {table.title}", "", *_markdown(table.columns, cells)]
        return lines[:-1]


def _markdown(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    cells = [columns, ["---"] * len(columns), *([cell.replace("|", "\\|") for cell in row] for row in rows)]
    return [*(f"| {' | '.join(row)} |" for row in cells), ""]
