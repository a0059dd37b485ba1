# SPDX-License-Identifier: BSD-3-Clause
"""The figure of a design: what a barrier along a line must be, metre by metre."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.limits import EAD_ENERGY
from rockfall.plots.style import BLUE, GREY, WIDE, new_figure, plain, styled
from rockfall.protection.demand import ENDS, usable

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from rockfall.protection.design import Design


@styled
def along_figure(found: Design) -> Figure:
    """Height needed and design energy along a line, with 95 % bands, and the energies that EAD
    classes may be asked to take; windows with few boulders are blank."""
    along = found.along
    assert along is not None
    figure = new_figure(WIDE, 4.2)
    upper, lower = figure.subplots(2, 1, sharex=True)
    _draw_windows(upper, along, "height_needed", 1.0)
    _draw_windows(lower, along, "E_d", 1e-3)
    for k, capacity in enumerate(EAD_ENERGY):
        allowed = usable(capacity, found.factors) / 1000
        if allowed < lower.get_ylim()[1]:
            lower.axhline(allowed, color=GREY, lw=0.6, linestyle=(0, (5, 2)))
            lower.text(along["end"].iloc[-1], allowed, f"class {k}", ha="right", va="bottom")
    upper.set_title(f"{plain(along['line'][0])}, {found.factors.conditions.standard}")
    upper.set(ylabel="height needed, vertical [m]")
    ends = along["start"].iloc[0], along["end"].iloc[-1]
    lower.set(ylabel="E_d [kJ]", xlim=ends, xlabel="position along the line [m]")
    return figure


def _draw_windows(axes: Axes, along: pd.DataFrame, name: str, factor: float) -> None:
    """Steps of a number and its band, hatched upwards where too few boulders bound it."""
    edges = np.append(along["start"], along["end"].iloc[-1])
    value, low, high = (factor * along[name + end].to_numpy() for end in ENDS)
    known = np.append(value, high)[np.isfinite(np.append(value, high))]
    top = 1.1 * known.max(initial=0.0) or 1.0
    low = np.where(np.isnan(low), 0.0, low)
    about: dict[str, Any] = {"fill": True, "color": BLUE, "alpha": 0.25}
    axes.stairs(np.where(np.isnan(high), value, high), edges, baseline=low, **about)
    if (open_ended := np.isnan(high) & np.isfinite(value)).any():
        beyond = np.where(open_ended, top, np.nan)
        about = {"fill": True, "facecolor": "none", "edgecolor": BLUE, "alpha": 0.4, "lw": 0}
        label = "too few boulders for an upper limit"
        axes.stairs(beyond, edges, baseline=value, hatch="////", label=label, **about)
        axes.legend(loc="lower left", bbox_to_anchor=(0.45, 1.0), borderaxespad=0)
    axes.stairs(value, edges, baseline=None, color=BLUE, lw=1.2)
    axes.set_ylim(0, top)
