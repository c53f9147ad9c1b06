"""The parametric wheel as a closed surface mesh, for tiers and tools that want one."""

from __future__ import annotations

import math

import numpy as np
import trimesh

from .slave.model import ModelError, describe_violation
from .wheel import WHEEL

_COARSEST = math.pi / 30.0  # [rad] of the rim between two vertices


def wheel_mesh(r_w: float, b_w: float, n_g: float, h_g: float, t_g: float, *, spacing: float = 2.5e-3) -> trimesh.Trimesh:
    """Watertight mesh of the wheel of ``cdl_fmu.wheel.WHEEL`` in the wheel's frame: y is the axle, the origin its middle.

    Grousers are plates of even thickness over the full width. One points along -z, as the contact models have it where T is the
    identity; the others follow at equal angles. The rim's vertices lie on its radius, chords dip below it by spacing^2 / (8 r_w).

    Args:
        r_w: Radius of the rim [m].
        b_w: Width [m].
        n_g: Number of grousers [1]; 0 = smooth wheel.
        h_g: Grouser height [m], from the rim to the middle of the flat tip; 0 = smooth wheel.
        t_g: Thickness of a grouser [m].
        spacing: Longest chord of the rim [m].

    Raises:
        ModelError: A value is outside its bounds, or the grousers do not fit.
    """
    for scalar, value in zip(WHEEL.scalars(), (r_w, b_w, n_g, h_g, t_g)):
        if not scalar.field.min <= value <= scalar.field.max:
            raise ModelError(describe_violation(scalar, value))
    if not spacing > 0.0:
        raise ModelError(f"spacing = {spacing:g} m: it must be above 0 m (longest chord of the rim)")
    if n_g != math.floor(n_g):
        raise ModelError(f"n_g = {n_g:g}: the number of grousers must be whole")
    x, z = _profile(r_w, int(n_g) if h_g > 0.0 else 0, h_g, t_g, min(spacing / r_w, _COARSEST))
    return _extruded(x, z, b_w)


def _profile(r_w: float, n_g: int, h_g: float, t_g: float, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Outline [m] in the x-z plane, from -z over +x, not repeating its first vertex."""
    if n_g == 0:
        angle = np.linspace(0.0, 2.0 * math.pi, math.ceil(2.0 * math.pi / step), endpoint=False)
        return r_w * np.sin(angle), -r_w * np.cos(angle)
    if t_g <= 0.0:
        raise ModelError(f"t_g = {t_g:g} m: a mesh cannot have grousers without thickness; give one above 0 m, or n_g = 0")
    pitch = 2.0 * math.pi / n_g
    root = math.asin(0.5 * t_g / r_w) if t_g < 2.0 * r_w else math.pi  # half the angle that a plate covers at the rim
    if 2.0 * root >= pitch:
        most = math.ceil(math.pi / root) - 1
        raise ModelError(
            f"n_g = {n_g:g}: grousers of t_g = {t_g:g} m overlap on the {2.0 * math.pi * r_w:.3g} m around the rim; "
            f"use at most {most} or thinner ones"
        )
    arc = np.linspace(root, pitch - root, max(1, math.ceil((pitch - 2.0 * root) / step)) + 1)
    # One grouser's tip and the rim up to the next grouser, tangential and radial.
    along = np.concatenate([[-0.5 * t_g, 0.5 * t_g], r_w * np.sin(arc)])
    out = np.concatenate([[r_w + h_g, r_w + h_g], r_w * np.cos(arc)])
    turn = pitch * np.arange(n_g)[:, None]
    x = along * np.cos(turn) + out * np.sin(turn)
    z = along * np.sin(turn) - out * np.cos(turn)
    return x.ravel(), z.ravel()


def _extruded(x: np.ndarray, z: np.ndarray, width: float) -> trimesh.Trimesh:
    """Prism over the outline along y; every vertex of the outline must be seen from the origin."""
    n = len(x)
    half = np.full(n, 0.5 * width)
    vertices = np.concatenate(
        [np.stack([x, -half, z], axis=1), np.stack([x, half, z], axis=1), [[0.0, -half[0], 0.0], [0.0, half[0], 0.0]]]
    )
    right = np.arange(n)  # the side at -y
    right_next = np.roll(right, -1)
    left, left_next = right + n, right_next + n
    faces = [
        (right, left_next, right_next),
        (right, left, left_next),
        (np.full(n, 2 * n), right, right_next),
        (np.full(n, 2 * n + 1), left_next, left),
    ]
    return trimesh.Trimesh(vertices, np.concatenate([np.stack(corner, axis=1) for corner in faces]), process=False)
