"""Rasters of undisturbed ground: heights at the nodes of a square grid in world axes, read from a file."""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..slave.model import ModelError

_SQUARE = 1e-6  # relative difference of a pixel's sides that files may have from rounding
_ESRI_KEYS = {"ncols", "nrows", "xllcorner", "yllcorner", "xllcenter", "yllcenter", "cellsize", "dx", "dy", "nodata_value"}


@dataclass(frozen=True)
class Raster:
    """Heights of the ground.

    Attributes:
        origin: World x, y of node [0, 0] [m].
        spacing: Distance of neighbouring nodes, in x as in y [m].
        z: Heights [m], float64 of shape [nx, ny], C-contiguous: node [i, j] lies at origin + spacing (i, j).
    """

    origin: tuple[float, float]
    spacing: float
    z: np.ndarray


def load_raster(path: str | Path) -> Raster:
    """Read ``.npz`` (arrays ``z`` [nx, ny], ``origin`` [2] and ``spacing``, in m), ESRI ASCII grid ``.asc`` or GeoTIFF ``.tif``.

    The values of ESRI grids and GeoTIFFs are heights at the middles of their pixels; x is east and y north.

    Raises:
        ModelError: The file is missing or damaged, its pixels are not square or not in metres, or a node has no height.
    """
    path = Path(path)
    readers = {".npz": _npz, ".asc": _esri, ".tif": _geotiff, ".tiff": _geotiff, ".npy": _npy}
    if path.suffix.lower() not in readers:
        raise ModelError(f"{path.name}: a raster of heights is read from .npz, .asc (ESRI ASCII grid) or .tif (GeoTIFF); convert it")
    if not path.is_file():
        raise ModelError(f"{path}: no such file; give the path of a raster of heights (.npz, .asc or .tif)")
    (x, y), spacing, z = readers[path.suffix.lower()](path)
    if not (np.isfinite([x, y, spacing]).all() and spacing > 0.0):
        raise ModelError(f"{path.name}: spacing = {spacing:g} m with node [0, 0] at ({x:g}, {y:g}) m: finite, with a spacing above 0 m")
    if min(z.shape) < 2:
        raise ModelError(f"{path.name} has {z.shape[0]} x {z.shape[1]} nodes: at least 2 x 2 are needed; use a larger part of the terrain")
    missing = z.size - np.count_nonzero(np.isfinite(z))
    if missing:
        raise ModelError(
            f"{path.name}: {missing} of {z.size} nodes have no height (NODATA, NaN or infinite); fill them, e.g. with gdal_fillnodata, "
            "or cut out a part without gaps"
        )
    return Raster((float(x), float(y)), float(spacing), np.ascontiguousarray(z))


# Readers return x, y of node [0, 0] [m], the spacing [m] and the heights [m], shape [nx, ny], with NaN where there is none.
def _npy(path: Path):
    raise ModelError(
        f"{path.name} does not say where its heights lie: save z, shape [nx, ny], as "
        f"numpy.savez('{path.stem}.npz', z=z, origin=(x, y), spacing=d), in m"
    )


def _npz(path: Path):
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: np.asarray(file[name], dtype=float) for name in ("z", "origin", "spacing") if name in file}
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        raise ModelError(f"{path.name} cannot be read ({error}): save numbers with numpy.savez") from None
    for name, shape in (("z", "[nx, ny]"), ("origin", "[2]"), ("spacing", "[]")):
        if name not in arrays:
            raise ModelError(f"{path.name} has no {name!r}: save it as numpy.savez('{path.name}', z=z, origin=(x, y), spacing=d), in m")
        array = arrays[name]
        if array.ndim != {"z": 2, "origin": 1, "spacing": 0}[name] or (name == "origin" and array.size != 2):
            raise ModelError(f"{path.name}: {name!r} has the shape {list(array.shape)}; it must be {shape}")
    return arrays["origin"], arrays["spacing"][()], arrays["z"]


def _esri(path: Path):
    header, rows = {}, []
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        for line in file:
            words = line.split()
            if words and not rows and words[0].lower() in _ESRI_KEYS:
                header[words[0].lower()] = _number(path.name, words[0], " ".join(words[1:]))
            else:
                rows.extend(words)
    if "dx" in header and "dy" in header:
        _check_square(path.name, header["dx"], header["dy"])
        header.setdefault("cellsize", header["dx"])
    first = []
    for axis in "xy":
        corner, centre = f"{axis}llcorner", f"{axis}llcenter"
        if corner not in header and centre not in header:
            raise ModelError(f"{path.name} has no {corner} or {centre}: write it above the heights, in m")
        first.append(header[centre] if centre in header else header[corner] + 0.5 * header.get("cellsize", 0.0))
    for key in ("ncols", "nrows", "cellsize"):
        if key not in header:
            raise ModelError(f"{path.name} has no {key}: an ESRI ASCII grid begins with ncols, nrows, xllcorner, yllcorner and cellsize")
    n_x, n_y = header["ncols"], header["nrows"]
    if n_x % 1.0 or n_y % 1.0 or n_x < 1.0 or n_x * n_y != len(rows):
        raise ModelError(
            f"{path.name} has {len(rows)} heights, not ncols x nrows = {n_x:g} x {n_y:g}; it is cut off or its header is wrong"
        )
    try:
        z = np.array(rows, dtype=float).reshape(int(n_y), int(n_x))
    except ValueError as error:
        raise ModelError(f"{path.name}: {error}; heights are numbers with a decimal point") from None
    z[z == header.get("nodata_value", -9999.0)] = np.nan
    return first, header["cellsize"], z[::-1].T  # rows run from north to south


def _number(file: str, key: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ModelError(f"{file}: {key} = {text!r} is no number; an ESRI ASCII grid has one number after each key") from None


def _check_square(file: str, dx: float, dy: float) -> None:
    if abs(dx - dy) > _SQUARE * abs(dx):
        raise ModelError(f"{file}: pixels of {dx:g} m x {dy:g} m are not square; resample it, e.g. with gdalwarp -tr {dx:g} {dx:g}")


def _geotiff(path: Path):
    try:
        import rasterio
    except ModuleNotFoundError:
        raise ModelError(
            f"{path.name}: GeoTIFF needs rasterio, which is not installed: pip install 'cdl-fmu[geotiff]', or convert the file with "
            "gdal_translate -of AAIGrid to .asc"
        ) from None
    try:
        with rasterio.open(path) as file:
            at, crs, bands = file.transform, file.crs, file.count
            z = file.read(1, masked=True).astype(float).filled(np.nan) * file.scales[0] + file.offsets[0]
    except rasterio.errors.RasterioError as error:
        raise ModelError(f"{path.name} cannot be read ({error}); export it again as GeoTIFF") from None
    if bands != 1:
        raise ModelError(f"{path.name} has {bands} bands: keep the one of the heights, e.g. with gdal_translate -b 1")
    if crs and (crs.is_geographic or crs.linear_units_factor[1] != 1.0):
        unit = "degrees" if crs.is_geographic else crs.linear_units
        raise ModelError(f"{path.name} is in {unit}: metres are needed; project it, e.g. with gdalwarp -t_srs and a map grid in metres")
    if at.b != 0.0 or at.d != 0.0 or at.a <= 0.0 or at.e >= 0.0:
        raise ModelError(f"{path.name} is turned: columns must run east and rows south; straighten it, e.g. with gdalwarp")
    _check_square(path.name, at.a, -at.e)
    return (at.c + 0.5 * at.a, at.f + at.e * (z.shape[0] - 0.5)), at.a, z[::-1].T
