# SPDX-License-Identifier: BSD-3-Clause
"""Checks of the units of nets, walls, dams, hazard classes and uncertain inputs."""

from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

from rockfall.io.input_warnings import InputWarning
from rockfall.language import say
from rockfall.scene.releases.frequencies import stated_frequency
from rockfall.scene.scene import Scene
from rockfall.terrain.dams import FINE, DamShape, finer

NET = 15.0  # [m] nets are up to 10 m high, walls hardly higher
CAPACITY = 20_000.0  # [kJ] twice the capacity of the strongest tested nets
WEAK = 5.0  # [kJ] minimum capacity or threshold: a stone has more, values in MJ are smaller
DAM = 30.0  # [m] rockfall dams are up to about 25 m high
FLAT = 15.0  # [degree] minimum slope of a dam face; smaller: a height-to-width ratio?
LOG = 120.0  # [cm] thicker logs are not felled across slopes
CREST = 20.0  # [m] maximum crest_width
CLIFF = 10.0  # [m] maximum cliff_length
APART = 1000.0  # suspicious ratio of a frequency to the next smaller one
SHIFT = 100.0  # [m] maximum source_shift
LOWERED = 0.8  # minimum fraction of the requested crest height
THRESHOLD = 10_000.0  # [kJ] above all intensity thresholds and all nets
PERIOD = 1.0  # [year] minimum return period of hazard classes; frequencies are below 1
#: Maximum frequencies [1/year] by `frequency_per`: in total, per source, per km2, per m of cliff.
FREQUENCY = {"year": 20.0, "source": 1.0, "km2": 10_000.0, "m": 1.0}


def protection_rules(scene: Scene) -> Iterator[InputWarning]:
    """Warnings about protection measures, and about inputs of `hazard` and `ensemble`."""
    yield from _barriers(scene)
    yield from dam_rules(scene.dams, scene.grid.cell)
    for rule in _hazard, _scenarios, _unequal, _ensemble:
        yield from rule(scene)


def _barriers(scene: Scene) -> Iterator[InputWarning]:
    for barrier in scene.case.barrier:
        where = f"&barrier name = '{barrier['name']}'"
        if barrier.get("height", 0.0) > NET:
            yield InputWarning(where, say("input.net_height", height=barrier["height"]))
        if barrier.get("capacity", 0.0) > CAPACITY:
            yield InputWarning(where, say("input.net_capacity", capacity=barrier["capacity"]))
        if barrier.get("capacity", WEAK) < WEAK:
            yield InputWarning(where, say("input.weak_net", capacity=barrier["capacity"]))
        if barrier.get("diameter", 0.0) > LOG:
            text = say("input.log_diameter", diameter=barrier["diameter"])
            yield InputWarning(where, text)
    for first, other in _twins(scene.case.barrier, _place):
        yield InputWarning(f"&barrier name = '{other}'", say("input.barrier_again", name=first))


def _twins(
    members: Sequence[Mapping[str, Any]], key: Callable[[Mapping[str, Any]], Hashable]
) -> Iterator[tuple[str, str]]:
    """Pairs of names: the first member with a key, and each later member with an equal key."""
    first: dict[Hashable, str] = {}
    for member in members:
        name = first.setdefault(key(member), member["name"])
        if name != member["name"]:
            yield name, member["name"]


def _place(barrier: Mapping[str, Any]) -> Hashable:
    """Key of a barrier's position: its vertices in either direction, and its height."""
    vertices = tuple(zip(barrier["x"], barrier["y"], strict=True))
    return min(vertices, vertices[::-1]), barrier.get("height")


def _boulders(scenario: Mapping[str, Any]) -> Hashable:
    return tuple(sorted((key, repr(value)) for key, value in scenario.items() if key != "name"))


def dam_rules(dams: Iterable[DamShape], cell: float) -> Iterator[InputWarning]:
    """Warnings about dams as rasterised."""
    for number, dam in enumerate(dams, start=1):
        asked, _, slope = dam.requested
        where = f"&dam {number}, height = {asked:g}, slope = {slope:g}"
        if dam.face_cells < FINE:
            shape = {"face": dam.face, "cells": dam.face_cells, "cell": cell}
            text = say("input.dam_face", **shape, fewest=FINE, finer=finer(dam))
            yield InputWarning(where, text)
        if dam.height_min < LOWERED * asked:
            yield InputWarning(where, say("input.dam_crest", height=dam.height_min))
        if dam.requested[1] > CREST:
            text = say("input.far", most=CREST)
            yield InputWarning(f"{where}, crest_width = {dam.requested[1]:g}", text)
        if asked > DAM:
            yield InputWarning(where, say("input.dam_height", highest=DAM))
        if slope < FLAT:
            yield InputWarning(where, say("input.dam_slope", slope=slope))


def _hazard(scene: Scene) -> Iterator[InputWarning]:
    hazard = scene.case.hazard
    if (largest := max(hazard["thresholds"])) > THRESHOLD:
        yield InputWarning("&hazard thresholds", say("input.threshold", largest=largest))
    if largest < WEAK:
        yield InputWarning("&hazard thresholds", say("input.low_threshold", largest=largest))
    if (shortest := min(hazard["return_periods"])) < PERIOD:
        yield InputWarning("&hazard return_periods", say("input.return_period", shortest=shortest))
    area, cell = hazard["minimum_area"], scene.grid.cell
    if 0 < area < cell * cell:
        text = say("input.minimum_area", cell=cell * cell)
        yield InputWarning(f"&hazard minimum_area = {area:g} m2", text)


def _scenarios(scene: Scene) -> Iterator[InputWarning]:
    for scenario in scene.case.scenario:
        frequency = stated_frequency(scenario, scene.case.boulder)
        if frequency > FREQUENCY[scenario["frequency_per"]]:
            key = next(key for key in ("frequency", "return_period", "activity") if key in scenario)
            other = "input.was_return_period" if key == "frequency" else "input.was_frequency"
            yield InputWarning(
                f"&scenario name = '{scenario['name']}' {key} = {scenario[key]:g}, "
                f"frequency_per = '{scenario['frequency_per']}'",
                say(other, frequency=frequency),
            )
    for first, again in _twins(scene.case.scenario, _boulders):
        where = f"&scenario name = '{again}'"
        yield InputWarning(where, say("input.scenario_again", name=first))


def _unequal(scene: Scene) -> Iterator[InputWarning]:
    """Warnings on cliff lengths in another unit, and on a frequency far above others with the same
    `frequency_per`: perhaps a return period."""
    by_reference: dict[str, list[tuple[float, str]]] = {}
    for scenario in scene.case.scenario:
        stated = stated_frequency(scenario, scene.case.boulder), scenario["name"]
        by_reference.setdefault(scenario["frequency_per"], []).append(stated)
        around = 2 * scene.grid.cell * sum(scene.grid.shape)
        length = scenario.get("cliff_length", around)
        where = f"&scenario name = '{scenario['name']}' cliff_length = {length:g} m"
        if length < CLIFF:
            yield InputWarning(where, say("input.cliff_length"))
        if length > around:
            yield InputWarning(where, say("input.long_cliff", around=around))
    for stated_ones in by_reference.values():
        ordered = sorted(stated_ones)
        for (less, below), (more, above) in pairwise(ordered):
            if more >= APART * less:
                text = say("input.frequencies_apart", ratio=more / less, name=below)
                yield InputWarning(f"&scenario name = '{above}'", text)


def _ensemble(scene: Scene) -> Iterator[InputWarning]:
    error, cell = scene.case.ensemble["dem_error"], scene.grid.cell
    if error > cell:
        yield InputWarning(f"&ensemble dem_error = {error:g} m", say("input.dem_error", cell=cell))
    if (reach := scene.case.ensemble.get("dem_correlation", cell)) < cell / 2:
        text = say("input.dem_correlation", cell=cell)
        yield InputWarning(f"&ensemble dem_correlation = {reach:g} m", text)
    if (shift := scene.case.ensemble["source_shift"]) > SHIFT:
        text = say("input.far", most=SHIFT)
        yield InputWarning(f"&ensemble source_shift = {shift:g} m", text)
