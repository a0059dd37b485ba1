# SPDX-License-Identifier: BSD-3-Clause
"""Checks of the units of sources, releases, boulders, rocks on the slope, and trees."""

import math
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from rockfall.case import given_groups, is_given
from rockfall.grounds import ABSORBS, TABLES, repose, usual_key
from rockfall.io.input_warnings import InputWarning
from rockfall.language import Text, say
from rockfall.quantities import percent
from rockfall.scene.ground import falls_and_rises
from rockfall.scene.rebounds.kernel_rebounds import sphere_radius
from rockfall.scene.releases.source_attributes import LAWS, MAX_AXIS_RATIO, values_of
from rockfall.scene.scene import Scene
from rockfall.scene.surface import radius_over_rg

NO_DATA = (127, 255, 32767, 65535, 2147483647)  # maxima of integer raster types
DENSITIES = (1000.0, 4000.0)  # [kg/m3] from porous tuff to ores
GRAVITIES = (1.35, 1.62, 3.71, 8.87, 9.81)  # [m/s2] Titan, Moon, Mars, Venus, Earth
LATITUDE = 0.006  # relative variation of gravity on the Earth
DROP = 50.0  # [m] maximum free fall; the source of a longer fall should be at its lower end
SPEED = 50.0  # [m/s] maximum at release
VOLUME = 150.0  # [m3] 6.6 m across; larger boulders are rare, and 0.15 m3 in litres is 150
TRUNCATED = 0.02  # maximum relative increase of a normal mean by truncation at zero
EXPONENT = 1.0  # surveys give 0.4 to 0.9, exponents of the density are 1.4 to 1.9
STOP = 5.0  # [m/s] maximum stop_speed; a boulder this fast does not stop
FLATTEST, STEEPEST = 2.0, 90.0  # [degree] limits of rest_angle; 2 rad are 115 degrees
SPREAD = 2.0  # standard deviation / mean; a larger value is probably a percentage
WIDEST = 5.0  # standard deviation / mean; larger values are refused for a normal distribution
RADIUS = 3.0  # [m] maximum mean radius of rocks on a slope
DBH = (4.0, 150.0)  # [cm] mean diameters in stands
SAPLING = 1.5  # [cm] thinner stems are not surveyed; diameters in metres are all thinner
THIN = 4.5  # [cm] stems from SAPLING to this diameter outnumber thinner stems
THICK = 250.0  # [cm] only sequoias are thicker
BASAL = 150.0  # [m2/ha] maximum basal area of European forests
CLEAR = 100.0  # [m] maximum clear_of_sources
TALL = 60.0  # [m] maximum stem_height
LOW = 2.0  # [m] minimum stem_height: boulders bounce this high, and thickets are taller
DENSE = 20_000.0  # stems per hectare in thickets
ORDERED = 0.9  # minimum fraction of places in the wrong order; half of the rows in published tables
#: [degree] On steeper ground without rocks no boulder may stop (theory, chapter 8).
SMOOTH_REST = 27.0
OF_ROCKS = "talus", "scree"  # ground names that imply rocks, although rock sizes are optional
RESTING = 0.1  # warning if boulders may wrongly rest on more than this fraction of the terrain
RG_FULL = 100.0  # [m] code for water in Rockyfor3D


def boulder_rules(scene: Scene) -> Iterator[InputWarning]:
    """Warnings about releases, boulders, rocks on the slope, and trees."""
    for rule in (
        _release, _source_cells, _source_points, _densities, _volumes, _exponents, _spreads, _stops,
        _gravity, _rocks,
        _order, _operator, _shapes, _rests, _forest,
    ):  # fmt: skip
        yield from rule(scene)


def _source_cells(scene: Scene) -> Iterator[InputWarning]:
    release, values = scene.case.release, scene.source_values
    if "cells" not in release:
        return
    where, top = f"&release cells = '{release['cells']}'", -int(values.value)
    if top in NO_DATA and values.next < math.inf:
        yield InputWarning(where, say("input.source_cells", value=top, n=values.count))
    elif scene.x.size == scene.ground.n_known and not release["steep_cells"]:
        yield InputWarning(where, say("input.all_sources", value=top))


def _source_points(scene: Scene) -> Iterator[InputWarning]:
    """Warnings on repeated points with the same boulders; different boulders may share a point."""
    release = scene.case.release
    if not {"x", "points"} & release.keys():
        return
    columns = [scene.x, scene.y]
    features = scene.features
    if features is not None and features.law is not None and features.value is not None:
        row = features.number - 1
        columns += [*np.nan_to_num(features.value[row], nan=-1.0).T, features.law[row]]
    places, counts = np.unique(columns, axis=1, return_counts=True)
    k = int(np.argmax(counts))
    if counts[k] > 1:
        more = np.count_nonzero(counts > 1) - 1
        key = "input.sources_given_again" if more else "input.source_given_again"
        points = "x, y" if "x" in release else f"points = '{release['points']}'"
        yield InputWarning(
            f"&release {points}",
            say(key, x=places[0, k], y=places[1, k], times=counts[k], more=more),
        )


def _release(scene: Scene) -> Iterator[InputWarning]:
    release = scene.case.release
    drop, speed = release["drop_height"], math.hypot(*release["velocity"])
    if (values := values_of(scene.case, scene.features)) is not None:
        drop, speed = values[:, 1].max(), np.linalg.norm(values[:, 2:], axis=1).max()
    if not drop and not speed:
        yield InputWarning("&release", say("input.no_drop"))
    if drop > DROP:
        yield InputWarning(f"&release drop_height = {drop:g}", say("input.high_drop", drop=drop))
    if speed > SPEED:
        text = say("input.fast_release", speed=speed, fast=3.6 * speed)
        yield InputWarning("&release velocity", text)


def _densities(scene: Scene) -> Iterator[InputWarning]:
    told, values = scene.source_boulders, values_of(scene.case, scene.features)
    if told is not None and told.density is not None:
        where, densities = "&boulder rock_density", told.density
    else:
        where = "&boulder density"
        densities = np.array([scene.case.boulder["density"]]) if values is None else values[:, 0]
    for density in dict.fromkeys((densities.min(), densities.max())):
        if not DENSITIES[0] <= density <= DENSITIES[1]:
            yield InputWarning(f"{where} = {density:g} kg/m3", say("input.density"))
    for scenario in scene.case.scenario:
        density = scenario.get("density", DENSITIES[0])
        if not DENSITIES[0] <= density <= DENSITIES[1]:
            where = f"&scenario name = '{scenario['name']}' density"
            yield InputWarning(f"{where} = {density:g} kg/m3", say("input.density"))


class _Volumes(NamedTuple):
    """Volume distribution of a case, scenario or feature."""

    group: str  # each group gets at most one warning
    where: str
    keys: Mapping[str, Any]


def _distributions(scene: Scene) -> Iterator[_Volumes]:
    """Volume distributions of the case, of each scenario, and of features that have their own."""
    boulder = scene.case.boulder
    yield _Volumes("", "&boulder", boulder)
    for scenario in scene.case.scenario:
        where = f"&scenario name = '{scenario['name']}'"
        yield _Volumes(where, where, {"volume": boulder["volume"]} | scenario)
    features = scene.features
    if features is None or features.law is None or features.value is None:
        return
    for name, law, row in zip(features.names, features.law, features.value, strict=True):
        if law:
            numbers = zip(("volume_mean", "volume_std", "", "volume_max"), row[:4], strict=True)
            told = {key: float(value) for key, value in numbers if key and not np.isnan(value)}
            usual = {key: boulder[key] for key in ("volume_mean", "volume_std") if key in boulder}
            keys = usual | told | {"volume": LAWS[law - 1]}
            yield _Volumes("layer", f"&release source '{name}'", keys)


def largest_volumes(scene: Scene) -> Iterator[float]:
    """Largest volume [m3] of each distribution in a scene; inf if unlimited."""
    if scene.source_boulders is not None:
        yield float(scene.source_boulders.volume.max())
    for group, _, keys in _distributions(scene):
        law = keys["volume"]
        if law == "source" or (not group and scene.case.scenario):
            continue
        usual = scene.case.boulder if group else {}
        name = {"fixed": "volume_mean", "list": "volumes", "uniform": "volume_max"}.get(law)
        name = "volume_max" if law == "pareto" else name
        yield math.inf if name is None else float(np.max(keys.get(name, usual.get(name, math.inf))))


def _volumes(scene: Scene) -> Iterator[InputWarning]:
    """Warnings about the largest volume of each key, over all features or cells."""
    largest_of: dict[str, tuple[float, str]] = {}
    for group, where, keys in _distributions(scene):
        for key in ("volume_mean", "volume_max", "volumes"):
            if (value := keys.get(key)) is not None:
                largest = float(np.max(value)), f"{where} {key} = {np.max(value):g} m3"
                largest_of[group + key] = max(largest_of.get(group + key, largest), largest)
    if scene.source_boulders is not None:
        largest = float(scene.source_boulders.volume.max())
        largest_of["sides"] = largest, f"&boulder d1, d2, d3: {largest:g} m3"
    for volume, where in largest_of.values():
        if volume > VOLUME:
            yield InputWarning(where, say("input.volume", across=2 * sphere_radius(volume)))


def _exponents(scene: Scene) -> Iterator[InputWarning]:
    """Warnings on exponents above all surveys; they probably belong to the density (1 larger)."""
    for _, where, keys in _distributions(scene):
        exponent = keys.get("volume_exponent", 0.0)
        if keys.get("volume") == "pareto" and exponent > EXPONENT:
            text = say("input.exponent", exponent=exponent - 1)
            yield InputWarning(f"{where} volume_exponent = {exponent:g}", text)


def _stops(scene: Scene) -> Iterator[InputWarning]:
    """Warnings on a stop speed or angle of rest that is probably in another unit."""
    impact = scene.case.impact
    if (speed := impact["stop_speed"]) > STOP:
        yield InputWarning(f"&impact stop_speed = {speed:g} m/s", say("input.stop_speed"))
    if (angle := impact.get("rest_angle", STEEPEST)) < FLATTEST:
        text = say("input.rest_angle", angle=math.degrees(angle))
        yield InputWarning(f"&impact rest_angle = {angle:g} degrees", text)


def _spreads(scene: Scene) -> Iterator[InputWarning]:
    """Warnings on lognormal distributions wider than a normal one may be, and on normal ones whose
    truncation at zero raises the mean (only the widest of each group)."""
    widest_of: dict[str, tuple[float, str, float, float]] = {}
    for group, where, keys in _distributions(scene):
        mean, std = keys.get("volume_mean"), keys.get("volume_std")
        law = keys.get("volume")
        if law == "lognormal" and mean and std and std > WIDEST * mean:
            text = say("input.wide_lognormal", ratio=std / mean)
            yield InputWarning(f"{where} volume_std = {std:g} m3", text)
        if law == "normal" and mean and std:
            widest = std / mean, where, mean, std
            widest_of[group] = max(widest_of.get(group, widest), widest)
    for ratio, where, mean, std in widest_of.values():
        after = truncated_mean(mean, std)
        if after > (1 + TRUNCATED) * mean:
            key = "input.spread_in_percent" if ratio >= SPREAD else "input.spread"
            text = say(key, after=after, mean=mean)
            yield InputWarning(f"{where} volume_std = {std:g} m3", text)


def truncated_mean(mean: float, std: float) -> float:
    """Mean of a normal distribution truncated at zero (Johnson, Kotz & Balakrishnan 1994)."""
    lower = mean / std
    density = math.exp(-(lower**2) / 2) / math.sqrt(2 * math.pi)
    return mean + std * density / (0.5 * math.erfc(-lower / math.sqrt(2)))


def _gravity(scene: Scene) -> Iterator[InputWarning]:
    gravity = scene.case.flight["gravity"]
    if not any(math.isclose(gravity, usual, rel_tol=LATITUDE) for usual in GRAVITIES):
        yield InputWarning(f"&flight gravity = {gravity:g} m/s2", say("input.gravity"))


def _rocks(scene: Scene) -> Iterator[InputWarning]:
    """Warnings on rock sizes far beyond those found on slopes."""
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
        key = "input.obstacles" if surface["method"] == "A" else "input.mean_radius"
        yield InputWarning("&surface", say(key, largest=largest))


def _order(scene: Scene) -> Iterator[InputWarning]:
    """Warning on Rg values that decrease from Rg70 to Rg10 nearly everywhere. Published tables have
    this order in some zones (Bourrier et al. 2009, table 1)."""
    ground = scene.ground
    if scene.case.surface["method"] == "B":
        return
    falling, rising = ground.falling, ground.rising
    if ground.used:
        falling, rising = falls_and_rises(ground.sizes[sorted(ground.used)].T)
    if falling > ORDERED * (falling + rising):
        yield InputWarning("&surface rg70, rg20, rg10", say("input.wrong_order"))


def _operator(scene: Scene) -> Iterator[InputWarning]:
    """Warning on an impact table or sets without effect, because a ground applies everywhere."""
    key = usual_key(scene.case)
    name, ground = scene.case.impact[key], scene.case.surface.get("ground", "")
    if ground not in ("", name) and is_given(scene.case, "impact", key):
        yield InputWarning(f"&impact {key} = '{name}'", say("input.no_effect", ground=ground))


def _shapes(scene: Scene) -> Iterator[InputWarning]:
    """Warnings on block shapes with fraction 0 or without effect, and on axes in mixed units."""
    given = given_groups(scene.case).get("boulder", {})
    shares = given.get("block_shape_share", [])
    if none := [given["block_shape"][k] for k, share in enumerate(shares) if not share]:
        text = say("input.no_share", names=", ".join(none))
        yield InputWarning("&boulder block_shape_share", text)
    axes = np.reshape(given.get("block_axes", [1.0, 1.0, 1.0]), (-1, 3))
    if (ratio := float((axes[:, 0] / axes[:, 2]).max())) > MAX_AXIS_RATIO:
        yield InputWarning("&boulder block_axes", say("input.axes_apart", ratio=ratio))
    if keys := [key for key in ("block_shape", "block_axes") if key in given]:
        tables = [ground for ground in scene.grounds if ground.model in TABLES]
        if all(ground.plane is None for ground in tables):
            names = ", ".join(ground.name for ground in tables)
            yield InputWarning(f"&boulder {keys[0]}", say("input.one_table", names=names))


def _rests(scene: Scene) -> Iterator[InputWarning]:
    """Warnings on ground without rocks where boulders rest as on talus, because the case sets one
    angle for all grounds, or the user's ground sets none."""
    given = scene.case.impact.get("rest_angle")
    angle = repose() if given is None else given
    smooth = [
        ground.rocks == 0
        and ground.model != ABSORBS
        and not any(rock in ground.name for rock in OF_ROCKS)
        and (given is not None or ground.rest_angle is None)
        for ground in scene.grounds
    ]
    if angle <= SMOOTH_REST or not any(smooth):
        return
    number = np.concatenate(scene.ground.numbers)
    slope = np.degrees(np.arctan(np.concatenate(scene.ground.slopes)))
    here = np.append(False, smooth)[number] & (slope > SMOOTH_REST) & (slope <= angle)
    if here.size and (fraction := float(here.mean())) > RESTING:
        attrs = {"fraction": percent(fraction), "low": SMOOTH_REST, "high": angle}
        yield InputWarning(f"&impact rest_angle = {angle:g}", say("input.rests", **attrs))


def _forest(scene: Scene) -> Iterator[InputWarning]:
    """Warnings on stem diameters and densities that are probably in other units."""
    if scene.trees is None:
        return
    diameters = scene.trees.dbh
    dbh, density = float(diameters.mean()), scene.trees.x.size / scene.trees.area()
    thin = int(np.count_nonzero(diameters < SAPLING))
    if not DBH[0] <= dbh <= DBH[1]:
        key = "input.dbh_in_m" if dbh < DBH[0] else "input.dbh_in_mm"
        yield InputWarning("&forest", say(key, dbh=dbh))
    elif "trees" in scene.case.forest and thin > np.count_nonzero(diameters < THIN) - thin:
        yield InputWarning(
            f"&forest trees = '{scene.case.forest['trees']}'",
            say("input.thin_stems", part=thin, n=diameters.size, thinnest=SAPLING),
        )
    doubts = (line.values["text"].key for line in scene.remarks if isinstance(line, Text))
    is_wide = "input.dbh_wide" in doubts
    basal = scene.trees.basal_area() / scene.trees.area()
    if density > DENSE:
        yield InputWarning("&forest", say("input.dense_stems", density=density))
    elif not is_wide and (thick := int(np.count_nonzero(diameters > THICK))):
        yield InputWarning("&forest", say("input.thick_stems", part=thick, n=diameters.size))
    elif not is_wide and basal > BASAL and dbh <= DBH[1]:
        yield InputWarning("&forest", say("input.basal_area", area=basal, most=BASAL))
    for key, most in ("clear_of_sources", CLEAR), ("stem_height", TALL):
        if (value := scene.case.forest.get(key, 0.0)) > most:
            yield InputWarning(f"&forest {key} = {value:g} m", say("input.far", most=most))
    if (height := scene.case.forest.get("stem_height", LOW)) < LOW:
        yield InputWarning(f"&forest stem_height = {height:g} m", say("input.low_stems"))
