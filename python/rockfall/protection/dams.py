# SPDX-License-Identifier: BSD-3-Clause
"""Dams of a result as rasterised on its terrain."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from rockfall.terrain.dams import DamShape

if TYPE_CHECKING:
    from rockfall.result.contents import Held


def dams_of(result: Held) -> list[DamShape]:
    """Dams of a run in case order; empty for results without dams."""
    return [DamShape(**dam) for dam in json.loads(str(result.attrs.get("dams", "[]")))]
