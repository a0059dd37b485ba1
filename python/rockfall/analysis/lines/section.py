# SPDX-License-Identifier: BSD-3-Clause
"""Section along a drawn line: the ground below, and energies, speeds and heights of nearby
boulders, from recorded trajectories, maps, and crossed lines.

A station is a short line across the section, treated as an evaluation line: a recorded boulder
counts at its first crossing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from rockfall.analysis.lines import section_maps
from rockfall.analysis.lines.crossed_lines import crossed_lines
from rockfall.analysis.lines.envelopes import QUANTITIES, envelope_names, envelopes
from rockfall.analysis.lines.stations import SectionLine, stations_of
from rockfall.analysis.precision.intervals import Sources, sources
from rockfall.errors import RockfallError
from rockfall.io.rasters.arrays import corner_of
from rockfall.result.crossings import masses_of
from rockfall.result.motion import Motion, motion_of, spins, spread
from rockfall.result.samples import simulated
from rockfall.result.trajectories import Terrain, curves
from rockfall.scene.rebounds.kernel_rebounds import kinetic_energy, sphere_radius
from rockfall.terrain.height import height, inside, steepness
from rockfall.terrain.polyline import beside, lengths

PATHS = 200  # maximum number of trajectories kept
RECORDED = "recorded_"  # prefix of statistics from recorded trajectories
COLUMNS = ["distance", "x", "y", "elevation", "crossed", "recorded_n", "unknown_energy"]
COLUMNS += [*envelope_names(RECORDED), *section_maps.COLUMNS]


@dataclass(frozen=True)
class Section:
    """A section of a result, in its units; intervals are 95 % confidence intervals.

    `table` has a row for each station, with statistics: `recorded_...` for recorded trajectories
    that cross it within the corridor, `cell_...` for all boulders in the map cell of the station,
    `corridor_..._max` for all boulders in the cells that the station crosses; `crossed` lists the
    lines crossed since the previous station. `lines` has a row for each crossing of the section
    with a line, barrier or dam, with statistics of all boulders that cross the line in the
    corridor. `passages` has a row for each recorded boulder at each station: distance along the
    section, boulder, elevation of its point, speed, total energy and heights. `paths` has up to 200
    trajectories within the corridor: distance along the section and elevation (2, n), NaN outside.
    `recorded` is the number of recorded trajectories, out of `boulders`; `has_maps` is True if the
    result has maps of these quantities. `not_kept` is the number of other recorded trajectories,
    omitted because the sizes and masses of their boulders were not kept.
    """

    line: SectionLine
    table: pd.DataFrame
    lines: pd.DataFrame
    passages: pd.DataFrame
    paths: tuple[np.ndarray, ...]
    recorded: int
    boulders: int
    has_maps: bool
    not_kept: int = 0

    @property
    def lacks_heights(self) -> bool:
        """True if the heights of recorded trajectories are unknown at some stations."""
        return bool(self.passages["passing_height"].isna().any())

    @property
    def unknown_energies(self) -> int:
        """Number of recorded passages whose energy is unknown, because the mass is unknown."""
        return int(self.passages["energy_total"].isna().sum())


class _Known(NamedTuple):
    """Masses [kg] and radii [m] of all boulders, and the terrain, where known."""

    mass: np.ndarray
    radius: np.ndarray
    terrain: Terrain | None


def section_of(result: xr.Dataset, line: SectionLine, terrain: Terrain | None = None) -> Section:
    """Section of a result along a line. Elevations and trajectory heights are NaN outside or
    without terrain; heights also if the terrain is coarser than in the run. Energies are NaN if
    neither the case nor a line crossing gives the mass. Raises RockfallError if the result has
    neither trajectories of moving boulders with kept rows nor maps of speed, energy or height."""
    stations = stations_of(line)
    mapped = section_maps.has_maps(result)
    followed, boulders = motion_of(result), result["boulder"].values
    motion = followed.straightened()
    moves = (motion.start != motion.end)[:3].any(axis=0)
    not_kept = np.setdiff1d(motion.boulder[moves], boulders).size
    moves &= np.isin(motion.boulder, boulders)
    if not (moves.any() or mapped) and not_kept:
        raise RockfallError(
            f"section: no rows are kept of the {not_kept:,} boulders with recorded trajectories: "
            "run with &output kept = 'all', or a larger number"
        )
    if not moves.any() and not mapped:
        raise RockfallError(
            "section: the result has neither trajectories of boulders that moved (&output "
            "trajectories) nor maps of speeds, energies or heights (&output maps)"
        )
    spin = spins(result, motion)[moves] if moves.any() else np.empty(0)
    motion = motion.take(moves)
    row_of = np.searchsorted(boulders, motion.boulder)
    rows, of_recorded = np.unique(row_of, return_inverse=True)
    own = sources(result)
    among = Sources.of(np.unique(own.number[rows], return_inverse=True)[1], own.sampled)
    lines = crossed_lines(result, line.vertices, line.within)
    radius = sphere_radius(result["volume"].values)
    context = _Known(masses_of(result), radius, terrain if _is_fine(result, terrain) else None)
    table, passages, crossing = [], [], []
    for at, place, direction in zip(*stations[:3], strict=True):
        k, part = _first_crossings(motion, place, direction, line.within)
        values = _values(motion.take(k), part, spin[k], row_of[k], context)
        crossing.append(boulder := motion.boulder[k])
        passages.append({"distance": np.full(k.size, at), "boulder": boulder} | values)
        row = {"distance": at, "x": place.real, "y": place.imag, f"{RECORDED}n": k.size}
        row["unknown_energy"] = int(np.isnan(values["energy_total"]).sum())
        table.append(row | envelopes(values, among[of_recorded[k]], RECORDED))
    columns = {
        name: np.concatenate([passage[name] for passage in passages]) for name in passages[0]
    }
    attrs = section_maps.map_numbers(result, stations) | {
        "elevation": _ground(terrain, stations.place, height),
        "crossed": _crossed(lines, stations.distance),
    }
    return Section(
        line, pd.DataFrame(table, columns=COLUMNS).assign(**attrs), lines, pd.DataFrame(columns),
        _paths(followed, line, np.concatenate(crossing)), rows.size, simulated(result),
        mapped, not_kept,
    )  # fmt: skip


def _crossed(lines: pd.DataFrame, distance: np.ndarray) -> list[str]:
    """Names of the lines crossed between the previous station and each station."""
    names_at: list[list[str]] = [[] for _ in distance]
    for name, at in zip(lines["name"], lines["distance"], strict=True):
        names_at[min(np.searchsorted(distance, at * (1 - 1e-12)), distance.size - 1)].append(name)
    return ["; ".join(names) for names in names_at]


def _is_fine(result: xr.Dataset, terrain: Terrain | None) -> bool:
    """Return True if the terrain has the cell size of the run; large terrain may be coarsened."""
    return terrain is not None and terrain[1].cell <= 1.001 * corner_of(result["crs"].attrs)[2]


def _paths(motion: Motion, line: SectionLine, boulders: np.ndarray) -> tuple[np.ndarray, ...]:
    """At most `PATHS` trajectories of `boulders` in the corridor: distance and elevation (2, n)
    [m], NaN outside (see `Section`)."""
    paths, length = [], lengths(line.vertices)[-1]
    drawn = np.isin(motion.boulder, spread(np.unique(boulders).tolist(), PATHS))
    for curve in curves(motion.take(drawn)):
        apart, along = beside(curve.x + 1j * curve.y, line.vertices)
        here = (apart <= line.within) & (along > 0) & (along < length)
        if here.any():
            paths.append(np.where(here, [along, curve.z], np.nan))
    return tuple(paths)


def _first_crossings(
    motion: Motion, place: complex, direction: complex, within: float
) -> tuple[np.ndarray, np.ndarray]:
    """Indices of the trajectory pieces in which boulders first cross a station (boulders,), and the
    fraction (0 to 1) of each piece before the crossing."""
    start, end = (x + 1j * y for x, y, *_ in (motion.start, motion.end))
    before = ((start - place) * np.conj(direction)).real
    after = ((end - place) * np.conj(direction)).real
    k = np.flatnonzero((before * after <= 0) & (before != after))
    part = before[k] / (before[k] - after[k])
    here = start[k] + part * (end[k] - start[k])
    near = np.abs(((here - place) * np.conj(direction)).imag) <= within
    k, part = k[near], part[near]
    _, first = np.unique(motion.boulder[k], return_index=True)
    return k[first], part[first]


def _values(
    motion: Motion, part: np.ndarray, spin: np.ndarray, row: np.ndarray, context: _Known
) -> dict[str, np.ndarray]:
    """QUANTITIES and elevations of boulders at the fraction `part` of their trajectory pieces;
    `row` is the index of each boulder in `context`."""
    (x, y, z, _), speed = motion.at(part)
    here = x + 1j * y
    jump = np.maximum(0.0, z - _ground(context.terrain, here, height))
    energy = kinetic_energy(context.mass[row], speed, spin)
    passing = jump + context.radius[row] * _ground(context.terrain, here, steepness)
    shown = (speed, energy, jump, passing)
    return {"elevation": z, **dict(zip(QUANTITIES, shown, strict=True))}


def _ground(
    terrain: Terrain | None, places: np.ndarray, what: Callable[..., np.ndarray]
) -> np.ndarray:
    """Property of the ground (`height` or `steepness`) at places x + iy [m]; NaN where unknown."""
    ground = np.full(places.shape, np.nan)
    if terrain is not None:
        z, grid = terrain
        inside_grid = inside(grid, places.real, places.imag)
        ground[inside_grid] = what(z, grid, places.real[inside_grid], places.imag[inside_grid])
    return ground
