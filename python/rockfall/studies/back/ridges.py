# SPDX-License-Identifier: BSD-3-Clause
"""Ridges of a posterior: on a slope, hard and rough ground can give the same speed and run-out as
soft and smooth ground."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from rockfall.studies.back.study import Back
from rockfall.studies.ensemble.uncertain_inputs import PAIR, PAIR_FACTORS


class Ridge(NamedTuple):
    """Trade-off between a ground's strength and relief in a posterior."""

    ground: str
    correlation: float  # correlation of log strength and log relief
    degrees: float  # change of relief along the ridge that compensates for doubling the strength


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
