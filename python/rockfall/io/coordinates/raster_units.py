# SPDX-License-Identifier: BSD-3-Clause
"""Elevation units that a raster file gives in addition to its CRS."""

import re
from pathlib import Path

from rockfall.errors import RockfallError
from rockfall.io.coordinates.geo_keys import DIRECTORY, TEXTS, check_plan, keys_of, stated_heights
from rockfall.io.coordinates.length_units import (
    Stated,
    stated_in_attributes,
    unit_in_words,
    unit_of,
)
from rockfall.io.coordinates.projection_file import projection_heights
from rockfall.io.files import TIFF, start_of
from rockfall.io.gdal_files import companions, tiff_numbers, tiff_text
from rockfall.io.rasters.raster_file import AsciiSource, RasterFile, raster_file

_METADATA = re.compile(r"<altunits>([^<]*)</altunits>", re.IGNORECASE)  # FGDC metadata
_MAX_METADATA = 2_000_000  # bytes


def stated_units(raster: RasterFile) -> list[Stated]:
    """Elevation units in the band, its description, tags, GeoTIFF keys, and companion files.
    Refuses depths, and a plan unit that contradicts the CRS."""
    source, file = raster.source, raster_file(raster.path)
    if isinstance(source, AsciiSource):
        return []
    tags = {
        key: value
        for key, value in (*source.tags().items(), *source.tags(1).items())
        if "#" not in key or key.startswith("NC_GLOBAL#")
    }  # attributes of coordinates are left out
    if tags.get("positive", "").lower() == "down":
        raise RockfallError(f"{raster.path}: has depths (positive = down): must have elevations")
    stated = [Stated(unit_of(unit), "band unit") for unit in source.units[:1] if unit]
    stated += stated_in_attributes({key: tags[key] for key in tags if key != "units"})
    if text := source.descriptions[0]:
        unit = unit_in_words(text)
        stated += [Stated(unit, "band description")] if unit else []
    if start_of(file).startswith(TIFF):
        keys = keys_of(tiff_numbers(file, DIRECTORY))
        check_plan(raster.path, keys)
        stated += stated_heights(keys, tiff_text(file, TEXTS))
    if source.driver == "AAIGrid" or source.crs is None:
        stated += projection_heights(file)
    return stated + _in_metadata(Path(file))


def _in_metadata(file: Path) -> list[Stated]:
    """Elevation unit in the FGDC metadata next to a file."""
    names = (f"{file.name}.xml".lower(), f"{file.stem}.xml".lower())
    stated = []
    for companion in companions(file):
        if companion.name.lower() in names:
            with open(companion, "rb") as content:
                text = content.read(_MAX_METADATA).decode("utf-8", "replace")
            stated += [Stated(unit_of(word), companion.name) for word in _METADATA.findall(text)]
    return [item for item in stated if item.unit.name]
