# SPDX-License-Identifier: BSD-3-Clause
"""Release frequency of a hazard scenario."""

from collections.abc import Mapping
from typing import Any


def stated_frequency(scenario: Mapping[str, Any], boulder: Mapping[str, Any]) -> float:
    """Boulders per year for each unit of `frequency_per`. An activity counts boulders larger than
    1 m3; it is converted by the power-law distribution between the volume limits of the scenario,
    or of &boulder (Hungr et al. 1999)."""
    if "frequency" in scenario:
        return float(scenario["frequency"])
    if "return_period" in scenario:
        return 1 / float(scenario["return_period"])
    volumes = {**boulder, **scenario}
    above_min, above_max = (
        volumes[f"volume_{end}"] ** -volumes["volume_exponent"] for end in ("min", "max")
    )
    return float(scenario["activity"] * (above_min - above_max))
