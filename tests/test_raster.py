"""Rasters of undisturbed ground from files, and what a file that is none is told."""

import sys

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from cdl_fmu.slave.model import ModelError
from cdl_fmu.terrain.raster import load_raster

NX, NY, SPACING, ORIGIN = 5, 4, 0.25, (10.0, -3.0)


def plane(x, y):
    return 0.5 + 0.125 * x - 0.0625 * y


def heights():
    x, y = ORIGIN[0] + SPACING * np.arange(NX), ORIGIN[1] + SPACING * np.arange(NY)
    return plane(x[:, None], y[None, :])


def npz(path, **arrays):
    np.savez(path, **(dict(z=heights(), origin=ORIGIN, spacing=SPACING) | arrays))
    return path


ESRI_CORNER = f"""ncols {NX}
nrows {NY}
xllcorner {ORIGIN[0] - SPACING / 2}
yllcorner {ORIGIN[1] - SPACING / 2}
cellsize {SPACING}
NODATA_value -9999
"""
ESRI_CENTRE = f"NCOLS {NX}\r\nNROWS {NY}\r\nXLLCENTER {ORIGIN[0]}\r\nYLLCENTER {ORIGIN[1]}\r\nCELLSIZE {SPACING}\r\n"


def asc(path, header=ESRI_CORNER, z=None):
    rows = heights().T[::-1] if z is None else z.T[::-1]
    path.write_bytes((header + "\n".join(" ".join(map(repr, row.tolist())) for row in rows)).encode())
    return path


def tif(path, bands=1, scale=1.0, z=None, **profile):
    rasterio = pytest.importorskip("rasterio")
    north = ORIGIN[1] + (NY - 0.5) * SPACING
    z = heights() if z is None else z
    settings = dict(
        driver="GTiff",
        width=NX,
        height=NY,
        count=bands,
        dtype="float64",
        transform=rasterio.Affine(SPACING, 0.0, ORIGIN[0] - SPACING / 2, 0.0, -SPACING, north),
        crs="EPSG:32633",
    )
    with rasterio.open(path, "w", **(settings | profile)) as file:
        file.scales = [scale] * bands
        for band in range(bands):
            file.write(z.T[::-1] / scale, band + 1)
    return path


def read(tmp_path, kind):
    if kind == "npz":
        return load_raster(npz(tmp_path / "dune.npz"))
    if kind == "tif":
        return load_raster(tif(tmp_path / "dune.tif"))
    return load_raster(asc(tmp_path / "dune.asc", ESRI_CORNER if kind == "corner" else ESRI_CENTRE))


@pytest.mark.parametrize("kind", ["npz", "corner", "centre", "tif"])
def test_a_plane_is_read_exactly(tmp_path, kind):
    raster = read(tmp_path, kind)
    assert raster.origin == ORIGIN and raster.spacing == SPACING
    assert raster.z.shape == (NX, NY) and raster.z.dtype == np.float64 and raster.z.flags.c_contiguous
    nodes = [raster.origin[k] + raster.spacing * np.arange(raster.z.shape[k]) for k in range(2)]
    ground = RegularGridInterpolator(nodes, raster.z)
    places = np.array([[10.0, -3.0], [10.1, -2.93], [10.77, -2.31], [11.0, -2.25]])
    assert ground(places) == pytest.approx(plane(*places.T), abs=1e-14)


def test_heights_may_be_whole_numbers_and_rows_broken(tmp_path):
    (tmp_path / "dune.asc").write_text("\ufeffncols 2\nnrows 2\nxllcenter 0\nyllcenter 0\ncellsize 1\n1\n2 3\n4\n", encoding="utf-8")
    assert load_raster(tmp_path / "dune.asc").z.tolist() == [[3.0, 1.0], [4.0, 2.0]]


def test_a_geotiffs_scale_is_applied(tmp_path):
    assert load_raster(tif(tmp_path / "dune.tiff", scale=0.5)).z == pytest.approx(heights(), abs=1e-14)


def refusal(path):
    with pytest.raises(ModelError) as raised:
        load_raster(path)
    return str(raised.value)


def test_files_that_are_no_raster_are_refused(tmp_path):
    assert "gone.asc: no such file; give the path of a raster of heights (.npz, .asc or .tif)" in refusal(tmp_path / "gone.asc")
    assert "dune.png: a raster of heights is read from .npz, .asc (ESRI ASCII grid) or .tif" in refusal(tmp_path / "dune.png")
    np.save(tmp_path / "dune.npy", heights())
    assert (
        refusal(tmp_path / "dune.npy") == "dune.npy does not say where its heights lie: save z, shape [nx, ny], as "
        "numpy.savez('dune.npz', z=z, origin=(x, y), spacing=d), in m"
    )
    (tmp_path / "noise.npz").write_text("noise")
    assert "noise.npz cannot be read" in refusal(tmp_path / "noise.npz")
    (tmp_path / "empty.asc").write_text("")
    assert "empty.asc has no xllcorner or xllcenter: write it above the heights, in m" in refusal(tmp_path / "empty.asc")


@pytest.mark.parametrize(
    ("arrays", "text"),
    [
        ({"z": np.zeros(5)}, "dune.npz: 'z' has the shape [5]; it must be [nx, ny]"),
        ({"origin": np.zeros(3)}, "dune.npz: 'origin' has the shape [3]; it must be [2]"),
        ({"spacing": np.ones(2)}, "dune.npz: 'spacing' has the shape [2]; it must be []"),
        ({"spacing": 0.0}, "dune.npz: spacing = 0 m with node [0, 0] at (10, -3) m: finite, with a spacing above 0 m"),
        ({"spacing": np.nan}, "dune.npz: spacing = nan m with node"),
        ({"z": np.zeros((1, 4))}, "dune.npz has 1 x 4 nodes: at least 2 x 2 are needed; use a larger part of the terrain"),
        ({"z": np.full((2, 2), np.nan)}, "dune.npz: 4 of 4 nodes have no height (NODATA, NaN or infinite); fill them, e.g. with gdal_fill"),
        ({"z": np.array([["high", "low"]])}, "dune.npz cannot be read"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(tmp_path, arrays, text):
    assert text in refusal(npz(tmp_path / "dune.npz", **arrays))


def test_an_array_that_is_missing_is_named(tmp_path):
    np.savez(tmp_path / "dune.npz", z=heights(), spacing=1.0)
    assert refusal(tmp_path / "dune.npz").startswith("dune.npz has no 'origin': save it as numpy.savez('dune.npz', z=z, origin=(x, y), ")


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("ncols 5", "ncols 6", "dune.asc has 20 heights, not ncols x nrows = 6 x 4; it is cut off or its header is wrong"),
        ("ncols 5", "ncols five", "dune.asc: ncols = 'five' is no number"),
        ("ncols 5", "ncols -5", "dune.asc has 20 heights, not ncols x nrows = -5 x 4"),
        ("ncols 5\nnrows 4", "ncols 2.5\nnrows 8", "dune.asc has 20 heights, not ncols x nrows = 2.5 x 8"),
        ("ncols 5\n", "", "dune.asc has no ncols: an ESRI ASCII grid begins with ncols, nrows, xllcorner, yllcorner and cellsize"),
        ("cellsize 0.25\n", "", "dune.asc has no cellsize"),
        ("xllcorner", "xcorner", "dune.asc has no xllcorner or xllcenter: write it above the heights, in m"),
        ("cellsize 0.25", "dx 0.25\ndy 0.5", "dune.asc: pixels of 0.25 m x 0.5 m are not square; resample it, e.g. with gdalwarp -tr 0.25"),
        ("cellsize 0.25", "cellsize -0.25", "dune.asc: spacing = -0.25 m"),
    ],
)
def test_an_esri_header_that_is_wrong_is_refused(tmp_path, old, new, text):
    assert old in ESRI_CORNER
    assert text in refusal(asc(tmp_path / "dune.asc", ESRI_CORNER.replace(old, new)))


GAPS = "3 of 20 nodes have no height (NODATA, NaN or infinite); fill them, e.g. with gdal_fillnodata, or cut out a part without gaps"


@pytest.mark.parametrize("write", [asc, tif])
def test_gaps_are_counted(tmp_path, write):
    z = heights()
    z[0, :2], z[2, 3] = -9999.0, np.nan
    declared = dict(nodata=-9999.0) if write is tif else {}
    assert GAPS in refusal(write(tmp_path / f"dune.{write.__name__}", z=z, **declared))


def test_a_gap_in_the_first_node_of_the_file_is_one(tmp_path):
    z = heights()
    z[0, -1] = np.nan
    assert "1 of 20 nodes have no height" in refusal(asc(tmp_path / "dune.asc", z=z))


def test_decimal_commas_are_refused(tmp_path):
    (tmp_path / "dune.asc").write_text(ESRI_CENTRE + "1,5 " * (NX * NY))
    assert "dune.asc: could not convert string to float: '1,5'; heights are numbers with a decimal point" in refusal(tmp_path / "dune.asc")


def test_geotiffs_that_do_not_lie_in_world_axes_are_refused(tmp_path):
    rasterio = pytest.importorskip("rasterio")
    upright = rasterio.Affine(0.25, 0.0, 0.0, 0.0, -0.25, 0.0)
    for profile, text in [
        (dict(bands=2), "dune.tif has 2 bands: keep the one of the heights, e.g. with gdal_translate -b 1"),
        (dict(crs="EPSG:4326"), "dune.tif is in degrees: metres are needed; project it, e.g. with gdalwarp -t_srs"),
        (dict(crs="EPSG:2263"), "dune.tif is in US survey foot: metres are needed"),
        (dict(transform=upright @ rasterio.Affine.rotation(10.0)), "dune.tif is turned: columns must run east and rows south"),
        (dict(transform=upright @ rasterio.Affine.scale(1.0, -1.0)), "dune.tif is turned"),
        (dict(transform=upright @ rasterio.Affine.scale(1.0, 2.0)), "dune.tif: pixels of 0.25 m x 0.5 m are not square"),
    ]:
        assert text in refusal(tif(tmp_path / "dune.tif", **profile))
    (tmp_path / "noise.tif").write_text("noise")
    assert "noise.tif cannot be read" in refusal(tmp_path / "noise.tif")


def test_without_rasterio_the_remedy_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rasterio", None)
    (tmp_path / "dune.tif").touch()
    assert (
        refusal(tmp_path / "dune.tif") == "dune.tif: GeoTIFF needs rasterio, which is not installed: pip install 'cdl-fmu[geotiff]', "
        "or convert the file with gdal_translate -of AAIGrid to .asc"
    )
