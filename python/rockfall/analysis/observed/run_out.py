# SPDX-License-Identifier: BSD-3-Clause
"""Run-out distances and lateral spread, observed and simulated; distances between distributions,
and the Kolmogorov-Smirnov test of a sample against a weighted sample.

Intervals come from resampled boulders (Efron 1979), both observed and simulated, within each
source. An interval requires the number of boulders in `rockfall.limits` for a mean or a standard
deviation. The interval of the Wasserstein distance is mirrored (pivotal), because chance increases
the distance between two samples. `by_chance` is the 95 % quantile of this distance for samples of
the observed size from the result itself: a smaller distance may be due to chance.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rockfall.analysis.observed.observations import Observed
from rockfall.analysis.precision.intervals import fraction_interval, sources
from rockfall.case import case_of
from rockfall.io.rasters.arrays import corner_of
from rockfall.language import say
from rockfall.limits import MIN_FOR_MEAN, MIN_FOR_STD
from rockfall.quantities import first_of
from rockfall.result.trajectories import stop_distances
from rockfall.result.variables import ENDS

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from numpy.typing import ArrayLike

    from rockfall.result.contents import Held
    from rockfall.scene.scene import Scene

RESAMPLES = 200
LIMITS = (0.025, 0.975)
STATIONS = 300  # number of distances on a passing curve
FARTHEST = 1e9  # [m] squares and sums of larger values overflow
MIN_BOULDERS = 2  # minimum boulders per source for statistics
UNDECIDED, DIFFERS = "undecided", "differs"
COLUMNS = ["source", "statistic", "n_observed", "n_simulated"] + [
    f"{whose}{end}" for whose in ("observed", "simulated", "difference") for end in ENDS
]  # fmt: skip
COLUMNS += ["by_chance", "verdict"]


class Sample(NamedTuple):
    """Values of boulders, in one or more columns (n, columns), and their sources."""

    values: np.ndarray
    source: np.ndarray

    def of(self, source: int) -> Sample:
        from_source = self.source == source
        return Sample(self.values[from_source], self.source[from_source])


def resampled(sample: Sample, random: np.random.Generator) -> np.ndarray:
    """Number of times each boulder occurs (boulders,) in a resample with the same number from each
    source."""
    counts = np.zeros(len(sample.source), int)
    for source in np.unique(sample.source):
        from_source = np.flatnonzero(sample.source == source)
        counts[from_source] = np.bincount(
            random.integers(from_source.size, size=from_source.size), minlength=from_source.size
        )
    return counts


class Distance:
    """Wasserstein distance between two weighted samples of a quantity: the area between their
    distribution functions. (SciPy would sort both for each set of weights.)"""

    def __init__(self, seen: np.ndarray, made: np.ndarray) -> None:
        both = np.concatenate([seen, made])
        self.order = np.argsort(both, kind="stable")
        self.gaps = np.diff(both[self.order])

    def __call__(self, seen: np.ndarray, made: np.ndarray) -> float:
        apart = np.concatenate([seen / seen.sum(), -made / made.sum()])
        return float(np.abs(np.cumsum(apart[self.order])[:-1]) @ self.gaps)


def kolmogorov_smirnov(
    seen: np.ndarray, made: np.ndarray, share: np.ndarray
) -> tuple[float, float]:
    """Kolmogorov-Smirnov statistic of a sample and a weighted sample, and its p-value.

    Equal weights give SciPy's two-sample test, which is exact for small samples. Otherwise the
    statistic is the largest distance between the distribution functions, and p assumes that the
    weighted sample has (sum w)^2 / sum w^2 boulders (Kish 1965): the variance of its distribution
    function F is F (1 - F) divided by that number, if weights do not depend on values.
    """
    from scipy.stats import ks_2samp, kstwo

    if np.ptp(share) == 0:
        test = ks_2samp(seen, made)
        return float(test.statistic), float(test.pvalue)
    both = np.concatenate([seen, made])
    order = np.argsort(both, kind="stable")
    apart = np.concatenate([np.full(len(seen), 1 / len(seen)), -share / share.sum()])[order]
    last = np.append(np.diff(both[order]) > 0, True)  # last of several equal values
    statistic = float(np.abs(np.cumsum(apart)[last]).max())
    effective = share.sum() ** 2 / (share @ share)
    size = len(seen) * effective / (len(seen) + effective)
    return statistic, float(kstwo.sf(statistic, max(round(size), 1)))


def run_out(result: xr.Dataset, seen: Observed) -> pd.DataFrame:
    """Table of values for each source and for all sources (observed and simulated, with limits,
    difference and verdict): mean and standard deviation of the stopping distance, Wasserstein
    distance, lateral spread and offset [m]; empty without observations.

    Lateral means perpendicular to the line from the release to the mean observed stopping place;
    the spread is the standard deviation, the offset the mean. With several sources, the boulders of
    the result are weighted by the number observed from each source.
    """
    import pandas as pd

    rows: list[list] = []
    pair = samples(result, seen)
    if pair is not None and pair[0].values.max() < FARTHEST:
        observed, simulated = pair
        given = [s for s in np.unique(observed.source)
                 if (observed.source == s).sum() >= MIN_BOULDERS]  # fmt: skip
        if len(np.unique(observed.source)) > 1:
            names = starts(result).names
            for source in given:
                rows += _rows(names[source], observed.of(source), simulated.of(source))
        if len(observed.source) >= MIN_BOULDERS:
            rows += _rows("all", observed, simulated)
    return pd.DataFrame(rows, columns=COLUMNS)


def samples(result: xr.Dataset, seen: Observed) -> tuple[Sample, Sample] | None:
    """Stopping distances and, if places are known, lateral offsets [m] of observed boulders and of
    simulated boulders from the same sources. None if distances are unknown."""
    observed = observed_boulders(result, seen)
    if observed is None:
        return None
    by_group = frames(result, seen)
    if not by_group:
        distance = result["plan_distance"].values[:, None]
        return observed, Sample(distance, np.zeros(len(distance), int))
    source = starts(result).group
    values = np.full((source.size, 2), np.nan)
    for group, frame in by_group.items():
        from_source = source == group
        values[from_source] = np.column_stack(
            [way_of(result, frame, group, k)[from_source] for k in (0, 1)]
        )
    among = np.isin(source, [*by_group])
    return observed, Sample(values[among], source[among])


def pooled_samples(pairs: Sequence[tuple[xr.Dataset, Observed]]) -> tuple[Sample, Sample] | None:
    """Pooled samples of several results from a site, each with its observations; None if distances
    are unknown for any of them. Lateral offsets are perpendicular to the mean of all observed
    vectors. A single result gives its `samples`."""
    if len(pairs) == 1:
        return samples(*pairs[0])
    parts = [part for part in (_ways(*pair) for pair in pairs) if part is not None]
    if len(parts) == len(pairs):
        across = _across(np.concatenate([seen.values for seen, _ in parts]))
        parts = [
            (_in_frame(seen, across), _in_frame(made, across)) for seen, made in parts
        ]  # fmt: skip
    else:
        sampled = [part for part in (samples(*pair) for pair in pairs) if part is not None]
        if len(sampled) < len(pairs):
            return None
        parts = [
            (Sample(seen.values[:, :1], seen.source), Sample(made.values[:, :1], made.source))
            for seen, made in sampled
        ]
    first = np.cumsum([0, *(made.source.max() + 1 for _, made in parts)])
    pooled = [
        Sample(
            np.concatenate([part[k].values for part in parts]),
            np.concatenate([part[k].source + at for part, at in zip(parts, first, strict=False)]),
        )
        for k in (0, 1)
    ]
    return pooled[0], pooled[1]


def _ways(result: xr.Dataset, seen: Observed) -> tuple[Sample, Sample] | None:
    """Vectors from release to rest [m], observed and simulated; None if places are unknown."""
    origins = starts(result)
    if seen.stops is None or (seen.starts is None and len(origins.places) > 1):
        return None
    ways, group = _observed_ways(seen, origins)
    made = [result[f"stop_{axis}"].values - result[f"start_{axis}"].values for axis in "xy"]
    among = np.isin(origins.group, group)
    return Sample(ways, group), Sample(np.column_stack(made)[among], origins.group[among])


def _in_frame(ways: Sample, across: np.ndarray) -> Sample:
    """Lengths of vectors [m], and their offsets in the direction `across` (a unit vector) [m]."""
    return Sample(np.column_stack([np.hypot(*ways.values.T), ways.values @ across]), ways.source)


class Starts(NamedTuple):
    """Release groups that observers can distinguish: features of the source layer, cliffs (adjacent
    source cells), or points."""

    group: np.ndarray  # group index of each boulder
    names: list[str]  # group names
    places: np.ndarray  # (n, 2): release places [m]
    group_at: np.ndarray  # group index of each place


def starts(result: xr.Dataset) -> Starts:
    """Release groups of a result."""
    is_points, at = "x" in case_of(result).release, result["start_x"].values
    feature = result["source_feature"].values if "source_feature" in result else None
    names = result["feature_name"].values.tolist() if feature is not None else []
    cell = None if is_points else cell_of(result)
    return _starts(at + 1j * result["start_y"].values, feature, names, cell)


def scene_starts(scene: Scene) -> Starts:
    """Release groups of a scene, each source once."""
    features, cell = scene.features, None if "x" in scene.case.release else scene.grid.cell
    feature, names = (None, []) if features is None else (features.number, features.names)
    return _starts(scene.x + 1j * scene.y, feature, names, cell)


def _starts(
    at: np.ndarray, feature: np.ndarray | None, feature_names: Sequence[str], cell: float | None
) -> Starts:
    """Release groups: the features (numbers from 1), else adjacent cells, else (`cell` is None)
    points."""
    import pandas as pd

    number, place = pd.factorize(at)
    places = np.column_stack([place.real, place.imag])
    if feature is not None:
        group, features = pd.factorize(feature)
        names = [str(feature_names[k - 1]) for k in features]
        group_at = np.zeros(len(places), int)
        group_at[number] = group
        return Starts(group, names, places, group_at)
    group_at = np.arange(len(places)) if cell is None else _touching(places, cell)
    names = [str(k + 1) for k in range(group_at.max(initial=-1) + 1)]
    return Starts(group_at[number], names, places, group_at)


def _touching(places: np.ndarray, cell: float) -> np.ndarray:
    """Index of the patch of adjacent source cells that each source cell, at `places` (n, 2),
    belongs to."""
    import pandas as pd
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import KDTree

    # Diagonal neighbours are 1.41 cells apart.
    pairs = KDTree(places).query_pairs(1.5 * cell, output_type="ndarray")
    ones = np.ones(len(pairs), bool)
    graph = coo_array((ones, (pairs[:, 0], pairs[:, 1])), shape=(len(places), len(places)))
    return pd.factorize(connected_components(graph, directed=False)[1])[0]


def cell_of(result: xr.Dataset) -> float:
    """Side of a terrain cell of a result [m]."""
    return corner_of(result["crs"].attrs)[2]


def compared(result: xr.Dataset, seen: Observed) -> tuple[np.ndarray, str]:
    """Mask of the boulders to compare with observed stopping places or distances, and notes on the
    choice. Only boulders from the observed starts are compared; all if starts are unknown."""
    total = result.sizes["boulder"]
    if seen.stops is None or seen.starts is None:
        return np.ones(total, bool), ""
    origins, nearest = starts(result), _nearest(seen.starts, starts(result).places)
    groups = np.unique(origins.group_at[nearest])
    in_groups = np.isin(origins.group, groups)
    apart = np.hypot(*(seen.starts - origins.places[nearest]).T).max()
    notes = []
    if not in_groups.all():
        places = ", ".join(first_of([origins.names[k] for k in groups], 10))
        notes.append(say("compare.same_starts", part=in_groups.sum(), n=total, names=places))
    if apart > 3 * cell_of(result):
        notes.append(say("compare.release_apart", apart=apart))
    return in_groups, " ".join(notes)


def observed_boulders(result: xr.Dataset, seen: Observed) -> Sample | None:
    """Observed boulders: stopping distance, lateral offset [m] if places are known, and source
    number; None if distances are unknown."""
    origins = starts(result)
    if seen.stops is None or (seen.starts is None and len(origins.places) > 1):
        if seen.distances is None:
            return None
        return Sample(seen.distances[:, None], np.zeros(seen.distances.size, int))
    ways, nearest = _observed_ways(seen, origins)
    offsets = np.empty(len(ways))
    for group in np.unique(nearest):
        offsets[nearest == group] = ways[nearest == group] @ _across(ways[nearest == group])
    return Sample(np.column_stack([np.hypot(*ways.T), offsets]), nearest)


def _observed_ways(seen: Observed, origins: Starts) -> tuple[np.ndarray, np.ndarray]:
    """Vectors (n, 2) [m] from the observed releases, or from the first place of `origins` if none
    were observed, to the stops, and the source group nearest to each release."""
    assert seen.stops is not None
    given = seen.starts
    given = origins.places[:1].repeat(len(seen.stops), axis=0) if given is None else given
    return seen.stops - given, origins.group_at[_nearest(given, origins.places)]


def _nearest(given: np.ndarray, places: np.ndarray) -> np.ndarray:
    from scipy.spatial import KDTree

    return KDTree(places).query(given)[1]


class Frame(NamedTuple):
    """Name of a source group, and the unit vector perpendicular to its mean observed vector."""

    name: str
    across: np.ndarray


def frames(result: xr.Dataset, seen: Observed) -> dict[int, Frame]:
    """Frames by source group, for groups with observed stopping places."""
    origins = starts(result)
    if seen.stops is None or (seen.starts is None and len(origins.places) > 1):
        return {}
    ways, group = _observed_ways(seen, origins)
    groups = np.unique(group).tolist()
    return {k: Frame(origins.names[k], _across(ways[group == k])) for k in groups}


def way_of(result: xr.Dataset, frame: Frame, group: int, column: int) -> np.ndarray:
    """Distance or lateral offset [m] (`column`) of each boulder in a group; NaN for others."""
    ways = np.column_stack(
        [result[f"stop_{axis}"].values - result[f"start_{axis}"].values for axis in "xy"]
    )
    distance = ways @ frame.across if column else np.hypot(*ways.T)
    return np.where(starts(result).group == group, distance, np.nan)


def _across(ways: np.ndarray) -> np.ndarray:
    """Unit vector (x, y) to the left of the mean of vectors (n, 2)."""
    x, y = ways.mean(axis=0)
    return np.array([-y, x]) / (np.hypot(x, y) or 1.0)


def _rows(name: str, seen: Sample, made: Sample) -> Iterator[list]:
    random = np.random.default_rng(0)
    share = weights(seen, made)
    distance = Distance(seen.values[:, 0], made.values[:, 0])
    counts = [(resampled(seen, random), resampled(made, random)) for _ in range(RESAMPLES)]
    ones, sizes = np.ones(len(seen.source)), [len(seen.source), len(made.source)]

    def row(label: str, column: int, statistic: int) -> list:
        values = [
            [moments(sample.values[:, column], w)[statistic] for w in weights_]
            for sample, weights_ in (
                (seen, [ones, *(a for a, _ in counts)]),
                (made, [share, *(share * b for _, b in counts)]),
            )
        ]
        observed, simulated = np.array(values)
        apart = simulated - observed
        fewest = MIN_FOR_STD if statistic else MIN_FOR_MEAN
        numbers = [
            limit
            for sample, size in ((observed, sizes[0]), (simulated, sizes[1]), (apart, min(sizes)))
            for limit in _limits(sample, size >= fewest)
        ]
        low, high = numbers[-2:]
        verdict = "larger" if low > 0 else "smaller" if high < 0 else UNDECIDED
        return [name, label, *sizes, *numbers, np.nan, verdict]

    yield row("mean", 0, 0)
    yield row("std", 0, 1)
    value = distance(ones, share)
    again = np.array([distance(a, share * b) for a, b in counts])
    high, low = 2 * value - np.quantile(again, LIMITS)
    chance = by_chance(seen, made, share, random)
    verdict = DIFFERS if value > chance else UNDECIDED
    unknown = 6 * [np.nan]
    limits = [value, max(low, 0.0), max(high, value)]
    yield [name, "wasserstein", *sizes, *unknown, *limits, chance, verdict]
    if seen.values.shape[1] > 1:
        yield row("lateral_spread", 1, 1)
        yield row("lateral_offset", 1, 0)


def _limits(values: np.ndarray, enough: bool) -> list[float]:
    """First of `values`, with limits from the others; limits are NaN unless `enough`."""
    limits = np.quantile(values[1:], LIMITS).tolist() if enough else [np.nan, np.nan]
    return [float(values[0]), *limits]


def weights(seen: Sample, made: Sample) -> np.ndarray:
    """Weights (boulders,), 1 on average, of simulated boulders that give each source its observed
    frequency."""
    observed = np.bincount(seen.source, minlength=made.source.max() + 1)
    share = (observed / np.maximum(np.bincount(made.source), 1))[made.source]
    return share / share.mean()


def moments(values: np.ndarray, weight: np.ndarray) -> tuple[float, float]:
    """Weighted mean and standard deviation (n - 1)."""
    n = weight.sum()
    mean = weight @ values / n
    squares = weight @ (values - mean) ** 2
    return float(mean), float(np.sqrt(squares / max(n - 1, 1.0)))


def by_chance(seen: Sample, made: Sample, share: np.ndarray, random: np.random.Generator) -> float:
    """95 % quantile of the Wasserstein distance between a result and samples of its boulders that
    have the observed numbers from each source."""
    values, distances = made.values[:, 0], []
    places = {s: np.flatnonzero(made.source == s) for s in np.unique(seen.source)}
    distance = Distance(values, values)
    for _ in range(RESAMPLES):
        counts = np.zeros(values.size, int)
        for source, n in zip(*np.unique(seen.source, return_counts=True), strict=True):
            picked = random.integers(places[source].size, size=n)
            counts[places[source]] += np.bincount(picked, minlength=places[source].size)
        distances.append(distance(counts, share))
    return float(np.quantile(distances, 0.95))


def mean_slopes(values: Held | Mapping[str, ArrayLike]) -> np.ndarray:
    """Slopes (boulders,) of the straight lines from release to end [degree]."""
    return np.degrees(np.arctan2(*falls_and_distances(values)))


def falls_and_distances(values: Held | Mapping[str, ArrayLike]) -> tuple[np.ndarray, np.ndarray]:
    """Fall heights (boulders,) from release to end, and plan distances [m]."""
    start, stop, distance = (
        np.asarray(values[name]) for name in ("start_z", "stop_z", "plan_distance")
    )
    return start - stop, distance


def passing(
    result: xr.Dataset, distance: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Distances [m], and the fraction of boulders that travel at least each distance with its 95 %
    limits, from the `distance` of each boulder."""
    source = sources(result)
    shown = np.linspace(0, stop_distances(result).max() or 1.0, STATIONS)
    fraction = [fraction_interval(distance >= limit, source) for limit in shown]
    return shown, *np.transpose(fraction)
