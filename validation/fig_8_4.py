"""Fig. 8.4 of the chapter: contact plane of a BCM wheel, estimated by rays in a rut with a wall.

Usage: python validation/fig_8_4.py [picture.png]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from cdl_fmu.frames import axis_rotation
from orchestrator.plane_picture import PlaneFit, figure_8_4, fit_plane

SPACING, NX, NY = 0.03, 13, 9
HEADING = 0.3  # [rad]


def scene() -> PlaneFit:
    """A wheel of Table 8.2 that leaves a rut of 30 mm over its left wall."""
    x, y = -0.18 + SPACING * np.arange(NX), -0.12 + SPACING * np.arange(NY)
    rut = np.clip((np.abs(y[None, :]) - 0.035) * np.tan(np.radians(36.7)), 0, 0.03) - 0.03
    z = rut + 0.002 * np.sin(40 * x[:, None])
    wheel = {"r_w": 0.125, "b_w": 0.125, "n_g": 12, "h_g": 0.01}
    return fit_plane(x, y, z, np.array([0, 0.045, 0.125 - 0.03]), axis_rotation(3, HEADING), wheel)


if __name__ == "__main__":
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_suffix(".png")
    figure_8_4(scene(), "Contact plane of a wheel leaving a rut").savefig(path)
    print(path)
