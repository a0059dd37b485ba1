# SPDX-License-Identifier: BSD-3-Clause
"""Sources of a case: points, polygons, raster cells or steep cells, with their boulders."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.case import Case, facts
from rockfall.errors import RockfallError
from rockfall.grounds import TABLES, GroundRule
from rockfall.grounds.impact_tables import BLOCK_SHAPES, BY_SOURCE
from rockfall.io.rasters.grid import NO_ID, Box, Grid, row_blocks
from rockfall.io.tables import read_columns
from rockfall.io.vectors.layers import EXTENSIONS, numbered_polygons, read_points
from rockfall.io.vectors.unused_attributes import note_marks, note_unused
from rockfall.language import remark
from rockfall.quantities import first_of, percent
from rockfall.scene.kernel_scene import area_ratios, can_start, terrain_of
from rockfall.scene.layers import Inputs
from rockfall.scene.parts import ExtremeCount, Rasters, SourceBoulders, Sources
from rockfall.scene.releases.source_attributes import (
    MAX_AXIS_RATIO,
    Table,
    axes_of,
    read_attributes,
)

SIDES = ("d1", "d2", "d3")
SHAPES = int(_core.constant("shapes"))  # number of block shapes
SPHERE = int(_core.constant("sphere"))  # number of the default shape
MAX_SIDE = 1e3  # [m]
APART = 1000.0  # suspicious ratio of the largest frequency to the next
MAX_NAMED = 5  # maximum features listed in a message


def threshold(case: Case, grid: Grid) -> float:
    """Minimum slope [degree] of steep cells: the case's, or the default for the cell size."""
    return case.release.get("slope_threshold", _core.slope_threshold(grid.cell))


def has_idle_shapes(sources: Sources, grounds: Iterable[GroundRule]) -> bool:
    """Return True if a layer gives block shapes although no ground uses an impact table."""
    features = sources.features
    has_shapes = features is not None and features.shape is not None
    return has_shapes and all(ground.model not in TABLES for ground in grounds)


def refuse_by_area(case: Case, sources: Sources, what: str) -> None:
    """Raise a RockfallError if the sources may release unequal numbers of boulders; `what` requires
    equal numbers."""
    if sources.frequency is not None:
        raise RockfallError(
            f"{case.name}: sources have a frequency: {what} requires equal numbers of boulders "
            "from each"
        )
    if case.release["by_area"]:
        text = f"{case.name}: &release by_area = .true."
        raise RockfallError(f"{text}: {what} requires equal numbers of boulders from each source")


def read_sources(inputs: Inputs, bands: Iterable[tuple[Rasters, Box]]) -> Sources:
    """Read release points, or the centres of source cells in raster order, with boulder
    properties.

    `bands` are consecutive bands of terrain rows, with rasters that include neighbouring rows.
    """
    release = inputs.case.release
    if "x" in release:
        sources = Sources(np.asarray(release["x"]), np.asarray(release["y"]))
    elif "points" in release:
        sources = _find_points(inputs)
    else:
        sources = _find_cells(inputs, bands)
    return _with_boulders(inputs, sources) if "d1" in inputs.case.boulder else sources


def _find_cells(inputs: Inputs, bands: Iterable[tuple[Rasters, Box]]) -> Sources:
    """Find the centres of source cells; refuses a layer or slope without any, and cells without
    elevations."""
    case, grid, release = inputs.case, inputs.grid, inputs.case.release
    centres, area, lowest, unknown = [], [], ExtremeCount(), Unknown()
    polygons = _polygons(inputs)
    numbers: list[np.ndarray] = []
    for band, box in bands:
        parts = _cells(inputs, band, box, polygons.cells if polygons else None, lowest, unknown)
        blocks = {rows.start: np.argwhere(block > 0) for rows, block in parts}
        cells = [blocks[start] + (start, 0) for start in sorted(blocks)]
        row, column = np.concatenate(cells).T
        centres.append((grid.x[column], grid.y[row]))
        numbers += [polygons.cells[row, column]] if polygons else []
        if release["by_area"] and row.size:
            area.append(area_ratios(band, *centres[-1]))
    x, y = (np.concatenate(axis) for axis in zip(*centres, strict=True))
    path = case.path(release.get("polygons") or release.get("cells") or "")
    if unknown.part == unknown.n > 0:
        raise RockfallError(
            f"{path}: none of its {unknown.n:,} source cells has an elevation: fill the DEM with "
            "rockfall dem --fill, or move them"
        )
    if not x.size and release["steep_cells"]:
        raise RockfallError(
            f"{case.name}: &release steep_cells: no cell is as steep as "
            f"{threshold(case, grid):.1f} degrees"
        )
    if not x.size:
        raise RockfallError(f"{path}: no source cells: at least one cell must be above zero")
    if unknown.part:
        inputs.remarks.append(remark(path, "input.sources_unknown", **vars(unknown)))
    sources = Sources(x, y, np.concatenate(area) if area else None, source_values=lowest)
    if not polygons:
        return sources
    part = np.concatenate(numbers)
    feature = polygons.owner[part].astype("i4")
    return _with_attributes(inputs, sources, polygons.table, feature, polygons.owner, part)


@dataclass
class Unknown:
    """Number `n` of source cells from a raster or polygons, and number `part` of those without the
    elevations that a start needs."""

    part: int = 0
    n: int = 0


class Polygons(NamedTuple):
    """Source polygons: part number in each cell (0: none), feature number of each part (both from
    1), and attributes of the features."""

    cells: np.ndarray
    owner: np.ndarray
    table: Table


def _polygons(inputs: Inputs) -> Polygons | None:
    """Read source polygons; None without a layer."""
    case, release = inputs.case, inputs.case.release
    if "polygons" not in release:
        return None
    path = case.path(release["polygons"])
    layer = release.get("polygons_layer")
    cells, owner, columns = numbered_polygons(
        path, inputs.grid, inputs.remarks, layer, "polygons_layer"
    )
    inputs.note_layer("polygons", path, layer)
    table = Table(str(path), columns, int(owner.max()), lambda k: f"{path}: feature {k + 1}")
    return Polygons(cells, owner, table)


def _find_points(inputs: Inputs) -> Sources:
    """Read source points from a layer or a table; refuses a layer name for a table."""
    case, release = inputs.case, inputs.case.release
    path = case.path(release["points"])
    if path.suffix.lower() in EXTENSIONS:
        layer = release.get("points_layer")
        x, y, columns, feature = read_points(
            path, inputs.grid, inputs.remarks, layer, "points_layer"
        )
        table = Table(str(path), columns, feature.size, lambda k: f"{path}: feature {feature[k]}")
    elif "points_layer" in release:
        raise RockfallError(f"{case.name}: &release points_layer: is not valid for a table")
    else:
        lines, columns = read_columns(path, ("x", "y"))
        table = Table(str(path), columns, len(lines), lambda k: lines[k], is_text=True)
        x, y = (table.places(axis) for axis in "xy")
    inputs.note_layer("points", path, release.get("points_layer"))
    return _with_attributes(inputs, Sources(x, y), table, np.arange(1, x.size + 1, dtype="i4"))


def _with_attributes(
    inputs: Inputs,
    sources: Sources,
    table: Table,
    feature: np.ndarray,
    owner: np.ndarray | None = None,
    part: np.ndarray | None = None,
) -> Sources:
    """Sources with the attributes of their features. `feature` is the feature of each source; for
    cells, `part` is its polygon part, and `owner` the feature of each part. Refuses features of
    which only some have a frequency."""
    features, frequency = read_attributes(inputs.case, table, feature)
    note_unused(inputs.remarks, table.path, table.columns, table.asked)
    note_marks(inputs.remarks, table.path, table.columns, table.asked)
    _note_unequal(inputs, table, frequency)
    _note_axes(inputs, table)
    given = ~np.isnan(frequency)
    if owner is not None and part is not None:
        _note_lost(inputs, table, features.names, frequency, owner, part)
    if not given.any():
        return replace(sources, features=features)
    if "boulders" in inputs.case.case:
        inputs.remarks.append(remark(table.path, "input.frequency_not_used"))
    if not given.all():
        k = int(np.argmin(given))
        raise RockfallError(
            f"{table.where(k)}: has no frequency: all sources or none must have a frequency"
        )
    own = np.ones(feature.size) if sources.area is None else sources.area
    together = np.bincount(feature, own, minlength=table.size + 1)
    return replace(
        sources, features=features, frequency=frequency[feature - 1] * own / together[feature]
    )


def _note_unequal(inputs: Inputs, table: Table, frequency: np.ndarray) -> None:
    """Add a remark if a frequency is far above all others: it may be a return period."""
    ordered = np.unique(frequency[frequency > 0])
    if ordered.size > 1 and (ratio := ordered[-1] / ordered[-2]) >= APART:
        k = int(np.nanargmax(frequency))
        text = remark(table.where(k), "input.frequency_apart", ratio=float(ratio))
        inputs.remarks.append(text)


def _note_axes(inputs: Inputs, table: Table) -> None:
    """Add a remark on block axes that differ too much to be in the same unit."""
    if (axes := axes_of(table)) is not None:
        ratio = np.nan_to_num(axes[0] / axes[2])
        if ratio.max() > MAX_AXIS_RATIO:
            where = table.where(int(ratio.argmax()))
            text = remark(where, "input.axes_apart", ratio=float(ratio.max()))
            inputs.remarks.append(text)


def _note_lost(
    inputs: Inputs,
    table: Table,
    names: list[str],
    frequency: np.ndarray,
    owner: np.ndarray,
    part: np.ndarray,
) -> None:
    """Add a remark on polygon parts without a source, which release no boulders: narrower than a
    cell, outside the known terrain, covered by later parts, or not steep."""
    is_lost = np.bincount(part, minlength=owner.size) == 0
    is_lost[0] = False
    if not is_lost.any():
        return
    parts = np.bincount(owner, minlength=table.size + 1)
    lost = np.bincount(owner[is_lost], minlength=table.size + 1)
    labels = [
        names[k - 1] + (f" ({lost[k]}/{parts[k]})" if lost[k] < parts[k] else "")
        for k in np.flatnonzero(lost).tolist()
    ]
    numbers = {"part": int(is_lost.sum()), "n": owner.size - 1}
    named = first_of(labels, MAX_NAMED)
    inputs.remarks.append(remark(table.path, "input.features_lost", **numbers, names=named))
    without = (lost == parts)[1:]
    if without.any() and not np.isnan(frequency).any() and (all_ := frequency.sum()) > 0:
        fraction = percent(frequency[without].sum() / all_)
        inputs.remarks.append(remark(table.path, "input.frequency_lost", fraction=fraction))


def _with_boulders(inputs: Inputs, sources: Sources) -> Sources:
    """Sources with boulder volume, inertia and density; sources of shape 0 are left out, and
    refused if there are no others."""
    boulder = inputs.case.boulder
    if "shape" in boulder:
        shape = _at_sources(inputs, sources, "shape", "shapes", np.int32)
        good = (shape >= 0) & (shape <= SHAPES)
        _check(inputs.case, sources, "shape", shape, good, f"must be 0 to {SHAPES}")
    else:
        shape = np.full(sources.x.size, SPHERE)
    shaped = shape > 0
    if not shaped.any():
        raise RockfallError(
            f"{inputs.case.path(boulder['shape'])}: is 0 at all sources, so no boulder is released"
        )
    if not shaped.all():
        out = np.count_nonzero(~shaped)
        numbers = {"part": int(out), "n": shaped.size}
        inputs.remarks.append(remark("&boulder shape", "input.no_boulders", **numbers))
    sources = sources.select(shaped)
    d = np.array([_at_sources(inputs, sources, key, "sides", np.float64) for key in SIDES])
    for key, side in zip(SIDES, d, strict=True):
        good = (side > 0) & (side <= MAX_SIDE)
        _check(inputs.case, sources, key, side, good, f"must be > 0 and at most {MAX_SIDE:g} m")
    volume, inertia = _core.shape_numbers(shape[shaped], np.asfortranarray(d))
    density = None
    if "rock_density" in boulder:
        density = _at_sources(inputs, sources, "rock_density", "densities", np.float64)
        first, rule = _core.check_numbers("boulder", "density", density)
        good = np.arange(1, density.size + 1) != first
        _check(inputs.case, sources, "rock_density", density, good, rule.decode().strip())
    own = _block_shapes(inputs, np.asfortranarray(np.sort(d, axis=0)[::-1]))
    return replace(sources, source_boulders=SourceBoulders(volume, inertia, density, own))


def _block_shapes(inputs: Inputs, axes: np.ndarray) -> np.ndarray | None:
    """Number of the block shape nearest to the axes (3, n) of each source's boulders. None if the
    case gives the shapes; a remark then counts the axes that are nearer to other shapes."""
    case, given = inputs.case, inputs.case.boulder["block_shape"]
    shape = _core.shapes_of_axes(axes)
    if BY_SOURCE in given:
        return shape
    others = ~np.isin(shape, [1 + BLOCK_SHAPES.index(name) for name in given])
    if others.any() and facts(case, "boulder", "release", "impact", "surface").by_table:
        numbers = {"part": int(others.sum()), "n": others.size}
        inputs.remarks.append(remark("&boulder block_shape", "input.shapes_of_sides", **numbers))
    return None


def _at_sources(inputs: Inputs, sources: Sources, key: str, what: str, dtype: Any) -> np.ndarray:
    """Raster values at the source cells."""
    grid, values = inputs.grid, np.empty(sources.x.size, dtype)
    row = ((grid.north - sources.y) / grid.cell).astype(int).clip(0, grid.ny - 1)
    column = ((sources.x - grid.west) / grid.cell).astype(int).clip(0, grid.nx - 1)
    for rows, block in inputs.blocks(key, what, dtype, smooth=False):
        in_rows = (row >= rows.start) & (row < rows.stop)
        values[in_rows] = block[row[in_rows] - rows.start, column[in_rows]]
    return values


def _check(
    case: Case, sources: Sources, key: str, values: np.ndarray, good: np.ndarray, rule: str
) -> None:
    """Raise a RockfallError that names the first source with an invalid boulder property."""
    if good.all():
        return
    k = np.flatnonzero(~good)[0]
    value = "no data" if np.isnan(values[k]) or values[k] == NO_ID else f"{values[k]:g}"
    raise RockfallError(
        f"{case.path(case.boulder[key])}: {value} at the source {sources.x[k]:.10g}, "
        f"{sources.y[k]:.10g}: {rule}"
    )


def _cells(
    inputs: Inputs,
    band: Rasters,
    box: Box,
    polygons: np.ndarray | None,
    lowest: ExtremeCount,
    unknown: Unknown,
) -> Iterator[tuple[slice, np.ndarray]]:
    """Yield the rows of a box in blocks, positive in source cells. Record the raster values in
    `lowest`, and count in `unknown` the cells without the elevations that a start needs."""
    release, parts = inputs.case.release, list(row_blocks(box.shape))
    if polygons is not None:
        blocks = ((rows, polygons[rows]) for rows in parts)
    elif "cells" in release:
        blocks = _noted(inputs.blocks("cells", "source cells", np.int32, box), lowest)
    else:
        blocks = ((rows, np.ones((rows.stop - rows.start, box.shape[1]), bool)) for rows in parts)
    blocks = ((slice(box.row + rows.start, box.row + rows.stop), block) for rows, block in blocks)
    if (polygons is not None or "cells" in release) and band.z.size:
        blocks = ((rows, _on_known(inputs, band, rows, block, unknown)) for rows, block in blocks)
    if not release["steep_cells"]:
        yield from blocks
        return
    with terrain_of(band) as terrain:
        for rows, block in blocks:
            cells = np.asfortranarray((block > 0).T, np.int16)
            _core.steep_cells(terrain, threshold(inputs.case, inputs.grid), rows.start + 1, cells)
            yield rows, cells.T


def _on_known(
    inputs: Inputs, band: Rasters, rows: slice, block: np.ndarray, unknown: Unknown
) -> np.ndarray:
    """Mask of the source cells of a block where boulders can start; `unknown` counts the others."""
    row, column = np.nonzero(block > 0)
    places = inputs.grid.x[column], inputs.grid.y[rows][row]
    is_start = can_start(band, *places) if row.size else np.ones(0, bool)
    unknown.n, unknown.part = unknown.n + row.size, unknown.part + int(np.count_nonzero(~is_start))
    kept = np.zeros(block.shape, bool)
    kept[row[is_start], column[is_start]] = True
    return kept


def _noted(
    blocks: Iterable[tuple[slice, np.ndarray]], lowest: ExtremeCount
) -> Iterator[tuple[slice, np.ndarray]]:
    """Yield blocks of source cells and record their values."""
    for rows, block in blocks:
        lowest.take(-block[block > 0].astype(float))
        yield rows, block
