# SPDX-License-Identifier: BSD-3-Clause
"""Text on boulder breakage in a case."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rockfall.scene.rebounds.breakage import breaking_speed, split_blocks

if TYPE_CHECKING:
    from rockfall.case import Case


def breakage_lines(case: Case, volumes: np.ndarray, density: np.ndarray) -> list[tuple[str, str]]:
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
        rows.append(f"at release by a fall of {fall:g} m, {_outcome(case, volume, energy)}")
    if at != "release":
        speed = breaking_speed(case, volume, dense)
        if np.isfinite(speed):
            outcome = _outcome(case, volume, 0.5 * dense * volume * speed**2)
            rows.append(f"at impacts above {speed:.3g} m/s normal to the ground, {outcome}")
        else:
            rows.append(f"at impacts: a block of {volume:.3g} m3 is too small to break")
    return [("breakage" if not k else "", row) for k, row in enumerate(rows)]


def _outcome(case: Case, volume: float, energy: float) -> str:
    split = split_blocks(case, np.array([volume]), np.array([energy]))
    block, ratio = f"a block of {volume:.3g} m3", f"area ratio {split.area_ratio[0]:.2f}"
    largest = split.volumes[0, 0]
    if largest == volume:
        return f"{block} stays whole: {ratio}"
    return (
        f"{block} breaks into {np.count_nonzero(split.volumes)} fragments, the largest "
        f"{largest:.3g} m3, and {split.fines[0]:.2g} m3 of fines: {ratio}"
    )
