# SPDX-License-Identifier: BSD-3-Clause
"""A remark on the validity of a run's model, and counts behind it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rockfall.language import Text

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from rockfall.result.contents import Held

    Variables = Held | Mapping[str, ArrayLike]


class Remark(NamedTuple):
    """A remark on the validity of a run's model."""

    text: Text
    is_warning: bool
    is_counted: bool = True  # of the boulders of the run


def sum_of(values: Variables, name: str) -> int:
    """Sum over the boulders of a count."""
    return int(np.asarray(values[name]).sum(dtype="i8"))
