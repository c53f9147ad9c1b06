"""Fig. 8.4 of the chapter: how rays find the contact plane of a BCM wheel on its height patch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

from cdl_fmu.slave.interface import patch_in, wheel_pose
from cdl_fmu.terrain import plane
from cdl_fmu.terrain.patch import surface

from .moment import Moment, Pose

_SPACING = 0.03  # [m] of a patch: the chapter's mesh for BCM (8.4.2)
_SOIL, _SOIL_EDGE, _RAY, _MISS = "#d8b98a", "#9c7b4b", "#D55E00", "0.65"
#: Colour of a contact plane.
PLANE_COLOUR = "#56B4E9"


@dataclass(frozen=True)
class PlaneFit:
    """A wheel on its patch and the plane that is fitted to the rays that meet soil within it.

    Attributes:
        patch, wheel: Records of the contact interface.
        r_w, b_w: Radius of the rim and width [m].
        rays: Rows of weight, hit point (3), soil normal (3), rim point (3), in world; shape [n_rays, 10].
        found: False if no ray met soil, so that there is no plane.
        normal, foot: Of the plane: unit normal [3], and its point next to the wheel's centre [3] [m].
    """

    patch: np.void
    wheel: np.void
    r_w: float
    b_w: float
    rays: np.ndarray
    found: bool
    normal: np.ndarray
    foot: np.ndarray

    @property
    def nodes(self) -> tuple[np.ndarray, np.ndarray]:
        """x and y [m] of the patch's nodes."""
        return tuple(o + self.patch["spacing"] * np.arange(n) for o, n in zip(self.patch["origin"], self.patch["z"].shape))

    @property
    def sheet(self) -> np.ndarray:
        """Points [25, 19, 3] [m] of the plane under the wheel, over its length and somewhat more than its width."""
        along = np.cross(self.wheel["T"][1], self.normal)
        along /= np.linalg.norm(along)
        across = np.cross(self.normal, along)
        s, t = np.linspace(-1, 1, 25)[:, None, None], np.linspace(-0.7, 0.7, 19)[None, :, None]
        return self.foot + s * self.r_w * along + t * self.b_w * across


def fit_plane(x: np.ndarray, y: np.ndarray, z: np.ndarray, r_0: np.ndarray, T: np.ndarray, size: dict[str, float]) -> PlaneFit:
    """Fit the contact plane of a wheel at ``r_0, T`` to the heights z [13, 9] [m] on nodes x, y, as BCM does before its low-pass.

    Args:
        size: ``r_w, b_w, h_g`` [m] and ``n_g`` [1] of the wheel.
    """
    block = np.zeros(1, (wheel_pose(1) | patch_in(1)).dtype)[0]
    patch, wheel = block["patch"][0], block["wheel"][0]
    patch["origin"], patch["spacing"], patch["z"] = (x[0], y[0]), x[1] - x[0], z
    wheel["r_0"], wheel["T"] = r_0, T
    radius, width = size["r_w"] + (size["h_g"] if size["n_g"] > 0 else 0.0), size["b_w"]
    rows = []
    for i in range(plane.RAYS_ALONG):
        for j in range(plane.RAYS_ACROSS):
            w, h_x, h_y, h_z, n_x, n_y, n_z, z_rim = plane.ray(patch, wheel, radius, width, i, j)
            rows.append([w, h_x, h_y, h_z, n_x, n_y, n_z, h_x, h_y, z_rim])
    rays = np.array(rows)
    rays[:, 1:4] += r_0
    rays[:, 7:10] += r_0
    found, *fitted = plane.contact_plane(patch, wheel, radius, width)
    normal, point = np.array(fitted[:3]), np.array(fitted[3:])
    return PlaneFit(patch, wheel, size["r_w"], width, rays, bool(found), normal, r_0 + (normal @ point) * normal)


def plane_under(moment: Moment, wheel: Pose) -> PlaneFit:
    """The contact plane of a wheel in the soil of a moment, on a patch around it as SCM makes one: each node the mean of nine points."""
    middle = np.round(wheel.r_0[:2] / _SPACING)
    x, y = (_SPACING * np.arange(m - n, m + n + 1) for m, n in zip(middle, (6, 4)))
    near = _SPACING / 3 * np.array([-1, 0, 1])
    x_9, y_9 = ((axis[:, None] + near).ravel() for axis in (x, y))
    z = moment.surface((x_9[0], x_9[-1]), (y_9[0], y_9[-1])).interp(x=x_9, y=y_9).values
    return fit_plane(x, y, z.reshape(x.size, 3, y.size, 3).mean(axis=(1, 3)), wheel.r_0, wheel.T, moment.dimensions)


def figure_8_4(fit: PlaneFit, title: str) -> Figure:
    """The plane in perspective, and in the section through the axle; 1800 pixels wide."""
    figure = Figure(figsize=(12, 6.2), dpi=150, layout="constrained")
    figure.get_layout_engine().set(h_pad=0.15)  # the legend would touch the labels of axes that keep their scale
    left, right = figure.add_gridspec(1, 2, width_ratios=(1.6, 1))
    _perspective(figure.add_subplot(left, projection="3d", computed_zorder=False), fit)
    _section(figure.add_subplot(right), fit)
    point = Line2D([], [], color="white", marker="o", markeredgecolor="black", label="contact points, by weight")
    lines = {"search direction, rays": _RAY, "rays without contact": _MISS, "soil normals": "black", "fitted plane": PLANE_COLOUR}
    handles = [point, *(Line2D([], [], color=colour, label=text) for text, colour in lines.items())]
    figure.legend(handles=handles, loc="outside lower center", ncols=5, frameon=False)
    tilt = np.degrees(np.arccos(min(fit.normal[2], 1.0)))
    hits = f"{np.count_nonzero(fit.rays[:, 0])} of {len(fit.rays)} rays hit"
    figure.suptitle(f"{title}: {hits}, plane tilted by {tilt:.1f}°" if fit.found else f"{title}: {hits}, no plane")
    return figure


def _perspective(view: Axes3D, fit: PlaneFit) -> None:
    """Patch, wheel, rays, contact points with normals, and the fitted plane."""
    x, y = fit.nodes
    r_0, z = fit.wheel["r_0"], fit.patch["z"]
    view.plot_surface(*np.meshgrid(x, y, indexing="ij"), z, color=_SOIL, edgecolor=_SOIL_EDGE, linewidth=0.4, alpha=0.6)
    right, left = _rim(fit)
    faces = [np.array([right[k], right[k + 1], left[k + 1], left[k]]) for k in range(len(right) - 1)]
    view.add_collection3d(Poly3DCollection(faces, facecolor="0.5", edgecolor="none", alpha=0.13))
    for ring in (right, left):
        view.plot(*ring.T, color="0.35", linewidth=0.9)
    if fit.found:
        corners = fit.sheet[[0, -1, -1, 0], [0, 0, -1, -1]]
        view.add_collection3d(Poly3DCollection([corners], facecolor=PLANE_COLOUR, edgecolor=PLANE_COLOUR, alpha=0.35))
        view.quiver(*fit.foot, *(0.13 * fit.normal), color=PLANE_COLOUR, linewidth=2.5, arrow_length_ratio=0.12)
    touching = fit.rays[:, 0] > 0
    segments = [[(ray[7], ray[8], r_0[2]), tuple(ray[7:10])] for ray in fit.rays]
    view.add_collection3d(Line3DCollection(segments, colors=np.where(touching, _RAY, _MISS), linewidths=0.6))
    hit = fit.rays[touching]
    view.scatter(*hit[:, 1:4].T, s=6 + 25 * hit[:, 0], color="white", edgecolor="black", depthshade=False)
    view.quiver(*hit[:, 1:4].T, *(0.03 * hit[:, 4:7]).T, color="black", linewidth=0.8, arrow_length_ratio=0.25)
    view.quiver(*r_0, 0, 0, -0.06, color=_RAY, linewidth=2.5, arrow_length_ratio=0.25)
    bounds = np.array([(x[0], x[-1]), (y[0], y[-1]), (z.min() - 0.01, r_0[2] + 1.05 * fit.r_w)])
    view.set(xlim=bounds[0], ylim=bounds[1], zlim=bounds[2], xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
    view.set_box_aspect(np.ptp(bounds, axis=1), zoom=1.1)
    view.view_init(22, -62)


def _section(view: Axes, fit: PlaneFit) -> None:
    """The plane through the axle, seen along the heading, with the rays that lie in it."""
    axle, r_0 = fit.wheel["T"][1], fit.wheel["r_0"]
    half = 0.5 * fit.patch["spacing"] * (fit.patch["z"].shape[1] - 1)
    s = np.linspace(-half, half, 401)
    spots = r_0 + s[:, None] * axle
    soil = np.array([z if inside else np.nan for inside, z, *_ in (surface(fit.patch, *spot[:2]) for spot in spots)])
    bottom, top = min(np.nanmin(soil), r_0[2] - fit.r_w) - 0.02, r_0[2] + 1.05 * fit.r_w
    view.fill_between(s, soil, bottom, color=_SOIL, alpha=0.8, linewidth=0)
    corner = (-fit.b_w / 2, r_0[2] - fit.r_w)
    view.add_patch(Rectangle(corner, fit.b_w, 2 * fit.r_w, facecolor="0.5", edgecolor="0.35", alpha=0.2))
    middle = plane.RAYS_ALONG // 2 * plane.RAYS_ACROSS
    for weight, *ray in fit.rays[middle : middle + plane.RAYS_ACROSS]:
        lateral = (np.array(ray[:3]) - r_0) @ axle
        view.plot([lateral] * 2, [r_0[2], ray[8]], color=_RAY if weight > 0 else _MISS, linewidth=0.9)
        if weight > 0:
            tip = (lateral + 0.03 * (np.array(ray[3:6]) @ axle), ray[2] + 0.03 * ray[5])
            view.annotate("", tip, (lateral, ray[2]), arrowprops={"arrowstyle": "->"})
            view.scatter(lateral, ray[2], s=10 + 30 * weight, color="white", edgecolor="black", zorder=3)
    if fit.found:
        line = (fit.normal @ fit.foot - spots[:, :2] @ fit.normal[:2]) / fit.normal[2]
        view.plot(s, line, color=PLANE_COLOUR, linewidth=2.5, zorder=1.5)
        start = np.array([(fit.foot - r_0) @ axle, fit.foot[2]])
        tip = start + 0.12 * np.array([fit.normal @ axle, fit.normal[2]])
        view.annotate("", tip, start, arrowprops={"arrowstyle": "->", "color": PLANE_COLOUR, "lw": 2.5})
    view.set(xlim=(half, -half), ylim=(bottom, top), xlabel="along the axle, to the left [m]", ylabel="z [m]", aspect="equal")


def _rim(fit: PlaneFit) -> np.ndarray:
    """Both edges of the rim in world, shape [2, 61, 3]."""
    theta, T = np.linspace(0, 2 * np.pi, 61), fit.wheel["T"]
    ring = np.stack([np.sin(theta), np.zeros_like(theta), -np.cos(theta)], axis=1) * fit.r_w
    return np.stack([fit.wheel["r_0"] + ring @ T + side * fit.b_w / 2 * T[1] for side in (-1, 1)])
