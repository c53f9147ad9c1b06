"""Where commands write what belongs to a checkout."""

from __future__ import annotations

import os
from pathlib import Path


def home() -> Path:
    """The checkout that this package is run from, else the current folder."""
    root = Path(__file__).resolve().parents[1]
    is_checkout = (root / ".git").exists() and os.access(root / "fmus", os.W_OK)
    return root if is_checkout else Path()
