# SPDX-License-Identifier: BSD-3-Clause
"""Checks for invalid elevations or units, and for projections that distort lengths."""

import math
from collections.abc import Iterator

import numpy as np

from rockfall.case import FROM_ARRAY
from rockfall.io.coordinates.crs import crs_name, length_scale
from rockfall.io.input_warnings import InputWarning
from rockfall.language import Number, Text, say
from rockfall.scene.ground import LOWEST_LAND
from rockfall.scene.scene import Scene

LOW, HIGH = -9000.0, 9000.0  # elevations [m] below the deepest sea slopes, above Everest
GAP = 300.0  # [m] gap between the lowest and the next elevation; no terrain has one this large
USUAL = (0.0, -1.0, -99.0, -999.0, -9999.0)  # common nodata values
USUAL_GAP = 20.0  # [m] gap for these values; lakes and seas have shores
MOST = 0.5  # maximum fraction of cells for these values; a plain at 0 m may cover more
FULL_CIRCLE = (-180.0, 360.0, -90.0, 90.0)  # [degree] west, east, south, north
SMALL_CELL = 0.1  # [degree] 11 km
WALL = 50.0  # tangent of 89 degrees; only coordinates in degrees give such a mean slope
STEEP = 60.0  # [degree] maximum median slope; 28 degrees become this if elevations are in feet
#: [degree] Median and 90 % quantile of slopes: hardly any 500 m of the Alps reach them, but
#: mountains of 21 and 37 degrees do if their elevations are in feet.
FEET = (52.0, 68.0)
SCALE = 0.03  # maximum scale error; national projections have less
STEPS = 0.05  # minimum fraction of places with bends in integer elevations that are rounded
FINE = (0.2, 2.5)  # [m] coarser cells follow the slope; finer cells come from a laboratory
#: [degree] Turns this large between cells, on a slope of 34 degrees, reduce the number of boulders
#: that pass the gentle ground below by 8 to 36 % (matrix) or 21 to 60 % (tables).
ROUGH = 8.0
STEP_SLOPE = 2.0  # [degree] maximum slope error of a 1 m step; larger than survey errors


def dem_rules(scene: Scene) -> Iterator[InputWarning]:
    """Warnings about the terrain model."""
    file = scene.case.terrain["dem"]
    where = "&terrain dem" if file == FROM_ARRAY else f"&terrain dem = '{file}'"
    for rule in _nodata, _low, _spikes, _units, _projection, _steps, _rough:
        yield from (InputWarning(where, text) for text in rule(scene))


def _nodata(scene: Scene) -> Iterator[Text]:
    """Warnings on undeclared nodata values, and on elevations above Everest."""
    ground = scene.ground
    ends = (
        (ground.low, 1, LOW, "input.elevation_below"),
        (ground.high, -1, -HIGH, "input.elevation_above"),
    )
    for extreme, sign, limit, key in ends:
        value, apart = sign * extreme.value, extreme.next - extreme.value
        is_usual = sign > 0 and value in USUAL and extreme.count < MOST * ground.n_known
        gap = USUAL_GAP if is_usual else GAP
        if sign < 0 and extreme.value <= limit and apart <= gap:
            yield say("input.too_high", highest=value)
            continue
        if extreme.value <= limit or (extreme.count > 1 and gap < apart < math.inf):
            key = "input.elevation_everywhere" if math.isinf(apart) else key
            yield say(key, value=value, n=extreme.count, apart=apart)


def _low(scene: Scene) -> Iterator[Text]:
    """Warning on elevations below all land but above nodata, as resampling near voids produces."""
    low, deep = scene.ground.low, scene.ground.deep
    if LOW < low.value < LOWEST_LAND and not (low.count == deep and low.next - low.value > GAP):
        yield say("input.too_low", n=deep, land=LOWEST_LAND, lowest=low.value)


def _spikes(scene: Scene) -> Iterator[Text]:
    """Warning on single cells far above or below all neighbours, unless they are reported as
    nodata."""
    ground = scene.ground
    if not ground.spikes or ground.low.value < LOWEST_LAND or -ground.high.value >= HIGH:
        return
    x, y, apart = ground.spike
    yield say("input.spikes", n=ground.spikes, x=x, y=y, apart=apart)


def _units(scene: Scene) -> Iterator[Text]:
    """Warning on degrees or feet that are not declared."""
    grid, (_, half, steep) = scene.grid, scene.ground.quantiles()
    west, east, south, north = FULL_CIRCLE
    inside = grid.west >= west and grid.east <= east and grid.south >= south and grid.north <= north
    if grid.crs is None and grid.cell < SMALL_CELL and inside and half > _degrees(WALL):
        cell = np.format_float_positional(grid.cell, 3, fractional=False, trim="-")
        ends = {"west": grid.west, "east": grid.east, "south": grid.south, "north": grid.north}
        yield say("input.degrees", cell=Number(cell), **ends)
    elif is_too_steep(half, steep):
        yield say("input.steep", half=half)


def is_too_steep(half: float, steep: float) -> bool:
    """Return True if the median and 90 % quantile of slopes [degree] are implausible."""
    return half > STEEP or (half > FEET[0] and steep > FEET[1])


def _degrees(tangent: float) -> float:
    return math.degrees(math.atan(tangent))


def _projection(scene: Scene) -> Iterator[Text]:
    scale = length_scale(scene.grid)
    if abs(scale - 1) > SCALE:
        yield say("input.projection", crs=crs_name(scene.grid.crs), scale=scale)


def _steps(scene: Scene) -> Iterator[Text]:
    ground, slope = scene.ground, _degrees(1 / scene.grid.cell)
    if ground.integers and slope > STEP_SLOPE and ground.steps > STEPS * ground.spans:
        yield say("input.steps", slope=slope)


def _rough(scene: Scene) -> Iterator[Text]:
    """Warning on fine cells with noise, or with rocks that R_m and the tables already represent."""
    cell = scene.grid.cell
    if FINE[0] <= cell <= FINE[1] and (angle := scene.ground.roughness()) > ROUGH:
        yield say("input.rough", angle=angle, metres=2 * cell)
