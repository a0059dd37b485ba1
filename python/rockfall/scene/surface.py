# SPDX-License-Identifier: BSD-3-Clause
"""Rock sizes on the ground: uniform, by zone, or by cell."""

from collections.abc import Iterator, Sequence

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.case import Case, is_given
from rockfall.case.zones import case_zones, polygon_zones
from rockfall.errors import RockfallError
from rockfall.evidence import only
from rockfall.grounds import (
    GroundRule,
    GroundTable,
    case_ground,
    check_number,
    is_calibrated,
    named_ground,
    table_path,
    usual_ground,
    usual_key,
    usual_name,
    zone_ground,
)
from rockfall.grounds.impact_tables import (
    BLOCK_SHAPES,
    possible_shapes,
    reliefs_thrown,
    softest_thrown,
)
from rockfall.io.rasters.dem import read_elevations
from rockfall.io.rasters.grid import NO_ID, Box, row_blocks
from rockfall.io.vectors.layers import EXTENSIONS, burn_polygons
from rockfall.io.zone_table import RADII, Zone, index_blocks
from rockfall.language import remark
from rockfall.scene.layers import Inputs, file_checksum
from rockfall.scene.parts import Rasters

#: Reduction of relief [degree] that errs on the safe side (docs/howto/own-ground.md).
SAFER = 2.0


def size_columns(case: Case) -> tuple[str, ...]:
    """Size columns that the case's method requires."""
    return RADII[:1] if case.surface["method"] == "B" else RADII[1:]


def radius_over_rg(case: Case) -> float:
    """Ratio of R_m to Rg in method A, where Rg is a diameter or a radius."""
    return _core.size_to_radius(case.surface["rg_reading"])


def read_rasters(inputs: Inputs, z: np.ndarray, box: Box) -> Rasters:
    """Read rasters for a box of cells with these elevations: rock sizes and grounds."""
    surface = inputs.case.surface
    columns = size_columns(inputs.case)
    uniform = surface.get("uniform_mean_radius" if surface["method"] == "B" else "uniform_rg")
    rasters = Rasters(inputs.grid, z, (box.row, box.column))
    zones, ids = read_grounds(inputs, rasters)
    if "ground_map" in surface:
        _read_cell_grounds(inputs, rasters, box, ids)
    if "zones" in surface and uniform is None:
        _read_zones(inputs, rasters, box, columns, zones)
    elif uniform is not None or set(columns).isdisjoint(surface):
        size = np.full(len(columns), np.nan) if uniform is None else uniform
        rasters.sizes = np.atleast_2d(np.asarray(size, dtype=float))
        _check_sizes(inputs, rasters, columns, [f"{inputs.case.name}: &surface"])
    else:
        _read_values(inputs, rasters, box, columns)
    return rasters


def read_grounds(inputs: Inputs, rasters: Rasters) -> tuple[dict[int, Zone], dict[int, str]]:
    """Read grounds that differ from the case's impact sets, and the ground of each material. Return
    the zones by id, and the ground names by raster id. Refuses ambiguous grounds."""
    case, surface = inputs.case, inputs.case.surface
    zones = case_zones(case, inputs.remarks)
    named = [zone for zone in zones.values() if zone.names_ground]
    if case.impact["form"] == "matrix" and not named:
        if {"ground", "ground_map"}.isdisjoint(surface):
            return zones, {}
    if named and "ground_map" in surface:
        raise RockfallError(
            f"{case.name}: &surface ground_map: the zones have their own grounds "
            f"({named[0].where}): give only one"
        )
    table = GroundTable(table_path(case))
    inputs.checksums.setdefault("ground_table", file_checksum(table.path))
    usual, base = case_ground(case, table), named_ground(case)
    if "ground" not in surface:
        of_cells = table.names.values() if "ground_map" in surface else ()
        others = {*of_cells, *(zone.ground or base.name for zone in named)}
        if base.name in table.rows and base.name in others and _differs(base.name, table, case):
            raise RockfallError(
                f"{case.name}: &impact: '{base.name}' is also a row of {table.path}: rename the row"
            )
    by_name = {usual.name: usual}
    of_zones = [str(zone.ground_in(base)) for zone in zones.values()]
    for zone, name in zip(zones.values(), of_zones, strict=True):
        if name not in by_name:
            by_name[name] = zone_ground(case, table, zone)
    if zones and usual.name not in of_zones:
        del by_name[usual.name]
    if "ground_map" in surface:
        by_name |= {
            key: table.ground(key, case) for key in table.names.values() if key not in by_name
        }
    check_number(by_name.values(), str(table.path))
    shapes = possible_shapes(case) or BLOCK_SHAPES[:1]
    remarks = [note for rule in by_name.values() for note in _plane_remarks(rule, shapes)]
    blank = [zone for zone in zones.values() if not (zone.names_ground or np.inf in zone.sizes)]
    if named and blank and not _chooses_ground(case):
        numbers = {"n": len(blank), "zones": len(zones), "name": base.name}
        remarks.append(remark(blank[0].where, "input.blank_ground", **numbers))
    inputs.remarks += [note for note in remarks if note not in inputs.remarks]
    rasters.grounds = tuple(by_name.values())
    numbers = {name: k for k, name in enumerate(by_name, start=1)}
    if named:
        rasters.material_ground = np.array([numbers[name] for name in of_zones], np.int8)
    return zones, dict(table.names)


def _chooses_ground(case: Case) -> bool:
    """Return True if the case chooses a ground for zones and cells that have none."""
    keys = "form", usual_key(case)
    return "ground" in case.surface or any(is_given(case, "impact", key) for key in keys)


def _plane_remarks(rule: GroundRule, shapes: Sequence[str]) -> Iterator[str]:
    """Remarks on a ground whose relief or strength is outside the simulated tables for all
    boulders, or whose relief is not calibrated. Ground harder than the hardest table does not yield
    either, so it gets no remark."""
    if rule.plane is None:
        return
    ground, radii = rule.plane.ground, np.array(rule.plane.radii)
    low, high = reliefs_thrown(rule.plane.model, shapes)
    met = np.sort(ground.reliefs(radii))
    if met[1] < low or met[0] > high:
        numbers = {"relief": met[np.argmin(abs(met - low))], "low": low, "high": high}
        yield remark(rule.file, "input.relief_not_thrown", name=rule.name, **numbers)
    elif not is_calibrated(rule.plane) and (less := min(SAFER, met[0] - low)) > 0:
        blocks = f"compact blocks, {rule.plane.model}"
        too_low = only("between-parts", blocks, "passing_too_low", "shipped").error
        numbers = {"relief": ground.relief - less, "part": 100 * too_low}
        yield remark(rule.file, "input.relief_uncalibrated", name=rule.name, **numbers)
    if ground.sizes(radii, rule.plane.weight).min() > softest_thrown(rule.plane.model):
        numbers = {"strength": ground.strength}
        yield remark(rule.file, "input.strength_not_thrown", name=rule.name, **numbers)


def _differs(name: str, table: GroundTable, case: Case) -> bool:
    """Return True if the ground table has a ground with the name of the case's impact table but
    other values."""
    return usual_ground(case).text != table.ground(name, case).text


def _read_cell_grounds(inputs: Inputs, rasters: Rasters, box: Box, ids: dict[int, str]) -> None:
    """Read the ground number of each cell; cells without an id get the case's ground."""
    case, grounds = inputs.case, rasters.grounds
    blocks = inputs.blocks("ground_map", "ids of grounds", np.int32, box)
    names = [grounds[0].name, *ids.values()]
    place = index_blocks(
        blocks, box.shape, [NO_ID, *ids], None, rasters.z,
        str(case.path(case.surface["ground_map"])), str(table_path(case)), "id",
    )  # fmt: skip
    numbers = {ground.name: k for k, ground in enumerate(grounds, start=1)}
    rasters.cell_ground = np.array([0, *(numbers[name] for name in names)], np.int8)[place]


def _read_zones(
    inputs: Inputs, rasters: Rasters, box: Box, columns: tuple[str, ...], zones: dict[int, Zone]
) -> None:
    """Read zones as indices to the size table; refuses a layer name for a raster."""
    case, surface = inputs.case, inputs.case.surface
    path = case.path(surface["zones"])
    table_path_, numbers = path, None  # polygons define their own ground
    if "table" in surface:
        table_path_ = case.path(surface["table"])
        inputs.checksums.setdefault("table", file_checksum(table_path_))
    else:
        numbers = polygon_zones(case)[0]
    if "zones" not in inputs.arrays and path.suffix.lower() in EXTENSIONS:
        ids = burn_polygons(
            path, inputs.grid, surface["zone_field"], inputs.remarks,
            layer=surface.get("zones_layer"), key="zones_layer", numbers=numbers,
            names={number: zone.name for number, zone in zones.items()},
        )  # fmt: skip
        blocks = [(rows, ids[rows]) for rows in row_blocks(ids.shape)]
        for rows, block in blocks:
            is_outside = (block == NO_ID) & ~np.isnan(rasters.z[rows])
            rasters.outside += int(np.count_nonzero(is_outside))
        inputs.note_layer("zones", path, surface.get("zones_layer"))
    elif "zones_layer" in surface:
        raise RockfallError(f"{case.name}: &surface zones_layer: is not valid for a raster")
    else:
        blocks = inputs.blocks("zones", "zones", np.int32, box)
    rasters.zone = index_blocks(
        blocks, box.shape, list(zones), surface.get("default_zone"), rasters.z,
        str(path), str(table_path_),
    )  # fmt: skip
    of_each = np.array([zone.sizes for zone in zones.values()])
    rasters.sizes = of_each[:, [RADII.index(column) for column in columns]]
    places = [zone.where for zone in zones.values()]  # for polygons, their number in the layer
    if numbers is None:
        places = [f"{table_path_}: zone {zone}" for zone in zones]
    _check_sizes(inputs, rasters, columns, places)


def _check_sizes(
    inputs: Inputs, rasters: Rasters, columns: tuple[str, ...], places: list[str]
) -> None:
    """Check that used materials have the sizes that their grounds require; set missing sizes of
    other materials to 0."""
    for k, ground in sorted(_used(rasters)):
        need = rasters.grounds[ground].rocks if rasters.grounds else 2
        missing = np.isnan(rasters.sizes[k]).any()
        if need and missing and not rasters.grounds:
            method = inputs.case.surface["method"]
            raise RockfallError(f"{places[k]}: method {method} requires {', '.join(columns)}")
        if need and (missing or (need == 2 and not rasters.sizes[k].all())):
            name = rasters.grounds[ground].name if rasters.grounds else inputs.case.impact["sets"]
            needs = f"'{name}' requires {', '.join(columns)}{' > 0' if need == 2 else ''}"
            if name == usual_name(inputs.case) and not _chooses_ground(inputs.case):
                raise RockfallError(
                    f"{places[k]}: ground is missing: give one (the default {needs})"
                )
            raise RockfallError(f"{places[k]}: ground {needs}")
    if rasters.grounds:
        rasters.sizes = np.where(np.isnan(rasters.sizes), 0.0, rasters.sizes)


def _used(rasters: Rasters) -> set[tuple[int, int]]:
    """0-based pairs (material, ground) that occur in some cell."""
    if rasters.cell_ground is None:
        used = [0] if rasters.zone is None else rasters.used_zones().tolist()
        grounds = rasters.material_ground
        return {(k, 0 if grounds is None else int(grounds[k]) - 1) for k in used}
    is_used = np.zeros((len(rasters.sizes) + 1, len(rasters.grounds) + 1), bool)
    for rows in row_blocks(rasters.z.shape):
        zone = np.ones((), np.int8) if rasters.zone is None else rasters.zone[rows]
        is_used[zone, rasters.cell_ground[rows]] = True
    return {(int(k), int(ground)) for k, ground in np.argwhere(is_used[1:, 1:])}


def _read_values(inputs: Inputs, rasters: Rasters, box: Box, columns: tuple[str, ...]) -> None:
    """Read size rasters; refuses missing values where the ground of known terrain needs them."""
    need = np.array(
        [0, *(ground.rocks for ground in rasters.grounds)] if rasters.grounds else [0, 2]
    )
    rasters.values = np.empty((len(columns), *box.shape), np.float32)
    for name, layer in zip(columns, rasters.values, strict=True):
        missing = bad = 0
        for rows, block in inputs.blocks(name, f"values of {name}", np.float32, box):
            here = need[1 if rasters.cell_ground is None else rasters.cell_ground[rows]]
            unknown = np.isnan(block)
            layer[rows] = np.where(unknown & (here == 0), 0, block) if rasters.grounds else block
            missing += np.count_nonzero(unknown & (here > 0) & ~np.isnan(rasters.z[rows]))
            bad += np.count_nonzero((block < 0) | ((block == 0) & (here == 2)))
        if missing or bad:
            raise RockfallError(
                f"{inputs.case.path(inputs.case.surface.get(name, name))}: {missing} cells of the "
                f"terrain without a value, {bad} not > 0 (Inf absorbs)"
            )


def read_window(inputs: Inputs, box: Box) -> Rasters:
    """Rasters for a box of cells."""
    z = read_elevations(inputs.case.path(inputs.case.terrain["dem"]), box)
    return read_rasters(inputs, z, box)


def cell_bytes(case: Case, dtype: np.dtype) -> int:
    """Raster memory of a case per cell [bytes]."""
    surface = case.surface
    own = dtype.itemsize + ("ground_map" in surface)
    if "zones" in surface:
        return own + 2
    has_layers = not set(RADII).isdisjoint(surface)
    return own + 4 * len(size_columns(case)) * has_layers
