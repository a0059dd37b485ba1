# SPDX-License-Identifier: BSD-3-Clause
"""CRS statements in the grid mapping of a netCDF file, which must agree for all readers."""

from collections.abc import Mapping
from typing import Any

from rockfall.errors import RockfallError
from rockfall.io.coordinates.crs import crs_name, same_crs
from rockfall.io.coordinates.projection_file import vertical_units

#: Attributes that define a system, in order of preference.
NAMES = (
    "crs_wkt", "spatial_ref", "esri_pe_string", "epsg_code", "proj4", "proj4text", "proj4_params",
)  # fmt: skip


def check_statements(where: str, attrs: Mapping[str, Any]) -> None:
    """Refuse a grid mapping with several texts that define different systems, or elevations in a
    unit other than the metre; texts that define no system are ignored."""
    from rasterio.crs import CRS
    from rasterio.errors import CRSError

    systems = []
    for name in NAMES:
        text = str(attrs.get(name, "")).strip()
        try:
            systems += [(name, text, CRS.from_user_input(text))] if text else []
        except (CRSError, ValueError):
            continue
    if len(systems) < 2:
        return
    first, _, own = systems[0]
    for name, text, system in systems:
        for unit in vertical_units(text):
            if not unit.is_metre:
                raise RockfallError(
                    f"{where}: elevations are in {unit.name} ({name}), but must be in metres"
                )
        if not same_crs(own, system):
            raise RockfallError(
                f"{where}: {first} is {crs_name(own)}, {name} is {crs_name(system)}: remove the "
                "wrong one"
            )
