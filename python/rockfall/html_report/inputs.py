# SPDX-License-Identifier: BSD-3-Clause
"""Inputs of a result: terrain, grounds, sources, boulders, obstacles; parties of the report."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr

from rockfall.analysis.lines.samples import LineSamples
from rockfall.analysis.validity.rebounds import followed_text
from rockfall.case import FROM_ARRAY, Case, case_of
from rockfall.case.zones import case_zones
from rockfall.grounds import named_ground, usual_name
from rockfall.html_report.validity import has
from rockfall.io.input_warnings import doubts_in
from rockfall.io.rasters.arrays import corner_of
from rockfall.io.tables import read_table
from rockfall.io.zone_table import MATERIAL, NAMES, Zone
from rockfall.language import Number, Text, say, say_count, translated, word
from rockfall.plots.cartography.rasters import cropped, draw_image
from rockfall.plots.cartography.sheet import crs_text, finish, new_sheet
from rockfall.plots.extent import Extent, reached
from rockfall.plots.style import styled
from rockfall.protection.barriers import barriers_of
from rockfall.quantities import number, percent, with_unit
from rockfall.result.boulders import boulders_by_shape
from rockfall.result.crossings import line_names
from rockfall.result.samples import has_rows, simulated
from rockfall.result.trajectories import Terrain
from rockfall.scene.read import read_scene
from rockfall.scene.scene import Scene
from rockfall.table import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

RADII = {"mean_radius": "R_m [m]", "rg70": "Rg70 [m]", "rg20": "Rg20 [m]", "rg10": "Rg10 [m]"}
UNITS = {"ground_strength": "Pa", "ground_relief": "degree"}
MATERIALS = 12  # maximum grounds in separate colours


class Parties(NamedTuple):
    """Report details given by the user."""

    project: str = ""
    client: str = ""
    author: str = ""
    dem_date: str = ""
    result: str = ""  # checksum of the result file


def facts_of(result: xr.Dataset, parties: Parties) -> list[tuple[str, str]]:
    """Parties of the report, and details of a run or a hazard."""
    program, _, _ = str(result.attrs["source"]).partition(", ")
    return [
        (say("front.project"), parties.project),
        (say("front.client"), parties.client),
        (say("front.date_of_the_run"), str(result.attrs.get("date_created", ""))[:10]),
        (say("label.program"), program),
        (say("front.result_sha"), parties.result or say("front.not_read_from_a_file")),
    ]


def input_table(result: xr.Dataset, parties: Parties) -> Table:
    """Table of the run's inputs."""
    case = case_of(result)
    west, north, cell = corner_of(result["crs"].attrs)
    nets = ", ".join(line_names(result)[k] for k in barriers_of(result))
    lines = ", ".join(line_names(result))
    volumes = _range(result["volume"].values) if has_rows(result) else say("inputs.not_kept")
    rows = [
        (say("inputs.terrain_model"), _file(case.terrain["dem"])),
        (say("inputs.cell_size_m"), Number(f"{cell:g}")),
        (say("inputs.coordinate_system"), crs_text(result["crs"].attrs)),
        (say("inputs.date_of_the_survey"), parties.dem_date or say("inputs.not_stated")),
        (say("inputs.sources"), Number(f"{LineSamples(result).sources:,}")),
        (say("label.release"), _release(case, "source_feature" in result)),
        (say("label.boulders"), Number(f"{simulated(result):,}")),
        (say("inputs.volume_m"), volumes),
        *_shapes(result),
        (say("inputs.density_kg_m"), _density(case, "source_feature" in result)),
        (say("label.rebounds"), followed_text(result, str(result.attrs["impact_set"]))),
    ]
    rows += [(say("inputs.evaluation_lines_and_barriers"), lines)] if lines else []
    rows += [(say("label.barriers"), nets)] if nets else []
    rows += [(say("inputs.dams"), f"{len(case.dam)}")] if case.dam else []
    if has(case, "forest"):
        rows += [(say("inputs.trees"), say("inputs.trees_stand_on_the_slope"))]
    return Table.of(say("inputs.what_the_run_was_given"), ("", say("label.value")), rows, "inputs")


def _file(name: str) -> str:
    return say("inputs.given_as_an_array") if name == FROM_ARRAY else name


def _release(case: Case, layer_says_more: bool) -> str:
    drop, velocity = case.release["drop_height"], case.release["velocity"]
    where = say("inputs.drop_height", drop=drop) if drop else say("inputs.on_the_surface")
    if any(velocity):
        east, north, up = (Number(f"{v:g}") for v in velocity)
        where = say("inputs.velocity", where=where, east=east, north=north, up=up)
    return say("inputs.unless_layer", value=where) if layer_says_more else where


def _density(case: Case, layer_says_more: bool) -> str:
    if "rock_density" in case.boulder:
        return say("inputs.of_each_source")
    density = number(case.boulder["density"], 4)
    return say("inputs.unless_layer", value=density) if layer_says_more else density


def _shapes(result: xr.Dataset) -> Iterator[tuple[str, Text]]:
    """Fractions of the block shapes, if there are several."""
    if shapes := boulders_by_shape(result):
        parts = [
            say("inputs.part", fraction=percent(own.mean()), name=word(name))
            for name, own in shapes.items()
        ]
        yield say("inputs.block_shape"), say("model.several", parts=parts)


def _range(values: np.ndarray) -> str:
    low, mean, high = (number(v) for v in (values.min(), values.mean(), values.max()))
    return low if low == high else say("inputs.range", low=low, high=high, mean=mean)


def doubtful_inputs(result: xr.Dataset, hazard: xr.Dataset | None) -> list[tuple[str, str]]:
    """Likely mistakes in the inputs (place and text), as printed by `check`, `run` and `hazard`.
    Reprojected layers appear in the list of files instead."""
    studies = [result] if hazard is None else [result, hazard]
    stored = (study.attrs.get("input_warnings", "[]") for study in studies)
    return [(where, text) for where, text in doubts_in(*stored)]


def doubts_note(doubts: list[tuple[str, str]]) -> Iterator[str]:
    """Line on page 1 about likely mistakes in the inputs."""
    if doubts:
        yield say_count("inputs.doubtful", len(doubts))


def zone_table(result: xr.Dataset) -> Iterator[Table]:
    """Table of rock sizes by zone. Raises a RockfallError if a file cannot be read."""
    case = case_of(result)
    surface = case.surface
    if "table" in surface and surface["table"] != FROM_ARRAY:
        _, columns, rows = read_table(case.path(surface["table"]))
        yield _zones([name for name in columns if name], [row.cells for row in rows])
    elif "zones" in surface and surface["zones"] != FROM_ARRAY:
        yield _polygon_zones(case_zones(case))
    elif any(key.startswith("uniform") for key in surface):
        sizes = np.ravel(surface.get("uniform_mean_radius", surface.get("uniform_rg", [])))
        heads = list(RADII.values())[slice(0, 1) if sizes.size == 1 else slice(1, 4)]
        cells = dict(zip(heads, map(number, sizes), strict=True))
        if "ground" in surface:  # rocks have radius 0 by default
            cells = {word("ground"): usual_name(case)} | (cells if sizes.any() else {})
        row = say("inputs.everywhere"), *cells.values()
        yield Table.of(say("inputs.grounds_and_radii_of_their_rocks"), ("", *cells), [row])


def _polygon_zones(zones: dict[int, Zone]) -> Table:
    """Table of zones whose polygons carry ground attributes."""
    cells = []
    for number_, zone in zones.items():
        sizes = {key: f"{size:g}" for key, size in zip(RADII, zone.sizes, strict=True)}
        sizes = {key: size for key, size in sizes.items() if size != "nan"}
        pair = {f"ground_{key}": f"{value:g}" for key, value in zone.pair.items()}
        named = {"zone": f"{number_}", "ground": zone.ground, "name": zone.name}
        cells.append(named | sizes | pair)
    shown = ("name", "zone", *MATERIAL)
    return _zones([key for key in shown if any(row.get(key) for row in cells)], cells)


def _zones(columns: list[str], cells: list[dict[str, str]]) -> Table:
    shown = [name for name in (*NAMES, "zone", *MATERIAL) if name in columns]
    heads = [RADII.get(name) or with_unit(word(name), UNITS.get(name, "")) for name in shown]
    rows = [tuple(_size(row, name) for name in shown) for row in cells]
    return Table.of(say("inputs.grounds_and_radii_of_their_rocks"), heads, rows)


def _size(row: dict[str, str], name: str) -> str:
    """Cell of a zone; "-" for rocks of radius 0 on a named ground, which needs no radius."""
    text = row.get(name, "").strip()
    if name not in RADII:
        return text
    if text.lower() in ("inf", "infinity"):
        return word("absorbs")
    return Number("-" if row.get("ground") and not text.strip("0.+") else text)


def ground_figure(result: xr.Dataset, terrain: Terrain | None) -> Figure | None:
    """Map of the grounds; None for a single ground, for more than MATERIALS, for arrays, and for
    scenes in windows. Raises a RockfallError if a file cannot be read."""
    case = case_of(result)
    if FROM_ARRAY in result.attrs["case"] or "zones" not in case.surface:
        return None
    scene = read_scene(case)
    if scene.rasters.zone is None or scene.windows or not 1 < len(scene.rasters.sizes) <= MATERIALS:
        return None
    labels = _zone_labels(case, scene.rasters.sizes)
    return _drawn(scene, labels, reached(result, terrain), terrain, result["crs"].attrs)


def _zone_labels(case: Case, sizes: np.ndarray) -> list[str]:
    """Labels for rows of the zone table: name or number, ground, and rock radii, unless a named
    ground has none."""
    usual = named_ground(case)
    return [
        f"{zone.name or say('inputs.zone', number=number)}"
        f"{f' ({zone.ground_in(usual)})' if zone.names_ground else ''}"
        f"{'' if zone.names_ground and not radii.any() else f'; {_radius(radii)}'}"
        for (number, zone), radii in zip(case_zones(case).items(), sizes, strict=True)
    ]


@styled
def _drawn(
    scene: Scene, names: list[str], extent: Extent, terrain: Terrain | None, crs: dict[str, Any]
) -> Figure:
    from matplotlib import colormaps
    from matplotlib.colors import BoundaryNorm, ListedColormap
    from matplotlib.patches import Patch

    assert scene.rasters.zone is not None
    zone, grid = cropped(scene.rasters.zone, scene.grid, extent, np.maximum)
    there = [k for k in range(1, len(scene.rasters.sizes) + 1) if (zone == k).any()]
    colours = colormaps["Set3"](np.arange(MATERIALS))
    key = [Patch(color=colours[k - 1], label=names[k - 1]) for k in there]
    sheet = new_sheet(extent, terrain, key)
    norm = BoundaryNorm(np.arange(0.5, MATERIALS + 1), MATERIALS)
    shown = np.where(zone > 0, zone, np.nan).astype(float)
    draw_image(sheet.axes, shown, grid, norm=norm, cmap=ListedColormap(colours), opacity=0.7)
    finish(sheet, crs)
    return sheet.figure


def _radius(sizes: np.ndarray) -> str:
    name = "R_m" if sizes.size == 1 else "Rg70, Rg20, Rg10"
    if np.isnan(sizes).all():
        return f"{name} [m]: -"
    if np.isinf(sizes).any():
        return f"{name} [m]: {word('absorbs')}"
    return f"{name} [m]: {', '.join(translated(number(size)) for size in sizes)}"
