# SPDX-License-Identifier: BSD-3-Clause
"""Impact marks at a known height, such as scars on trees, and the heights at which simulated
boulders pass there.

A boulder hits a trunk with its side, and the scar's middle is at the height of the boulder's
centre above the ground. A run records the passing heights at the first crossing of a short line
through the mark, perpendicular to the mean direction of the arriving boulders. The line is as long
as the trunk and the mean boulder together are wide. If fewer than `ENOUGH` boulders of the case
touch the trunk, the line belongs to the narrowest object in `WIDTHS` that enough boulders touch,
or to the widest object.

If n of N boulders cross the line at heights H_j (only boulders that could hit the marked side, if
it is known), the predictive density of a mark at height s is

    f(s) = (sum_j K(s - H_j) + a/top) / (n + a)

K is a normal kernel with Silverman's width, at least `ACCURACY`. As for blocks at rest
(`rockfall.analysis.observed.deposits`), the weight a = 1 represents one boulder at any height below
`top`, which is twice the maximum height observed or simulated. A mark shows that at least one block
passed at its height: f is the density of one hit. For the highest of k marks the density is k f
F^(k - 1), with the distribution function F (David and Nagaraja 2003). As the number of blocks that
passed is unknown, many boulders at a mark are no stronger evidence than a few. Besides f only one
factor counts: the probability 1 - (1 - (n + 1/2)/(N + 1))^N that at least one of N blocks arrives
(0.39 for n = 0, 0.78 for n = 1, 0.99 for n = 4).

David, H. A., Nagaraja, H. N. (2003): Order Statistics. Wiley.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from rockfall.analysis.observed.deposits import ANYWHERE, silverman
from rockfall.analysis.observed.observations import Observed
from rockfall.result.crossings import line_names, values_at
from rockfall.scene.scene import Scene
from rockfall.simulation.simulate import run_scene

ENOUGH = 50  # minimum boulders of the case at a mark; with fewer, its line is longer
WIDTHS = (2.0, 5.0, 10.0)  # widths of objects used instead of the trunk [m]
ACCURACY = 0.1  # [m] accuracy of a mark's height: scars are at least this high
PREFIX = "mark"


@dataclass(frozen=True)
class Mark:
    """A mark: place [m], height of its middle [m], trunk diameter [m], azimuth of the side that
    was hit [degree] (NaN if unknown), number of marks up to its height (including itself), and its
    line in a case."""

    where: str
    x: float
    y: float
    height: float
    diameter: float = 0.0
    side: float = np.nan
    hits: int = 1
    line: str = ""


class Passing(NamedTuple):
    """Passing heights [m] of boulders that could make a mark."""

    heights: np.ndarray
    boulders: int  # number of boulders in the run


class Heights(NamedTuple):
    """Kernel of a mark: width and maximum height [m]."""

    width: float
    top: float


def read_marks(seen: Observed) -> list[Mark]:
    """Observed impacts with a height above the ground."""
    if seen.contacts is None:
        return []
    rows: pd.DataFrame = seen.contacts
    marks = []
    for k, row in enumerate(rows.to_dict("records")):
        if row["height"] > 0:
            diameter = 0.0 if np.isnan(row["dbh"]) else row["dbh"] / 100
            hits = 1 if np.isnan(row["hits"]) else int(row["hits"])
            place = row["x"], row["y"], row["height"], diameter, row["side"], hits
            marks.append(Mark(seen.where["contacts"][k], *place))
    return marks


def with_lines_at(scene: Scene, marks: list[Mark]) -> tuple[Scene, list[Mark]]:
    """Scene with a line at each mark, and marks with the names of their lines. A first run gives
    the widths of the lines and the directions of the boulders."""
    if not marks:
        return scene, marks
    given = list(scene.case.line)
    taken = {line["name"] for line in scene.case.lines}  # includes names of barriers
    objects, names = [], []
    for k, mark in enumerate(marks):
        name = f"{PREFIX} {k + 1}"
        while name in taken:
            name += "'"
        names.append(name)
        for width in _widths(mark):
            place = {"x": [mark.x, mark.x], "y": [mark.y, mark.y]}
            objects.append({"name": f"{name}: {width:g}", "object_width": width, **place})
    trial = _with_lines(scene, objects)
    result = run_scene(trial)
    order = line_names(result)
    first, lines, named = order.index(str(objects[0]["name"])), [], []
    for mark, name in zip(marks, names, strict=True):
        widths = _widths(mark)
        rows = slice(first, first + len(widths))
        lines.append({"name": name} | _line(result, mark, widths, rows))
        named.append(replace(mark, line=name))
        first += len(widths)
    return _with_lines(scene, given + lines), named


def _with_lines(scene: Scene, lines: list[dict]) -> Scene:
    return replace(scene, case=scene.case.replace(line=lines))


def _widths(mark: Mark) -> list[float]:
    return [mark.diameter, *(width for width in WIDTHS if width > mark.diameter)]


def _line(
    result: xr.Dataset, mark: Mark, widths: list[float], rows: slice
) -> dict[str, list[float]]:
    """Ends of the line at a mark, from the boulders that touch the objects (`rows`) there."""
    touched = result["row_size"].values[rows]
    many = touched >= ENOUGH
    k = int(np.argmax(many)) if many.any() else len(widths) - 1
    if touched[k]:
        at = rows.start + k
        heading = np.array([values_at(result, f"velocity_{axis}", at).mean() for axis in "xy"])
    else:  # no boulder arrives: direction from the centre of the sources
        start = [result[f"start_{axis}"].values.mean() for axis in "xy"]
        heading = np.array([mark.x, mark.y]) - start
    east, north = (heading / (np.hypot(*heading) or 1.0)).tolist()
    radius = np.cbrt(0.75 / np.pi * result["volume"].values.mean())
    half = widths[k] / 2 + float(radius)
    dx, dy = half * north, -half * east
    return {"x": [mark.x - dx, mark.x + dx], "y": [mark.y - dy, mark.y + dy]}


def passing_at(result: xr.Dataset, mark: Mark) -> Passing:
    """Heights [m] of a run's boulders that cross the line of a mark; if the side of the mark is
    known, only of boulders that move towards it."""
    k = line_names(result).index(mark.line)
    heights = values_at(result, "passing_height", k)
    able = np.ones(heights.size, bool)
    if not np.isnan(mark.side):
        out = np.radians(mark.side)
        east, north = (values_at(result, f"velocity_{axis}", k) for axis in "xy")
        able &= east * np.sin(out) + north * np.cos(out) < 0
    return Passing(heights[able], result.sizes["boulder"])


def fitted_heights(mark: Mark, passing: Passing, greatest: float) -> Heights:
    """Kernel for a mark, fitted to the boulders of a run. `greatest` is the maximum height observed
    or simulated [m]."""
    width = silverman(passing.heights)
    if not np.isfinite(width):
        width = mark.height / 4 if passing.heights.size < 2 else 0.0
    return Heights(max(width, ACCURACY), 2 * greatest)


def height_sums(kernel: Heights, height: float, heights: np.ndarray) -> tuple[float, float, float]:
    """Sums over boulders at a mark's height: kernels [1/m], their squares, and distribution
    functions."""
    from scipy.special import ndtr

    scores = (height - heights) / kernel.width
    near = np.exp(-(scores**2) / 2) / (np.sqrt(2 * np.pi) * kernel.width)
    return float(near.sum()), float((near**2).sum()), float(ndtr(scores).sum())


def log_density(
    near: np.ndarray, below: np.ndarray, crossed: np.ndarray, mark: Mark, top: float
) -> np.ndarray:
    """Logarithm of the predictive density [1/m] of a mark. `near` and `below` are the sums of
    kernels and distribution functions over the `crossed` boulders."""
    log_density = np.log((near + ANYWHERE / top) / (crossed + ANYWHERE))
    if mark.hits > 1:
        part = (below + ANYWHERE * min(mark.height / top, 1.0)) / (crossed + ANYWHERE)
        log_density = log_density + np.log(mark.hits) + (mark.hits - 1) * np.log(part)
    return log_density


def log_reach(crossed: np.ndarray, boulders: int) -> np.ndarray:
    """Logarithm of the probability that at least one of `boulders` blocks arrives at a mark, if
    `crossed` of an equal number of simulated boulders do.

    >>> np.exp(log_reach(np.array([0.0, 1.0]), 1000)).round(2).tolist()
    [0.39, 0.78]
    """
    frequency = (crossed + 0.5) / (boulders + 1)
    return np.log(-np.expm1(boulders * np.log1p(-np.minimum(frequency, 1 - 1e-12))))
