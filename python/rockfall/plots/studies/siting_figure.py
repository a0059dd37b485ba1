# SPDX-License-Identifier: BSD-3-Clause
"""Figure of a barrier siting: loads and requirements against upslope distance."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from rockfall.kernel_rules import EAD_ENERGY
from rockfall.plots.style import BLUE, GREY, INK, VERMILION, WIDE, new_figure, plain, styled
from rockfall.protection.demand import usable
from rockfall.result.variables import ENDS
from rockfall.studies.siting import BEST, NOT_DISTINGUISHED, Siting

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LIMIT: dict[str, Any] = {"color": VERMILION, "lw": 0.9, "linestyle": (0, (5, 2))}


@styled
def siting_figure(siting: Siting) -> Figure:
    """Energy, height, and fractions of boulders that still arrive, for each alignment with 95 %
    intervals and limits. The best alignment, and those that may be as good, are marked."""
    figure = new_figure(WIDE, 6.2)
    energy, high, round_it = figure.subplots(3, 1, sharex=True, height_ratios=[2, 2, 1])
    _draw(energy, siting.table, "energy_q95", 1e-3, BLUE, "95 % quantile, total")
    _draw(energy, siting.table, "E_d", 1e-3, GREY, "E_d")
    energy.set(ylabel="energy [kJ]", ylim=(0, None))
    if siting.limits.ead_class is not None:
        allowed = usable(EAD_ENERGY[siting.limits.ead_class], siting.factors) / 1000
        energy.axhline(allowed, label=f"class {siting.limits.ead_class}", **LIMIT)
    _draw(high, siting.table, "height_q95", 1.0, BLUE, "95 % quantile of the centre")
    _draw(high, siting.table, "height_needed", 1.0, GREY, "height needed")
    high.set(ylabel="height, vertical [m]", ylim=(0, None))
    if siting.limits.height is not None:
        high.axhline(siting.limits.height, label="limit", **LIMIT)
    _draw(round_it, siting.table, "bypass", 100.0, BLUE, "around the alignment")
    _draw(round_it, siting.table, "remaining", 100.0, GREY, "with a barrier there")
    round_it.axhline(100 * siting.limits.bypass, **LIMIT)
    round_it.set(ylabel="still come [%]", ylim=(0, None))
    for axes in (energy, high, round_it):
        for choice, linestyle in ((BEST, "-"), (NOT_DISTINGUISHED, ":")):
            for distance in siting.table["distance"][siting.table["choice"] == choice]:
                axes.axvline(distance, color=INK, lw=0.8, linestyle=linestyle, zorder=0)
        axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, borderaxespad=0)
    energy.set_title(f"Above {plain(siting.line)}", pad=22)
    round_it.set(xlabel=f"distance from {plain(siting.line)} [m]")
    figure.align_ylabels()
    return figure


def _draw(
    axes: Axes, table: pd.DataFrame, name: str, factor: float, colour: str, label: str
) -> None:
    """Draw a value for each alignment with its interval; a triangle marks a missing upper limit."""
    value, low, high = (factor * table[name + end].to_numpy() for end in ENDS)
    ends = np.nan_to_num(np.stack([value - low, high - value])).clip(min=0)
    style: dict[str, Any] = {"marker": "o", "ms": 3, "lw": 0.8, "color": colour, "label": label}
    axes.errorbar(table["distance"], value, yerr=ends, **style)
    unknown = np.isfinite(value) & ~np.isfinite(high)
    style = {"linestyle": "", "marker": "^", "ms": 5, "mfc": "none", "color": colour}
    axes.plot(table["distance"][unknown], value[unknown], **style)
