# SPDX-License-Identifier: BSD-3-Clause
"""The figure of a design: what a barrier along a line must be, metre by metre."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rockfall.limits import EAD_ENERGY
from rockfall.plots.along import POSITION, draw_windows
from rockfall.plots.style import GREY, WIDE, new_figure, plain, styled
from rockfall.protection.demand import usable

if TYPE_CHECKING:
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
    draw_windows(upper, along, "height_needed", 1.0)
    draw_windows(lower, along, "E_d", 1e-3)
    for k, capacity in enumerate(EAD_ENERGY):
        allowed = usable(capacity, found.factors) / 1000
        if allowed < lower.get_ylim()[1]:
            lower.axhline(allowed, color=GREY, lw=0.6, linestyle=(0, (5, 2)))
            lower.text(along["end"].iloc[-1], allowed, f"class {k}", ha="right", va="bottom")
    upper.set_title(f"{plain(along['line'][0])}, {found.factors.conditions.standard}")
    upper.set(ylabel="height needed, vertical [m]")
    ends = along["start"].iloc[0], along["end"].iloc[-1]
    lower.set(ylabel="E_d [kJ]", xlim=ends, xlabel=POSITION)
    return figure
