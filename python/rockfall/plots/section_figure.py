# SPDX-License-Identifier: BSD-3-Clause
"""Figure of a section along a drawn line: profile with trajectories, numbers of boulders, and
envelopes of energy, height and speed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from rockfall.analysis.line_statistics import with_limits
from rockfall.analysis.lines.section import Section
from rockfall.analysis.lines.section_maps import SHOWN
from rockfall.language import say, say_count
from rockfall.plots.profile_figures import draw_curves, true_scale
from rockfall.plots.style import (
    BARRIER,
    BLUE,
    GREEN,
    INK,
    LINE,
    VERMILION,
    WIDE,
    new_figure,
    plain,
    styled,
)
from rockfall.quantities import DESIGN, Quantity, with_unit
from rockfall.terrain.polyline import lengths

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

HEIGHTS = [1.0, 1.4, 1.4, 1.1]  # heights of the panels below the profile [inch]
TALLEST = 4.0  # maximum profile height that fits on A4 [inch]
MEAN: dict[str, Any] = {"lw": 0.8, "linestyle": (0, (4, 2))}
QUANTILE: dict[str, Any] = {"lw": 1.3}
MAXIMUM: dict[str, Any] = {"lw": 0.9, "linestyle": ":"}
AT_LINE: dict[str, Any] = {"color": GREEN, "marker": "D", "ms": 3.5, "lw": 0.9, "linestyle": ""}
STRENGTH: dict[str, Any] = {"color": INK, "marker": "_", "ms": 9, "mew": 1.8, "linestyle": ""}


@styled
def section_figure(section: Section) -> Figure:
    """Profile at true scale with recorded trajectories in the corridor; boulders at each station;
    mean, 95 % quantile with its 95 % band, and maximum of total energy, passing height and speed.
    Sources are recorded trajectories, map cells, and crossed lines. Barriers are drawn with height
    and capacity. Values from too few boulders are omitted."""
    length = float(lengths(section.line.vertices)[-1])
    high, furthest = true_scale(_relief(section), length, TALLEST)
    figure = new_figure(WIDE, high + sum(HEIGHTS) + 1.3)
    panels = figure.subplots(1 + len(HEIGHTS), 1, sharex=True, height_ratios=[high, *HEIGHTS])
    _draw_profile(panels[0], section)
    _draw_boulders(panels[1], section)
    for axes, quantity in zip(panels[2:], SHOWN, strict=True):
        _draw_envelopes(axes, section, quantity, DESIGN[quantity])
    _draw_strength(panels[2], section.lines, "capacity", DESIGN["energy_total"].factor)
    _draw_strength(panels[3], section.lines, "height", 1.0)
    _mark_lines(panels, section.lines)
    panels[-1].set_xlabel(say("axis.along_section"))
    panels[-1].set_xlim(0, furthest)
    _draw_key(figure, panels[2:])
    figure.align_ylabels()
    return figure


def _relief(section: Section) -> float:
    """Elevation range of a profile [m]."""
    shown = [section.table["elevation"].to_numpy(float), *(z for _, z in section.paths)]
    values = np.concatenate(shown)
    return float(np.ptp(finite)) if (finite := values[np.isfinite(values)]).size else 0.0


def _draw_profile(axes: Axes, section: Section) -> None:
    """Draw the ground, barriers and trajectories at true scale."""
    draw_curves(axes, [(along, z) for along, z in section.paths])
    distance, ground = (section.table[name].to_numpy(float) for name in ("distance", "elevation"))
    axes.plot(distance, ground, color=INK, lw=1.0)
    for row in section.lines[section.lines["height"].notna()].itertuples():
        base = np.interp(row.distance, distance, ground)
        if row.kind == "barrier":
            axes.plot([row.distance] * 2, [base, base + row.height], **BARRIER)
    axes.set_ylabel(say("axis.elevation"))
    axes.ticklabel_format(axis="y", useOffset=False)
    axes.set_aspect("equal", adjustable="datalim")
    style = {"part": section.recorded, "n": section.boulders, "within": section.line.within}
    left_out = section.not_kept
    more = [say_count("figures.section_not_kept", left_out)] if left_out else []
    axes.set_title("\n".join([say("axis.recorded_of", **style), *more]))


def _draw_boulders(axes: Axes, section: Section) -> None:
    """Draw recorded boulders at each station, and the fraction of all boulders in its cell."""
    table = section.table
    if section.recorded:
        axes.step(table["distance"], table["recorded_n"], where="mid", color=BLUE, lw=1)
        axes.set_ylim(0, None)
    axes.set_ylabel(say("axis.recorded"), color=BLUE)
    if table["cell_fraction"].notna().any():
        other = axes.twinx()
        other.spines["right"].set_visible(True)
        _draw_band(other, table, "cell_fraction", 100.0, VERMILION)
        other.set_ylim(0, None)
        other.set_ylabel(say("axis.all_in_cell"), color=VERMILION)


def _draw_envelopes(axes: Axes, section: Section, quantity: str, display: Quantity) -> None:
    """Draw the envelopes of a quantity, for each data source."""
    table, factor = section.table, display.factor
    for before, colour in (("recorded", BLUE), ("cell", VERMILION)):
        mean = factor * table[f"{before}_{quantity}_mean"]
        axes.plot(table["distance"], mean, color=colour, label=say(f"axis.{before}_mean"), **MEAN)
        label = say(f"axis.{before}_quantile")
        _draw_band(axes, table, f"{before}_{quantity}_q95", factor, colour, label)
    for before, colour in (("recorded", BLUE), ("corridor", VERMILION)):
        most = factor * table[f"{before}_{quantity}_max"]
        axes.plot(table["distance"], most, color=colour, label=say(f"axis.{before}_max"), **MAXIMUM)
    value, low, high = _with_limits(section.lines, f"{quantity}_q95", factor)
    ends = np.stack([value - low, high - value])
    axes.errorbar(
        section.lines["distance"], value, yerr=ends, label=say("axis.at_a_line"), **AT_LINE
    )
    label = with_unit(display.name.replace(", ", ",\n"), display.unit)
    axes.set(ylabel=label, ylim=(0, None))


def _draw_band(
    axes: Axes, table: pd.DataFrame, name: str, factor: float, colour: str, label: str = ""
) -> None:
    """Draw a quantity along the section with its 95 % band."""
    value, low, high = _with_limits(table, name, factor)
    axes.fill_between(table["distance"], low, high, color=colour, alpha=0.2, lw=0)
    axes.plot(table["distance"], value, color=colour, label=label, **QUANTILE)


def _with_limits(table: pd.DataFrame, name: str, factor: float) -> list[np.ndarray]:
    """Values of a quantity and its interval limits, multiplied by `factor`."""
    return [factor * table[column].to_numpy(float) for column in with_limits(name)]


def _draw_strength(axes: Axes, lines: pd.DataFrame, name: str, factor: float) -> None:
    """Draw the height or capacity of barriers."""
    barriers = lines[lines["kind"] == "barrier"]
    axes.plot(barriers["distance"], factor * barriers[name].astype(float), **STRENGTH,
              label=say("tables.barrier"))  # fmt: skip


def _mark_lines(panels: np.ndarray, lines: pd.DataFrame) -> None:
    """Mark lines, barriers and dams in all panels, and label them in the first."""
    for k, row in enumerate(lines.itertuples()):
        for axes in panels:
            axes.axvline(row.distance, **(LINE | {"lw": 0.6, "zorder": 0}))
        high = 0.03 + 0.1 * (k % 4)  # staggered, because lines may be close together
        style: dict[str, Any] = {"transform": panels[0].get_xaxis_transform(), "clip_on": True}
        panels[0].text(row.distance, high, f" {plain(str(row.name))}", **style)


def _draw_key(figure: Figure, panels: np.ndarray) -> None:
    from matplotlib.container import ErrorbarContainer

    shown: dict[str, Any] = {}
    for axes in panels:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            line = handle[0] if isinstance(handle, ErrorbarContainer) else handle
            if np.isfinite(np.asarray(line.get_ydata(), float)).any():
                shown.setdefault(label, handle)
    figure.legend(shown.values(), shown.keys(), loc="outside upper left", ncols=4)
