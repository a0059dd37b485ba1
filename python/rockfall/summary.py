# SPDX-License-Identifier: BSD-3-Clause
"""What a run gave, in the few lines that its user wants to see first."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import xarray as xr


def summary(result: xr.Dataset) -> str:
    """How many boulders, how they ended, how they passed the lines, and what to be wary of."""
    boulders = result.sizes["boulder"]
    lines = [f"{result.attrs['title'] or 'rockfall'}: {boulders:,} boulders"]
    lines += _ends(result)
    if "line" in result:
        lines += _passages(result)
    lines += _rebounds(result)
    wall, cpu = (result.attrs[f"{clock}_seconds"] for clock in ("wall", "cpu"))
    lines.append(f"  {wall:.1f} s, {cpu:.1f} s of CPU")
    return "\n".join(lines)


def _ends(result: xr.Dataset) -> Iterator[str]:
    """The share of boulders that ended in each way."""
    status, boulders = result["status"], result.sizes["boulder"]
    words = status.attrs["flag_meanings"].split()
    for flag, word in zip(status.attrs["flag_values"], words, strict=True):
        count = np.count_nonzero(status.values == flag)
        if count:
            yield f"  {word.replace('_', ' '):14}{count:12,}{count / boulders:8.1%}"


def _passages(result: xr.Dataset) -> Iterator[str]:
    """Boulders at each line, their mean speed and passing height."""
    names = [str(name) for name in result["line"].values]
    wide = max(14, *map(len, names))
    head = f"{'boulders':>12}{'share':>8}{'mean speed':>12}{'mean passing height':>21}"
    yield f"  {'line':{wide}}{head}"
    for k, name in enumerate(names):
        speed, height = (result[f"line_{key}"].values[k] for key in ("speed", "passing_height"))
        count = np.count_nonzero(~np.isnan(speed))
        row = f"  {name:{wide}}{count:12,}{count / result.sizes['boulder']:8.1%}"
        if count:
            row += f"{np.nanmean(speed):8.1f} m/s{np.nanmean(height):19.2f} m"
        yield row


def _rebounds(result: xr.Dataset) -> Iterator[str]:
    """How the draws of the impact model fared."""
    rebounds, redrawn, forced, outside = (
        int(result[f"rebounds{of}"]) for of in ("", "_redrawn", "_forced", "_out_of_range")
    )
    yield f"  {rebounds:,} rebounds" + (f", {redrawn / rebounds:.1%} redrawn" if redrawn else "")
    if forced:
        yield f"  forced rebounds: {forced:,} (none of 32 draws was admissible)"
    if outside:
        yield (
            f"  {outside / rebounds:.1%} of rebounds had R_b/R_m outside 0.5 to 5.5: "
            "the impact set is not calibrated there"
        )
