"""Beds of particles: settled, kept, read; their surface and memory, and the limits of coarse grains."""

import warnings
from dataclasses import fields, replace

import numpy as np
import pytest

from cdl_fmu.dem import bed_files, library, memory
from cdl_fmu.dem.bed import BedKey, porosity_between, replicate
from cdl_fmu.dem.bed_files import key_hash, key_text, load_bed, write_bed
from cdl_fmu.dem.contacts import no_contacts
from cdl_fmu.dem.library import Library
from cdl_fmu.dem.material import Material
from cdl_fmu.dem.memory import check_memory, estimate_memory
from cdl_fmu.dem.particles import PARTICLE
from cdl_fmu.dem.scaling import check_box, check_feature, check_overlap, overlap_under
from cdl_fmu.dem.settle import MOST_ENERGY, MOST_UNBALANCE, TOLERANCE, rest_of, settle
from cdl_fmu.dem.shape import Shape
from cdl_fmu.dem.sizes import Shares, Uniform
from cdl_fmu.dem.surface import NOTHING, fill_heights, mean_height
from cdl_fmu.slave.model import ModelError

D = 0.01
KEY = BedKey(Material(), Uniform(0.009, 0.011), porosity=0.40, depth=0.08, size=(0.08, 0.08), seed=3)


@pytest.fixture(scope="module")
def bed():
    return settle(KEY)


def moved(bed, simulation):
    """How far the particles of a bed have moved [m], by their numbers."""
    now = np.empty_like(bed.positions)
    now[simulation.ident] = simulation.bodies[:, :3]
    away = now - bed.positions
    away[:, :2] -= np.rint(away[:, :2] / bed.periods) * bed.periods
    return np.linalg.norm(away, axis=1)


def test_a_bed_has_the_porosity_depth_and_columns_asked_for(bed):
    assert bed.porosity == pytest.approx(KEY.porosity, abs=TOLERANCE)
    assert bed.surface == pytest.approx(0.0, abs=1e-12)
    assert bed.floor == pytest.approx(-KEY.depth, abs=0.2 * D)
    assert bed.counts == (2, 2) and bed.column == pytest.approx(4 * 0.011)
    assert bed.periods == (2 * bed.column, 2 * bed.column)
    assert (bed.positions[:, :2] >= 0.0).all() and (bed.positions[:, :2] < bed.periods).all()
    assert (bed.positions[:, 2] - bed.radii - bed.floor > -0.02 * D).all()
    # Level: what lies above the mean surface is less than a layer, and it is the depth of a bed that has its mass.
    assert (bed.positions[:, 2] + bed.radii).max() < D
    volume = (4 / 3 * np.pi * bed.radii**3).sum()
    assert volume == pytest.approx((1 - KEY.porosity) * KEY.depth * bed.periods[0] * bed.periods[1], rel=0.05)
    assert 4.0 < bed.coordination < 6.0  # frictional packings lie between their isostatic number and that without friction


def test_a_bed_is_at_rest_and_stays_there_as_its_history_says(bed):
    simulation = bed.simulation()
    energy, unbalance = rest_of(simulation, D)
    assert energy < MOST_ENERGY and unbalance < MOST_UNBALANCE
    assert simulation.tools[0].f_0[2] == pytest.approx(-9.81 * simulation.bodies[:, 7].sum(), rel=1e-3)
    simulation.step(0.05)
    assert moved(bed, simulation).max() < 0.01 * D
    # Without their history contacts bear no shear: the bed gives way at first.
    bare = replace(bed, contacts=no_contacts()).simulation()
    assert rest_of(bare, D)[1] > 100 * MOST_UNBALANCE


def test_equal_keys_give_equal_bits_and_progress_tells_stages_and_shares(bed):
    told = []
    again = settle(KEY, lambda stage, share: told.append((stage, share)))
    assert np.array_equal(again.positions, bed.positions) and np.array_equal(again.radii, bed.radii) and again.floor == bed.floor
    assert all(np.array_equal(a, b) for a, b in zip(again.contacts, bed.contacts))
    assert list(dict.fromkeys(stage for stage, _ in told)) == ["falling", "compacting", "coming to rest"]
    assert all(0.0 <= share <= 1.0 for _, share in told)


def test_a_replicated_bed_rests_as_one_tile_does(bed):
    block = replicate(bed, 3, 2)
    assert block.periods == pytest.approx((3 * bed.periods[0], 2 * bed.periods[1])) and block.counts == (6, 4)
    assert len(block.radii) == 6 * len(bed.radii) and len(block.contacts.pairs) == 6 * len(bed.contacts.pairs)
    assert block.porosity == pytest.approx(bed.porosity) and block.coordination == pytest.approx(bed.coordination)
    assert block.surface == pytest.approx(0.0, abs=1e-12)
    assert rest_of(block.simulation(), D) == pytest.approx(rest_of(bed.simulation(), D), rel=1e-6)
    # Every pair that is named touches where its image says.
    first, second = block.contacts.pairs.T
    away = block.positions[first] - block.positions[second]
    away[:, :2] -= block.contacts.images * block.periods
    assert (np.linalg.norm(away, axis=1) < block.radii[first] + block.radii[second]).all()
    with pytest.raises(ModelError, match="replicated 0 by 1 times: both numbers must be at least 1"):
        replicate(bed, 0, 1)


def test_a_denser_bed_has_more_contacts(bed):
    dense = settle(replace(KEY, porosity=0.37))
    assert dense.porosity == pytest.approx(0.37, abs=TOLERANCE)
    assert dense.coordination > bed.coordination


@pytest.mark.parametrize("porosity, message", [(0.48, "settle to at most 0.4"), (0.30, "settle to between 0.3.* and 0.4")])
def test_a_porosity_out_of_reach_is_refused_with_what_can_be_had(porosity, message):
    with pytest.raises(ModelError, match=f"porosity = {porosity:g}: these particles {message}"):
        settle(replace(KEY, porosity=porosity))


def test_a_bed_stands_on_a_slope_below_its_angle_of_repose_and_flows_above_it(bed):
    tilted = settle(replace(KEY, gravity=(9.81 * np.sin(0.2), 0.0, -9.81 * np.cos(0.2))))
    simulation = tilted.simulation()
    simulation.step(0.02)
    f = simulation.tools[0].f_0
    assert f[0] / f[2] == pytest.approx(-np.tan(0.2), rel=1e-2)  # the floor bears the weight, and nothing else
    with pytest.raises(ModelError, match=r"not at rest after .* s: on its slope of 45 deg it flows; tilt gravity less"):
        settle(replace(KEY, gravity=(6.9, 0.0, -6.9)))


def test_fine_particles_lie_on_coarse_ones_and_do_not_trickle_into_them():
    key = replace(KEY, sizes=Uniform(0.0055, 0.0065), depth=0.09, size=(0.05, 0.05), refinement=((0.03, 2.0),), porosity=0.41)
    fine_everywhere = (1 - key.porosity) * key.depth * key.column**2 / key.sizes.mean_volume
    bed = settle(key)
    fine = bed.radii < 0.004
    assert len(bed.radii) < 0.55 * fine_everywhere * bed.counts[0] * bed.counts[1]
    assert set(np.round(bed.radii[~fine] / 0.006)) == {1.0}
    simulation, z = bed.simulation(), bed.positions[:, 2]
    deep = -0.03 - 0.006  # a fine diameter below the interface
    before = (z[fine] < deep).sum()
    for k in range(10):  # shaken along x
        simulation.gravity = np.array([6.0 * (-1) ** k, 0.0, -9.81])
        simulation.step(0.02)
    now = np.empty(len(z))
    now[simulation.ident] = simulation.bodies[:, 2]
    assert before < 0.1 * fine.sum()
    assert (now[fine] < deep).sum() - before < 0.02 * fine.sum()


@pytest.mark.parametrize(
    "change, message",
    [
        (dict(porosity=0.0), "porosity = 0: it must be within 0 and 1"),
        (dict(scale=0.5), "scale = 0.5: a coarse-grain factor must be at least 1"),
        (dict(size=(0.1, 0.0)), "size along y = 0 m: it must be above 0 m"),
        (dict(gravity=(0.0, 0.0, 9.81)), "its z must be below 0 m/s2"),
        (dict(refinement=((0.04, 2.5),)), "refinement at 0.04 m by the ratio 2.5: it must be above 1 and at most 2"),
        (dict(refinement=((0.02, 1.1), (0.04, 1.1), (0.06, 1.1))), "refinement has 3 steps: at most 2"),
        (
            dict(refinement=((0.02, 1.5),)),
            "of depth holds particles of 0.01 m: it must be at least 0.04 m thick",
        ),
        (dict(depth=0.05), "depth = 0.05 m: too shallow .* make it at least 0.055 m"),
    ],
)
def test_a_key_out_of_bounds_is_refused(change, message):
    with pytest.raises(ModelError, match=message):
        replace(KEY, **change)


def test_coarse_grains_scale_all_lengths_of_particles():
    coarse = replace(KEY, sizes=Uniform(0.0045, 0.0055), scale=2.0)
    assert (coarse.diameter, coarse.largest, coarse.column) == (KEY.diameter, KEY.largest, KEY.column)


def test_sizes_are_drawn_as_shares_of_mass_and_evenly():
    rng = np.random.default_rng(0)
    shares = Shares(((0.002, 0.2), (0.004, 0.5), (0.008, 0.3)))
    d = shares.draw(20_000, rng)
    for size, share in shares.shares:
        assert (d[d == size] ** 3).sum() / (d**3).sum() == pytest.approx(share, rel=0.02)
    assert np.pi / 6 * (d**3).mean() == pytest.approx(shares.mean_volume, rel=0.02)
    uniform = Uniform(0.002, 0.006)
    d = uniform.draw(20_000, rng)
    assert np.histogram(d, np.linspace(0.002, 0.006, 5))[0] == pytest.approx([5000] * 4, abs=1)
    assert np.pi / 6 * (d**3).mean() == pytest.approx(uniform.mean_volume, rel=1e-3)
    for wrong, message in [
        (lambda: Uniform(0.0, 0.01), "0 < d_min <= d_max is needed"),
        (lambda: Uniform(0.001, 0.02), "the largest is 20 times the smallest, at most 5 times"),
        (lambda: Shares(((0.002, 0.5),)), "sum to 0.5: they must sum to 1"),
        (lambda: Shares(((0.002, -1.0),)), "both must be above 0"),
    ]:
        with pytest.raises(ModelError, match=message):
            wrong()


def test_heights_are_those_of_the_highest_spheres_and_numbers_everywhere():
    bodies = np.zeros((2, PARTICLE))
    bodies[0, :4], bodies[1, :4] = (0.02, 0.01, 0.0, 0.01), (0.02, 0.02, 0.004, 0.01)
    heights = np.full((5, 4), np.nan)
    fill_heights(bodies, 2, np.array([0.0, 0.0]), 0.01, heights)
    assert heights[2, 1] == 0.01 and heights[2, 2] == pytest.approx(0.014) and heights[0, 0] == NOTHING
    assert np.isfinite(heights).all()
    bodies[:, 0] = 1e9
    fill_heights(bodies, 2, np.array([0.0, 0.0]), 0.01, heights)
    assert (heights == NOTHING).all()


def test_mean_height_of_a_square_layer_is_its_integral_and_knows_no_edges():
    # A sphere of radius r over each square of 2 r: the mean of sqrt(r^2 - q^2) within the disc, and what lies lower at the corners.
    k = np.arange(4)
    x, y = np.meshgrid(0.02 * k, 0.02 * k, indexing="ij")
    top = np.stack([x.ravel(), y.ravel(), np.zeros(16)], axis=1)
    below = top + np.array([0.01, 0.01, -0.01])
    s = np.linspace(-0.01, 0.01, 401)[:-1] + 2.5e-5
    q = s[:, None] ** 2 + s**2
    c = (np.abs(s)[:, None] - 0.01) ** 2 + (np.abs(s) - 0.01) ** 2
    high, low = (np.where(square < 1e-4, np.sqrt(np.maximum(1e-4 - square, 0.0)), -1.0) for square in (q, c))
    expected = np.maximum(high, low - 0.01).mean()
    radii = np.full(32, 0.01)
    for shift in (0.0, 0.0031):
        positions = np.concatenate([top, below])
        positions[:, :2] = (positions[:, :2] + shift) % 0.08
        assert mean_height(positions, radii, (0.08, 0.08), 0.08 / 160) == pytest.approx(expected, abs=2e-5)


def test_porosity_cuts_spheres():
    volume = 4 / 3 * np.pi * 0.01**3
    parts = 1 - porosity_between(np.zeros(1), np.array([0.01]), (0.1, 0.1), np.array([-0.01, 0.0, 0.005, 0.01]))
    assert parts * 1e-2 * [0.01, 0.005, 0.005] == pytest.approx(volume * np.array([16, 11, 5]) / 32)


def test_a_library_settles_once_and_repairs_what_is_damaged(bed, tmp_path, monkeypatch):
    made = []
    monkeypatch.setattr(library, "settle", lambda key, progress: made.append(key) or bed)
    beds = Library(tmp_path / "beds")
    first = beds.get(KEY)
    kept = beds.get(KEY)
    assert len(made) == 1 and kept.key == first.key == KEY
    assert np.array_equal(kept.positions, bed.positions) and (kept.periods, kept.counts, kept.floor) == (bed.periods, bed.counts, bed.floor)
    assert all(np.array_equal(a, b) and a.dtype == b.dtype for a, b in zip(kept.contacts, bed.contacts))
    assert sorted(path.suffix for path in beds.folder.iterdir()) == [".npz", ".toml"]
    text = beds.path(KEY).with_suffix(".toml").read_text()
    assert 'density = { value = 2600.0, unit = "kg/m3" }' in text and "coordination" in text
    data = beds.path(KEY).read_bytes()
    assert key_hash(replace(KEY, seed=4)) != beds.path(KEY).stem
    for damaged in (data[: len(data) // 2], data[:5000] + b"xxxx" + data[5004:], b""):
        beds.path(KEY).write_bytes(damaged)
        with pytest.warns(UserWarning, match=r"damaged, or no .npz .*the bed is settled anew"):
            beds.get(KEY)
        assert beds.path(KEY).read_bytes() == data
    beds.path(KEY).with_suffix(".toml").write_text(key_text(replace(KEY, seed=9)))
    with pytest.warns(UserWarning, match="it was made from something else; the bed is settled anew"):
        beds.get(KEY)
    assert len(made) == 5


def test_a_key_has_all_its_values_with_units_and_comes_back(tmp_path, bed):
    for kind, section in ((Material, "material"), (BedKey, "bed")):
        names = {field.name for field in fields(kind)} - {"material", "sizes", "shape"}
        assert names == {name for name in bed_files._UNITS[section] if not name.startswith("shape_")}
    sizes, shape = Shares(((0.009, 0.25), (0.011, 0.75))), Shape(corners=8, returned=0.5)
    other = replace(KEY, sizes=sizes, depth=0.2, refinement=((0.07, 1.5),), scale=1.25, material=Material(linear=True, shape=shape))
    turned = np.tile([0.6, 0.8, 0.0, 0.0], (len(bed.radii), 1))
    write_bed(replace(bed, key=other, orientations=turned), tmp_path / "bed.npz")
    back = bed_files.read_bed(tmp_path / "bed.npz")
    assert back.key == other and np.array_equal(back.orientations, turned)


def damage(path, **arrays):
    with np.load(path) as stored:
        arrays = dict(stored) | arrays
    np.savez(path, **{name: array for name, array in arrays.items() if array is not None})


@pytest.mark.parametrize(
    "change, message",
    [
        (lambda b: dict(radii=None), "has no array radii: a bed needs positions, radii"),
        (lambda b: dict(positions=b.positions[:, :2]), r"positions has the shape \(\d+, 2\), \(\d+, 3\) is needed"),
        (lambda b: dict(radii=np.where(np.arange(len(b.radii)) == 5, np.nan, b.radii)), "radii holds what is no finite number"),
        (lambda b: dict(radii=np.where(np.arange(len(b.radii)) == 5, 0.0, b.radii)), "particle 5 has the radius 0 m: it must be above 0 m"),
        (lambda b: dict(counts=np.array([3, 2])), "period along x is 0.088 m in 3 columns: a column must be at least 0.04"),
        (lambda b: dict(counts=np.array([1, 2])), "columns are 0.088 m by 0.044 m: they must be squares"),
        (lambda b: dict(floor=np.array(b.floor + 0.002)), r"m deep in the floor at -0.07.* m, above 5 % of its radius"),
        (lambda b: dict(on_floor=b.contacts.on_floor + 10_000), "on_floor must hold numbers of particles, whole and within 0 and"),
        (lambda b: dict(shear=None), "has no array shear"),
        (lambda b: dict(counts=b.counts - np.array([0.0, 0.5])), "counts = .* of columns: they must be whole numbers"),
        (lambda b: dict(positions=b.positions - [0.01, 0.0, 0.0]), r"particle \d+ is at \(-.*outside the tile.*: shift the bed, or wrap"),
        (lambda b: dict(radii=0.4 * b.radii), r"its diameters are .* m, but \[sizes\] says .* m at the surface"),
        (
            lambda b: dict(positions=b.positions + np.array([0.0, 0.0, 0.02]), floor=np.array(b.floor + 0.02)),
            r"depth says .* m below the surface",
        ),
    ],
)
def test_a_bed_given_by_a_user_is_checked(bed, tmp_path, change, message):
    path = tmp_path / "mine.npz"
    write_bed(bed, path)
    damage(path, **change(bed))
    with pytest.raises(ModelError, match=f"mine.npz.*{message}"):
        load_bed(path)


def test_an_overlapping_bed_is_refused_with_the_particles_named(bed, tmp_path):
    path = tmp_path / "mine.npz"
    i, j = sorted(bed.contacts.pairs[0])
    write_bed(bed, path)
    positions = bed.positions.copy()
    away = positions[j] - positions[i]
    away[:2] -= np.rint(away[:2] / bed.periods) * bed.periods
    positions[j] = positions[i] + 0.4 * away
    positions[:, :2] %= bed.periods
    damage(path, positions=positions)
    with pytest.raises(ModelError, match=rf"particles {i} and {j} \(radii .* of the smaller radius; at most 5 % are possible"):
        load_bed(path)
    # Without history it is a bed, too.
    damage(path, positions=bed.positions, **dict.fromkeys(bed.contacts._fields))
    assert len(load_bed(path).contacts.pairs) == 0


def test_a_user_file_with_wrong_units_or_names_is_refused(bed, tmp_path):
    path = tmp_path / "mine.npz"
    with pytest.raises(ModelError, match=r"mine.npz: no such file; a bed is an .npz of arrays and a .toml beside it"):
        load_bed(path)
    for old, new, message in [
        ('unit = "Pa"', 'unit = "MPa"', r'\[material\] E must read { value = ..., unit = "Pa" }'),
        ("mu =", "friction =", r"\[material\] friction is not known; known are E, nu, e, mu"),
        ("depth = { value = 0.08, ", "# {", "mine.toml lacks a value"),
        ("[bed]", "[bed", "mine.toml: damaged, or no TOML"),
    ]:
        write_bed(bed, path)
        text = path.with_suffix(".toml").read_text()
        path.with_suffix(".toml").write_text(text.replace(old, new, 1))
        with pytest.raises(ModelError, match=message):
            load_bed(path)


def test_memory_is_that_of_the_arrays_and_too_much_is_refused_before(bed, monkeypatch):
    simulation = replicate(bed, 4, 4).simulation()
    n = len(simulation.bodies)
    assert estimate_memory(n) == pytest.approx(sum(array.nbytes for array in (*simulation.particles, *simulation._tools)), rel=0.01)
    assert estimate_memory(91_000, n_tools=2) < 500e6
    assert estimate_memory(n, precision=np.float32) < estimate_memory(n)
    assert estimate_memory(n, shape=Shape(corners=6)) >= estimate_memory(n) + 2 * 4 * 8 * n  # a quaternion on both sides
    monkeypatch.setattr(memory, "available_memory", lambda: int(1e9))
    check_memory(100_000)
    with pytest.raises(ModelError, match=r"10000000 particles need 1\d.\d GB of memory, 1 GB are available: take coarser grains"):
        check_memory(10_000_000)
    with pytest.raises(ModelError, match=r"particles need .* GB of memory, 1 GB are available"):
        settle(replace(KEY, size=(100.0, 100.0)))


def test_tools_and_boxes_are_large_against_particles():
    check_feature("h_g", 0.05, D)
    with pytest.warns(UserWarning, match=r"h_g = 0.03 m is 3 mean diameters .* below 5 its forces depend on single particles"):
        check_feature("h_g", 0.03, D)
    with pytest.raises(ModelError, match=r"h_g = 0.015 m is 1.5 mean diameters .* at least 2 are needed: take particles below 0.0075 m"):
        check_feature("h_g", 0.015, D)
    check_box(0.25, 0.15, tool_width=0.125, tool_radius=0.125)
    with pytest.raises(ModelError, match=r"box_width = 0.2 m: for this tool it must be at least 0.25 m \(2 widths of 0.125 m\)"):
        check_box(0.2, 0.15, tool_width=0.125, tool_radius=0.125)
    with pytest.raises(ModelError, match=r"depth = 0.1 m: for this tool it must be at least 0.15 m"):
        check_box(0.3, 0.1, tool_width=0.125, tool_radius=0.125)


@pytest.mark.parametrize("linear", [False, True])
def test_the_overlap_under_load_is_what_a_bed_has_at_its_floor_and_a_softer_one_is_warned_of(bed, linear):
    material = Material(linear=linear)
    pressure = 10e3
    assert overlap_under(replace(material, E=100 * material.E), pressure) < 0.1 * overlap_under(material, pressure)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_overlap(replace(material, E=1e9), pressure)
    with pytest.warns(UserWarning, match=r"E = 10000 Pa: under 1e\+04 Pa particles overlap by .* take E >= (\S+) Pa"):
        check_overlap(replace(material, E=1e4), pressure)
    if not linear:
        near_floor = bed.positions[:, 2] < bed.floor + 3 * D
        first, second = bed.contacts.pairs[near_floor[bed.contacts.pairs].all(axis=1)].T
        away = bed.positions[first] - bed.positions[second]
        away[:, :2] -= np.rint(away[:, :2] / bed.periods) * bed.periods
        overlaps = bed.radii[first] + bed.radii[second] - np.linalg.norm(away, axis=1)
        weight = (1 - bed.porosity) * 2600 * 9.81 * (KEY.depth - 1.5 * D)
        assert overlaps.mean() / D == pytest.approx(overlap_under(KEY.material, weight), rel=0.3)
