# SPDX-License-Identifier: BSD-3-Clause
"""Section along a drawn line as a message, with the columns and lines of `rockfall section`."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from rockfall.analysis.line_statistics import with_limits
from rockfall.analysis.lines.section import section_of
from rockfall.analysis.lines.section_maps import MAPPED, SHOWN
from rockfall.analysis.lines.stations import SectionLine
from rockfall.app.messages import binary_message
from rockfall.errors import RockfallError
from rockfall.quantities import QUANTITIES
from rockfall.result.trajectories import Terrain

Places = Sequence[Sequence[float]]

WITHIN = 10.0  # [m] to either side, the default of the command
#: Maps that a live run computes while a section is shown.
MAPS = (
    "passages",
    *(name for quantity in SHOWN for name in with_limits(f"{MAPPED[quantity][0]}_q95")),
    *(MAPPED[quantity][1] for quantity in SHOWN),
)
COLUMNS = (
    "distance", "x", "y", "elevation", "cell_n", "recorded_n",
    *(f"{before}_{quantity}_{number}"
      for before in ("cell", "recorded") for quantity in SHOWN for number in with_limits("q95")),
    *(f"{before}_{quantity}_max" for before in ("corridor", "recorded") for quantity in SHOWN),
)  # fmt: skip


def section_message(
    result: xr.Dataset | None, vertices: Places, terrain: Terrain | None, **fields: Any
) -> bytes:
    """Message `section` along these vertices in SI units, or an `error`; empty without vertices."""
    fields |= {"vertices": vertices, "within": WITHIN, "error": "", "lines": []}
    shown = {name: QUANTITIES[name] for name in SHOWN}
    fields["quantities"] = {
        name: {"unit": quantity.unit, "factor": quantity.factor, "decimals": quantity.decimals}
        for name, quantity in shown.items()
    }
    if result is None or not vertices:
        return binary_message("section", {}, **fields)
    line = SectionLine(np.array([complex(*place) for place in vertices]), WITHIN)
    try:
        cut = section_of(result, line, terrain)
    except RockfallError as error:
        return binary_message("section", {}, **fields | {"error": str(error)})
    arrays = {name: cut.table[name].to_numpy("f8") for name in COLUMNS}
    gap = np.full((2, 1), np.nan)
    paths = [part for path in cut.paths for part in (path, gap)]
    arrays["paths"] = np.concatenate([np.zeros((2, 0)), *paths], axis=1).T.astype("f4")
    fields["lines"] = [
        {key: row[key] for key in ("name", "kind", "distance", "height")}
        | {"q95": {name: [row[key] for key in with_limits(f"{name}_q95")] for name in SHOWN}}
        for row in cut.lines.to_dict("records")
    ]  # fmt: skip
    return binary_message("section", arrays, **fields)
