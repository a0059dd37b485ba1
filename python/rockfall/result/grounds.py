# SPDX-License-Identifier: BSD-3-Clause
"""Rebounds of a result by ground, for scenes with several grounds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rockfall.grounds import ABSORBS, IMPACT_SETS, TABLES
from rockfall.language import Text, say, speaking, word
from rockfall.version import __version__

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import ArrayLike

    from rockfall.result.contents import Held

    Variables = Held | Mapping[str, ArrayLike]


class GroundRebounds(NamedTuple):
    """Number of rebounds on a ground, and the fraction of all rebounds."""

    name: str
    model: str
    rebounds: int
    fraction: float
    block_radius: float  # R_b [m] of the largest blocks in its impact table; NaN if unknown


def rebounds_by_ground(values: Variables) -> list[GroundRebounds]:
    """Rebounds by ground, in scene order; empty if there are only the case's impact sets."""
    if "rebounds_by_ground" not in values:
        return []
    names, models, counts = (
        np.asarray(values[name]) for name in ("ground", "ground_model", "rebounds_by_ground")
    )
    radii = np.full(len(names), np.nan)
    if "ground_block_radius" in values:  # a hazard has none
        radii = np.asarray(values["ground_block_radius"])
    total = max(1, int(counts.sum()))
    return [
        GroundRebounds(str(name), str(model), int(count), int(count) / total, float(radius))
        for name, model, count, radius in zip(names, models, counts, radii, strict=True)
    ]


def source_text(values: Variables) -> str:
    """Program and rebound models of a run, in English, for the result file."""
    with speaking("en"):
        return f"rockfall {__version__}, {_models(values)}"


def program_text(data: xr.Dataset) -> str:
    """Program and rebound models of a result or hazard, in the language of a report."""
    program, _, _ = str(data.attrs["source"]).partition(", ")
    return f"{program}, {_models(data)}"


def _models(values: Variables) -> Text:
    """Names of a run's rebound models: stochastic, impact tables, and classical models."""
    grounds = rebounds_by_ground(values)
    followed = {ground.model for ground in grounds if ground.rebounds}
    parts = []
    if IMPACT_SETS in followed or not grounds:
        parts.append(say("tables.stochastic_model"))
    if followed.intersection(TABLES):
        parts.append(say("tables.impact_tables"))
    if classical := dict.fromkeys(ground.model for ground in classical_grounds(values)):
        parts.append(say("tables.classical_models", models=[*map(word, classical)]))
    return say("model.several", parts=parts or [say("tables.no_rebounds")])


def stochastic_fraction(values: Variables) -> float:
    """Fraction of the rebounds from impact sets or impact tables."""
    grounds = rebounds_by_ground(values)
    if not grounds:
        return 1.0
    return sum(ground.fraction for ground in grounds if ground.model in (IMPACT_SETS, *TABLES))


def classical_grounds(values: Variables) -> list[GroundRebounds]:
    """Grounds with classical models on which boulders rebounded, most frequent first."""
    grounds = [
        ground
        for ground in rebounds_by_ground(values)
        if ground.rebounds and ground.model not in (IMPACT_SETS, ABSORBS, *TABLES)
    ]
    return sorted(grounds, key=lambda ground: -ground.rebounds)


def table_grounds(values: Variables) -> list[GroundRebounds]:
    """Grounds with impact tables on which boulders rebounded."""
    return [rule for rule in rebounds_by_ground(values) if rule.rebounds and rule.model in TABLES]


def sets_followed(values: Variables, case_set: str) -> list[str]:
    """Names of impact sets used for rebounds; `case_set` is the impact set of the case."""
    if "rebounds_by_ground" not in values:
        return [case_set]
    grounds = rebounds_by_ground(values)
    return [ground.name for ground in grounds if ground.rebounds and ground.model == IMPACT_SETS]
