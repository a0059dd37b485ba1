# SPDX-License-Identifier: BSD-3-Clause
"""Nets, walls and dams, hazard classes and uncertain inputs in units other than those of the
keys."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from rockfall.scene.frequencies import stated_frequency
from rockfall.scene.scene import InputWarning, Scene
from rockfall.terrain.dams import FINE, DamShape, finer

NET = 15.0  # [m] nets are up to 10 m high, walls hardly higher
CAPACITY = 20_000.0  # [kJ] twice the capacity of the strongest tested nets
DAM = 30.0  # [m] rockfall dams are up to about 25 m high
FLAT = 15.0  # [degree] no dam face is flatter; a height-to-width ratio is a small number
LOWERED = 0.8  # fraction of the requested height: a lower crest has another cause
THRESHOLD = 10_000.0  # [kJ] above all intensity thresholds and all nets
PERIOD = 1.0  # [year] shorter return periods are not hazard classes; frequencies are below 1
FREQUENCY = {"year": 20.0, "source": 1.0, "km2": 10_000.0, "m": 1.0}  # [1/year] one boulder per
#: class every few weeks, from one place every year, from a metre of cliff every year


def protection_rules(scene: Scene) -> Iterator[InputWarning]:
    """Warnings about protection, and about the inputs of `hazard` and `ensemble`."""
    yield from _barriers(scene)
    yield from dam_rules(scene.dams, scene.grid.cell)
    for rule in _hazard, _scenarios, _ensemble:
        yield from rule(scene)


def _barriers(scene: Scene) -> Iterator[InputWarning]:
    for one in scene.case.barrier:
        where = f"&barrier name = '{one['name']}'"
        if one.get("height", 0.0) > NET:
            yield InputWarning(
                where,
                f"height = {one['height']:g} m: nets are up to 10 m high; was it meant in cm?",
            )
        if one.get("capacity", 0.0) > CAPACITY:
            yield InputWarning(
                where,
                f"capacity = {one['capacity']:,.0f} kJ: the strongest nets take 10,000 kJ; was it "
                "meant in J?",
            )


def dam_rules(dams: Iterable[DamShape], cell: float) -> Iterator[InputWarning]:
    """Warnings about dams as rasterised."""
    for number, one in enumerate(dams, start=1):
        asked, _, slope = one.requested
        where = f"&dam {number}, height = {asked:g}, slope = {slope:g}"
        if one.face_cells < FINE:
            yield InputWarning(
                where,
                f"its face is {one.face:.2g} m wide, {one.face_cells:.2g} cells of "
                f"{cell:g} m: on fewer than {FINE:g} cells boulders meet another shape, "
                "and more of them may pass; resample the terrain to cells of "
                f"{finer(one):g} m or less",
            )
        if one.height_min < LOWERED * asked:
            yield InputWarning(
                where,
                f"on the raster its crest is only {one.height_min:.2g} m high at its lowest place: "
                "cells are too coarse for its crest",
            )
        if asked > DAM:
            yield InputWarning(
                where, f"dams against rockfall are up to {DAM:g} m high: was it meant in cm?"
            )
        if slope < FLAT:
            yield InputWarning(
                where,
                f"a face of {slope:g} degrees is a ramp: was it meant as a ratio of height to "
                "width?",
            )


def _hazard(scene: Scene) -> Iterator[InputWarning]:
    hazard = scene.case.hazard
    if (largest := max(hazard["thresholds"])) > THRESHOLD:
        yield InputWarning(
            "&hazard thresholds",
            f"a threshold of {largest:,.0f} kJ: no barrier takes so much; was it meant in J?",
        )
    if (shortest := min(hazard["return_periods"])) < PERIOD:
        yield InputWarning(
            "&hazard return_periods",
            f"a return period of {shortest:g} years: was a frequency meant?",
        )


def _scenarios(scene: Scene) -> Iterator[InputWarning]:
    for one in scene.case.scenario:
        frequency = stated_frequency(one, scene.case.boulder)
        if frequency > FREQUENCY[one["frequency_per"]]:
            key = next(key for key in ("frequency", "return_period", "activity") if key in one)
            other = "return period" if key == "frequency" else "frequency"
            yield InputWarning(
                f"&scenario name = '{one['name']}' {key} = {one[key]:g}, "
                f"frequency_per = '{one['frequency_per']}'",
                f"{frequency:,g} boulders in a year: was a {other} meant?",
            )


def _ensemble(scene: Scene) -> Iterator[InputWarning]:
    error, cell = scene.case.ensemble["dem_error"], scene.grid.cell
    if error > cell:
        yield InputWarning(
            f"&ensemble dem_error = {error:g} m",
            f"elevations are less certain than a cell of {cell:g} m is wide: was it meant in cm?",
        )
