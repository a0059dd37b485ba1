# SPDX-License-Identifier: BSD-3-Clause
"""Posterior of each parameter of a back-analysis: tables, draws, and reasons to distrust it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from rockfall.analysis.precision.weighted import value_at
from rockfall.io.zone_table import read_zone_table
from rockfall.studies.back.contributions import CONFLICT
from rockfall.studies.back.sampling import effective
from rockfall.studies.back.study import Back
from rockfall.studies.ensemble.uncertain_inputs import PAIR, PAIR_FACTORS

LEVELS = (0.05, 0.5, 0.95)
KS = 1.63  # critical Kolmogorov-Smirnov value times root n, at a level of 1 % because of smoothing
EDGE = 0.5  # minimum posterior fraction beyond the prior's 5 or 95 % quantile for a warning
NOISY = 1.0  # variance of the log-likelihood above which more boulders help more than more members
DRAWS = 256  # rows in the file of draws
ALONE = "by_data.csv"  # file of posteriors from each data set alone
TRADED = 0.7  # correlation of a ground's strength and relief above which a warning is given
CONTRADICTED = 0.05  # p-value of all data sets together below which a warning is given


class Parameter(NamedTuple):
    """Parameter of the back-analysis: its column in the members, name, units, and value in the
    case if it is a factor, else None."""

    column: str
    label: str
    units: str
    scale: float | None


def parameters(analysis: Back) -> Iterator[Parameter]:
    """Parameters in the order of the cube's columns, except impact sets, which have no order."""
    inputs, case = analysis.inputs, analysis.case
    sought = set(analysis.sought.tolist())
    volume, drop, source, sets, _, first, _, pairs = inputs.ends[:8].tolist()
    if volume in sought:
        mean = case.boulder.get("volume_mean")
        yield Parameter("volume", "volume, mean", "m3", mean)
    if volume + 1 in sought:
        std = case.boulder.get("volume_std")
        yield Parameter("volume_std", "volume, standard deviation", "m3", std)
    if drop in sought:
        yield Parameter("drop_height", "drop height", "m", case.release["drop_height"])
    if source in sought:
        yield Parameter("source_east", "source, eastwards", "m", None)
        yield Parameter("source_north", "source, northwards", "m", None)
    names = _zones(analysis)
    for row in range(inputs.radii):
        if first + row in sought:
            column = f"radius_{row + 1}"
            if inputs.scene.rasters.values is not None or case.surface["method"] == "A":
                yield Parameter(column, f"factor on rock sizes{names[row]}", "1", 1.0)
            else:
                size = float(inputs.scene.rasters.sizes[row, 0])
                yield Parameter(column, f"R_m{names[row]}", "m", size)
    for i, k in enumerate(inputs.pairs):
        rule = inputs.scene.grounds[k]
        for j, (key, units) in enumerate(zip(PAIR, ("Pa", "degree"), strict=True)):
            if pairs + 2 * i + j in sought:
                value = getattr(rule.plane.ground, key) if rule.plane else 1.0
                yield Parameter(f"{key}_{i + 1}", f"{key} of {rule.name}", units, value)


def _zones(analysis: Back) -> list[str]:
    surface = analysis.case.surface
    if analysis.inputs.radii == 1 or "table" not in surface:
        return [""] * analysis.inputs.radii
    return [f", zone {zone}" for zone in read_zone_table(analysis.case.path(surface["table"]))]


def posterior_table(analysis: Back) -> pd.DataFrame:
    """Table with a row for each parameter: parameter, units, case (value in the case, 0 for
    shifts), 5, 50 and 95 % quantiles of prior and posterior, ratio (5-95 % range of the posterior
    divided by that range of the prior, for factors in logarithms), moved (Kolmogorov-Smirnov
    distance between both), verdict, and correlation (between the logarithms of a ground's strength
    and relief, in the posterior). For impact sets, ratio compares effective numbers (exp of the
    entropy), moved is the total variation distance, and set_best the most likely set, from 0."""
    rows = [_row(analysis, parameter) for parameter in parameters(analysis)]
    for ridge in ridges(analysis):
        for row in rows:
            if row["parameter"] in (f"{key} of {ridge.ground}" for key in PAIR):
                row["correlation"] = ridge.correlation
    if "sets" in analysis.inputs.names:
        rows.append(_set_row(analysis))
    columns = ["parameter", "units", "case", *(f"{prefix}{name}" for prefix in ("prior_", "")
               for name in ("q05", "median", "q95")), "ratio", "moved", "verdict"]  # fmt: skip
    return pd.DataFrame(rows, columns=[*columns, "set_best", "correlation"])


def alone_table(analysis: Back) -> pd.DataFrame:
    """Rows of `posterior_table` from each data set alone (column `data`), if it has weights."""
    tables = []
    for name, weight in zip(analysis.data["data"], analysis.alone, strict=True):
        if weight.any():
            other = replace(analysis, members=analysis.members.assign(weight=weight))
            table = posterior_table(other)
            table.insert(0, "data", name)
            tables.append(table)
    return pd.concat(tables, ignore_index=True)


def _row(analysis: Back, parameter: Parameter) -> dict[str, Any]:
    from scipy.special import ndtri

    values = analysis.members[parameter.column].to_numpy()
    scale = 1.0 if parameter.scale is None else parameter.scale
    shift, spread = parameter.column.startswith("source"), _spread(analysis, parameter)
    scores = (values if shift else np.log(values)) / spread
    posterior = np.array([weighted_quantile(scores, analysis.weight, level) for level in LEVELS])
    prior, ends = ndtri(LEVELS), (scores < ndtri(LEVELS[0]), scores > ndtri(LEVELS[2]))
    moved = _moved(analysis.weight, scores)
    verdict = _informed(analysis, moved > KS / np.sqrt(analysis.effective))
    if any(analysis.weight @ beyond > EDGE for beyond in ends):
        verdict = "at the edge of the prior"
    ratio = float((posterior[2] - posterior[0]) / (prior[2] - prior[0]))
    prior, posterior = (
        spread * values if shift else np.exp(spread * values) for values in (prior, posterior)
    )
    names = ("q05", "median", "q95")
    return {
        "parameter": parameter.label, "units": parameter.units,
        "case": scale if parameter.scale else 0.0,
        **{f"prior_{name}": scale * value for name, value in zip(names, prior, strict=True)},
        **{name: scale * value for name, value in zip(names, posterior, strict=True)},
        "ratio": ratio, "moved": moved, "verdict": verdict,
    }  # fmt: skip


def _informed(analysis: Back, moved: bool) -> str:
    """Verdict on a parameter, from whether its posterior has moved away from the prior."""
    return "informed" if moved else "not informed" if analysis.is_enough else "undecided"


def _spread(analysis: Back, parameter: Parameter) -> float:
    """Prior standard deviation of a shift, or of the log of a factor."""
    given = analysis.inputs.given
    if parameter.column.startswith("source"):
        return given["source_shift"]
    return float(np.log(given[f"{parameter.column.rstrip('_0123456789')}_factor"]))


def _moved(weight: np.ndarray, scores: np.ndarray) -> float:
    """Kolmogorov-Smirnov distance of the posterior from the prior."""
    from scipy.special import ndtr

    order = np.argsort(scores)
    reached, prior = np.cumsum(weight[order]), ndtr(scores[order])
    return float(np.maximum(reached - prior, prior - reached + weight[order]).max())


def _set_row(analysis: Back) -> dict[str, Any]:
    which = analysis.members["set"].to_numpy(int)
    chance = np.bincount(which, analysis.weight, len(analysis.inputs.sets))
    positive = chance[chance > 0]
    number = float(np.exp(-(positive * np.log(positive)).sum()))
    expected, total = 1 / chance.size, analysis.effective
    chi2 = total * ((chance - expected) ** 2 / expected).sum()
    from scipy.stats import chi2 as distribution

    informed = distribution.sf(chi2, chance.size - 1) < CONTRADICTED
    return {
        "parameter": f"impact set or table, of {chance.size}", "units": "1",
        "ratio": number / chance.size, "moved": float(np.abs(chance - expected).sum() / 2),
        "verdict": _informed(analysis, bool(informed)), "set_best": int(chance.argmax()),
    }  # fmt: skip


def weighted_quantile(values: np.ndarray, weight: np.ndarray, level: float) -> float:
    """Value that has a given fraction of the weight below it, interpolated between the middles of
    the steps. With n effective draws the rank is level (n + 1) (Weibull 1939), so that another
    draw, or the true value, is below the result with this probability."""
    n = effective(weight)
    return value_at(values, weight, (level * (n + 1) - 0.5) / n)


def warnings(analysis: Back) -> Iterator[str]:
    """Warnings that give reasons to distrust the posterior."""
    if not analysis.is_enough:
        more = "--boulders" if analysis.noise > NOISY else "--members"
        yield (
            f"undecided: {analysis.effective:.0f} effective members of {analysis.asked} requested, "
            f"so ranges are uncertain: raise {more}"
        )
    limit = CONTRADICTED / len(analysis.data)
    for row in analysis.data.to_dict("records"):
        if row["predictive_p"] < limit:
            yield (
                f"the model does not explain the {row['data']}: only {row['predictive_p']:.1%} of "
                "its posterior samples deviate as much as the observations"
            )
    for row in analysis.data.to_dict("records"):
        if row["agreement"] == CONFLICT:
            yield (
                f"conflict: {row['data']} is less likely with the other data than alone, by "
                f"exp({row['loss']:.1f} +- {row['loss_error']:.1f}): {ALONE} gives each data set "
                "alone"
            )
    edge = [row["parameter"] for row in posterior_table(analysis).to_dict("records")
            if row["verdict"].startswith("at the edge")]  # fmt: skip
    if edge:
        yield f"the data pull beyond the prior, which may be too narrow: {', '.join(edge)}"
    for ridge in ridges(analysis):
        if ridge.correlation > TRADED:
            yield (
                f"{ridge.ground}: twice the strength is like {ridge.degrees:.1f} degrees more "
                f"relief (correlation {ridge.correlation:.2f}): measure one of them with `rockfall "
                "ground`"
            )


def draws_table(analysis: Back) -> pd.DataFrame:
    """Equally probable draws from the posterior (systematic resampling), as `&ensemble draws`."""
    columns = [name for name in analysis.members if name.startswith(
        ("radius_", "volume", "drop_height", "source_east", "source_north", "set",
         *(f"{key}_" for key in PAIR)))]  # fmt: skip
    random = np.random.default_rng((analysis.case.case["seed"], DRAWS))
    steps = (np.arange(DRAWS) + random.random()) / DRAWS
    picked = np.searchsorted(np.cumsum(analysis.weight), steps).clip(max=len(analysis.weight) - 1)
    table = analysis.members.iloc[picked][columns].reset_index(drop=True)
    if "set" in table:
        table["set"] = table["set"].astype(int)
    table.insert(0, "draw", np.arange(1, DRAWS + 1))
    return table


class Ridge(NamedTuple):
    """Trade-off between a ground's strength and relief in a posterior."""

    ground: str
    correlation: float  # correlation of log strength and log relief
    degrees: float  # change of relief [degree] along the ridge that offsets twice the strength


def ridges(analysis: Back) -> Iterator[Ridge]:
    """Ridge of each ground for which both strength and relief are parameters."""
    inputs, sought = analysis.inputs, {*analysis.sought.tolist()}
    weight, first = analysis.weight, int(inputs.ends[-2])
    for i, k in enumerate(inputs.pairs):
        plane = inputs.scene.grounds[k].plane
        if plane is None or not {first + 2 * i, first + 2 * i + 1} <= sought:
            continue
        strength, relief = (analysis.members[f"{key}_{i + 1}"].to_numpy() for key in PAIR)
        spreads = np.log([inputs.given[key] for key in PAIR_FACTORS])
        scores = np.log([strength, relief]) / spreads[:, None]
        covariance = np.cov(scores, aweights=weight)
        # direction in which the posterior is widest, relative to the prior
        along = spreads * np.linalg.eigh(covariance)[1][:, -1]
        yield Ridge(
            inputs.scene.grounds[k].name,
            float(covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1])),
            float(plane.ground.relief * np.log(2) * along[1] / along[0]),
        )
