# SPDX-License-Identifier: BSD-3-Clause
"""Advice on files that are given as tables but have another format."""

from pathlib import Path

from rockfall.errors import RockfallError
from rockfall.io import file_kinds as kinds
from rockfall.io.files import start_of

_TABLE, _LAYER = "save the table as CSV", "save it as a GeoPackage (.gpkg), as QGIS does"
#: Advice by file type; other tables must be saved as CSV.
_CURES = {
    **dict.fromkeys(kinds.ARCHIVES, "unpack it"),
    **dict.fromkeys((kinds.KMZ, kinds.KML, kinds.GPX, kinds.XML), _LAYER),
    kinds.GEOPACKAGE: "name it .gpkg",
    kinds.SHAPEFILE: "name it .shp",
    kinds.JSON: "if it is GeoJSON, name it .geojson",
    kinds.UTF_16: "save it as UTF-8",
    kinds.HTML: "the download failed",
}
#: Trajectory files of RAMMS, whose layout is not published.
_TRAJECTORIES = (".rts", ".pts")


def check_table(path: str | Path) -> None:
    """Refuse trajectory files, and files of a known type that are not tables. Missing files and
    folders pass this check; a file that cannot be read raises a RockfallError."""
    if not Path(path).is_file():
        return
    if Path(path).suffix.lower() in _TRAJECTORIES:
        raise RockfallError(f"{path}: trajectories are not read: give samples and stops as CSV")
    if kind := kinds.kind_of(start_of(path)):
        cure = _CURES.get(kind, _TABLE)
        raise RockfallError(f"{path}: is {kind.name}, not a CSV table: {cure}")
