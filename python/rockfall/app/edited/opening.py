# SPDX-License-Identifier: BSD-3-Clause
"""Opening a case or DEM: the split into an editable document and an unchanged part."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rockfall.app.edited.document import OTHER_SOURCES, Document, Settings, Site, Variants
from rockfall.app.edited.features import MAX_FEATURES, MAX_VERTICES, Feature
from rockfall.app.edited.forms import DRAWN, REST, Form, ground_names, layer_forms, settings_forms
from rockfall.case import FROM_ARRAY, REPEATABLE, Case, given_groups, given_in_lists, read_case
from rockfall.case.variants import variants
from rockfall.draft.grounds import GROUNDS, needs_rocks
from rockfall.draft.groups import RADIUS, VOLUME
from rockfall.errors import RockfallError
from rockfall.io.files import NETCDF, start_of
from rockfall.io.netcdf import open_netcdf
from rockfall.io.rasters.dem import dem_header
from rockfall.io.rasters.grid import Grid
from rockfall.io.tables import decimal, read_columns
from rockfall.io.vectors.layers import (
    EXTENSIONS,
    attribute,
    named_attribute,
    plain,
    read_points,
    read_polygons,
)
from rockfall.io.zone_table import NAMES, RADII
from rockfall.result.dataset import DAMAGED
from rockfall.scene.frames import GROUPS
from rockfall.scene.layers import Inputs
from rockfall.scene.lines import read_lines
from rockfall.scene.releases.source_attributes import AXES, has_axes

TOTAL = 10_000  # boulders in a new document
FIRST: Settings = {
    "case": {"boulders_total": TOTAL},
    "boulder": {"volume_mean": VOLUME},
    "release": {"drop_height": 1.0},
    "output": {
        "maps": ["passages", "deposits", "reach_probability", "energy_q95", "jump_height_q95"],
        "trajectories": 200,
    },
}


def is_result(path: Path) -> bool:
    """Return True if a netCDF file is a result rather than a DEM."""
    if not start_of(path).startswith(NETCDF):
        return False
    try:
        with open_netcdf(path) as file:
            return {"case", "case_file"} <= set(file.ncattrs())
    except DAMAGED:
        return False


def ground_choices() -> list[dict[str, Any]]:
    """Grounds offered for a document without ground, with the rock radius [m] where needed."""
    return [{"name": name, "radius": RADIUS if needs_rocks(name) else None} for name in GROUNDS]


def open_site(path: Path) -> tuple[Site, Document]:
    """Site and document of a case or a DEM; raises a RockfallError if it cannot be read."""
    return _open_case(path) if path.suffix.lower() == ".nml" else _open_dem(path)


def _open_dem(path: Path) -> tuple[Site, Document]:
    """Site and document of a DEM without a case; the document has no sources and no ground."""
    grid, _ = dem_header(path)
    name = path.with_name(f"{path.stem}.nml")
    settings = {group: dict(values) for group, values in FIRST.items()}
    settings["case"]["title"] = path.stem
    settings["terrain"] = {"dem": path.name}
    whole = {group: dict(values) for group, values in settings.items()}
    whole["release"]["points"] = FROM_ARRAY
    whole["surface"] = {"ground": next(iter(GROUNDS))}  # placeholder: the document has none
    case = Case(folder=path.parent, name=str(name), **whole)
    grounds = ground_names(case)
    forms = settings_forms(grounds), layer_forms(case, True, grounds)
    return Site(path, str(name), grid, *forms, opened=settings), Document(settings)


def _open_case(path: Path) -> tuple[Site, Document]:
    case = read_case(path)
    if case.terrain["dem"] == FROM_ARRAY:
        raise RockfallError(f"{path}: &terrain dem is missing: give a raster file")
    grid, _ = dem_header(case.path(case.terrain["dem"]))
    cases = variants(case)
    grounds = ground_names(case, *cases.values())
    document, kept, forms = _read(case.replace(variant=[]), grid, grounds)
    site = Site(
        path, case.name, grid, settings_forms(grounds), forms, kept=kept,
        opened={group: dict(values) for group, values in document.settings.items()},
        variants=Variants(case.variant, cases, document if cases else None),
    )  # fmt: skip
    for name, variant in cases.items():
        variant_document, kept, forms = _read(variant, grid, grounds)
        if other := _differs(site, variant, variant_document, kept, forms):
            site.variants.others[name] = other
        else:
            site.variants.documents[name] = replace(variant_document, variant=name)
    return site, document


def _differs(
    site: Site, case: Case, document: Document, kept: dict[str, Any], forms: dict[str, Form]
) -> str:
    """Group in which a variant differs from its site beyond what the page can edit; "" if none."""
    if case.terrain != site.opened["terrain"]:
        return "terrain"
    if document.layers["zones"] and forms["zones"] != site.layer_forms.get("zones"):
        return "surface"
    return next((name for name in kept if kept[name] != site.kept.get(name)), "")


def _read(
    case: Case, grid: Grid, grounds: tuple[str, ...]
) -> tuple[Document, dict[str, Any], dict[str, Form]]:
    """Document of a case, the part kept unchanged, and the forms of the layers."""
    settings, document = given_groups(case), Document()
    kept: dict[str, Any] = {name: getattr(case, name) for name in REPEATABLE}
    inputs = Inputs(case, grid)
    named = case.surface.get("zones", FROM_ARRAY)
    polygons = case.path(named).suffix.lower() in EXTENSIONS
    uniform = not {"zones", *RADII} & case.surface.keys()
    forms = layer_forms(case, polygons or uniform, grounds)
    layers = dict(document.layers)
    lines = read_lines(inputs)
    for name, group in GROUPS.items():
        features = list(line_features(name, lines, forms[name]))
        if _fits(features):
            layers[name], kept[group] = features, []
    release = settings.get("release", {})
    sources = list(_sources(inputs, forms["sources"]))
    places = {key: release.pop(key) for key in OTHER_SOURCES if key in release and key != "cells"}
    if _fits(sources):
        layers["sources"] = sources
        release.pop("name_field", None)
    else:
        kept["release"] = places
        if "name_field" in release:
            kept["release"] |= {"name_field": release.pop("name_field")}
    if polygons:
        layers["zones"] = list(_zones(inputs, forms["zones"], settings["surface"]))
        for key in ("zones", *DRAWN["surface"]):
            settings["surface"].pop(key, None)
    return Document(settings, layers), kept, forms


def _fits(features: list[Feature]) -> bool:
    """Return True if a layer is small enough to be edited on the page."""
    return (
        len(features) <= MAX_FEATURES
        and sum(feature.vertices() for feature in features) <= MAX_VERTICES
    )  # fmt: skip


def line_features(layer: str, case: Case, form: Form) -> Iterator[Feature]:
    """Features from line groups, with the keys that differ from their defaults."""
    for k, group in enumerate(given_in_lists(case)[GROUPS[layer]], start=1):
        own = {key: group[key] for key in form if key in group}
        places = [[*at] for at in zip(group["x"], group["y"], strict=True)]
        yield Feature(f"{layer[0]}{k}", "LineString", places, own)


def _sources(inputs: Inputs, form: Form) -> Iterator[Feature]:
    """Features from the source points or polygons of a case."""
    import shapely

    case, release = inputs.case, inputs.case.release
    if "x" in release:
        for k, at in enumerate(zip(release["x"], release["y"], strict=True), start=1):
            yield Feature(f"s{k}", "Point", [*at], {})
        return
    key = "points" if "points" in release else "polygons"
    if key not in release:
        return
    path, layer = case.path(release[key]), release.get(f"{key}_layer")
    if key == "polygons":
        shapes, columns = read_polygons(path, inputs.grid, inputs.remarks, layer, "polygons_layer")
        parts, owner = shapely.get_parts(shapes, return_index=True)
        columns = {name: column[owner] for name, column in columns.items()}
        columns = _shared(columns, parts, owner)
        places = [_rings(polygon) for polygon in parts]
    else:
        if path.suffix.lower() in EXTENSIONS:
            x, y, columns, _ = read_points(path, inputs.grid, inputs.remarks, layer, "points_layer")
        else:
            _, columns = read_columns(path, ("x", "y"))
            x, y = (np.array([decimal(text) for text in columns[axis]]) for axis in "xy")
        places = [[*at] for at in zip(map(float, x), map(float, y), strict=True)]
    if name := release.get("name_field"):
        columns = {**columns, "name": named_attribute(str(path), columns, name)}
    if not has_axes(columns):
        columns = {name: column for name, column in columns.items() if name.lower() not in AXES}
    kind = "Point" if key == "points" else "Polygon"
    for k, (at, own) in enumerate(
        zip(places, _properties(columns, form, len(places)), strict=True)
    ):
        yield Feature(f"s{k + 1}", kind, at, _plain_volume(own))


def _shared(columns: dict[str, Any], parts: np.ndarray, owner: np.ndarray) -> dict[str, Any]:
    """Columns with a value for each polygon part; `owner` has the polygon index of each part.
    Frequencies are divided in proportion to the area of the parts."""
    import shapely

    frequency = attribute(columns, "frequency")
    if frequency is None or frequency.dtype.kind not in "iuf":
        return columns
    area = shapely.area(parts)
    fraction = area / np.bincount(owner, area)[owner]
    others = {name: column for name, column in columns.items() if column is not frequency}
    return {**others, "frequency": frequency * fraction}


def _plain_volume(own: dict[str, Any]) -> dict[str, Any]:
    """Attributes with a numeric `volume` replaced by a fixed volume distribution."""
    number = decimal(str(own["volume"])) if "volume" in own else np.nan
    return {**own, "volume": "fixed", "volume_mean": number} if np.isfinite(number) else own


def _rings(polygon: Any) -> list[list[list[float]]]:
    rings = [polygon.exterior, *polygon.interiors]
    return [[[*map(float, at[:2])] for at in ring.coords] for ring in rings]


def _properties(columns: dict[str, Any], form: Form, size: int) -> Iterator[dict[str, Any]]:
    """For each feature, the attributes in a form, converted to the field types if possible."""
    fields = {name: attribute(columns, name) for name in form}
    for k in range(size):
        values = {name: plain(column[k]) for name, column in fields.items() if column is not None}
        yield {
            name: _typed(form[name].kind, value)
            for name, value in values.items() if value is not None
        }  # fmt: skip


def _typed(kind: str, value: Any) -> Any:
    """Attribute converted to the type of its field. If impossible it is unchanged, and the reader
    refuses it."""
    if kind == "text":
        return str(value).strip()
    number = decimal(value) if isinstance(value, str) else float(value)
    if not np.isfinite(number):
        return value
    return int(number) if kind == "integer" and number == int(number) else number


def _zones(inputs: Inputs, form: Form, surface: dict[str, Any]) -> Iterator[Feature]:
    """Features from the zone polygons. Zones that this window wrote to fill the rest of the
    terrain become the uniform ground of the case again."""
    import shapely

    own = inputs.case.surface
    path, layer = inputs.case.path(own["zones"]), own.get("zones_layer")
    shapes, columns = read_polygons(path, inputs.grid, inputs.remarks, layer, "zones_layer")
    parts, owner = shapely.get_parts(shapes, return_index=True)
    columns = {name: column[owner] for name, column in columns.items()}
    number = attribute(columns, own["zone_field"])
    name = next((column for column in map(columns.get, NAMES) if column is not None), None)
    columns |= {} if number is None else {"zone": number}
    columns |= {} if name is None else {"name": name}
    rest = attribute(columns, REST)
    for k, properties in enumerate(_properties(columns, form, len(parts))):
        if rest is not None and str(rest[k]) == "True":
            radii = [properties[key] for key in RADII[1:] if key in properties]
            if "mean_radius" in properties:
                surface["uniform_mean_radius"] = properties["mean_radius"]
            elif radii:
                surface["uniform_rg"] = radii
        else:
            yield Feature(f"z{k + 1}", "Polygon", _rings(parts[k]), properties)
