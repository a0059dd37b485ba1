# SPDX-License-Identifier: BSD-3-Clause
"""Samples of boulder values at lines and at their ends, for runs that do not keep all rows
(`&output kept`): counts in narrow bins, exact sums, the largest values. They are sums over
boulders, so that parts add up exactly, bit for bit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from rockfall.case import Case
from rockfall.errors import RockfallError
from rockfall.language import say
from rockfall.limits import (
    SAMPLE_BINS,
    SAMPLE_BITS,
    SAMPLE_COARSE,
    SAMPLE_LARGEST,
    SAMPLE_QUANTITIES,
    SAMPLE_TAILS,
    SAMPLE_WORDS,
)
from rockfall.result import variables

if TYPE_CHECKING:
    from rockfall.result.contents import Held


def simulated(result: Held) -> int:
    """Number of boulders of a result, which may have rows for some of them only."""
    if "sample_ended" in result:
        return int(result["sample_ended"].values.sum())
    return int(result.sizes["boulder"])


def kept_note(result: Held) -> str:
    """Note on the boulders behind numbers that need rows; "" if these are all."""
    rows, boulders = result.sizes["boulder"], simulated(result)
    return "" if rows == boulders else say("compare.kept", part=rows, n=boulders)


def has_rows(result: Held) -> bool:
    """Return True if a result has rows of boulders, of all or of some."""
    return bool(result.sizes["boulder"])


def check_rows(result: Held, what: str) -> None:
    """Refuse an analysis that needs rows of boulders if a run kept none."""
    if "sample_ended" in result and not has_rows(result):
        raise RockfallError(
            f"{what}: needs rows of boulders, and &output kept = 'none' keeps none; run with a "
            "number of them, or 'all'"
        )


def check_all_rows(result: Held, what: str) -> None:
    """Refuse an analysis that needs rows of all boulders if a run did not keep them."""
    if result.sizes["boulder"] < simulated(result):
        raise RockfallError(f"{what}: needs rows of all boulders: &output kept = 'all'")


def rows_kept(case: Case, boulders: int) -> int | None:
    """Number of boulders whose rows are kept; None: all, without samples."""
    kept = case.output["kept"]
    return None if kept == "all" else 0 if kept == "none" else min(kept, boulders)


#: Dimensions of arrays in files, after "sample_".
DIMS: dict[str, tuple[str, ...]] = {
    "bin": ("entry",), "count": ("entry",),
    "group_bin": ("group_entry",), "group_count": ("group_entry",),
    "sums": ("place", "part", "quantity", "word"), "largest": ("line", "tail", "rank"),
    "ended": ("status",), "part_last": ("part",), "group_part": ("group",),
}  # fmt: skip


def lengths(case: Case, boulders: int) -> dict[str, int]:
    """Lengths of the dimensions that follow from the case and the boulders of the run."""
    lines = len(case.lines)
    return {
        "place": lines + 1, "line": lines, "quantity": SAMPLE_QUANTITIES, "word": SAMPLE_WORDS,
        "tail": SAMPLE_TAILS, "rank": min(boulders, SAMPLE_LARGEST),
        "status": len(variables.STATUS), "fine": SAMPLE_BINS, "coarse": SAMPLE_COARSE,
    }  # fmt: skip


def sample_dims(name: str) -> tuple[str, ...]:
    """Dimensions of a variable of samples in a file."""
    return tuple(f"sample_{dim}" for dim in DIMS[name])


def possible(arrays: Mapping[str, np.ndarray], shape: Mapping[str, int], boulders: int) -> str:
    """First variable of samples with values impossible for the given number of boulders; "" if
    none."""
    for before, count, bins, fine in (
        ("", "count", "part", "fine"), ("group_", "group_count", "group", "coarse"),
    ):  # fmt: skip
        places, counts = arrays[f"sample_{before}bin"], arrays[f"sample_{count}"]
        of_bins = shape["place"] * shape[bins] * SAMPLE_QUANTITIES * shape[fine]
        if places.size and not (
            places[0] >= 0 and places[-1] < of_bins and (np.diff(places) > 0).all()
        ):
            return f"sample_{before}bin"
        if not ((counts > 0) & (counts <= boulders)).all():
            return f"sample_{count}"
    ended, sums = arrays["sample_ended"], arrays["sample_sums"]
    if not (ended >= 0).all() or ended.sum() != boulders:
        return "sample_ended"
    if not ((sums[..., [1, 3]] >> SAMPLE_BITS) == 0).all() or not (sums[..., 2:] >= 0).all():
        return "sample_sums"
    largest = arrays["sample_largest"]
    if not np.isfinite(largest).all() or not ((largest >= 0) | (largest == -1)).all():
        return "sample_largest"
    part_last, group_part = arrays["sample_part_last"], arrays["sample_group_part"]
    if not (np.diff(part_last, prepend=0) > 0).all():
        return "sample_part_last"
    if not ((group_part >= 1) & (group_part <= part_last.size)).all():
        return "sample_group_part"
    return ""
