# SPDX-License-Identifier: BSD-3-Clause
"""Scenarios of a case: boulder classes with runs and frequencies."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from rockfall.case import Case
from rockfall.errors import RockfallError
from rockfall.io.input_warnings import InputWarning
from rockfall.language import remark, word
from rockfall.scene.releases.frequencies import stated_frequency
from rockfall.scene.releases.source_attributes import DENSITY
from rockfall.scene.rules.plausible import input_warnings
from rockfall.scene.scene import Findings, Scene

VOLUMES = (
    "volume", "volume_mean", "volume_std", "volume_min", "volume_max", "volume_exponent",
    "volumes",
    "d1", "d2", "d3", "shape", "rock_density", "volume_spread",
)  # fmt: skip
OUTPUT: dict[str, Any] = {  # output needed for a hazard
    "maps": [
        "passages", "energy_exceeded", "hits", "hits_energy_exceeded",
        "energy_line_angle_max", "energy_line_angle_min", "travel_time_min",
    ],
    "map_extent": "terrain", "rebounds": False, "trajectories": 0,
}  # fmt: skip
KM2 = 1e6  # square metres per km2


class Scenario(NamedTuple):
    """A boulder class as its own case, with the annual number of releases."""

    name: str
    frequency: float  # total over all sources [1/year]
    case: Case


def base_case(case: Case, output: Mapping[str, Any] = OUTPUT) -> Case:
    """Case common to all scenarios, with `output`; raises a RockfallError for invalid scenarios."""
    if not case.scenario:
        raise RockfallError(
            f"{case.name}: a hazard needs a &scenario: a class of boulders with its frequency"
        )
    base = case.replace(output=dict(output))
    for scenario in case.scenario:
        _case(base, scenario)
    return base


def scenarios_of(scene: Scene, lines: list[dict[str, Any]]) -> list[Scenario]:
    """Scenarios of a scene, with `lines` in place of the case's evaluation lines."""
    case = scene.case.replace(line=lines)
    return [
        Scenario(scenario["name"], _frequency(scenario, scene), _case(case, scenario))
        for scenario in scene.case.scenario
    ]


def scenario_remarks(scene: Scene) -> Iterator[str]:
    """Remarks on properties given both by scenarios and by the source layer; raises a RockfallError
    if the layer gives such a property for all sources."""
    case = scene.case
    for what, keys, given in _of_layer(scene):
        for scenario in case.scenario:
            if not {*keys} & scenario.keys() or not given.any():
                continue
            place = f"&scenario name = '{scenario['name']}'"
            if given.all():
                raise RockfallError(
                    f"{case.name}: {place}: gives a {what}, but the layer gives it for every "
                    "source and takes precedence: remove one of the two"
                )
            attrs = {"what": word(what), "part": np.count_nonzero(given), "n": given.size}
            yield remark(case.name, "input.scenario_and_layer", place=place, **attrs)


def scenario_warnings(scene: Scene, scenarios: Sequence[Scenario]) -> list[InputWarning]:
    """Likely mistakes in a case and its scenarios (with their names), each once."""
    doubts = list(input_warnings(scene))
    for scenario in scenarios:
        case = scenario.case.replace(line=scene.case.line)  # without the outlines of objects
        own = replace(scene, case=case, findings=Findings())
        place = f"&scenario name = '{scenario.name}'"
        own_texts = {text for where, text in doubts if where.startswith(place)}
        for warning in input_warnings(own):
            is_again = warning.where.startswith("&boulder") and warning.text in own_texts
            if not is_again and warning not in doubts:
                doubts.append(warning)
    return doubts


def _of_layer(scene: Scene) -> Iterator[tuple[str, tuple[str, ...], np.ndarray]]:
    """Properties that both a source layer and a scenario may give: name, scenario keys, and a mask
    of the sources for which the layer gives the property."""
    features = scene.features
    if features is not None and features.law is not None and features.value is not None:
        yield "volume", VOLUMES, features.law[features.number - 1] > 0
        yield "density", ("density",), ~np.isnan(features.value[features.number - 1, DENSITY])


def _case(case: Case, scenario: dict[str, Any]) -> Case:
    """Case with the boulders of a scenario. The scenario's volume keys replace all volume keys of
    &boulder; its other keys replace single keys. Raises a RockfallError that names the scenario."""
    boulder: dict[str, Any] = dict.fromkeys(VOLUMES) if "volume" in scenario else {}
    boulder |= {"rock_density": None} if "density" in scenario else {}
    boulder |= {key: scenario[key] for key in (*VOLUMES, "density") if key in scenario}
    try:
        return case.replace(boulder=boulder, scenario=[])
    except RockfallError as error:
        text = f"{case.name}: &scenario name = '{scenario['name']}': "
        raise RockfallError(str(error).replace(f"{case.name}: ", text, 1)) from error


def _frequency(scenario: dict[str, Any], scene: Scene) -> float:
    """Annual number of boulders from all sources [1/year]."""
    given = stated_frequency(scenario, scene.case.boulder)
    values: dict[str, Any] = {
        "year": 1.0,
        "source": scene.x.size,
        "km2": source_area(scene) / KM2,
        "m": scenario.get("cliff_length"),
    }
    return float(given * values[scenario["frequency_per"]])


def source_area(scene: Scene) -> float:
    """Area of the source cells [m2]: surface area if cells release boulders in proportion to it,
    plan area if all cells release equally."""
    cells = scene.x.size if scene.area is None else scene.area.sum()
    return float(cells) * scene.grid.cell**2
