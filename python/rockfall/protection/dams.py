# SPDX-License-Identifier: BSD-3-Clause
"""Dams of a result, as they came out on the cells of its terrain."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from rockfall.terrain.dams import DamShape

if TYPE_CHECKING:
    from rockfall.result.contents import Held


def dams_of(result: Held) -> list[DamShape]:
    """The dams of a run in the order of its case; none of results that do not have them."""
    return [DamShape(**one) for one in json.loads(str(result.attrs.get("dams", "[]")))]
