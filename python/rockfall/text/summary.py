# SPDX-License-Identifier: BSD-3-Clause
"""What a run gave, in the few lines that its user wants to see first."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from rockfall.analysis.extrapolation import extrapolations
from rockfall.analysis.line_statistics import line_numbers, sources
from rockfall.analysis.run_until import verdicts_of
from rockfall.result.trajectories import ends

if TYPE_CHECKING:
    import xarray as xr


def summary(result: xr.Dataset) -> str:
    """How many boulders, how they ended, how they passed the lines, and what to be wary of."""
    boulders = result.sizes["boulder"]
    lines = [f"{result.attrs['title'] or 'rockfall'}: {boulders:,} boulders"]
    lines += _ends(result)
    if "line" in result:
        lines += _passages(result)
    lines += [f"  until {verdict}" for verdict in verdicts_of(result)]
    lines += _rebounds(result)
    wall, cpu = (result.attrs[f"{clock}_seconds"] for clock in ("wall", "cpu"))
    lines.append(f"  {wall:.1f} s, {cpu:.1f} s of CPU")
    return "\n".join(lines)


def _ends(result: xr.Dataset) -> Iterator[str]:
    """The share of boulders that ended in each way."""
    for word, ended in ends(result).items():
        if ended.any():
            yield f"  {word.replace('_', ' '):14}{ended.sum():12,}{ended.mean():8.1%}"


def _passages(result: xr.Dataset) -> Iterator[str]:
    """Boulders at each line, their mean speed and passing height, with 95 % intervals."""
    names = [str(name) for name in result["line"].values]
    wide = max(14, *map(len, names))
    head = f"{'boulders':>12}{'fraction':>17}{'mean speed':>20}{'mean passing height':>22}"
    yield f"  {'line (95 %)':{wide}}{head}"
    source = sources(result)
    for k, name in enumerate(names):
        speed, height = (
            line_numbers(result, k, key, source) for key in ("speed", "passing_height")
        )
        fraction = _at_most(speed["fraction_high"])
        if speed["n"]:
            fraction = _within(speed, "fraction", ".1f", 100)
        row = f"  {name:{wide}}{speed['n']:12,}{f'{fraction} %':>17}"
        if speed["n"]:
            row += f"{_within(speed, 'mean', '.1f') + ' m/s':>20}"
            row += f"{_within(height, 'mean', '.2f') + ' m':>22}"
        yield row


def _at_most(share: float) -> str:
    """What none of the boulders did, others may."""
    return f"0 to {100 * share:.2g}"


def _within(numbers: dict[str, float], name: str, digits: str, scale: float = 1.0) -> str:
    """A number and half the length of its interval, where it has one."""
    text = f"{scale * numbers[name]:{digits}}"
    if f"{name}_low" not in numbers:
        return text
    half = scale * (numbers[f"{name}_high"] - numbers[f"{name}_low"]) / 2
    return f"{text} +- {half:{digits}}"


def _rebounds(result: xr.Dataset) -> Iterator[str]:
    """How the draws of the impact model fared, and where it does not hold."""
    rebounds, redrawn, forced = (int(result[f"rebounds{of}"]) for of in ("", "_redrawn", "_forced"))
    yield f"  {rebounds:,} rebounds" + (f", {redrawn / rebounds:.1%} redrawn" if redrawn else "")
    if forced:
        yield f"  forced rebounds: {forced:,} (none of 32 draws was admissible)"
    for found in extrapolations(result):
        yield f"  {'warning: ' if found.is_warning else ''}{found.text}"
