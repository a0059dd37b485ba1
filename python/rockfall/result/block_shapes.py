# SPDX-License-Identifier: BSD-3-Clause
"""Block shapes of the boulders of a result, for runs with several."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from rockfall.result.variables import BLOCK_SHAPE

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from rockfall.result.contents import Held


def boulders_by_shape(values: Held | Mapping[str, ArrayLike]) -> dict[str, np.ndarray]:
    """Mask (boulders,) of the boulders of each block shape that occurs; {} if the run has one
    shape."""
    if "block_shape" not in values:
        return {}
    shape = np.asarray(values["block_shape"])
    masks = {name: shape == number for name, number in BLOCK_SHAPE.items()}
    return {name: mask for name, mask in masks.items() if mask.any()}
