# SPDX-License-Identifier: BSD-3-Clause
"""Figures along a line: frequency, energy and height of boulders, and barrier requirements."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from rockfall.kernel_rules import EAD_ENERGY
from rockfall.language import say
from rockfall.plots.style import BLUE, GREY, WIDE, new_figure, plain, styled
from rockfall.protection.demand import usable
from rockfall.protection.design import Design
from rockfall.quantities import DESIGN, QUANTITIES, with_unit
from rockfall.result.variables import ENDS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@styled
def line_profile_figure(profile: pd.DataFrame) -> Figure:
    """Figure of a `rockfall.line_profile`: fraction of all boulders that pass, per metre of the
    line, and 95 % quantiles of their total energy and passing height, with 95 % bands."""
    figure = new_figure(WIDE, 5.2)
    panels = figure.subplots(3, 1, sharex=True)
    _draw_windows(panels[0], profile, "per_metre", 100.0)
    panels[0].set(ylabel=say("axis.passing_a_metre"))
    panels[0].set_title(plain(str(profile["line"].iloc[0])))
    for axes, quantity in zip(panels[1:], ("energy_total", "passing_height"), strict=True):
        display = DESIGN[quantity]
        _draw_windows(axes, profile, f"{quantity}_q95", display.factor)
        axes.set(ylabel=with_unit(display.name.replace(", ", ",\n"), display.unit) + ", q95")
    ends = profile["start"].iloc[0], profile["end"].iloc[-1]
    panels[-1].set(xlim=ends, xlabel=QUANTITIES["position"].title)
    figure.align_ylabels()
    return figure


@styled
def along_figure(design: Design) -> Figure:
    """Required height and design energy along a line with 95 % bands, and usable energies of EAD
    classes; windows with few boulders are blank."""
    along = design.along
    assert along is not None
    figure = new_figure(WIDE, 4.2)
    upper, lower = figure.subplots(2, 1, sharex=True)
    _draw_windows(upper, along, "height_needed", 1.0)
    _draw_windows(lower, along, "E_d", 1e-3)
    for k, capacity in enumerate(EAD_ENERGY):
        allowed = usable(capacity, design.factors) / 1000
        if allowed < lower.get_ylim()[1]:
            lower.axhline(allowed, color=GREY, lw=0.6, linestyle=(0, (5, 2)))
            lower.text(
                along["end"].iloc[-1], allowed, say("axis.class", number=k), ha="right", va="bottom"
            )
    upper.set_title(f"{plain(along['line'][0])}, {design.factors.conditions.standard}")
    upper.set(ylabel=say("design.height_needed_vertical"))
    ends = along["start"].iloc[0], along["end"].iloc[-1]
    lower.set(ylabel="E_d [kJ]", xlim=ends, xlabel=QUANTITIES["position"].title)
    return figure


def _draw_windows(axes: Axes, along: pd.DataFrame, name: str, factor: float) -> None:
    """Draw a quantity as steps with a band, which is hatched upwards without an upper limit."""
    edges = np.append(along["start"], along["end"].iloc[-1])
    value, low, high = (factor * along[name + end].to_numpy() for end in ENDS)
    finite = np.append(value, high)[np.isfinite(np.append(value, high))]
    top = 1.1 * finite.max(initial=0.0) or 1.0
    low = np.where(np.isnan(low), 0.0, low)
    style: dict[str, Any] = {"fill": True, "color": BLUE, "alpha": 0.25}
    axes.stairs(np.where(np.isnan(high), value, high), edges, baseline=low, **style)
    if (open_ended := np.isnan(high) & np.isfinite(value)).any():
        beyond = np.where(open_ended, top, np.nan)
        style = {"fill": True, "facecolor": "none", "edgecolor": BLUE, "alpha": 0.4, "lw": 0}
        label = say("axis.no_upper_limit")
        axes.stairs(beyond, edges, baseline=value, hatch="////", label=label, **style)
        axes.legend(loc="lower left", bbox_to_anchor=(0.45, 1.0), borderaxespad=0)
    axes.stairs(value, edges, baseline=None, color=BLUE, lw=1.2)
    axes.set_ylim(0, top)
