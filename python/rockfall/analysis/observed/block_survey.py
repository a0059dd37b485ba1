# SPDX-License-Identifier: BSD-3-Clause
"""Block survey: volumes of all deposited blocks, and of blocks that fell in a known period (De
Biagi et al. 2017)."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rockfall.errors import RockfallError
from rockfall.io.tables import Row, check_columns, read_table

AXES = ("a", "b", "c")
DATES = ("year", "date")
MIN_VOLUME, MAX_VOLUME = 1e-6, 1e5  # [m3] the largest is 58 m across
MAX_AXIS = 50.0  # maximum block axis [m]
MAX_YEARS = 1e4
CALENDAR = (1800.0, 2100.0)  # range of plausible calendar years
LARGE = 150.0  # [m3] 6.6 m across; larger numbers may be litres
LONG = 200.0  # [year] longer than any rockfall record
UNLIKELY = 1e-3  # probability below which a survey is implausible

Volumes = str | Path | Sequence[float] | np.ndarray  # a table, or volumes [m3]


@dataclass(frozen=True)
class Survey:
    """Surveyed blocks: `volumes` [m3] of all deposited blocks, `undated` blocks without a date,
    and `dated` blocks that fell within `years`; `dates` are decimal years, where known."""

    name: str
    volumes: np.ndarray
    undated: np.ndarray
    dated: np.ndarray
    dates: np.ndarray
    years: float


class _Blocks(NamedTuple):
    """Columns of a survey table: volumes [m3] and decimal years, NaN where unknown."""

    name: str
    volumes: np.ndarray
    dates: np.ndarray


def read_survey(blocks: Volumes, events: Volumes | None, years: float | None) -> Survey:
    """Read a survey: `blocks` are the deposited blocks, `events` those that fell in a period of
    `years` (None: the dated rows of `blocks`). Raises a RockfallError if `blocks` has no dates
    without `events`, or any with `events`; if only some `events` are dated; and if `years` is None
    or contradicts the dates."""
    deposited = _read(blocks, "blocks")
    if events is None:
        is_dated = ~np.isnan(deposited.dates)
        if not is_dated.any():
            raise RockfallError(
                f"{deposited.name}: dated blocks are missing: give rows with a year, or a table of "
                "dated blocks (events)"
            )
        fallen = _Blocks(deposited.name, deposited.volumes[is_dated], deposited.dates[is_dated])
        undated = deposited.volumes[~is_dated]
    else:
        if not np.isnan(deposited.dates).all():
            raise RockfallError(
                f"{deposited.name}: has dated blocks: they cannot be combined with events"
            )
        fallen, undated = _read(events, "events"), deposited.volumes
        if 0 < np.isnan(fallen.dates).sum() < fallen.dates.size:
            raise RockfallError(f"{fallen.name}: dates must be in all rows, or in none")
    return Survey(
        deposited.name,
        np.sort(deposited.volumes),
        undated,
        fallen.volumes,
        fallen.dates,
        _period(years, fallen),
    )


def _period(years: float | None, fallen: _Blocks) -> float:
    """Observation period [year]; raises a RockfallError if it contradicts the dates."""
    if years is None:
        raise RockfallError(
            "years is missing: give the length of the complete record, which exceeds the time from "
            "the first to the last dated block"
        )
    if not 0 < years <= MAX_YEARS:
        raise RockfallError(f"years = {years:g}: must be > 0 and <= {MAX_YEARS:g}")
    if CALENDAR[0] <= years <= CALENDAR[1]:
        raise RockfallError(
            f"years = {years:g}: is a calendar year: give the length of the observation period"
        )
    dates = fallen.dates[~np.isnan(fallen.dates)]
    if dates.size and (span := float(np.ptp(dates))) > years:
        raise RockfallError(
            f"years = {years:g}: must be >= {span:.4g}, the time from the first to the last dated "
            f"block of {fallen.name}"
        )
    return float(years)


def survey_remarks(survey: Survey) -> Iterator[str]:
    """Remarks on probably wrong units of volumes or `years`, and on incomplete records."""
    largest, years = float(survey.volumes.max()), survey.years
    if largest > LARGE:
        yield (f"the largest block has {largest:.3g} m3: are volumes in dm3 or kg, or axes in dm?")
    elif largest > 1 and (survey.volumes == survey.volumes.round()).all():
        yield "all volumes are whole numbers of m3: are they in dm3 or kg?"
    dates = survey.dates[~np.isnan(survey.dates)]
    part = float(np.ptp(dates)) / years if dates.size > 1 else 1.0
    if part ** (dates.size - 1) * (dates.size - (dates.size - 1) * part) < UNLIKELY:
        yield (
            f"all dated blocks fell within {part * years:.0f} of {years:g} years: is the "
            "observation period in months, or is the record incomplete?"
        )
    elif years > LONG:
        yield f"an observation period of {years:g} years: is the value in months?"


def _read(given: Volumes, name: str) -> _Blocks:
    if isinstance(given, str | Path):
        return _read_file(given)
    volumes = np.asarray(given, float)
    if volumes.ndim != 1 or not volumes.size:
        raise RockfallError(f"{name}: must be a table, or a sequence of volumes")
    wrong = volumes[~((volumes >= MIN_VOLUME) & (volumes <= MAX_VOLUME))]
    if wrong.size:
        raise RockfallError(
            f"{name}: volume = {wrong[0]:g}: must be >= {MIN_VOLUME:g} and <= {MAX_VOLUME:g} m3"
        )
    return _Blocks(name, volumes, np.full(volumes.size, np.nan))


def _read_file(path: str | Path) -> _Blocks:
    """Read a table with `volume` or three block axes, and dates if any. Refuses missing or
    contradictory columns."""
    where, columns, rows = read_table(path)
    check_columns(where, columns, columns)
    has_volume, has_axes = "volume" in columns, all(name in columns for name in AXES)
    if not has_volume and not has_axes:
        raise RockfallError(
            f"{where}: columns volume or a, b, c are missing (columns: {', '.join(columns)})"
        )
    if has_volume and has_axes:
        raise RockfallError(f"{where}: columns volume and a, b, c cannot be combined")
    dated = [name for name in DATES if name in columns]
    if len(dated) > 1:
        raise RockfallError(f"{where}: columns year and date cannot be combined")
    volumes, dates = [], []
    for row in rows:
        volumes.append(_volume(row, has_axes))
        dates.append(_decimal_year(row, dated[0]) if dated else math.nan)
    return _Blocks(str(path), np.array(volumes), np.array(dates))


def _volume(row: Row, has_axes: bool) -> float:
    if not has_axes:
        return row.number("volume", MIN_VOLUME, MAX_VOLUME)  # [m3]
    volume = math.prod(row.number(name, 1e-3, MAX_AXIS) for name in AXES)
    if volume < MIN_VOLUME:
        row.refuse("a", f"a x b x c must be >= {MIN_VOLUME:g} m3")
    if volume > MAX_VOLUME:
        row.refuse("a", f"a x b x c must be <= {MAX_VOLUME:g} m3, with axes in metres")
    return volume


def _decimal_year(row: Row, column: str) -> float:
    """Date in a row as a decimal year; NaN if empty. Refuses other texts and future years."""
    text = row.cells[column]
    if not text:
        return math.nan
    if text[:4].isdecimal() and int(text[:4]) > date.today().year:
        row.refuse(column, "is in the future: give the year in which the block fell")
    if re.fullmatch("[0-9]{4}", text):
        return float(text)
    try:
        if not re.fullmatch("[0-9]{4}-[0-9]{2}-[0-9]{2}", text):
            raise ValueError
        day = date.fromisoformat(text)
    except ValueError:
        row.refuse(column, "must be a year such as 1987, or a date such as 1987-05-30")
    return day.year + (day.timetuple().tm_yday - 1) / 366
