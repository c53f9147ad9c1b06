"""Fig. 8.4 of the chapter: contact plane of a BCM wheel, estimated by rays in a rut with a wall.

Usage: python validation/fig_8_4.py [picture.png]
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

from cdl_fmu import BCM, Instance, load_soil
from cdl_fmu.frames import axis_rotation
from cdl_fmu.terrain import plane
from cdl_fmu.terrain.patch import surface

SPACING, NX, NY = 0.03, 13, 9
HEADING = 0.3  # [rad]


def scene() -> Instance:
    """A wheel that leaves a rut of 30 mm over its left wall."""
    contact = Instance(BCM(1, 1), **load_soil("mss_d"))
    patch, wheel = contact.u.patch[0], contact.u.wheel[0]
    patch.spacing, patch.origin[:] = SPACING, (-0.18, -0.12)
    x, y = patch.origin[0] + SPACING * np.arange(NX)[:, None], patch.origin[1] + SPACING * np.arange(NY)[None, :]
    rut = np.clip((np.abs(y) - 0.035) * np.tan(np.radians(36.7)), 0, 0.03) - 0.03
    patch.z[:] = rut + 0.002 * np.sin(40 * x)
    wheel.r_0[:] = (0, 0.045, 0.125 - 0.03)
    wheel["T"][:] = axis_rotation(3, HEADING)
    contact.initialise()
    contact.step(0.0, 1e-3)
    return contact


def rays(contact: Instance) -> np.ndarray:
    """Rows of weight, hit point (3), soil normal (3), rim point (3), in world; shape [63, 10]."""
    U, p = contact.arrays[1], contact.p
    patch, wheel = U[0]["patch"][0], U[0]["wheel"][0]
    rows = []
    for i in range(plane.RAYS_ALONG):
        for j in range(plane.RAYS_ACROSS):
            w, x, y, z, n_x, n_y, n_z, z_rim = plane.ray(patch, wheel, p.r_w + p.h_g, p.b_w, i, j)
            rows.append([w, x, y, z, n_x, n_y, n_z, x, y, z_rim])
    rows = np.array(rows)
    rows[:, 1:4] += wheel["r_0"]
    rows[:, 7:10] += wheel["r_0"]
    return rows


def wheel_rings(contact: Instance) -> np.ndarray:
    """Both edges of the rim in world, shape [2, 61, 3]."""
    wheel, p = contact.u.wheel[0], contact.p
    theta = np.linspace(0, 2 * np.pi, 61)
    ring = np.stack([np.sin(theta), np.zeros_like(theta), -np.cos(theta)], axis=1) * p.r_w
    return np.stack([wheel.r_0 + ring @ wheel["T"] + s * p.b_w / 2 * wheel["T"][1] for s in (-1, 1)])


def draw_perspective(view, contact: Instance, hits: np.ndarray) -> None:
    """Patch, wheel, rays, contact points with normals, and the fitted plane."""
    patch, wheel, axes = contact.u.patch[0], contact.u.wheel[0], contact.y.contact[0].axes
    normal, offset = contact.x.plane[0].normal, contact.x.plane[0].offset
    x = patch.origin[0] + SPACING * np.arange(NX)
    y = patch.origin[1] + SPACING * np.arange(NY)
    view.plot_surface(*np.meshgrid(x, y, indexing="ij"), patch.z, color="#d8b98a", edgecolor="#9c7b4b", linewidth=0.4, alpha=0.6)
    right, left = wheel_rings(contact)
    faces = [np.array([right[k], right[k + 1], left[k + 1], left[k]]) for k in range(60)]
    view.add_collection3d(Poly3DCollection(faces, facecolor="0.5", edgecolor="none", alpha=0.13))
    for ring in (right, left):
        view.plot(*ring.T, color="0.35", linewidth=0.9)
    foot = wheel.r_0 - (normal @ wheel.r_0 - offset) * normal
    corners = foot + np.array([s * 0.12 * axes[0] + t * 0.085 * axes[1] for s, t in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
    view.add_collection3d(Poly3DCollection([corners], facecolor="tab:blue", edgecolor="tab:blue", alpha=0.35))
    touching = hits[:, 0] > 0
    segments = [[(a[7], a[8], wheel.r_0[2]), tuple(a[7:10])] for a in hits]
    view.add_collection3d(Line3DCollection(segments, colors=np.where(touching, "tab:red", "0.65"), linewidths=0.6))
    hit = hits[touching]
    view.scatter(*hit[:, 1:4].T, s=6 + 25 * hit[:, 0], color="white", edgecolor="black", depthshade=False)
    view.quiver(*hit[:, 1:4].T, *(0.03 * hit[:, 4:7]).T, color="black", linewidth=0.8, arrow_length_ratio=0.25)
    view.quiver(*foot, *(0.13 * normal), color="tab:blue", linewidth=2.5, arrow_length_ratio=0.12)
    view.quiver(*wheel.r_0, 0, 0, -0.06, color="tab:red", linewidth=2.5, arrow_length_ratio=0.25)
    view.set(xlim=(-0.18, 0.18), ylim=(-0.12, 0.12), zlim=(-0.04, 0.22), xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
    view.set_box_aspect((0.36, 0.24, 0.26), zoom=1.1)
    view.view_init(22, -62)


def draw_section(view, contact: Instance, hits: np.ndarray) -> None:
    """The plane through the axle, seen along the heading, with the seven rays that lie in it."""
    wheel, p = contact.u.wheel[0], contact.p
    axle, r = wheel["T"][1], wheel.r_0
    normal, offset = contact.x.plane[0].normal, contact.x.plane[0].offset
    s = np.linspace(-0.115, 0.115, 401)
    spots = r + s[:, None] * axle
    patch = contact.arrays[1][0]["patch"][0]
    soil = np.array([z if inside else np.nan for inside, z, *_ in (surface(patch, *spot[:2]) for spot in spots)])
    view.fill_between(s, soil, -0.06, color="#d8b98a", alpha=0.8)
    view.add_patch(plt.Rectangle((-p.b_w / 2, r[2] - p.r_w), p.b_w, 2 * p.r_w, facecolor="0.5", edgecolor="0.35", alpha=0.2))
    view.plot(s, (offset - normal[0] * spots[:, 0] - normal[1] * spots[:, 1]) / normal[2], color="tab:blue", linewidth=2.5)
    middle = plane.RAYS_ALONG // 2 * plane.RAYS_ACROSS
    for w, *a in hits[middle : middle + plane.RAYS_ACROSS]:
        lateral = (np.array(a[:3]) - r) @ axle
        view.plot([lateral] * 2, [r[2], a[8]], color="tab:red" if w > 0 else "0.65", linewidth=0.9)
        if w > 0:
            view.annotate(
                "", (lateral + 0.03 * (np.array(a[3:6]) @ axle), a[2] + 0.03 * a[5]), (lateral, a[2]), arrowprops={"arrowstyle": "->"}
            )
            view.scatter(lateral, a[2], s=10 + 30 * w, color="white", edgecolor="black", zorder=3)
    foot = r - (normal @ r - offset) * normal
    start = np.array([(foot - r) @ axle, foot[2]])
    view.annotate(
        "", start + 0.12 * np.array([normal @ axle, normal[2]]), start, arrowprops={"arrowstyle": "->", "color": "tab:blue", "lw": 2.5}
    )
    view.set(xlim=(0.115, -0.115), ylim=(-0.05, 0.23), xlabel="along the axle, to the left [m]", ylabel="z [m]", aspect="equal")


def draw(contact: Instance, path: Path) -> None:
    """Both views, with a legend."""
    hits = rays(contact)
    figure = plt.figure(figsize=(12, 6), layout="constrained")
    left, right = figure.add_gridspec(1, 2, width_ratios=(1.6, 1))
    draw_perspective(figure.add_subplot(left, projection="3d", computed_zorder=False), contact, hits)
    draw_section(figure.add_subplot(right), contact, hits)
    point = plt.Line2D([], [], color="white", marker="o", markeredgecolor="black", label="contact points, by weight")
    lines = {"search direction, rays": "tab:red", "rays without contact": "0.65", "soil normals": "black", "fitted plane": "tab:blue"}
    handles = [point, *(plt.Line2D([], [], color=colour, label=text) for text, colour in lines.items())]
    figure.legend(handles=handles, loc="outside lower center", ncols=5, frameon=False)
    tilt = np.degrees(np.arccos(contact.x.plane[0].normal[2]))
    hit = np.count_nonzero(hits[:, 0])
    figure.suptitle(f"Contact plane of a wheel leaving a rut: {hit} of {len(hits)} rays hit, plane tilted by {tilt:.1f}°")
    figure.savefig(path, dpi=90)


if __name__ == "__main__":
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_suffix(".png")
    draw(scene(), path)
    print(path)
