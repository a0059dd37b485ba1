# SPDX-License-Identifier: BSD-3-Clause
"""Ground zones of a case, from the zone table or the polygons' attributes."""

import numpy as np

from rockfall.case.case import FROM_ARRAY, Case
from rockfall.errors import RockfallError
from rockfall.io.vectors.layers import EXTENSIONS, read_attributes
from rockfall.io.zone_table import Zone, read_zone_table, zones_of_polygons


def case_zones(case: Case, remarks: list[str] | None = None) -> dict[int, Zone]:
    """Zones by id, in the order of the table or of the polygons; empty for a surface without
    zones. Remarks on unusual values are added to `remarks`."""
    if "zones" not in case.surface:
        return {}
    if "table" in case.surface:
        return read_zone_table(case.path(case.surface["table"]), remarks)
    return polygon_zones(case, remarks)[1]


def polygon_zones(
    case: Case, remarks: list[str] | None = None
) -> tuple[np.ndarray, dict[int, Zone]]:
    """Id of each polygon (int32), and the zones by id, for a case without a zone table. Refuses
    rasters, a default zone without ids, and polygons without grounds."""
    surface = case.surface
    path = case.path(surface["zones"])
    if surface["zones"] == FROM_ARRAY or path.suffix.lower() not in EXTENSIONS:
        raise RockfallError(
            f"{case.name}: &surface table is missing: it must give the grounds of the zones"
        )
    columns = read_attributes(path, "polygons", surface.get("zones_layer"), "zones_layer")
    ids, zones, own = zones_of_polygons(columns, str(path), surface["zone_field"], remarks)
    if "default_zone" in surface and not own:
        raise RockfallError(
            f"{case.name}: &surface default_zone = {surface['default_zone']}: needs an integer "
            f"attribute {surface['zone_field']} that distinguishes zones, or a table"
        )
    return ids, zones
