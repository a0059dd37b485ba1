# SPDX-License-Identifier: BSD-3-Clause
"""Forest stands of a result, with numbers of stems."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from rockfall.scene.forest.trees import Stand

if TYPE_CHECKING:
    from rockfall.result.contents import Held


def stands_of(result: Held) -> list[Stand]:
    """Stands of a run in layer order; empty for results without stands."""
    return [Stand(*stand) for stand in json.loads(str(result.attrs.get("stands", "[]")))]
