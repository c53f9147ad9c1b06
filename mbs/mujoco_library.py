"""MuJoCo's C library for kernels, which call it with the addresses of a model, of data and of arrays."""

from __future__ import annotations

import sys
from pathlib import Path

import mujoco
from numba import types

from cdl_fmu.slave.library import Library

_FOLDER = Path(mujoco.__file__).parent
_FILES = {"win32": "mujoco.dll", "darwin": "libmujoco.*.dylib"}
_ADDRESS = types.intp
_OF_STATE = types.void(_ADDRESS, _ADDRESS)

MUJOCO = Library(
    file=next(_FOLDER.glob(_FILES.get(sys.platform, "libmujoco.so.*"))),
    headers=_FOLDER / "include",
    source=Path(__file__).parent / "rover.c",
    functions={
        **dict.fromkeys(("mj_setConst", "mj_kinematics", "mj_comPos", "mj_comVel", "mj_makeM"), _OF_STATE),
        "mj_fullM": types.void(_ADDRESS, _ADDRESS, _ADDRESS),
        "mj_rne": types.void(_ADDRESS, _ADDRESS, types.intc, _ADDRESS),
        "mju_eig3": types.intc(_ADDRESS, _ADDRESS, _ADDRESS, _ADDRESS),
    },
    licences=(("mujoco-core", "LICENSE"), ("mujoco-core", "LICENSES_THIRD_PARTY.md")),
)
