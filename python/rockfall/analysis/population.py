# SPDX-License-Identifier: BSD-3-Clause
"""Notes on the boulders behind the results of a case and its hazard."""

from __future__ import annotations

from collections.abc import Iterator

from rockfall.case import Case, keys_of
from rockfall.case.text import literal
from rockfall.language import Text, say

OF_VOLUMES = (  # keys of &boulder, except the list of volumes, which may be long
    "volume", "volume_mean", "volume_std", "volume_min", "volume_max", "volume_exponent",
)  # fmt: skip


def population_notes(case: Case, yearly: bool = False) -> Iterator[Text]:
    """Notes on the boulders behind results of a case; `yearly` means that the results cover its
    scenarios."""
    given = {key: case.boulder[key] for key in keys_of("boulder") if key in case.boulder}
    volumes = [f"{key} = {literal(value)}" for key, value in given.items() if key in OF_VOLUMES]
    yield say("variants.population", boulders=", ".join(volumes))
    if case.scenario:
        yield say("variants.of_scenarios" if yearly else "variants.other_population")


def scenario_note(case: Case) -> Iterator[Text]:
    """Note that results of the run do not cover the scenarios of the case, if there are any."""
    if case.scenario:
        yield say("variants.other_population")
