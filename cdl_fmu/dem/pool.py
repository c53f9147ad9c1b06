"""The soil of a DEM instance: what is live around its tools, in the arrays that the kernels work on, and all the rest in columns."""

from __future__ import annotations

import io
import math
from typing import NamedTuple

import numpy as np

from ..contact import has_pose, is_set
from ..slave.model import ModelError
from .columns import SavedGround, ground_from_arrays, ground_to_arrays, keys_of
from .live import live_of, make_live, touches_of
from .particles import FREE, PAIRS, SIDE, N, X, Z, empty_particles, history_of_pairs, set_history_of_pairs
from .patches import patch_heights
from .tools import VELOCITY

#: Time between two looks at what lies outside the boxes [s]: a particle that is at the top of its flight has gone on since. Own choice.
_LOOK = 0.02
#: Place of the time in the settings.
TIME = 4
#: Room beyond what is live, so that it need not be made anew often.
_SPARE = 1.3


class Box(NamedTuple):
    """Where the soil moves around a tool, along its heading and across [m], from its middle."""

    half_length: float
    half_width: float


class SavedGrains(NamedTuple):
    """Content of a :class:`GrainPool`: copies of what is live; stored columns are never changed in place and shared with other saves.

    Among the arrays is the law of the particles, which does not change, for those who look at the forces between them.
    """

    arrays: dict[str, np.ndarray]
    ground: SavedGround


class GrainPool:
    """Live particles and tools for the kernels, and the ground they are taken from.

    The kernels get the arrays of ``Particles``, of ``Tools``, of ``Meshes``, the law of the particles, the longest substep [s], gravity
    [m/s2] and time [s], and the patches: origin, revision, heights of each.

    Args:
        ground: All the soil.
        new_tools: Makes ``Tools`` for a number of particles: the floor, then wheels, then bodies.
        meshes: Surfaces of the bodies.
        law: Contact law of the particles.
        settings: Longest substep [s], gravity [m/s2] (3) and the time of the soil [s], [5].
        boxes: Active box of each wheel and body.
        patches: Shape of the patches [n, nodes along x, along y], and distance of their nodes [m].
        rest_speed: Speed below which a particle rests [m/s].
    """

    def __init__(self, ground, new_tools, meshes, law, settings, boxes, patches, rest_speed):
        self.ground, self._new_tools, self._meshes, self._boxes, self._rest_speed = ground, new_tools, meshes, boxes, rest_speed
        (n, *self._nodes), self._spacing = patches
        self._law, self._settings, self._shape = law, settings, ground.bed.key.material.shape
        self._patches = np.zeros((n, 3 + math.prod(self._nodes)))
        self._active = np.zeros(0, np.int64)  # columns that move
        self._wanted = self._active  # those in the boxes
        # Of the last look: its time [s], particles outside the boxes and where they were, and columns that were at rest.
        self._looked = 0.0
        self._seen_ident, self._seen_at = np.zeros(0, np.int64), np.zeros((0, 3))
        self._resting = np.zeros(0, np.int64)
        self._make_room(1)

    def _make_room(self, n: int) -> None:
        tools = self._tools if hasattr(self, "_tools") else None
        self._grains, self._tools = empty_particles(n, precision=self._law.dtype, shape=self._shape), self._new_tools(n)
        if tools is not None:
            for name in ("present", "laws", "poses", "goals", "turns", "sums"):
                getattr(self._tools, name)[:] = getattr(tools, name)
        self.arrays = (*self._grains, *self._tools, *self._meshes, self._law, self._settings, self._patches)

    @property
    def live(self) -> np.ndarray:
        """Records of the particles that are live, [n, PARTICLE]; a view."""
        count = self._grains.count
        return self._grains.body[count[SIDE], : count[N]]

    @property
    def time(self) -> float:
        """Simulated time of this soil [s]."""
        return float(self._settings[TIME])

    @property
    def _ident(self) -> np.ndarray:
        count = self._grains.count
        return self._grains.ident[count[SIDE], : count[N]]

    @property
    def highest(self) -> float:
        """Height that no particle of the undisturbed soil reaches above [m]."""
        bed = self.ground.bed
        return self.ground.ground_z + float((bed.positions[:, 2] + bed.radii).max())

    # -- the moving boxes

    def reserve(self, u) -> None:
        """Make the columns around the tools live, and store those that rest elsewhere; patches follow their wheels."""
        wanted = self._columns_wanted(u)
        look = self.time - self._looked >= _LOOK
        if look or not np.array_equal(wanted, self._wanted):
            self._wanted = wanted
            active = np.union1d(wanted, self._restless(wanted, look))
            if not np.array_equal(active, self._active):
                self._active = active
                self._exchange()
        for k in range(len(self._patches)):
            self._follow(self._patches[k], u["trailing"]["r_0"][k], look)

    def _columns_wanted(self, u) -> np.ndarray:
        side, found = self.ground.column, []
        tools = [(f"{name}[{k + 1}]", tool) for name in ("wheel", "body") if name in u.dtype.names for k, tool in enumerate(u[name])]
        for (name, tool), box in zip(tools, self._boxes):
            if not has_pose(tool) or ("active" in tool.dtype.names and tool["active"] == 0.0):
                continue
            axle, r_0 = tool["T"][1, :2], tool["r_0"]
            axle = axle / max(np.hypot(*axle), 1e-9)
            reach = math.hypot(*box) + side
            if max(abs(r_0[:2])) + reach > self.ground.farthest:
                raise ModelError(
                    f"{name} is at ({r_0[0]:g}, {r_0[1]:g}) m, but a bed of these particles goes {self.ground.farthest:.4g} m from the "
                    "origin; let wheels and bodies begin near it"
                )
            i, j = (np.arange(math.floor((x - reach) / side), math.ceil((x + reach) / side)) for x in r_0[:2])
            x, y = np.meshgrid((i + 0.5) * side - r_0[0], (j + 0.5) * side - r_0[1], indexing="ij")
            inside = (abs(x * axle[1] - y * axle[0]) <= box.half_length + 0.5 * side) & (
                abs(x * axle[0] + y * axle[1]) <= box.half_width + 0.5 * side
            )
            found.append(keys_of(*np.meshgrid(i, j, indexing="ij"))[inside])
        return np.unique(np.concatenate(found)) if found else np.zeros(0, np.int64)

    def _restless(self, wanted: np.ndarray, look: bool) -> np.ndarray:
        """Columns outside the boxes with particles that went on since the last look; those that tremble where they are rest.

        A particle that is seen for the first time counts as one that went on.
        """
        outside = self.live[:, FREE] > 0.0
        keys = self.ground.columns_of(self.live)
        outside &= ~np.isin(keys, wanted)
        keys = keys[outside]
        if not look:  # columns that have just been left; others stay as they are
            return np.setdiff1d(keys, self._resting)
        ident, at = self._ident[outside], self.live[outside, X : Z + 1]
        order = np.argsort(ident)
        ident, at, keys = ident[order], at[order], keys[order]
        place = np.minimum(np.searchsorted(self._seen_ident, ident), max(len(self._seen_ident) - 1, 0))
        far = np.ones(len(ident), bool)
        if len(self._seen_ident):
            known = self._seen_ident[place] == ident
            longest = self._rest_speed * (self.time - self._looked)
            far = ~known | (((at - self._seen_at[place]) ** 2).sum(axis=1) > longest**2)
        self._seen_ident, self._seen_at, self._looked = ident, at, self.time
        self._resting = np.setdiff1d(keys, keys[far])
        return np.unique(keys[far])

    def _exchange(self) -> None:
        live, touches = live_of(self._grains, self._tools), touches_of(self._grains, self._tools)
        live = self.ground.exchange(live, self._active)
        n = len(live.grains.ident)
        if n > self._grains.body.shape[1]:
            self._make_room(math.ceil(_SPARE * n))
        make_live(self._grains, self._tools, live, touches)

    # -- the surface

    def _follow(self, patch: np.ndarray, r_0: np.ndarray, look: bool) -> None:
        """Heights around a wheel of another tier: at once where it moves on, else now and then, as the soil may still move."""
        if not is_set(r_0):
            return
        corner = [math.floor(x / self._spacing + 0.5) - n // 2 for x, n in zip(r_0, self._nodes)]
        origin = np.array(corner) * self._spacing
        if look or patch[2] == 0.0 or np.any(patch[:2] != origin):
            z = patch_heights(self.ground, self.live, origin, self._spacing, self._nodes).ravel()
            if patch[2] == 0.0 or np.any(patch[:2] != origin) or np.any(patch[3:] != z):
                patch[:2], patch[2], patch[3:] = origin, patch[2] + 1.0, z

    # -- the whole state

    def save(self) -> SavedGrains:
        """Copies of what is live."""
        g, t = self._grains, self._tools
        n, side = g.count[N], g.count[SIDE]
        touches = t.first[side, -1]
        arrays = dict(
            count=g.count.copy(),
            body=g.body[side, :n].copy(),
            ident=g.ident[side, :n].copy(),
            built=g.built[:n].copy(),
            first=g.first[side, : n + 1].copy(),
            orientation=g.orientation[side, :n].copy(),
            partner=g.partner[side, : g.count[PAIRS]].copy(),
            history=history_of_pairs(g.history[side], g.count[PAIRS]),
            slabs=g.slabs.copy(),
            present=t.present.copy(),
            poses=t.poses.copy(),
            margins=t.margins.copy(),
            touch_slabs=t.slabs.copy(),
            sums=t.sums.copy(),
            touch_first=t.first[side].copy(),
            particle=t.particle[side, :touches].copy(),
            kept=t.kept[side, :touches].copy(),
            patches=self._patches.copy(),
            active=self._active,
            wanted=self._wanted,
            settings=self._settings.copy(),
            looked=np.array(self._looked),
            seen_ident=self._seen_ident,
            seen_at=self._seen_at,
            resting=self._resting,
            law=self._law.copy(),
        )
        return SavedGrains(arrays, self.ground.save())

    def restore(self, saved: SavedGrains) -> None:
        """Go back, to the same bits."""
        s = saved.arrays
        n, side = s["count"][N], s["count"][SIDE]
        if n > self._grains.body.shape[1]:
            self._make_room(math.ceil(_SPARE * n))
        g, t = self._grains, self._tools
        g.count[:] = s["count"]
        g.body[side, :n], g.ident[side, :n], g.built[:n], g.first[side, : n + 1] = s["body"], s["ident"], s["built"], s["first"]
        g.orientation[side, : len(s["orientation"])] = s["orientation"]
        g.partner[side, : len(s["partner"])] = s["partner"]
        set_history_of_pairs(g.history[side], s["history"])
        g.slabs[:], g.force[:] = s["slabs"], 0.0
        t.present[:], t.poses[:], t.margins[:], t.sums[:] = s["present"], s["poses"], s["margins"], s["sums"]
        t.goals[:] = t.poses[:, :VELOCITY]  # where all tools are between steps, those that are away, too
        touches = len(s["particle"])
        t.slabs[:] = s["touch_slabs"]
        t.first[side], t.particle[side, :touches], t.kept[side, :touches] = s["touch_first"], s["particle"], s["kept"]
        self._patches[:] = s["patches"]
        self._active, self._wanted = s["active"], s["wanted"]
        self._settings[:], self._looked, self._resting = s["settings"], float(s["looked"]), s["resting"]
        self._seen_ident, self._seen_at = s["seen_ident"], s["seen_at"]
        self.ground.restore(saved.ground)

    @staticmethod
    def to_bytes(saved: SavedGrains) -> bytes:
        """An archive of arrays."""
        parts = {**saved.arrays, **ground_to_arrays(saved.ground)}
        memory = io.BytesIO()
        np.savez(memory, **parts)
        return memory.getvalue()

    @staticmethod
    def from_bytes(data: bytes) -> SavedGrains:
        """What ``to_bytes`` wrote."""
        with np.load(io.BytesIO(data)) as archive:
            parts = dict(archive)
        ground = ground_from_arrays(parts)
        return SavedGrains(parts, ground)
