# SPDX-License-Identifier: BSD-3-Clause
"""Text of a first case, with the reason and alternatives for each value."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rockfall.case import keys_of
from rockfall.case.text import Entry, Group, case_text
from rockfall.draft.grounds import CHOICES, needs_rocks
from rockfall.draft.observed import ANGLES, Observed
from rockfall.draft.recognise import LINES, SEVERAL, SOURCES, STANDS, TREES, ZONES, Layer
from rockfall.draft.zones import Zones
from rockfall.io.files import relative_name
from rockfall.io.rasters.grid import Grid
from rockfall.scene.forest.attributes import matching

VOLUME = 1.0  # [m3]
RADIUS = 0.25  # [m] gives R_b/R_m = 2.5 with VOLUME, within the range of impact sets
MAPS = ("passages", "deposits", "reach_probability", "energy_mean", "energy_q95", "jump_height_q95")
TRAJECTORIES = 200
STAND = {
    "dbh_mean": 30.0,
    "dbh_std": 10.0,
    "conifers": 100.0,
}  # [cm], [cm], [%]; conifers absorb less energy


@dataclass
class New:
    """A draft of a case."""

    dem: Path
    out: Path
    grid: Grid
    used: dict[str, list[Layer]] = field(default_factory=dict)  # use -> layers
    zones: Zones | None = None
    ground: str = ""  # ground of a case without zones
    observed: Observed | None = None
    notes: list[str] = field(default_factory=list)  # notes on the use of each layer
    remarks: list[str] = field(default_factory=list)  # remarks on unusual inputs
    sources: int = 0  # number of sources, once known
    boulders: int = 1  # total number
    threshold: float = 1.0  # slope of steep cells [degree]
    volumes: int = 0  # number of sources whose layer gives boulder volumes

    @staticmethod
    def has_key(group: str, name: str) -> bool:
        """Return True if a group of the case has this key."""
        return name in keys_of(group)


def new_text(new: New, place: Path) -> str:
    """Text of the case for the folder `place`."""
    groups = [
        _case(new), Group("terrain", [_entry("terrain", "dem", _name(new.dem, place))]),
        _surface(new, place), _boulder(new), _release(new, place),
        *_forest(new, place), *_drawn(new, place), *_observed(new, place), _output(),
    ]  # fmt: skip
    return case_text(_head(new), groups, _foot(new))


def _entry(group: str, key: str, value: Any, why: str = "", on: bool = True) -> Entry:
    """A key with its chosen value, and its description from the key table."""
    key_row = keys_of(group)[key]
    unit = f" [{key_row.unit}]" if key_row.unit else ""
    parts = why, f"{key_row.meaning}{unit}", key_row.allowed
    return Entry(key, value, " | ".join(filter(None, parts)), on)


def _name(file: Path, place: Path) -> str:
    """Name of a file for a case in a given folder."""
    return relative_name(file.resolve(), place.resolve())


def _layer(layer: Layer, group: str, key: str) -> Iterator[Entry]:
    """Yield the key for the layer name if the file has several layers."""
    if not layer.alone:
        yield _entry(group, key, layer.name)


def _head(new: New) -> Iterator[str]:
    yield f"A first case for {new.dem.name}, by `rockfall new`. It runs unchanged. Values marked"
    yield "CHOOSE are guesses to be replaced by yours. Keys in comments are off."
    yield "All keys: docs/case.md. `rockfall check` lists what will run, with warnings."
    yield from (f"- {note}" for note in new.notes)


def _foot(new: New) -> Iterator[str]:
    if new.observed is None or not (new.observed.files or new.observed.angles):
        yield "No observations were given. To compare runs with the site, add for example:"
        yield f"&observed files = 'blocks.csv', energy_line_angle = {ANGLES['energy_line_angle']} /"
    yield "Hazard and dossier require frequencies (docs/howto/hazard.md), for example:"
    yield "&scenario name = 'blocks', return_period = 10.0 /"
    if LINES in new.used:
        return
    west, east, y = (f"{end:.10g}" for end in (new.grid.west, new.grid.east, new.grid.y.mean()))
    yield "No lines were given. To record boulders that cross a road, add for example:"
    yield f"&line name = 'road', x = {west}, {east}, y = {y}, {y} /"
    yield "&line file = 'site.gpkg', layer = 'road', field = 'name' /"


def _case(new: New) -> Group:
    total = f"CHOOSE, or give boulders for each of the {new.sources:,} sources"
    return Group(
        "case",
        [
            _entry("case", "title", new.out.stem),
            _entry("case", "boulders_total", new.boulders, total),
            _entry("case", "seed", 1),
            _entry("case", "question", "Is the road safe?", on=False),
        ],
    )


def _surface(new: New, place: Path) -> Group:
    if new.zones is None:
        why = f"As given, or use zones with a table. Grounds: {CHOICES}"
        rocks = needs_rocks(new.ground)
        radius = "CHOOSE; or mean_radius = 'raster.tif'" if rocks else "For grounds that need it"
        return Group(
            "surface",
            [
                _entry("surface", "ground", new.ground, why),
                _entry("surface", "uniform_mean_radius", RADIUS, radius, on=rocks),
            ],
        )
    zones, layer = new.zones, new.used[ZONES][0]
    named = [_entry("surface", "zones", _name(layer.path, place))]
    named += _layer(layer, "surface", "zones_layer")
    if zones.copy:
        why = "A copy of the polygons, with ids"
        named = [_entry("surface", "zones", zones.copy.name, why)]
    rest = []
    if zones.rest is not None:
        why = f"CHOOSE: {zones.outside:,} cells are in no polygon, this zone is the most frequent"
        rest = [_entry("surface", "default_zone", zones.rest, why)]
    return Group(
        "surface",
        [
            *named,
            _entry("surface", "zone_field", zones.field),
            _entry("surface", "table", zones.table.name, "Attributes and grounds of the polygons"),
            _entry("surface", "method", zones.method),
            *rest,
        ],
    )


def _boulder(new: New) -> Group:
    density = _entry("boulder", "density", 2800.0, "CHOOSE")
    if new.volumes and new.volumes == new.sources:
        why = f"From the attributes of {new.used[SOURCES][0]}"
        return Group("boulder", [_entry("boulder", "volume", "source", why), density])
    remainder = f", of {new.sources - new.volumes:,} sources without it" if new.volumes else ""
    return Group(
        "boulder",
        [
            _entry("boulder", "volume", "fixed", f"CHOOSE{remainder}"),
            _entry("boulder", "volume_mean", VOLUME, "CHOOSE, from blocks on the slope"),
            _entry("boulder", "volume_std", VOLUME / 5, on=False),
            density,
        ],
    )


def _release(new: New, place: Path) -> Group:
    drop = _entry("release", "drop_height", 1.0, "CHOOSE")
    slope = _entry("release", "slope_threshold", round(new.threshold, 2), on=False)
    if SOURCES not in new.used:
        why = "CHOOSE, none were given. Or polygons = 'cliff.gpkg', cells = 'raster.tif', x and y"
        return Group("release", [_entry("release", "steep_cells", True, why), slope, drop])
    layer = new.used[SOURCES][0]
    key = "points" if layer.shape == "Point" else "polygons"
    entries = [_entry("release", key, _name(layer.path, place))]
    entries += _layer(layer, "release", f"{key}_layer")
    if key == "points":
        return Group("release", [*entries, drop])
    steep = _entry("release", "steep_cells", True, on=False)
    return Group("release", [*entries, steep, slope, drop])


def _forest(new: New, place: Path) -> Iterator[Group]:
    for layer in new.used.get(TREES, ()):
        entries = [_entry("forest", "trees", _name(layer.path, place))]
        entries += _layer(layer, "forest", "trees_layer")
        if "species" not in layer.columns:
            why = "CHOOSE: the layer has no species, and conifers stop less"
            entries.append(_entry("forest", "uniform_conifers", 100.0, why))
        yield Group("forest", entries)
    for layer in new.used.get(STANDS, ()):
        entries = [_entry("forest", "polygons", _name(layer.path, place))]
        entries += _layer(layer, "forest", "polygons_layer")
        for key, value in STAND.items():
            also = ("species",) if key == "conifers" else ()
            if not any(matching(names, layer.columns) for names in (key, *also)):
                why = "CHOOSE: the layer does not give it"
                entries.append(_entry("forest", f"uniform_{key}", value, why))
        yield Group("forest", entries)


def _drawn(new: New, place: Path) -> Iterator[Group]:
    """Groups of lines, barriers and dams; the layers' attributes give the other values."""
    for kind, group in SEVERAL.items():
        for layer in new.used.get(kind, ()):
            entries = [_entry(group, "file", _name(layer.path, place))]
            entries += _layer(layer, group, "layer")
            field = layer.name_column
            if field and new.has_key(group, "field"):
                entries.append(_entry(group, "field", layer.own_names[field]))
            yield Group(group, entries)


def _observed(new: New, place: Path) -> Iterator[Group]:
    seen = new.observed
    if seen is None or not (seen.files or seen.angles):
        return
    copies = {path: path.name for path in seen.copies}
    files = [copies.get(path) or _name(path, place) for path in seen.files]
    entries = [_entry("observed", "files", files)] if files else []
    why = "CHOOSE: lowest angle of blocks at the site or in the region"
    for key, usual in ANGLES.items():
        angle = seen.angles.get(key, usual)
        entries.append(_entry("observed", key, angle, why, on=key in seen.angles))
    yield Group("observed", entries)


def _output() -> Group:
    return Group(
        "output",
        [
            Entry("maps", list(MAPS), "CHOOSE from docs/result.md"),
            _entry("output", "rebounds", True),
            _entry("output", "trajectories", TRAJECTORIES),
        ],
    )
