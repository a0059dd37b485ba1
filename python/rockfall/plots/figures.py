# SPDX-License-Identifier: BSD-3-Clause
"""All figures of a result, with captions: the figures of the paper for any case."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from rockfall.analysis.lines.envelopes import fewest_for
from rockfall.analysis.lines.profile import line_profile
from rockfall.analysis.lines.section import Section
from rockfall.analysis.precision.intervals import passing_percent
from rockfall.case import case_of
from rockfall.errors import RockfallError, need
from rockfall.grounds.impact_sets import set_path
from rockfall.io.atomic import atomic_folder
from rockfall.io.output_files import check_outputs
from rockfall.language import say, say_count
from rockfall.limits import MIN_FOR_MEAN
from rockfall.plots.along_figures import line_profile_figure
from rockfall.plots.left_out import LeftOut
from rockfall.plots.line_figures import DRAWN, distribution_figure, passing_figure
from rockfall.plots.map_figures import (
    MAX_TRAJECTORIES,
    Look,
    is_fraction,
    map_figure,
    map_note,
    stops_figure,
    trajectories_figure,
)
from rockfall.plots.profile_figures import profile_figure
from rockfall.plots.rebound_figures import (
    ENERGY,
    RESTITUTION,
    beside_paper,
    draw_restitution,
    histogram,
    histogram_figure,
)
from rockfall.plots.section_figure import section_figure
from rockfall.plots.studies.ensemble_figures import ranges_figure
from rockfall.plots.style import FORMATS, capital, save
from rockfall.quantities import number
from rockfall.result.crossings import line_names, most_crossed
from rockfall.result.grounds import sets_followed
from rockfall.result.maps.flat_maps import flat_maps
from rockfall.result.maps.map_labels import map_label
from rockfall.result.maps.passages import PASSED, passed_map, thin_cells
from rockfall.result.samples import has_rows, is_ensemble, simulated
from rockfall.result.trajectories import Terrain, left_terrain, lines, vertices_of
from rockfall.scene.rebounds.coefficients import open_sets
from rockfall.scene.rebounds.sets import Sets, read_sets
from rockfall.simulation.progress import add_steps

if TYPE_CHECKING:
    from matplotlib import figure

PER_FIGURE = 8  # number of lines in a figure
#: Figures of rebounds, compared with the laboratory and the paper.
LABORATORY = ("incident_energy", "incidence_angle", "restitution", "impact_set")


@dataclass(frozen=True)
class Figure:
    """A figure: file name, title, explanatory sentence, and the function `draw` that creates it."""

    name: str
    title: str
    caption: str
    draw: Callable[[], figure.Figure]


def figures(
    result: xr.Dataset,
    terrain: Terrain | None = None,
    observed: Any = None,
    look: Look | None = None,
    most_lines: int | None = None,
    left: LeftOut | None = None,
) -> list[Figure]:
    """Figures of a result, in reading order. Raises a RockfallError without boulders.

    `terrain`, from `rockfall.plots.terrain.terrain_of`, gives the relief for maps and the ground
    for profiles. `observed`, from `rockfall.analysis.observed.observations.read_observed`, adds
    summaries and samples to the distributions at lines, distances and fractions to the passing
    curve, and stopping places to the maps. `look` has class limits and a basemap. With more than
    `most_lines` lines, only those with the most passages are drawn. `left` collects figures that
    cannot be drawn because a file of the case cannot be read.
    """
    if "boulder" not in result.sizes or not simulated(result):
        raise RockfallError("figures need a result with boulders")
    result, rows = flat_maps(result), has_rows(result)
    return [
        *_trajectories(result, terrain, look),
        *(_reach(result, terrain, observed, look) if rows else ()),
        *_passages(result, terrain, observed, look),
        *(_at_lines(result, observed, most_crossed(result, most_lines)) if rows else ()),
        *_ranges(result),
        *_rebounds(result, left or LeftOut()),
        *_maps(result, terrain, look),
    ]


def write_figures(
    shown: Iterable[Figure],
    folder: str | Path,
    format: str = "png",
    inputs: Iterable[str | Path] = (),
) -> list[Path]:
    """Write figures to a folder: all or none, and never over `inputs`. Return the files. Raises a
    RockfallError for an unknown format."""
    if format not in FORMATS:
        raise RockfallError(f"format = '{format}': must be one of {', '.join(FORMATS)}")
    need("figures need", "report")
    files = {f"{figure.name}.{format}": figure.draw for figure in shown}
    inputs = list(inputs)
    add_steps(len(files))
    # Checked before drawing, which takes long.
    check_outputs([Path(folder) / name for name in files], inputs)
    with atomic_folder(folder, inputs) as part:
        for name, draw in files.items():
            save(draw(), part / name)
    return [Path(folder) / name for name in files]


def _trajectories(
    result: xr.Dataset, terrain: Terrain | None, look: Look | None
) -> Iterator[Figure]:
    """Figures of recorded trajectories (paper, Fig. 4)."""
    if not any(np.ptp(xyz, axis=1).any() for xyz in vertices_of(result, "x", "y", "z")):
        return  # none recorded, or none moved
    recorded = np.unique(result["trajectory_boulder"].values).size
    drawn, total = min(recorded, MAX_TRAJECTORIES), simulated(result)
    yield Figure(
        "trajectories",
        say("figures.trajectories_title"),
        say_count("figures.trajectories", drawn, total=total),
        lambda: trajectories_figure(result, terrain, look),
    )
    yield Figure(
        "profile",
        say("figures.profile_title"),
        say_count("figures.profile", drawn, total=total),
        lambda: profile_figure(result, terrain),
    )


def _reach(
    result: xr.Dataset, terrain: Terrain | None, observed: Any, look: Look | None
) -> Iterator[Figure]:
    """Figures of run-out distance and reach (paper, Figs 9 and 10)."""
    boulders, gone = result.sizes["boulder"], int(left_terrain(result).sum())
    yield Figure(
        "passing",
        say("figures.passing_title"),
        say_count("figures.passing_open" if gone else "figures.passing", boulders, gone=gone),
        lambda: passing_figure(result, observed),
    )
    stops = None if observed is None else observed.stops
    yield Figure(
        "stops",
        say("label.stopping_points"),
        say_count("figures.stops", boulders)
        if stops is None
        else say_count("figures.stops_and_observed", len(stops), boulders=boulders),
        lambda: stops_figure(result, terrain, stops, look),
    )


def _passages(
    result: xr.Dataset, terrain: Terrain | None, observed: Any, look: Look | None
) -> Iterator[Figure]:
    """Map of the fraction of all boulders that pass each cell."""
    boulders, stops = simulated(result), None if observed is None else observed.stops
    if name := passed_map(result):
        yield Figure(
            "pass_frequency",
            say("front.pass_frequency"),
            say_count("figures.pass_frequency", boulders)
            if stops is None
            else say_count("figures.pass_frequency_and_observed", len(stops), boulders=boulders),
            lambda: map_figure(result, name, terrain, stops, look),
        )


def _at_lines(result: xr.Dataset, observed: Any, which: list[int]) -> Iterator[Figure]:
    """Figures of distributions at evaluation lines (paper, Figs 8 and 11), several in each."""
    if not which:
        return
    passed = {}
    for k in which:
        n, *percents = passing_percent(result, k)
        limits = dict(zip(("fraction", "low", "high"), map(number, percents), strict=True))
        passed[k] = say("figures.passed", line=line_names(result)[k], n=n, **limits)
    shown = say("figures.some_lines", part=len(which), n=result.sizes["line"])
    some_ = [shown] if len(which) < result.sizes["line"] else []
    blocks = [which[k : k + PER_FIGURE] for k in range(0, len(which), PER_FIGURE)]
    for name in DRAWN:
        for page, block in enumerate(blocks, start=1):
            at = [passed[k] for k in block]
            yield Figure(
                f"line_{name}" + (f"_{page}" if len(blocks) > 1 else ""),
                say(f"at_lines.{name}_title"),
                " ".join([say(f"at_lines.{name}", lines=at), *some_]),
                partial(distribution_figure, result, name, observed, block),
            )
    for k in which:
        name = line_names(result)[k]
        if result["row_size"].values[k]:
            yield Figure(
                f"along_{k + 1}",
                say("figures.along_title", line=name),
                say("figures.along"),
                partial(_along, result, name),
            )


def section_entry(section: Section) -> Figure:
    """Figure of a section along a drawn line, with a caption that explains each curve."""
    unknown, left_out = section.unknown_energies, section.not_kept
    captions = [
        say_count(
            "figures.section", section.recorded, total=section.boulders, within=section.line.within
        ),
        say("figures.section_maps" if section.has_maps else "figures.section_without_maps"),
        *([say("figures.section_lines")] if len(section.lines) else []),
        say("figures.section_blank", mean=MIN_FOR_MEAN, quantile=fewest_for(0.95)),
        *([say("figures.section_heights")] if section.lacks_heights else []),
        *([say_count("figures.section_unknown", unknown)] if unknown else []),
        *([say_count("figures.section_not_kept", left_out)] if left_out else []),
    ]
    return Figure(
        "section", say("figures.section_title"), " ".join(captions),
        partial(section_figure, section),
    )  # fmt: skip


def _along(result: xr.Dataset, line: str) -> figure.Figure:
    return line_profile_figure(line_profile(result, line))


def _ranges(result: xr.Dataset) -> Iterator[Figure]:
    if is_ensemble(result) and lines(result):
        yield Figure(
            "epistemic",
            say("figures.ranges_title"),
            say_count("figures.ranges", result.sizes["run"]),
            lambda: ranges_figure(result),
        )


def _rebounds(result: xr.Dataset, left: LeftOut) -> Iterator[Figure]:
    """Figures of all rebounds (paper, Figs 11 to 14), and of the impact set used (Fig. 5)."""
    if "incidence_angle_histogram" in result and result["incidence_angle_histogram"].any():
        n = int(result["incidence_angle_histogram"].sum())
        frequency, edges = histogram(result, "tangential_share")
        above = 100 * frequency[edges[:-1] > 0.75].sum()  # bins are 0.02 wide
        theirs = beside_paper(result)
        for name, title, what, shown in (
            ("incident_energy", say("figures.energy_title"),
             say_count("figures.energy_and_paper" if theirs else "figures.energy", n, above=above),
             ENERGY),
            ("incidence_angle", say("figures.incidence_title"), say_count("figures.incidence", n),
             ("incidence_angle",)),
            ("restitution", say("figures.restitution_title"),
             say_count("figures.restitution_and_paper" if theirs else "figures.restitution", n),
             RESTITUTION),
        ):  # fmt: skip
            yield Figure(name, title, what, partial(histogram_figure, result, *shown))
    named = str(result.attrs["impact_set"])
    followed = named in sets_followed(result, named)
    impact_set = left.attempt("page.part_set", set_of, result) if followed else None
    if impact_set is not None:
        yield Figure(
            "impact_set",
            say("figures.impact_set_title"),
            say("figures.impact_set", name=impact_set.name),
            lambda: draw_restitution([impact_set]),
        )


def set_of(result: xr.Dataset) -> Sets:
    """Impact set of a run. Raises a RockfallError if its file cannot be read or has changed."""
    path = set_path(case_of(result))
    if open_sets(path).checksum != result.attrs["impact_set_checksum"]:
        raise RockfallError(f"{path}: is not the impact set of the run (SHA-256 differs)")
    return read_sets(path)[0]


def _maps(result: xr.Dataset, terrain: Terrain | None, look: Look | None) -> Iterator[Figure]:
    """Figures of maps that other figures do not show, in the order of the result."""
    boulders = say_count("figures.in_each_cell", simulated(result))
    for name in map(str, result.data_vars):
        variable = result[name]
        if variable.dims != ("y", "x") or name in PASSED:
            continue
        title = capital(map_label(name, variable.attrs["long_name"]))
        notes = [say("map.outline") if is_fraction(name) else "", map_note(result, name)]
        notes += ["" if thin_cells(result, name) is None else say("map.hatched_there")]
        remarks = "".join(f"; {note}" for note in notes if note)
        yield Figure(
            f"map_{name}",
            title,
            f"{boulders}{remarks}.",
            partial(map_figure, result, name, terrain, look=look),
        )
