# SPDX-License-Identifier: BSD-3-Clause
"""Protection that a result records: dams as rasterised on its terrain, stands with their stems."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from rockfall.scene.forest.trees import Stand
from rockfall.terrain.dams import DamShape

if TYPE_CHECKING:
    from rockfall.result.contents import Held


def dams_of(result: Held) -> list[DamShape]:
    """Dams of a run in case order; empty for results without dams."""
    return [DamShape(**dam) for dam in json.loads(str(result.attrs.get("dams", "[]")))]


def stands_of(result: Held) -> list[Stand]:
    """Stands of a run in layer order; empty for results without stands."""
    return [Stand(*stand) for stand in json.loads(str(result.attrs.get("stands", "[]")))]
