"""Drives in perspective: soil, wheels and rover as facets that are drawn in one sweep, so that the near hides the far."""

from __future__ import annotations

import matplotlib
import numpy as np
import xarray as xr
from matplotlib.colors import Normalize, to_rgb
from matplotlib.ticker import MultipleLocator
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from .moment import Moment, Pose

#: Colours of wheels by tier and of the rover's body (Okabe & Ito 2008, for all eyes).
TIER_COLOURS = {"SCM": "#D55E00", "BCM": "#0072B2", "VEM": "#009E73", "DEM": "#CC79A7"}
BODY_COLOUR = "#333333"
ROCK_COLOUR = "#8C7B75"
#: Heights of soil, even in lightness for all eyes.
HEIGHTS = matplotlib.colormaps["cividis"]

_SUN = 60.0, 40.0  # [deg] to the viewer's left and above the ground: low, so that the flanks of ruts show
_AMBIENT = 0.4  # share of the light that comes from everywhere
_AROUND, _ACROSS = 72, 8  # facets of a rim: as small as soil's, since whole facets hide each other


def lit(colours: np.ndarray, normals: np.ndarray, sun: np.ndarray) -> np.ndarray:
    """RGB colours [..., 3] of facets with unit normals [..., 3] in the light of a ``sun`` (unit vector [3]); level ones keep theirs."""
    light = _AMBIENT + (1.0 - _AMBIENT) * np.clip(normals @ sun, 0.0, 1.0)
    return np.clip(colours * (light / (_AMBIENT + (1.0 - _AMBIENT) * sun[2]))[..., None], 0.0, 1.0)


def direction(elevation: float, azimuth: float) -> np.ndarray:
    """Unit vector [3] towards an elevation and an azimuth from the x axis to the left [deg]."""
    e, a = np.radians([elevation, azimuth])
    return np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])


class Scene:
    """Facets in world coordinates and the direction they are seen from.

    Args:
        elevation, azimuth: Of the viewer [deg], as in matplotlib.
        bounds: Lower and upper x, y and z [m] of what is shown.
    """

    def __init__(self, elevation: float, azimuth: float, bounds: np.ndarray):
        self.bounds = np.asarray(bounds, dtype=float)
        self._angles = elevation, azimuth
        self._viewer = direction(elevation, azimuth)
        self._sun = direction(_SUN[1], azimuth - _SUN[0])
        self._facets: list[np.ndarray] = []
        self._colours: list[np.ndarray] = []

    def add(self, sheet: np.ndarray, colour, opacity: float = 1.0, ahead: float = 0.0) -> None:
        """A surface of points [m, n, 3] [m] in one ``colour`` or one for each of its facets [m - 1, n - 1, 3], shaded by the sun.

        What lies less than ``ahead`` [m] in front of it, as seen by the viewer, does not hide it.
        """
        sheet = sheet + ahead * self._viewer
        facets = np.stack([sheet[:-1, :-1], sheet[1:, :-1], sheet[1:, 1:], sheet[:-1, 1:]], axis=2)
        normals = np.cross(facets[:, :, 2] - facets[:, :, 0], facets[:, :, 3] - facets[:, :, 1])
        normals /= np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-12)
        normals *= np.where(normals @ self._viewer < 0.0, -1.0, 1.0)[:, :, None]  # the side that is seen
        rgb = np.asarray(to_rgb(colour) if isinstance(colour, str) else colour)
        self._facets.append(facets.reshape(-1, 4, 3))
        shaded = lit(rgb, normals, self._sun).reshape(-1, 3)
        self._colours.append(np.column_stack([shaded, np.full(len(shaded), opacity)]))

    def add_triangles(self, triangles: np.ndarray, colour: str) -> None:
        """A surface of triangles [n, 3, 3] [m] with outward normals in one ``colour``, shaded by the sun."""
        normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
        seen = normals @ self._viewer > 0.0
        self._facets.append(triangles[seen][:, [0, 1, 2, 2]])
        self._colours.append(np.column_stack([lit(np.array(to_rgb(colour)), normals[seen], self._sun), np.ones(seen.sum())]))

    def add_soil(self, moment: Moment, heights: Normalize) -> None:
        """The soil within the bounds, coloured by its height above the undeformed ground in ``heights`` [mm]."""
        z = moment.surface(*self.bounds[:2])
        middle = z.values[:-1, :-1] + z.values[1:, :-1] + z.values[1:, 1:] + z.values[:-1, 1:]
        self.add(_sheet(z), HEIGHTS(heights(1e3 * (middle / 4 - moment.ground)))[:, :, :3])

    def add_wheel(self, moment: Moment, wheel: Pose, opacity: float = 1.0) -> None:
        """A cylinder with radial grousers, in the colour of its tier."""
        size = moment.dimensions
        colour = np.array(to_rgb(TIER_COLOURS.get(wheel.tier, "0.5")))
        around = np.linspace(0.0, 2 * np.pi, _AROUND + 1)
        across = np.linspace(-0.5, 0.5, _ACROSS + 1) * size["b_w"]
        self.add(_ring(wheel, around[:, None], size["r_w"], across[None, :]), colour, opacity)
        for side in across[[0, -1]]:
            radii = np.linspace(0.0, size["r_w"], 7)
            self.add(_ring(wheel, around[:, None], radii[None, :], side), 0.75 * colour, opacity)
        for angle in np.arange(size["n_g"]) * 2 * np.pi / max(size["n_g"], 1.0):
            # Thicker than the plates are, which would vanish.
            width = np.array([-0.5, -0.5, 0.5, 0.5]) * 0.4 * size["h_g"] / size["r_w"]
            radius = size["r_w"] + np.array([0.0, 1.0, 1.0, 0.0]) * size["h_g"]
            self.add(_ring(wheel, angle + width[:, None], radius[:, None], across[None, :]), 0.5 * colour, opacity)

    def add_rover(self, moment: Moment, rear_opacity: float = 1.0) -> None:
        """Both wheels, the link between their centres, and the point mass on its post."""
        self.add_wheel(moment, moment.wheels["front"])
        self.add_wheel(moment, moment.wheels["rear"], rear_opacity)
        front, rear = moment.wheels["front"].r_0, moment.wheels["rear"].r_0
        self.add(_tube(rear, front, 0.010, 40), BODY_COLOUR)
        self.add(_tube((front + rear) / 2, moment.mass, 0.008, 8), BODY_COLOUR)
        azimuth, polar = np.linspace(0, 2 * np.pi, 25)[:, None], np.linspace(0, np.pi, 13)[None, :]
        ball = np.stack(np.broadcast_arrays(np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)), axis=2)
        self.add(moment.mass + 0.035 * ball, BODY_COLOUR)

    def draw(self, ax: Axes3D, zoom: float = 1.0) -> None:
        """Draw all, true to scale in all directions."""
        facets, colours = np.concatenate(self._facets), np.concatenate(self._colours)
        # Edges of their own colour close the seams that smoothing leaves between facets; on what is translucent they would show.
        edges = colours * [1.0, 1.0, 1.0, 0.0] + np.outer(colours[:, 3] == 1.0, [0.0, 0.0, 0.0, 1.0])
        shown = Poly3DCollection(facets, facecolors=colours, edgecolors=edges, linewidths=0.25, zsort="average")
        shown.set_clip_on(False)
        ax.add_collection3d(shown)
        ax.set(xlim=self.bounds[0], ylim=self.bounds[1], zlim=self.bounds[2], xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
        for axis in (ax.xaxis, ax.yaxis, ax.zaxis):
            axis.set_major_locator(MultipleLocator(0.2))
            axis.set_pane_color((1.0, 1.0, 1.0, 0.0))
            axis.labelpad = 0
            axis.label.set_size(8)
        ax.tick_params(labelsize=7, pad=0)
        ax.grid(False)
        ax.set_facecolor("none")
        ax.zaxis.set_rotate_label(False)  # or it may stand on its head
        ax.zaxis.label.set_rotation(90)
        ax.set_box_aspect(np.ptp(self.bounds, axis=1), zoom=zoom)
        ax.set_proj_type("persp", focal_length=2.0)
        ax.view_init(*self._angles)


def _sheet(z: xr.DataArray) -> np.ndarray:
    return np.stack([*np.meshgrid(z.x.values, z.y.values, indexing="ij"), z.values], axis=2)


def _ring(wheel: Pose, angle, radius, across) -> np.ndarray:
    """Points of a wheel in world at angles from nadir [rad], radii [m] and places across [m], broadcast to [m, n, 3]."""
    x, y, z = np.broadcast_arrays(radius * np.sin(angle), across, -radius * np.cos(angle))
    return wheel.r_0 + np.stack([x, y, z], axis=2) @ wheel.T


def _tube(start: np.ndarray, end: np.ndarray, radius: float, n: int) -> np.ndarray:
    """A round bar from start to end, in n pieces."""
    along = end - start
    first = np.cross(along, (0.0, 1.0, 0.0) if abs(along[1]) < np.linalg.norm(along) / 2 else (1.0, 0.0, 0.0))
    first /= np.linalg.norm(first)
    second = np.cross(along, first) / np.linalg.norm(along)
    turn = np.linspace(0, 2 * np.pi, 13)[:, None, None]
    return start + np.linspace(0, 1, n + 1)[None, :, None] * along + radius * (np.cos(turn) * first + np.sin(turn) * second)
