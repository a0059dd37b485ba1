# SPDX-License-Identifier: BSD-3-Clause
"""Distribution of boulders along a line: frequency, energy and height by window."""

from __future__ import annotations

import itertools
import json
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from rockfall.analysis.line_statistics import sample_numbers, with_limits
from rockfall.analysis.precision.intervals import fraction_interval, sources
from rockfall.errors import RockfallError
from rockfall.quantities import round_step
from rockfall.result.crossings import line_names, line_values
from rockfall.result.samples import check_rows
from rockfall.result.trajectories import lines
from rockfall.terrain.line_beyond import length_beyond, vertices_key
from rockfall.terrain.polyline import lengths

MAX_WINDOWS = 10_000  # maximum windows per line
ROUNDING = 1e-9  # narrower windows, relative to the line length, count as rounding errors
WINDOWS = 40  # approximate default number of windows
SHOWN = {"energy_total": ("mean", "q95"), "passing_height": ("mean", "q95")}
_NUMBERS = [f"{name}_{number}" for name, numbers in SHOWN.items() for number in numbers]
_COLUMNS = ["line", "start", "end", "length", "n"]
_COLUMNS += [
    column for name in ("fraction", "per_metre", *_NUMBERS) for column in with_limits(name)
]


def line_profile(result: xr.Dataset, line: str, width: float | None = None) -> pd.DataFrame:
    """Table with a row for each window of `width` [m] along a line, from its first vertex (default:
    a round width that gives about 40 windows). The last window may be shorter.

    The columns are `start` and `end` [m] of the window; its `length` on the terrain [m], NaN if the
    run did not check the line; `n` and `fraction` of the boulders that cross the line first in the
    window; `per_metre`, the fraction divided by `length` [1/m], NaN off the terrain; mean and 95 %
    quantile of the total energy [J] and of the passing height (centre, vertical) [m] of crossing
    boulders. `..._low` and `..._high` are the limits of 95 % confidence intervals, as in
    `line_statistics`; NaN where too few cross. Raises RockfallError for an unknown line, and for a
    width that is not above 0 or gives more than 10,000 windows.

    >>> import rockfall
    >>> result = rockfall.run(rockfall.read_case("case.nml"))
    >>> rockfall.line_profile(result, "L", width=60.0)["start"].tolist()
    [0.0, 60.0]
    """
    number = line_number(result, line)
    values = {name: line_values(result, name, number) for name in ("position", *SHOWN)}
    edges, window = windows(result, number, width)
    source, rows, on_terrain = sources(result), [], _lengths_on_terrain(result, number, edges)
    for k, (start, end) in enumerate(itertools.pairwise(edges)):
        here, length = window == k, on_terrain[k]
        row: dict[str, Any] = {"line": line, "start": start, "end": end, "length": length}
        row["n"] = int(here.sum())
        interval = np.array(fraction_interval(here, source))
        row |= zip(with_limits("fraction"), interval, strict=True)
        row |= zip(with_limits("per_metre"), interval / (length or np.nan), strict=True)
        for name in SHOWN if row["n"] else ():
            numbers = sample_numbers(values[name][here], source[here])
            row |= {f"{name}_{key}": value for key, value in numbers.items()}
        rows.append(row)
    return pd.DataFrame(rows, columns=_COLUMNS)


def _lengths_on_terrain(result: xr.Dataset, line: int, edges: np.ndarray) -> np.ndarray:
    """Length of each window on the terrain [m]; exactly 0 off it, NaN if the run did not check the
    line."""
    _, x, y = lines(result)[line]
    stretches = json.loads(result.attrs.get("lines_beyond", "{}")).get(vertices_key(x, y))
    if stretches is None:
        return np.full(edges.size - 1, np.nan)
    on_terrain = np.diff(edges) - length_beyond(stretches, edges[:-1], edges[1:])
    return np.where(on_terrain > ROUNDING * edges[-1], on_terrain, 0.0)


def line_number(result: xr.Dataset, line: str) -> int:
    """Index of the line with this name; raises a RockfallError if the result has no such line or no
    rows."""
    names = line_names(result)
    check_rows(result, "places along a line")
    if not names or not result.sizes.get("boulder"):
        raise RockfallError("the result has no evaluation lines, or no boulders")
    if line not in names:
        raise RockfallError(f"along = '{line}': no such line (lines: {', '.join(names)})")
    return names.index(line)


def windows(
    result: xr.Dataset, line: int, width: float | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Window edges along a line [m], and each boulder's window, -1 if it misses the line. Raises a
    RockfallError for a width <= 0 or too many windows."""
    _, x, y = lines(result)[line]
    length = float(lengths(x + 1j * y)[-1])
    width = round_step(length / WINDOWS) if width is None else width
    if not 0 < width < np.inf:
        raise RockfallError(f"width = {width}: must be > 0 m")
    number = max(1, int(np.ceil(length / width * (1 - ROUNDING))))
    if number > MAX_WINDOWS:
        raise RockfallError(
            f"width = {width}: gives {number:,} windows along the line: must be at most "
            f"{MAX_WINDOWS:,}"
        )
    position = line_values(result, "position", line)
    window = np.where(np.isnan(position), -1, np.minimum(position // width, number - 1))
    return np.append(width * np.arange(number), length), window.astype(int)
