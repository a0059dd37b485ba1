# SPDX-License-Identifier: BSD-3-Clause
"""The edited document, its site (the unedited parts of a case), and the case with layers made from
both. A live run and saved files use the same case."""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rockfall.app.edited.features import LAYERS, Feature, Layer, check_features, check_size
from rockfall.app.edited.forms import REST, Form, check_value
from rockfall.app.messages import Refused
from rockfall.case import FROM_ARRAY, Case
from rockfall.io.rasters.grid import Grid
from rockfall.io.zone_table import PAIR, RADII
from rockfall.language import say
from rockfall.scene.frames import GROUPS

Settings = dict[str, dict[str, Any]]
#: Keys of &release that set the places of release if no sources are drawn.
OTHER_SOURCES = ("x", "y", "points", "points_layer", "cells", "polygons", "polygons_layer")
OF_CELLS = ("steep_cells", "slope_threshold", "by_area")  # not valid for point sources
SIZES = ("uniform_mean_radius", "uniform_rg")


@dataclass(frozen=True)
class Document:
    """Edited state: explicit keys of the case by group, and features by layer."""

    settings: Settings = field(default_factory=dict)
    layers: dict[str, list[Feature]] = field(default_factory=lambda: {name: [] for name in LAYERS})
    variant: str = ""  # name of the edited &variant group; "" for the base case

    def content(self) -> dict[str, Any]:
        """Content of the document, as sent to the page."""
        layers = {
            name: [feature._asdict() for feature in features]
            for name, features in self.layers.items()
        }
        return {"settings": self.settings, "layers": layers, "variant": self.variant}


@dataclass(frozen=True)
class Variants:
    """The &variant groups of an opened case."""

    groups: list[dict[str, Any]] = field(default_factory=list)  # groups as in the case file
    cases: dict[str, Case] = field(default_factory=dict)
    base: Document | None = None  # the case without variants
    documents: dict[str, Document] = field(default_factory=dict)  # variants that the page can show
    others: dict[str, str] = field(default_factory=dict)  # variant -> group that prevents display


@dataclass(frozen=True)
class Site:
    """Properties of an opened file that editing does not change."""

    file: Path  # path as opened
    case_name: str  # used in messages
    grid: Grid
    settings_forms: dict[str, Form]
    layer_forms: dict[str, Form]
    opened: Settings  # settings when opened; their file names cannot be edited
    kept: dict[str, Any] = field(default_factory=dict)  # groups and keys not sent to the page
    mode: str = "case"
    variants: Variants = field(default_factory=Variants)

    @property
    def folder(self) -> Path:
        """Folder of the opened file, where files are saved."""
        return self.file.absolute().parent

    def given(self, group: str, key: str) -> list[Any]:
        """Values of a key in the opened case and its variants."""
        documents = self.variants.documents.values()
        states = (self.opened, *(document.settings for document in documents))
        return [settings[group][key] for settings in states if key in settings.get(group, {})]

    def edited(
        self,
        document: Document,
        layers: Mapping[str, Any],
        settings: Mapping[str, Any],
        variant: str = "",
    ) -> Document:
        """Copy of a document, shown as `variant`, with layers and groups replaced by those from the
        page. Raise Refused for invalid values."""
        if not isinstance(variant, str) or variant not in ("", *self.variants.documents):
            raise Refused(say("app.server_wrong_type", name="variant"))
        new_layers, new_settings = dict(document.layers), dict(document.settings)
        for name, given in layers.items():
            if name not in self.layer_forms:
                place = {"layer": name} if name in LAYERS else {}
                raise Refused(say("app.server_no_layer", name=str(name)[:40]), **place)
            form, before = self.layer_forms[name], document.layers[name]
            new_layers[name] = check_features(name, given, form, before)
        for group, values in settings.items():
            new_settings[group] = self._group(group, values)
        check_size(new_layers.values())
        return Document(new_settings, new_layers, variant)

    def _group(self, group: str, values: Any) -> dict[str, Any]:
        """Checked keys of a group."""
        form = self.settings_forms.get(group)
        if form is None or not isinstance(values, dict):
            raise Refused(say("app.server_unknown", name=f"&{group}"[:40]))
        checked = {}
        for key, value in values.items():
            place = {"group": group, "key": str(key)[:40]}
            if key not in form:
                raise Refused(say("app.server_unknown", name=str(key)[:40]), **place)
            if value is None or value == "" or value == []:
                continue
            if form[key].read_only:
                if value not in self.given(group, key):
                    raise Refused(say("app.server_names_file", name=key), **place)
                checked[key] = value
            else:
                checked[key] = check_value(form[key], value, **place)
        return checked


class Runnable(NamedTuple):
    """A case and its layers; in the case, the files of `sources` and `zones` are `FROM_ARRAY`."""

    case: Case
    layers: dict[str, Layer]

    def named(self, file: str, inline: Collection[str] = ()) -> Case:
        """Case that reads its layers from files with these names, except the `inline` layers."""
        groups: dict[str, Any] = {}
        for name, layer in self.layers.items():
            if name in inline:
                group = GROUPS[name]
                groups[group] = [*getattr(self.case, group), *layer.groups()]
            elif name in GROUPS:
                group = GROUPS[name]
                groups[group] = [*getattr(self.case, group), {"file": file, "layer": name}]
            elif name == "zones":
                groups["surface"] = {"zones": file, "zones_layer": name}
            else:
                key = "points" if layer.geometry == "Point" else "polygons"
                groups["release"] = {key: file, f"{key}_layer": name}
        return self.case.replace(**groups) if groups else self.case


def runnable(site: Site, document: Document) -> Runnable:
    """Case and layers made from a document; raises Refused without sources or ground."""
    groups = {group: dict(values) for group, values in document.settings.items()}
    for group, kept in site.kept.items():
        groups[group] = kept if isinstance(kept, list) else {**kept, **groups.get(group, {})}  # type: ignore[assignment]
    features = {name: [*drawn] for name, drawn in document.layers.items() if drawn}
    if "sources" in features:
        _release_from(features["sources"], groups.setdefault("release", {}))
    elif not {*OTHER_SOURCES, "steep_cells"} & groups.get("release", {}).keys():
        raise Refused(say("app.server_no_sources"), layer="sources")
    if not ("zones" in features or groups.get("surface") or groups.get("impact")):
        raise Refused(say("app.server_no_ground"), group="surface", key="ground")
    if "zones" in features:
        features["zones"] = _zones_of(features["zones"], groups.setdefault("surface", {}), site)
    layers = {
        name: Layer.of(drawn, site.layer_forms[name]) for name, drawn in features.items()
    }  # fmt: skip
    case = Case(folder=site.folder, name=site.case_name, **groups)
    return Runnable(case, layers)


def _release_from(sources: list[Feature], release: dict[str, Any]) -> None:
    """Replace all boulder sources by the drawn sources."""
    points = sources[0].type == "Point"
    for key in (*OTHER_SOURCES, *(OF_CELLS if points else ())):
        release.pop(key, None)
    release["points" if points else "polygons"] = FROM_ARRAY


def _zones_of(zones: list[Feature], surface: dict[str, Any], site: Site) -> list[Feature]:
    """Drawn zones, and zones with the uniform ground of the case on the rest of the terrain. If the
    case has a default zone instead, all drawn zones get numbers."""
    sizes = {key: surface.pop(key) for key in SIZES if key in surface}
    surface["zones"] = FROM_ARRAY
    if "table" in surface:
        return zones
    if "default_zone" in surface:
        new = max((zone.properties.get("zone", 0) for zone in zones), default=0)
        numbered = []
        for zone in zones:
            if "zone" not in zone.properties:
                new += 1
                zone = zone._replace(properties={**zone.properties, "zone": new})
            numbered.append(zone)
        return numbered
    return zones + _rest(zones, sizes, surface, site.grid)


def _rest(
    zones: list[Feature], sizes: dict[str, Any], surface: dict[str, Any], grid: Grid
) -> list[Feature]:
    """Zones with the uniform ground outside the drawn zones; none if a drawn zone is invalid, which
    the reader refuses later."""
    import shapely

    radii = sizes.get("uniform_mean_radius"), sizes.get("uniform_rg")
    values = [*np.ravel(radii[0] or []), *np.ravel(radii[1] or [])]
    names = RADII[:1] if radii[0] is not None else RADII[1:]
    properties: dict[str, Any] = dict(zip(names, map(float, values), strict=False))
    if not properties and "ground" in surface:
        properties = {key: surface[key] for key in ("ground", *PAIR) if key in surface}
    shapes = [zone.shape() for zone in zones]
    if not properties or not shapely.is_valid(shapes).all():
        return []
    box = shapely.box(grid.west, grid.south, grid.east, grid.north)
    rest = shapely.get_parts(shapely.difference(box, shapely.union_all(shapes)))
    rings = [[part.exterior, *part.interiors] for part in rest if part.geom_type == "Polygon"]
    return [
        Feature("rest", "Polygon", [[[*at] for at in ring.coords] for ring in several],
                {**properties, REST: True})
        for several in rings
    ]  # fmt: skip


def with_output(case: Case, maps: Iterable[str], trajectories: int) -> Case:
    """Case of a live run that computes only the displayed outputs; the boulders do not change."""
    output = {
        "maps": [*dict.fromkeys(maps)] or None, "trajectories": trajectories or None,
        "rebounds": None, "energy_balance": None,
    }  # fmt: skip
    return case.replace(output=output)
