# SPDX-License-Identifier: BSD-3-Clause
"""Impact-set files, written with the provenance needed to reproduce them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rockfall.errors import RockfallError
from rockfall.io.atomic import atomic_write
from rockfall.io.files import read_text
from rockfall.scene.rebounds.sets import ERROR_MARK
from rockfall_lab.case import LabCase, lab_case_of
from rockfall_lab.spheres.experiment import STATUS, checksum

if TYPE_CHECKING:
    import xarray as xr

    from rockfall_lab.sets.fit import ImpactSet
    from rockfall_lab.sets.lateral import Lateral

CASE_MARK = "! | "  # prefix of lines of a set file that contain its laboratory case
STATE_MARK = "! Outgoing state: "


def provenance(data: xr.Dataset, state: str) -> list[str]:
    """Provenance lines of a set file, sufficient to reproduce it. Raises a RockfallError if impacts
    are missing."""
    if missing := int((data["status"].values == STATUS["not_done"]).sum()):
        raise RockfallError(f"{missing} of {data['status'].size} impacts are not done: no set yet")
    case = lab_case_of(data.attrs["lab_case"], "impacts")
    lines = [
        f"{data.attrs['title']}",
        "",
        "Means and covariances of a1..a9 from discrete-element impacts of a boulder on rocks.",
        STATE_MARK[2:] + state,
        f"Made by rockfall {data.attrs['version']}; `rockfall lab remake FILE` makes it again.",
        f"SHA-256 of the outcomes: {checksum(data)}",
    ]
    for ratio in data["ratio"].values:
        status = data["status"].sel(ratio=ratio).values
        ended = ", ".join(
            f"{int((status == value).sum())} {name}"
            for name, value in STATUS.items()
            if name != "not_done"
        )
        solid = data["solid"].sel(ratio=ratio).values
        lines.append(
            f"R_b/R_m = {ratio:g}: {status.size} impacts, {ended}; "
            f"solid fraction {solid.mean():.3f} +- {solid.std():.3f}"
        )
    lines += ["The laboratory case:"]
    return lines + [CASE_MARK[2:] + line for line in case.text().splitlines()]


def origin(path: str | Path) -> tuple[LabCase, str]:
    """Laboratory case from which a set file was made, and the boulder state that its sets use.
    Raises a RockfallError for other files."""
    lines = read_text(path).splitlines()
    text = [line[len(CASE_MARK) :] for line in lines if line.startswith(CASE_MARK)]
    state = [line[len(STATE_MARK) :] for line in lines if line.startswith(STATE_MARK)]
    if not (text and state):
        raise RockfallError(f"{path}: does not say what laboratory case it was made from")
    return lab_case_of("\n".join(text), str(path)), state[0]


def write_sets(
    path: str | Path, sets: dict[int, ImpactSet], provenance: list[str], *more: dict[int, ImpactSet]
) -> None:
    """Write an impact-set file: `provenance` as comments, then one group per ratio. For an
    ensemble, write the groups of each draw: `sets`, then `more`."""
    text = [f"! {line}".rstrip() for line in provenance]
    for draw, draw_sets in enumerate((sets, *more), 1):
        for ratio, impact_set in sorted(draw_sets.items()):
            text += ["", *_group(ratio, impact_set, draw if more else None)]
    with atomic_write(path) as part:
        part.write_text("\n".join(text) + "\n", encoding="utf-8")


def _group(ratio: int, impact_set: ImpactSet, draw: int | None = None) -> list[str]:
    """Text of a set, with twelve digits per number so that its covariance remains semidefinite."""
    text = []
    if impact_set.impacts:
        text += [f"! {impact_set.impacts} impacts; standard errors of the means:"]
        text += [f"!   {_short(impact_set.mean_error)}", "! and of the covariance:"]
        text += [f"!   {_short(row)}" for row in _lower(impact_set.covariance_error)]
    if impact_set.error_covariance is not None:
        text += [f"! {ERROR_MARK}"]
        text += [f"!   {_numbers(row)}" for row in _lower(impact_set.error_covariance)]
    text += [f"&impact_set ratio = {ratio}" + (f", draw = {draw}" if draw else "")]
    text += [f"  mean = {_numbers(impact_set.mean)}", "  covariance =   ! lower triangle by rows"]
    text += [_rows(_lower(impact_set.covariance))]
    for name in "speed_range", "angle_range":
        if (ends := getattr(impact_set, name)) is not None:
            text += [f"  {name} = {_numbers(ends)}"]
    if impact_set.lateral is not None:
        text += _lateral_lines(impact_set.lateral)
    return [*text, "/"]


def _lateral_lines(lateral: Lateral) -> list[str]:
    """Keys of lateral deviations; a single class has no limits."""
    behind = ", ".join(f"{number}" for number in lateral.impacts)
    between = [f"  incidence = {_numbers(lateral.incidence)}"] if lateral.incidence.size else []
    head = f"  lateral =   ! quantiles [degrees] for each class, of {behind} impacts"
    return [*between, head, _rows(lateral.quantiles)]


def _rows(rows: Iterable[np.ndarray]) -> str:
    return ",\n".join(f"    {_numbers(row)}" for row in rows)


def _lower(matrix: np.ndarray) -> list[np.ndarray]:
    """Lower triangle, row by row."""
    return [matrix[k, : k + 1] for k in range(len(matrix))]


def _short(values: np.ndarray) -> str:
    return ", ".join(f"{value:.2g}" for value in values)


def _numbers(values: np.ndarray) -> str:
    return ", ".join(f"{value:.12g}" for value in values)
