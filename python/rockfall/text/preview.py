# SPDX-License-Identifier: BSD-3-Clause
"""Preview of a case: inputs, resources, and approximate run time."""

from collections.abc import Iterator
from dataclasses import replace
from statistics import NormalDist
from typing import Any

import numpy as np

from rockfall.analysis.hazard.scenarios import base_case, scenarios_of
from rockfall.analysis.planes.neutral_slopes import NeutralSlopes, Rocks, rocks_of
from rockfall.analysis.validity.extrapolation import fractions_outside
from rockfall.analysis.validity.remarks import model_remarks
from rockfall.case import Case
from rockfall.grounds import band
from rockfall.io.coordinates.crs import crs_name
from rockfall.io.rasters.grid import row_blocks
from rockfall.limits import CORES
from rockfall.quantities import first_of, number, percent
from rockfall.result.boulders import boulders_by_shape
from rockfall.result.grounds import rebounds_by_ground, sets_followed
from rockfall.scene.ground import Ground
from rockfall.scene.rebounds.breakage import breaking_speed, split_blocks
from rockfall.scene.rebounds.coefficients import ANY_SPEED
from rockfall.scene.rebounds.kernel_rebounds import sphere_radius
from rockfall.scene.releases.sources import threshold
from rockfall.scene.scene import Scene
from rockfall.simulation.memory import machine_memory
from rockfall.simulation.pilot import PILOT_REBOUNDS, Pilot, cpu_seconds, memory, pilot_run
from rockfall.table import as_text
from rockfall.tables.run import dam_tables, stand_tables
from rockfall.text.summary import MOST_STANDS, NO_CRS

MAX_LINES = 20  # maximum number of names listed by `check`
LARGE_RESULT = 2e9  # [bytes] boulder rows larger than this are reported
MAX_ZONES = 12  # maximum number of zones listed individually
DRAWS = 101  # rock-size samples per boulder, for quantiles


def preview(scene: Scene) -> str:
    """Overview of a scene; a pilot run of some boulders gives time and statistics."""
    case = scene.case
    pilot = pilot_run(scene)
    values = pilot.values()
    rows = [
        ("terrain", _terrain(scene)),
        ("elevations", _elevations(scene.ground)),
        ("slopes", _slopes(scene.ground)),
        ("surface", _surface(scene)),
        *_grounds(values),
        *_band(scene),
        ("sizes", _sizes(pilot.density, values["volume"])),
        *_shapes(values),
        *(("", line) for line in _rocks(scene, values["volume"])),
        *_sets(scene, values),
        *_forest(scene),
        *_breakage(case, values["volume"], pilot.density),
        ("boulders", _boulders(scene)),
        *_attributes(scene),
        ("speed", _speed(scene)),
        ("lines", _lines(case)),
        ("maps", ", ".join(case.output.get("maps", [])) or "none"),
        ("memory", _memory(scene, pilot)),
        ("time", _time(scene, pilot)),
        *_scenarios(scene),
    ]
    title = f"{case.name}: {case.case['title']}".removesuffix(": ")
    warnings = [
        (
            remark.grade,
            f"in a pilot run {remark.text}" if remark.is_counted else remark.text,
        )
        for remark in model_remarks(values, case)
        if remark.is_warning
    ]
    warnings += [("note", NO_CRS)] if scene.grid.crs is None else []
    facts, warned = ([f"  {name:13}{text}" for name, text in part] for part in (rows, warnings))
    tables = (*dam_tables(scene.dams), *stand_tables(scene.stands, MOST_STANDS))
    return "\n".join([title, *facts, *map(as_text, tables), *warned])


def _lines(case: Case) -> str:
    names = [line["name"] for line in case.lines]
    more = f" ({len(names):,})" if len(names) > MAX_LINES else ""
    return ", ".join(first_of(names, MAX_LINES)) + more or "none"


def _terrain(scene: Scene) -> str:
    grid, z = scene.grid, scene.rasters.z
    crs = crs_name(grid.crs) if grid.crs else "no CRS"
    cells = f"{grid.nx} x {grid.ny} cells of {grid.cell:g} m"
    if scene.windows:
        cells += f", in windows of about {scene.windows.cells:,} cells"
    else:
        empty = sum(np.count_nonzero(np.isnan(z[rows])) for rows in row_blocks(grid.shape))
        cells += f", {empty / z.size:.1%} nodata"
    return f"{cells}, {z.dtype}, {crs}"


def _elevations(ground: Ground) -> str:
    at = np.concatenate(ground.source_z)
    terrain = f"{ground.low.value:,.1f} to {-ground.high.value:,.1f} m"
    sources = dict.fromkeys(f"{z:,.1f}" for z in (at.min(), at.max()))
    return f"{terrain}; sources: {' to '.join(sources)} m"


def _slopes(ground: Ground) -> str:
    """Quantiles of the slope angle [degree], over the terrain and at the sources."""

    def text(quantiles: np.ndarray) -> str:
        if np.isnan(quantiles).any():
            return "not known"
        low, half, high = (f"{slope:.0f}" for slope in quantiles)
        return f"{half} degrees" + (f" ({low} to {high} for 80 %)" if low != high else "")

    return f"median {text(ground.quantiles())}; sources: median {text(ground.source_quantiles())}"


def _speed(scene: Scene) -> str:
    """Upper bound of the speed [m/s]: energy conservation from highest release to lowest cell."""
    low, head = scene.ground.low.value, scene.survey().head[0]
    speed = np.sqrt(2 * scene.case.flight["gravity"] * max(0.0, head - low))
    return f"at most {speed:.0f} m/s: from the highest release to the lowest cell without a loss"


def _surface(scene: Scene) -> str:
    surface, ground = scene.case.surface, scene.ground
    how = "one value everywhere" if ground.used else "a raster of values"
    if "zones" in surface:
        how = f"{surface['zones']}: {len(ground.used)} of {len(ground.sizes)} zones used"
        if outside := scene.rasters.outside:
            how += f", {outside:,} cells ({percent(outside / ground.n_known)}) in no polygon get "
            how += f"default_zone = {surface['default_zone']}"
    return f"method {surface['method']}, {how}"


def _grounds(values: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Text on rebounds by ground in the pilot run."""
    met = [ground for ground in rebounds_by_ground(values) if ground.rebounds]
    parts = (
        f"{percent(ground.fraction)} {ground.name} ({ground.model.replace('_', ' ')})"
        for ground in met
    )
    if "ground" in values:
        yield "grounds", ", ".join(parts) + " of the rebounds of a pilot run"


def _band(scene: Scene) -> Iterator[tuple[str, str]]:
    """Command that runs the case with softer and with firmer ground everywhere."""
    names = {ground.name for ground in scene.grounds}
    others = band(names.pop()) if len(names) == 1 else ()
    if others:
        options = " ".join(f"--table {name}" for name in others)
        yield "ground band", f"rockfall models {scene.case.name} {options}"


def _boulders(scene: Scene) -> str:
    kind, release = "points", scene.case.release
    if not {"x", "points"} & release.keys():
        kind = "cells within polygons" if "polygons" in release else "cells"
    if scene.case.release["steep_cells"]:
        kind += f" of {threshold(scene.case, scene.grid):.1f} degrees or more"
    sources = f"sources: {scene.x.size:,} ({kind})"
    if "boulders_total" in scene.case.case:
        fewest, most = _released(scene)
        each = f"{fewest:,}" if fewest == most else f"{fewest:,} to {most:,}"
        by = "" if scene.weight is None else ", by " + weighing(scene)
        return f"{scene.boulders:,} from all sources together, {each} from each{by}; {sources}"
    place = "each source" if scene.area is None else "a flat cell, more by area"
    return f"{scene.boulders:,}, {scene.case.case['boulders']:,} from {place}; {sources}"


def weighing(scene: Scene) -> str:
    """Quantity in proportion to which the sources release boulders."""
    return "true surface area" if scene.frequency is None else "frequency"


def _released(scene: Scene) -> tuple[int, int]:
    """Minimum and maximum number of boulders that a source releases."""
    numbers = scene.sources_of(np.arange(1, scene.boulders + 1))
    counts = np.bincount(numbers, minlength=scene.x.size)
    return int(counts.min()), int(counts.max())


def _attributes(scene: Scene) -> Iterator[tuple[str, str]]:
    """Text on the release attributes of a layer."""
    features = scene.features
    if features is not None and features.law is not None and features.value is not None:
        given = ~np.isnan(features.value).all(axis=0)
        attrs = {"density": given[4], "drop height": given[5], "velocity": given[6:].any()}
        what = ["volumes"] * bool(features.law.any()) + [name for name, has in attrs.items() if has]
        names = ", ".join(dict.fromkeys(features.names[:4])) + (
            " ..." if len(features.names) > 4 else ""
        )
        if what:
            text = f"their layer gives {', '.join(what)}; {len(features.names):,} features: {names}"
            yield "", text


def _sizes(density: np.ndarray, volumes: np.ndarray) -> str:
    radii = sphere_radius(volumes)
    masses = density * volumes
    return (
        f"R_b {_range(radii.min(), radii.max())} m, volume "
        f"{_range(volumes.min(), volumes.max())} m3, mass {_range(masses.min(), masses.max())} kg"
    )


def _shapes(values: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Text on the block shapes of the pilot boulders, in a case with several shapes."""
    if shapes := boulders_by_shape(values):
        yield "shapes", ", ".join(f"{percent(own.mean())} {name}" for name, own in shapes.items())


def _sets(scene: Scene, values: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Text on impact sets: names, fitted ranges, and rebounds outside these ranges, or a note."""
    name = scene.case.impact["sets"]
    if name not in sets_followed(values, name):
        yield "impact sets", f"{name}, not used by any rebound of a pilot run"
        return
    speeds, angles = scene.coefficients.speed_range, scene.coefficients.angle_range
    ranges = []
    if speeds.max() < ANY_SPEED:
        ranges.append(f"{_range(speeds.min(), speeds.max())} m/s")
    if angles.min() > 0 or angles.max() < 90:
        ranges.append(f"{_range(angles.min(), angles.max())} degrees")
    fitted_on = " and ".join(ranges) or "speeds and angles that it does not state"
    yield "impact sets", f"{name}, fitted on {fitted_on}"
    outside = fractions_outside(values)
    yield (
        "rebounds",
        f"outside the fitted range of the set: {outside['range']:.1%} by R_b/R_m, "
        f"{outside['speed']:.1%} by speed, {outside['angle']:.1%} by angle, in a pilot run",
    )


def _forest(scene: Scene) -> list[tuple[str, str]]:
    """Description of the trees; empty without trees."""
    trees = scene.trees
    if trees is None:
        return []
    n, area = trees.x.size, sum(stand.area for stand in scene.stands) or trees.area()
    text = (
        f"{n:,} stems on {area:.3g} ha, {n / area:,.0f} per hectare, mean DBH "
        f"{trees.dbh.mean():.1f} cm, basal area {trees.basal_area() / area:.3g} m2/ha"
    )
    return [("forest", text)]


def _rocks(scene: Scene, volumes: np.ndarray) -> list[str]:
    """Text on rocks: R_m, R_b/R_m and the neutral slope of each zone, or of the smallest, median
    and largest rocks.

    Values are for the mean volume; the 5 and 95 % quantiles follow in brackets if these volumes
    use other sets. Boulders are relatively larger on smaller rocks."""
    grounds, neutral = list(rocks_of(scene)), NeutralSlopes(scene)
    if sigma := scene.case.boulder["mean_radius_sigma"]:
        deviates = [NormalDist(sigma=sigma).inv_cdf((k + 0.5) / DRAWS) for k in range(DRAWS)]
        spread = np.outer(volumes, np.exp(3 * np.array(deviates)))
    else:
        spread = volumes
    mean, *ends = sphere_radius(np.array([volumes.mean(), *np.quantile(spread, [0.05, 0.95])]))
    lines = [_ground(ground, neutral, mean, ends) for ground in grounds[:MAX_ZONES]]
    more = len(grounds) - len(lines)
    return [*lines, f"and {more} more zones"] if more else lines


def _ground(rocks: Rocks, neutral: NeutralSlopes, mean: float, ends: list[float]) -> str:
    name, radii = f"{rocks.name}: " if rocks.name else "", rocks.radii[np.isfinite(rocks.radii)]
    if not radii.size:
        return f"{name}absorbs"
    served = [neutral.classes(radius, radii) for radius in ends]
    cases = [mean] if served[0] == served[1] else [mean, *ends]
    slopes = [neutral.of(radius, rocks.radii) for radius in cases]
    columns = (
        [_range(radius / radii.max(), radius / radii.min()) for radius in cases],
        [f"{slope:.0f}" for slope in slopes],
        [f"{rocks.steeper(slope):.0%}" for slope in slopes],
    )
    ratio, slope, steeper = (
        column[0] + (f" ({column[1]} to {column[2]})" if len(set(column)) > 1 else "")
        for column in columns
    )
    cells = f", {steeper} of cells steeper" if rocks.tangents.size else ""
    return (
        f"{name}R_m {_range(radii.min(), radii.max())} m, R_b/R_m {ratio}; neutral slope {slope} "
        f"degrees{cells}"
    )


def _range(low: float, high: float) -> str:
    texts = (f"{float(f'{value:.3g}'):,.10g}" for value in (low, high))
    return " to ".join(dict.fromkeys(texts))


def _memory(scene: Scene, pilot: Pilot) -> str:
    need = memory(scene, pilot)
    made, file = need.pop("made"), need.pop("file")
    # rasters are freed before maps are allocated
    total = sum(need.values()) + max(0, made - need["rasters"])
    parts = ", ".join(f"{name} {_bytes(size)}" for name, size in need.items() if size)
    warning = ", more than this machine has" if total > machine_memory() else ""
    if file > LARGE_RESULT:
        warning += (
            f"; the result file takes {_bytes(file)}: &output kept = 'none' keeps sums and counts"
        )
    return f"about {_bytes(total)} ({parts}){warning}"


def _bytes(number: float) -> str:
    return f"{number / 1e9:.1f} GB" if number >= 1e9 else f"{max(1, number / 1e6):.0f} MB"


def _breakage(case: Case, volumes: np.ndarray, density: np.ndarray) -> list[tuple[str, str]]:
    """Lines (label and text) on the impacts that break boulders of the median volume [m3] and
    density [kg/m3], and on the fragments; empty if boulders do not break."""
    at = case.breakage["at"]
    if at == "none":
        return []
    volume = float(np.median(volumes))
    dense = float(np.median(density))
    rows = []
    if at != "impact":
        fall = case.breakage["release_fall"]
        energy = dense * volume * case.flight["gravity"] * fall
        rows.append(f"at release by a fall of {fall:g} m, {_split_outcome(case, volume, energy)}")
    if at != "release":
        speed = breaking_speed(case, volume, dense)
        if np.isfinite(speed):
            outcome = _split_outcome(case, volume, 0.5 * dense * volume * speed**2)
            rows.append(f"at impacts above {speed:.3g} m/s normal to the ground, {outcome}")
        else:
            rows.append(f"at impacts: a block of {volume:.3g} m3 is too small to break")
    return [("breakage" if not k else "", row) for k, row in enumerate(rows)]


def _split_outcome(case: Case, volume: float, energy: float) -> str:
    split = split_blocks(case, np.array([volume]), np.array([energy]))
    block, ratio = f"a block of {volume:.3g} m3", f"area ratio {split.area_ratio[0]:.2f}"
    largest = split.volumes[0, 0]
    if largest == volume:
        return f"{block} stays whole: {ratio}"
    return (
        f"{block} breaks into {np.count_nonzero(split.volumes)} fragments, the largest "
        f"{largest:.3g} m3, and {split.fines[0]:.2g} m3 of fines: {ratio}"
    )


def _time(scene: Scene, pilot: Pilot) -> str:
    of_cpu, wall = cpu_seconds(scene, pilot)
    cores = scene.case.case["threads"] or CORES
    return (
        f"about {_duration(of_cpu)} of CPU, {_duration(wall)} on {cores} cores (estimated from "
        f"{pilot.tally.done:,} boulders)"
    )


def _scenarios(scene: Scene) -> Iterator[tuple[str, str]]:
    """Text on the scenarios: releases per year, volumes in pilot runs, and time of a hazard."""
    if not scene.case.scenario:
        return
    own = replace(scene, case=base_case(scene.case))
    scenarios = scenarios_of(own, own.case.line)
    scenes = [replace(own, case=scenario.case) for scenario in scenarios]
    pilots = [pilot_run(each, PILOT_REBOUNDS // len(scenes)) for each in scenes]
    volumes = np.concatenate([pilot.values()["volume"] for pilot in pilots])
    of_cpu = sum(cpu_seconds(each, pilot)[0] for each, pilot in zip(scenes, pilots, strict=True))
    yearly = number(sum(scenario.frequency for scenario in scenarios))
    yield (
        "scenarios",
        f"{len(scenarios)}, {yearly} boulders per year, volume "
        f"{_range(volumes.min(), volumes.max())} m3; rockfall hazard takes about "
        f"{_duration(of_cpu)} of CPU, a dossier up to twice that for each variant",
    )


def _duration(seconds: float) -> str:
    for size, unit in ((86400, "days"), (3600, "h"), (60, "min")):
        if seconds >= 1.5 * size:
            return f"{seconds / size:.1f} {unit}"
    return f"{seconds:.1f} s"
