"""`cdl identify` on plate tests whose fit is known."""

from __future__ import annotations

from cdl_fmu.soil import SOIL, load_soil
from cdl_fmu.soil.identify import identify

from . import cmu
from .bench import Bench
from .rows import Findings, relative

_BAR = 0.03


def check(bench: Bench) -> Findings:
    """Soil from plate tests"""
    known, found = load_soil(cmu.SOIL), identify(cmu.PLATES).values
    rows = [
        relative("cdl identify", "Wong's fit of the CMU plates", key, known[key], found[key].value, SOIL.fields[key].unit, _BAR)
        for key in ("k_c", "k_phi", "n")
    ]
    return Findings(rows, note="Round plates of 60, 80 and 100 mm, three tests each, in the sand of the smooth wheel above.")
