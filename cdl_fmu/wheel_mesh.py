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
    _check(r_w, b_w, n_g, h_g, t_g)
    if not spacing > 0.0:
        raise ModelError(f"spacing = {spacing:g} m: it must be above 0 m (longest chord of the rim)")
    x, z = _profile(r_w, int(n_g) if h_g > 0.0 else 0, h_g, t_g, min(spacing / r_w, _COARSEST))
    return _extruded(x, z, b_w)


def grouser_plates(r_w: float, b_w: float, n_g: float, h_g: float, t_g: float) -> trimesh.Trimesh:
    """The grousers of ``wheel_mesh`` alone, as closed boxes that begin within the rim; for contacts beside those of an exact rim.

    Arguments and errors are those of ``wheel_mesh``; n_g and h_g must be above 0.
    """
    _check(r_w, b_w, n_g, h_g, t_g)
    if n_g < 1.0 or h_g <= 0.0:
        raise ModelError(f"n_g = {n_g:g}, h_g = {h_g:g} m: a smooth wheel has no plates; give both above 0, or use the rim alone")
    _root(r_w, int(n_g), t_g)
    # Own choice: as deep within the rim as they stand out of it, so that no inner corner is near to what touches the rim.
    inner = max(0.5 * r_w, math.sqrt(r_w * r_w - 0.25 * t_g * t_g) - h_g)
    plate = trimesh.creation.box(extents=(t_g, b_w, r_w + h_g - inner))
    plate.apply_translation((0.0, 0.0, -0.5 * (r_w + h_g + inner)))
    # One along -z, the others on towards +x, as in _profile.
    turns = [trimesh.transformations.rotation_matrix(-2.0 * math.pi * k / n_g, (0.0, 1.0, 0.0)) for k in range(int(n_g))]
    return trimesh.util.concatenate([plate.copy().apply_transform(turn) for turn in turns])


def _check(r_w: float, b_w: float, n_g: float, h_g: float, t_g: float) -> None:
    for scalar, value in zip(WHEEL.scalars(), (r_w, b_w, n_g, h_g, t_g)):
        if not scalar.field.min <= value <= scalar.field.max:
            raise ModelError(describe_violation(scalar, value))
    if n_g != math.floor(n_g):
        raise ModelError(f"n_g = {n_g:g}: the number of grousers must be whole")


def _root(r_w: float, n_g: int, t_g: float) -> float:
    """Half the angle [rad] that a plate covers at the rim."""
    if t_g <= 0.0:
        raise ModelError(f"t_g = {t_g:g} m: a mesh cannot have grousers without thickness; give one above 0 m, or n_g = 0")
    root = math.asin(0.5 * t_g / r_w) if t_g < 2.0 * r_w else math.pi
    if 2.0 * root >= 2.0 * math.pi / n_g:
        most = math.ceil(math.pi / root) - 1
        raise ModelError(
            f"n_g = {n_g:g}: grousers of t_g = {t_g:g} m overlap on the {2.0 * math.pi * r_w:.3g} m around the rim; "
            f"use at most {most} or thinner ones"
        )
    return root


def _profile(r_w: float, n_g: int, h_g: float, t_g: float, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Outline [m] in the x-z plane, from -z over +x, not repeating its first vertex."""
    if n_g == 0:
        angle = np.linspace(0.0, 2.0 * math.pi, math.ceil(2.0 * math.pi / step), endpoint=False)
        return r_w * np.sin(angle), -r_w * np.cos(angle)
    pitch, root = 2.0 * math.pi / n_g, _root(r_w, n_g, t_g)
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
