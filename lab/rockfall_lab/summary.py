# SPDX-License-Identifier: BSD-3-Clause
"""Text summaries of impacts and of fitted sets."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from rockfall.analysis.planes.plane_bounce import Rebound, growth, neutral_slope, set_rebound
from rockfall_lab.case import COEFFICIENTS
from rockfall_lab.contact_records import EXITS as CONTACT_EXITS
from rockfall_lab.sets.contacts import title
from rockfall_lab.sets.fit import Impacts, as_rebounds, impacts_of, within_points
from rockfall_lab.sets.lateral import lateral_line
from rockfall_lab.sets.resampled import resampled_rebound
from rockfall_lab.spheres.experiment import STATUS

if TYPE_CHECKING:
    import xarray as xr

    from rockfall_lab.sets.contacts import Contacts
    from rockfall_lab.sets.fit import ImpactSet

CONTACT_MEANS = "vt_out", "vn_out", "w_out"
INCIDENCES = 0, 10, 20, 30, 45, 60, 91  # limits of incidence classes [degrees]
ENDS = [name for name in STATUS if name != "not_done"]
#: Means, and the standard error for which the required number of contacts is estimated.
AIMED, AIM = ("a1", "a4", "a5"), 0.05
SLOPES = 34.0, 38.0, 42.0  # slopes of the planes on which a set is checked [degrees]


def impact_summary(data: xr.Dataset) -> str:
    """Text with the numbers of impacts by outcome, for each ratio."""
    head = f"{'R_b/R_m':>8}{'solid':>7}{'impacts':>9}"
    lines = [head + "".join(f"{name:>11}" for name in ENDS)]
    for ratio in data["ratio"].values:
        status = data["status"].sel(ratio=ratio).values
        counts = "".join(f"{int((status == STATUS[name]).sum()):11,}" for name in ENDS)
        solid = float(data["solid"].sel(ratio=ratio).mean())
        lines.append(f"{ratio:8g}{solid:7.3f}{status.size:9,}{counts}")
    lines.append(f"{data.attrs['cpu_seconds']:.0f} s of CPU")
    return "\n".join(lines)


def contact_summary(data: xr.Dataset) -> str:
    """Outcomes of contacts of thrown blocks, and the velocity they retained."""
    n, attrs = data.sizes["contact"], data.attrs
    lines = [f"{attrs['shape']} blocks on {attrs['ground']}: {n:,} contacts"]
    ends = data["exit"].values
    lines.append(
        ", ".join(f"{int((ends == k).sum()):,} {name}" for k, name in enumerate(CONTACT_EXITS))
    )
    lines.append(f"{'incidence':>12}{'contacts':>10}{'V_t':>8}{'V_n':>8}{'W':>8}  out over |V_in|")
    angle = data["incidence"].values
    flies = (ends == 0) & (data["entry"].values == 0)
    for low, high in pairwise(INCIDENCES):
        these = flies & (angle >= low) & (angle < high)
        if these.any():
            means = (float(data[name].values[these].mean()) for name in CONTACT_MEANS)
            lines.append(
                f"{low:>6}-{min(high, 90):<5}{int(these.sum()):10,}"
                + "".join(f"{mean:8.2f}" for mean in means)
            )
    if attrs["unfinished"]:
        lines.append(f"{attrs['unfinished']} throws were cut short: their last contact is missing")
    lines.append(
        f"{attrs['cpu_seconds']:.0f} s of CPU, {attrs['cpu_seconds'] / n * 1e3:.2f} ms each"
    )
    return "\n".join(lines)


def sequences_summary(data: xr.Dataset) -> str:
    """Outcomes of contacts of boulders thrown at rocks, for each ratio."""
    lines = [f"{'R_b/R_m':>8}{'solid':>7}{'throws':>8}{'short':>7}{'contacts':>10}"]
    lines[0] += "".join(f"{name:>10}" for name in CONTACT_EXITS) + f"{'ms each':>9}"
    attrs = {name: np.atleast_1d(value) for name, value in data.attrs.items()}
    for k, ratio in enumerate(attrs["ratios"]):
        ends = data["exit"].values[data["ratio"].values == ratio]
        counts = "".join(f"{int((ends == code).sum()):10,}" for code in range(len(CONTACT_EXITS)))
        lines.append(
            f"{ratio:8g}{attrs['solid'][k]:7.3f}{int(attrs['done'][k]):8,}"
            f"{int(attrs['unfinished'][k]):7,}{len(ends):10,}{counts}"
            f"{1000 * attrs['cpu_seconds'][k] / max(1, len(ends)):9.1f}"
        )
    return "\n".join([*lines, *_lost_throws(data, attrs)])


def _lost_throws(data: xr.Dataset, attrs: dict[str, np.ndarray]) -> Iterator[str]:
    """Warnings for ratios with throws that have no contact because no step was stable."""
    for ratio, done in zip(attrs["ratios"], attrs["done"], strict=True):
        thrown = len(np.unique(data["sequence"].values[data["ratio"].values == ratio]))
        if lost := int(done) - thrown:
            yield (
                f"warning: R_b/R_m = {ratio:g}: no step was stable in {lost} of {int(done)} "
                "throws: they have no contacts, so a table or set of the others may be biased"
            )


def fit_summary(data: xr.Dataset, sets: dict[int, ImpactSet], state: str) -> str:
    """Values of a1..a9 for each ratio, and an independent check of the fit: bounces on planes by
    the set and by the impacts themselves."""
    lines = []
    for ratio, impact_set in sets.items():
        impacts = as_rebounds(impacts_of(data, ratio, state))
        noise = np.sqrt(np.diag(within_points(data, ratio, state)))
        lines += set_lines(f"R_b/R_m = {ratio}: {impact_set.impacts:,} impacts", impact_set)
        lines.append(
            f"  {impact_set.redrawn:.2f} draws rejected for each rebound; scatter within a point "
            f"{' '.join(f'{value:.2f}' for value in noise)} of |V_in| (V_t, V_n, W)"
        )
        assert impacts.lateral is not None
        lines += [lateral_line(impacts.lateral), *bounce_lines(impact_set, impacts)]
    return "\n".join(lines)


def contacts_summary(contacts: Contacts, sets: dict[int, ImpactSet]) -> str:
    """Values of a1..a9 and checks for each set fitted to measured contacts, and the number of
    contacts needed."""
    lines = []
    for ratio, impacts in contacts.by_ratio().items():
        impact_set = sets[ratio or 1]  # if no ratio was measured, all sets are equal
        lines += set_lines(f"{title(ratio)}: {impact_set.impacts:,} contacts", impact_set)
        lines.append(contacts_needed(impact_set))
        if impacts.lateral is not None:
            lines.append(lateral_line(impacts.lateral))
        lines += bounce_lines(impact_set, impacts)
    return "\n".join(lines)


def contacts_needed(impact_set: ImpactSet) -> str:
    """Text: number of contacts for standard error `AIM` of the means `AIMED`; errors decrease with
    the square root of this number."""
    numbers = []
    for name in AIMED:
        error = impact_set.mean_error[COEFFICIENTS.index(name)]
        number = float(
            f"{impact_set.impacts * (error / AIM) ** 2:.2g}"
        )  # estimate within a factor of two
        numbers.append(f"{number:,.0f} for {name}")
    return f"  contacts for a standard error of {AIM:g}: about {', '.join(numbers)}"


def set_lines(title: str, impact_set: ImpactSet) -> list[str]:
    """Lines of text: means of a1..a9, their standard errors, and standard deviations."""
    rows = [
        ("mean", impact_set.mean),
        ("standard error", impact_set.mean_error),
        ("deviation", np.sqrt(np.diag(impact_set.covariance))),
    ]
    head = [title, f"  {'':16}" + "".join(f"{name:>8}" for name in COEFFICIENTS)]
    return head + [f"  {name:16}" + "".join(f"{v:8.4f}" for v in row) for name, row in rows]


def bounce_lines(impact_set: ImpactSet, impacts: Impacts) -> list[str]:
    """Neutral slope, and growth and scatter of a bounce on planes, by the set and by impacts."""
    rules: dict[str, Rebound] = {
        "the set": set_rebound(impact_set.mean, impact_set.covariance),
        "the impacts": resampled_rebound(impacts.v_in, impacts.v_out),
    }
    lines = []
    for name, rebound in rules.items():
        planes = []
        for slope in SLOPES:
            bounce = growth(rebound, slope)
            planes.append(f"{slope:g}: {bounce.mean:+.4f} {bounce.std:.4f}")
        lines.append(
            f"  by {name:12} neutral slope {neutral_slope(rebound):5.1f} degrees; "
            f"log growth and scatter of a bounce at {'; '.join(planes)}"
        )
    return lines
