# SPDX-License-Identifier: BSD-3-Clause
"""Samples of boulder values at lines and ends, for runs that do not keep all rows
(`&output kept`): counts in narrow bins, exact sums, and the largest values. Samples of parts can
be added bit-exactly.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rockfall.errors import RockfallError
from rockfall.language import say

if TYPE_CHECKING:
    from rockfall.result.contents import Held


def simulated(result: Held) -> int:
    """Number of boulders simulated for a result, with or without rows."""
    if "sample_ended" in result:
        return int(result["sample_ended"].values.sum())
    return int(result.sizes["boulder"])


def kept_note(result: Held) -> str:
    """Note on the number of boulders that have rows; "" if all have."""
    rows, boulders = result.sizes["boulder"], simulated(result)
    return "" if rows == boulders else say("compare.kept", part=rows, n=boulders)


def has_rows(result: Held) -> bool:
    """Return True if a result has rows, for all or some boulders."""
    return bool(result.sizes["boulder"])


def check_rows(result: Held, what: str) -> None:
    """Refuse an analysis that needs boulder rows if the run kept none."""
    if "sample_ended" in result and not has_rows(result):
        raise RockfallError(
            f"{what}: requires rows of boulders, but &output kept = 'none' keeps none: run with "
            "kept = 'all' or a number"
        )


def check_all_rows(result: Held, what: str) -> None:
    """Refuse an analysis that needs the rows of all boulders if the run did not keep them."""
    if result.sizes["boulder"] < simulated(result):
        raise RockfallError(f"{what}: requires rows of all boulders: &output kept = 'all'")


def is_ensemble(result: Held) -> bool:
    """Return True for an ensemble, which includes the result of the unchanged case."""
    return "ensemble_runs" in result.attrs
