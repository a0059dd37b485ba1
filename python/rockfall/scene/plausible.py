# SPDX-License-Identifier: BSD-3-Clause
"""What a scene may have, but hardly ever means: a line for each, which says what it would mean.

What is impossible is refused where it is read. The limits are far from what is usual: a warning of
a sound scene does harm, too.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator

import numpy as np

from rockfall.case import FROM_ARRAY
from rockfall.io.crs import crs_name, length_scale
from rockfall.scene.rebound import sphere_radius
from rockfall.scene.scene import Scene, lines_outside
from rockfall.scene.sources.attributes import values_of
from rockfall.scene.surface import radius_over_rg

LOW, HIGH = -9000.0, 9000.0  # elevations [m]: far below any land, above Everest
GAP = 300.0  # [m] from the lowest elevation to the next: no terrain leaves out so much
FULL_CIRCLE = (-180.0, 360.0, -90.0, 90.0)  # west, east, south, north of degrees
SMALL_CELL = 0.1  # of degrees: 11 km
WALL = 50.0  # tangent of a slope (89 degrees) that terrain in degrees has, and no other on average
STEEP = 60.0  # [degree] half of no terrain is steeper; elevations in feet turn 28 degrees into it
SCALE = 0.03  # by which lengths of a projection may be off: within its own country none is
STEPS = 0.05  # of places where whole metres bend to and fro: rounded slopes, not round numbers
STEP_SLOPE = 2.0  # [degree] that a step of 1 m may turn a cell by: more than slopes are known to
NO_DATA = (127, 255, 32767, 65535, 2147483647)  # the largest integers that rasters hold
DENSITY = (1000.0, 4000.0)  # [kg/m3] tuff with pores, ores
GRAVITY = (1.0, 25.0)  # [m/s2] the Moon, Jupiter
DROP = 50.0  # [m] a boulder that falls so far in the air has its source there
SPEED = 50.0  # [m/s] of a release
VOLUME = 5000.0  # [m3] more than single boulders that are known to have rolled
RADIUS = 3.0  # [m] mean radius of the rocks on a slope
DBH = (4.0, 150.0)  # [cm] mean diameters of stands
DENSE = 20_000.0  # stems a hectare: thickets
RG_FULL = 100.0  # [m] an Rg of Rockyfor3D that means water


def implausible(scene: Scene) -> list[str]:
    """A line for each thing that is likely a mistake."""
    return [f"{scene.case.name}: {line}" for rule in RULES for line in rule(scene)]


def warn_of(scene: Scene) -> None:
    """The lines as warnings of Python, to the caller of the caller."""
    for line in implausible(scene):
        warnings.warn(line, stacklevel=3)


def _dem(scene: Scene) -> str:
    file = scene.case.terrain["dem"]
    return "&terrain dem" if file == FROM_ARRAY else f"&terrain dem = '{file}'"


def _nodata(scene: Scene) -> Iterator[str]:
    """Nodata that the file does not declare."""
    ground = scene.ground
    ends = (ground.low, 1, LOW, "below"), (ground.high, -1, -HIGH, "above")
    for found, sign, limit, word in ends:
        value, apart = sign * found.value, found.next - found.value
        if found.value <= limit or (found.count > 1 and GAP < apart < math.inf):
            where = "" if math.isinf(apart) else f", {apart:,.0f} m {word} all others"
            yield (
                f"{_dem(scene)}: elevation {value:.6g} m in {found.count:,} cells{where}: is it "
                "a nodata value that the file does not declare?"
            )


def _units(scene: Scene) -> Iterator[str]:
    """Degrees or feet of which nothing tells."""
    grid, (_, half, _) = scene.grid, scene.ground.quantiles()
    west, east, south, north = FULL_CIRCLE
    inside = grid.west >= west and grid.east <= east and grid.south >= south and grid.north <= north
    if grid.crs is None and grid.cell < SMALL_CELL and inside and half > _degrees(WALL):
        yield (
            f"{_dem(scene)}: cells of {grid.cell:g} between x {grid.west:g} and {grid.east:g}, "
            f"y {grid.south:g} and {grid.north:g} look like degrees: metres are needed"
        )
    elif half > STEEP:
        yield (
            f"{_dem(scene)}: half of the terrain is steeper than {half:.0f} degrees: are its "
            "elevations in metres, as its cells are?"
        )


def _degrees(tangent: float) -> float:
    return math.degrees(math.atan(tangent))


def _projection(scene: Scene) -> Iterator[str]:
    scale = length_scale(scene.grid)
    if abs(scale - 1) > SCALE:
        yield (
            f"{_dem(scene)}: {crs_name(scene.grid.crs)} draws lengths {scale:.2f} times as long as "
            "they are here, elevations not: slopes are wrong; reproject to UTM or the country's "
            "own system"
        )


def _steps(scene: Scene) -> Iterator[str]:
    ground, slope = scene.ground, _degrees(1 / scene.grid.cell)
    if ground.integers and slope > STEP_SLOPE and ground.steps > STEPS * ground.spans:
        yield (
            f"{_dem(scene)}: elevations are whole metres: the ground is made of steps, which "
            f"turn slopes by up to {slope:.0f} degrees"
        )


def _source_cells(scene: Scene) -> Iterator[str]:
    release, values = scene.case.release, scene.source_values
    if "cells" not in release:
        return
    about, top = f"&release cells = '{release['cells']}'", -int(values.value)
    if top in NO_DATA and values.next < math.inf:
        yield (
            f"{about}: {top} in {values.count:,} cells, which makes them sources: is it a nodata "
            "value that the file does not declare?"
        )
    elif scene.x.size == scene.ground.known and not release["steep_cells"]:
        yield (
            f"{about}: every cell of the terrain is a source: is {top} a nodata value that the "
            "file does not declare?"
        )


def _source_points(scene: Scene) -> Iterator[str]:
    if "x" not in scene.case.release:
        return
    places, counts = np.unique([scene.x, scene.y], axis=1, return_counts=True)
    k = int(np.argmax(counts))
    if counts[k] > 1:
        more = np.count_nonzero(counts > 1) - 1
        also = f", {more} more several times" if more else ""
        yield (
            f"&release x, y: the source ({places[0, k]:.12g}, {places[1, k]:.12g}) is given "
            f"{counts[k]} times{also}: it releases as many times the boulders"
        )


def _release(scene: Scene) -> Iterator[str]:
    release = scene.case.release
    drop, speed = release["drop_height"], math.hypot(*release["velocity"])
    if (values := values_of(scene)) is not None:
        drop, speed = values[:, 1].max(), np.linalg.norm(values[:, 2:], axis=1).max()
    if not drop and not speed:
        yield "&release has no drop_height and no velocity: boulders stop where they start"
    if drop > DROP:
        yield (
            f"&release drop_height = {drop:g}: boulders start {drop:g} m above the ground: was it "
            "meant in cm, or as an elevation?"
        )
    if speed > SPEED:
        yield f"&release velocity: {speed:g} m/s, {3.6 * speed:,.0f} km/h: was it meant in km/h?"


def _boulders(scene: Scene) -> Iterator[str]:
    boulder, gravity = scene.case.boulder, scene.case.flight["gravity"]
    told, values = scene.source_boulders, values_of(scene)
    if told is None or told.density is None:
        densities = np.array([boulder["density"]]) if values is None else values[:, 0]
        for density in dict.fromkeys((densities.min(), densities.max())):
            yield from _density("density = {:g} kg/m3", density)
    else:
        for density in dict.fromkeys((told.density.min(), told.density.max())):
            yield from _density("rock_density: {:g} kg/m3 at a source", density)
    sizes = {key: boulder.get(key) for key in ("volume_mean", "volume_max", "volumes")}
    for key, value in sizes.items():
        if value is not None and np.max(value) > VOLUME:
            largest = np.max(value)
            yield (
                f"&boulder {key} = {largest:g} m3: a boulder {2 * sphere_radius(largest):.0f} m "
                "across: was it meant in dm3?"
            )
    if not GRAVITY[0] <= gravity <= GRAVITY[1]:
        unit = "; was it meant in cm/s2?" if 900 < gravity < 1000 else ""
        yield f"&flight gravity = {gravity:g} m/s2: the Earth has 9.81{unit}"


def _density(about: str, density: float) -> Iterator[str]:
    if not DENSITY[0] <= density <= DENSITY[1]:
        unit = "; was it meant in t/m3?" if 1 <= density <= 4 else ""
        yield f"&boulder {about.format(density)}: rocks have 2000 to 3200{unit}"


def _rocks(scene: Scene) -> Iterator[str]:
    """Sizes of the rocks on the slope, far beyond those of slopes."""
    ground, surface = scene.ground, scene.case.surface
    limit = RADIUS
    if surface["method"] == "A":
        limit /= radius_over_rg(scene.case)
    largest = ground.largest
    if ground.used:
        sizes = ground.sizes[sorted(ground.used)]
        usual = np.isfinite(sizes) & (sizes != RG_FULL)
        largest = np.max(sizes, initial=0.0, where=usual)
    if largest > limit and (surface["method"] == "B" or largest != RG_FULL):
        what = "obstacles" if surface["method"] == "A" else "a mean radius"
        yield (
            f"&surface: {what} of {largest:g} m: the ground is made of rocks of that size; was it "
            "meant in cm?"
        )


def _forest(scene: Scene) -> Iterator[str]:
    """Diameters and densities in other units."""
    if scene.trees is None:
        return
    dbh, density = float(scene.trees.dbh.mean()), scene.trees.x.size / scene.trees.area()
    if not DBH[0] <= dbh <= DBH[1]:
        unit = "m" if dbh < DBH[0] else "mm"
        yield f"&forest: a mean diameter of {dbh:.3g} cm: was it meant in {unit}?"
    if density > DENSE:
        yield f"&forest: {density:,.0f} stems a hectare: were they meant for each cell?"


def _lines(scene: Scene) -> Iterator[str]:
    barriers = {one["name"] for one in scene.case.barrier}
    for name in lines_outside(scene):
        group = "barrier" if name in barriers else "line"
        yield f"&{group} name = '{name}': no part of it lies over the terrain"


def _read(scene: Scene) -> Iterator[str]:
    yield from scene.remarks


RULES = (
    _lines, _release, _nodata, _units, _projection, _steps, _source_cells, _source_points,
    _boulders, _rocks, _forest, _read,
)  # fmt: skip
