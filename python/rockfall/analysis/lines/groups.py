# SPDX-License-Identifier: BSD-3-Clause
"""Groups of boulders in a result: by source, volume class, or block shape."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from rockfall.errors import RockfallError
from rockfall.quantities import number
from rockfall.result.boulders import boulders_by_shape

if TYPE_CHECKING:
    from rockfall.result.contents import Held

BY = ("source", "volume", "shape")
MAX_SOURCES = 50  # with more sources, a group is a range of sources
RANGES = 20  # number of such ranges
MAX_VOLUMES = 6  # maximum number of distinct volumes that each form a class

Group = tuple[str, np.ndarray]  # name, and mask of boulders


def groups(result: Held, by: str, classes: Sequence[float] | None = None) -> list[Group]:
    """Groups of boulders: each boulder is in exactly one group, and no group is empty. Raises a
    RockfallError for an unknown `by`, invalid `classes`, or by = 'shape' with a single shape.

    by = 'source': the polygons or points of the source layer by name or, without a layer, the
    sources by number; in ranges if there are more than `MAX_SOURCES`. by = 'volume': `classes` are
    the edges between classes [m3] (default: the distinct volumes if they are few, else quartiles of
    the boulders). An edge belongs to the class above it. by = 'shape': the block shapes.
    """
    check_by(by, classes)
    if by == "shape":
        if not (shapes := boulders_by_shape(result)):
            raise RockfallError(
                "by = 'shape': all boulders of the result have the same block shape"
            )
        return [*shapes.items()]
    groups = _by_source(result) if by == "source" else _by_volume(result["volume"].values, classes)
    return [(name, chosen) for name, chosen in groups if chosen.any()]


def check_by(by: str, classes: Sequence[float] | None) -> None:
    """Raise a RockfallError for an unknown `by`, or for `classes` unless by = 'volume'."""
    if by not in BY:
        raise RockfallError(f"by = '{by}': must be one of: {', '.join(BY)}")
    if classes is not None and by != "volume":
        raise RockfallError(f"classes: are only valid with by = 'volume', not '{by}'")


def _by_source(result: Held) -> Iterator[Group]:
    layer = "source_feature" in result
    numbers = result["source_feature" if layer else "source"].values
    present = np.unique(numbers)
    if present.size > MAX_SOURCES:
        for sources in np.array_split(present, RANGES):
            yield (
                f"{sources[0]} to {sources[-1]}",
                (numbers >= sources[0]) & (numbers <= sources[-1]),
            )
        return
    for k, name in zip(present, _names(result, present), strict=True):
        yield name, numbers == k


def part_names(result: Held) -> list[str]:
    """Names of the sample parts, which are features, sources, or ranges of either."""
    last = result["sample_part_last"].values
    if last[-1] == last.size:
        return _names(result, last)
    return [f"{low + 1} to {high}" for low, high in itertools.pairwise([0, *last])]


def _names(result: Held, numbers: np.ndarray) -> list[str]:
    """Names of features; numbers of sources if there are no features."""
    if "feature" not in result:
        return [str(k) for k in numbers]
    names = [str(name) for name in result["feature_name"].values]
    labels = [(names[k - 1], k) for k in numbers]
    return [f"{name} ({k})" if names.count(name) > 1 else name for name, k in labels]


def _by_volume(volume: np.ndarray, classes: Sequence[float] | None) -> Iterator[Group]:
    edges = np.asarray(classes if classes is not None else (), float)
    if classes is not None and not (edges.size and np.isfinite(edges).all() and edges[0] > 0):
        raise RockfallError("classes: must be volumes > 0 m3")
    if (np.diff(edges) <= 0).any():
        raise RockfallError(f"classes = {', '.join(f'{edge:g}' for edge in edges)}: must increase")
    if classes is None:
        volumes = np.unique(volume)
        if volumes.size <= MAX_VOLUMES:
            yield from ((f"{number(value)} m3", volume == value) for value in volumes)
            return
        quarters = np.quantile(volume, [0.25, 0.5, 0.75])
        edges = np.unique([float(f"{edge:.2g}") for edge in quarters])
    names = [f"below {edges[0]:g} m3"]
    names += [f"{low:g} to {high:g} m3" for low, high in itertools.pairwise(edges)]
    member = np.searchsorted(edges, volume, side="right")
    for k, name in enumerate([*names, f"{edges[-1]:g} m3 and more"]):
        yield name, member == k
