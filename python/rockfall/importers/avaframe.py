# SPDX-License-Identifier: BSD-3-Clause
"""Import of inputs from an AvaFrame avalanche folder (com1DFA, com4FlowPy and others)."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from rockfall.case.text import Entry, Group
from rockfall.draft.grounds import Ask, Grounds, needs_rocks
from rockfall.draft.groups import MAPS, RADIUS, VOLUME
from rockfall.errors import RockfallError, need
from rockfall.files.export import write_geopackage
from rockfall.importers.imported import CASE, Import, only
from rockfall.io.atomic import atomic_folder
from rockfall.io.coordinates.crs import plan_wkt
from rockfall.io.files import relative_name
from rockfall.io.rasters.aligned import aligned_blocks

RASTERS, LAYERS = (".asc", ".tif"), (".shp",)
BOULDERS = 100_000
OBJECTS = "objects.gpkg"
#: Input folders that are irrelevant for boulders, with reasons.
WITHOUT = {
    "SECREL": "secondary releases are of snow", "ENT": "boulders entrain nothing",
    "RELTH": "release thickness is of snow", "RASTERS": "friction and diameters are of flows",
    "DAM": "a dam needs a height: &dam file, height", "LINES": "profiles of AlphaBeta and AIMEC",
    "POINTS": "points of AlphaBeta and AIMEC", "POLYGONS": "areas of AIMEC",
    "CFGS": "settings of flow models", "UMAX": "limits of flow models",
    "ALPHA": "angles of flow models", "EXP": "spreading of flow models",
    "RELID": "the name of each release area is in the results",
}  # fmt: skip


def import_avaframe(
    directory: str | Path,
    out: str | Path,
    *,
    ground: str = "",
    crs: str | None = None,
    no_forest: bool = False,
    ask: Ask | None = None,
) -> dict[str, list[str]]:
    """Write a case to the folder `out`, from the inputs of an AvaFrame folder or of its `Inputs`.

    Uses the DEM, the release areas in `REL` (a variant for each if there are several), and the
    cells of `INFRA`, as polygons for `rockfall hazard --objects`. `ground` is the ground of the
    slope, which AvaFrame lacks; `crs` (such as EPSG:31287) is the CRS of a DEM without one. A
    raster in `RES` has no stems: it is refused, or with `no_forest` ignored.

    Returns lines about the inputs by heading: "taken over", "imported with changes" and "not
    imported". Raises a RockfallError for an input that cannot be used.

    >>> import rockfall
    >>> lines = rockfall.import_avaframe("avaHill", "boulders", ground="talus", crs="EPSG:31287")
    >>> lines["taken over"][0]
    'Inputs/hill.asc: the terrain'
    """
    folder, out = Path(directory), Path(out)
    inputs = next((path for path in (folder / "Inputs", folder) if (path / "REL").is_dir()), None)
    if inputs is None:
        raise RockfallError(f"{folder}: has no folder Inputs/REL")
    dem = only(_files(inputs, RASTERS), inputs, "DEM (.asc or .tif)")
    releases = _files(inputs / "REL", (*RASTERS, *LAYERS))
    kinds = {path.suffix.lower() in LAYERS for path in releases}
    if len(kinds) != 1:
        held = "both" if kinds else "none"
        raise RockfallError(f"{inputs / 'REL'}: must have shapefiles or rasters (found: {held})")
    _check_forest(inputs, no_forest)
    infra = _files(inputs / "INFRA", RASTERS)
    ground = Grounds(ground, {}, ask).of_case(str(dem))
    with atomic_folder(out, [dem, *releases, *infra], last=CASE) as part:
        made = Import(folder, dem, out, part, crs)
        _note_left(made, inputs)
        if infra:
            _objects(made, only(infra, inputs / "INFRA", "raster"))
        names = [_release(made, path) for path in releases]
        made.changed.append(f"ground {ground} and boulders of {VOLUME:g} m3 must be chosen")
        made.write("avaframe", lambda place: _groups(made, place, ground, releases, names))
    return made.lists()


def _files(folder: Path, endings: tuple[str, ...]) -> list[Path]:
    """Files in a folder with these extensions; none if the folder does not exist."""
    if not folder.is_dir():
        return []
    paths = (path for path in folder.iterdir() if path.is_file())
    return sorted(path for path in paths if path.suffix.lower() in endings)


def _check_forest(inputs: Path, no_forest: bool) -> None:
    """Refuse forest rasters, which give no stems, unless the user gave `--no-forest`."""
    for path in _files(inputs / "RES", RASTERS):
        if not no_forest:
            raise RockfallError(
                f"{path}: a forest structure index (FSI) has no stems: give --no-forest, then "
                "&forest with stems per hectare and diameters"
            )


def _note_left(made: Import, inputs: Path) -> None:
    """Note each input that the case does not use."""
    for path in _files(inputs / "RES", RASTERS):
        made.left.append(f"{made.name(path)}: no stems; &forest takes stems and diameters")
    for path in _files(inputs / "RES", LAYERS):
        made.left.append(f"{made.name(path)}: resistance to snow; &forest polygons takes stands")
    for folder in sorted(path for path in inputs.iterdir() if path.is_dir()):
        why = WITHOUT.get(folder.name.upper(), "unknown folder")
        if folder.name.upper() not in ("REL", "RES", "INFRA") and any(folder.iterdir()):
            made.left.append(f"{made.name(folder)}: {why}")


def _release(made: Import, path: Path) -> tuple[str, str]:
    """Key of a release area, and the name of its copy ("" if the original is used)."""
    if path.suffix.lower() in LAYERS:
        made.taken.append(f"{made.name(path)}: release polygons")
        made.left.append(f"{made.name(path)}: thickness and other attributes of snow")
        return "polygons", ""
    values = np.empty(made.grid.shape)
    for rows, block in aligned_blocks(path, made.grid, "release areas", "f8", smooth=False):
        values[rows] = block
    name = f"release_{path.stem}.tif"
    made.write_raster(name, (values > 0).astype("u1"))
    made.taken.append(f"{made.name(path)}: {np.count_nonzero(values > 0):,} release cells")
    return "cells", name


def _objects(made: Import, path: Path) -> None:
    """Write cells of infrastructure as polygons, one for each connected area of equal value."""
    need("objects need", "vector")
    import rasterio.features
    import shapely

    values = np.zeros(made.grid.shape)
    for rows, block in aligned_blocks(path, made.grid, "infrastructure", "f8", smooth=False):
        values[rows] = np.nan_to_num(block)
    levels, index = np.unique(np.where(values > 0, values, 0), return_inverse=True)
    areas = [
        (shapely.geometry.shape(shape), float(levels[int(number)]))
        for shape, number in rasterio.features.shapes(
            index.reshape(values.shape).astype("i4"), values > 0, transform=made.grid.transform
        )
    ]
    if not areas:
        made.left.append(f"{made.name(path)}: no cell above zero")
        return
    fields = {
        "name": np.array([f"infra {k}" for k in range(1, len(areas) + 1)]),
        "infra": np.array([value for _, value in areas]),
    }
    crs = plan_wkt(made.grid.crs) if made.grid.crs else None
    parts = [(np.array([shape for shape, _ in areas]), fields)]
    write_geopackage(made.part / OBJECTS, {"objects": ("Polygon", parts)}, crs)
    made.taken.append(
        f"{made.name(path)}: {len(areas):,} objects: rockfall hazard --objects {OBJECTS}"
    )


def _groups(
    made: Import, place: Path, ground: str, paths: list[Path], releases: list[tuple[str, str]]
) -> Iterator[Group]:
    """Groups of the case; file names are relative to the folder `place`."""
    files = [
        copy or relative_name(path.resolve(), place.resolve())
        for path, (_, copy) in zip(paths, releases, strict=True)
    ]
    title = f"{made.folder.resolve().name}, after AvaFrame"
    yield Group("case", [Entry("title", title), Entry("boulders_total", BOULDERS)])
    yield made.terrain(place)
    rocks = needs_rocks(ground)
    yield Group("surface", [
        Entry("ground", ground, "CHOOSE: docs/grounds.md"),
        Entry("uniform_mean_radius", RADIUS, "CHOOSE [m]", on=rocks),
    ])  # fmt: skip
    yield Group("boulder", [
        Entry("volume", "fixed"), Entry("volume_mean", VOLUME, "CHOOSE [m3]"),
        Entry("density", 2800.0, "CHOOSE [kg/m3]"),
    ])  # fmt: skip
    key = releases[0][0]
    yield Group("release", [
        Entry(key, files[0]), Entry("drop_height", 1.0, "CHOOSE [m]"),
    ])  # fmt: skip
    yield Group("output", [Entry("maps", list(MAPS)), Entry("rebounds", True)])
    if len(paths) > 1:  # AvaFrame runs each release area separately
        for path, file in zip(paths, files, strict=True):
            yield Group("variant", [Entry("name", path.stem), Entry(f"release_{key}", file)])
