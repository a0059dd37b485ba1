# SPDX-License-Identifier: BSD-3-Clause
"""Section along a drawn line: the ground below it, and what recorded trajectories near it do at
stations, with quantile envelopes of energy and height.

A station is a short line across the section. A boulder counts where it first crosses it, as at an
evaluation line, and by the same rules: between its contacts it flies on a parabola.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rockfall.analysis.line_statistics import sample_numbers, with_limits
from rockfall.analysis.precision.intervals import Sources, sources
from rockfall.case import case_of
from rockfall.errors import RockfallError
from rockfall.quantities import round_step
from rockfall.result.samples import check_rows
from rockfall.result.trajectories import vertices_of
from rockfall.scene.rebound import INERTIA_FACTOR, sphere_radius
from rockfall.terrain.height import height, inside, steepness
from rockfall.terrain.polyline import lengths

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from rockfall.result.trajectories import Terrain

STATIONS = 100  # approximate number, if no interval is given
MAX_STATIONS = 10_000
QUANTITIES = ("speed", "energy_total", "jump_height", "passing_height")
LEVELS = ("q50", "q95")
COLUMNS = ["distance", "x", "y", "elevation", "n", "unknown_energy"]
COLUMNS += [
    one
    for quantity in QUANTITIES
    for name in LEVELS
    for one in with_limits(f"{quantity}_{name}")
]  # fmt: skip
COLUMNS += [f"{quantity}_max" for quantity in QUANTITIES]


class SectionLine(NamedTuple):
    """A section: vertices as x + iy [m], the distance to either side within which trajectories
    count, and the interval between stations [m]; None: a round one, for about 100."""

    vertices: np.ndarray
    within: float = 10.0
    every: float | None = None


@dataclass(frozen=True)
class Section:
    """A section of a result. `table` has COLUMNS, a row for each station, in the units of the
    result; `passages` has a row for each boulder at each station that it crosses: distance along
    the section, boulder, elevation of its point, and QUANTITIES. `recorded` trajectories are
    behind it, of `boulders`."""

    line: SectionLine
    table: pd.DataFrame
    passages: pd.DataFrame
    recorded: int
    boulders: int


class _Flights(NamedTuple):
    """Flights between contacts, in order of time for each boulder: ends as x + iy [m]; elevation,
    vertical velocity and plan speed at the start, duration, acceleration; W = R_b omega [m/s]; row
    of the boulder."""

    start: np.ndarray
    end: np.ndarray
    z: np.ndarray
    velocity_z: np.ndarray
    plan_speed: np.ndarray
    duration: np.ndarray
    fall: np.ndarray
    spin: np.ndarray
    row: np.ndarray


def section_of(result: xr.Dataset, line: SectionLine, terrain: Terrain | None = None) -> Section:
    """Section of a result along a line. Without terrain, or beyond it, elevations and heights are
    unknown (NaN); energies are where neither the case nor a crossing of a line tells the mass."""
    import pandas as pd

    distance, places, directions = _stations(line)
    check_rows(result, "a section")
    flights = _flights(result)
    rows, of_recorded = np.unique(flights.row, return_inverse=True)
    own = sources(result)
    among = Sources.of(np.unique(own.number[rows], return_inverse=True)[1], own.sampled)
    masses = _masses(result)
    radii = sphere_radius(result["volume"].values)
    table, passages = [], []
    for at, place, direction in zip(distance, places, directions, strict=True):
        k, part = _first_crossings(flights, place, direction, line.within)
        values = _values(flights, k, part, masses, radii, terrain)
        number = result["boulder"].values[flights.row[k]]
        passages.append({"distance": np.full(k.size, at), "boulder": number} | values)
        source = among[of_recorded[k]]
        ground = _ground(terrain, np.array([place]), height)[0]
        row = {"distance": at, "x": place.real, "y": place.imag, "elevation": ground, "n": k.size}
        row["unknown_energy"] = int(np.isnan(values["energy_total"]).sum())
        table.append(row | _envelopes(values, source))
    columns = {name: np.concatenate([one[name] for one in passages]) for name in passages[0]}
    return Section(
        line, pd.DataFrame(table, columns=COLUMNS), pd.DataFrame(columns), rows.size,
        result.sizes["boulder"],
    )  # fmt: skip


def _stations(line: SectionLine) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distances of stations along a section, their places, and its directions there; the last is
    its end."""
    vertices, within, every = line
    if vertices.size < 2 or not np.isfinite(vertices).all():
        raise RockfallError("section: must have two or more vertices, x y x y ...")
    vertices = vertices[np.append(True, np.abs(np.diff(vertices)) > 0)]
    if vertices.size < 2:
        raise RockfallError("section: must have a length above 0 m")
    at = lengths(vertices)
    every = round_step(at[-1] / STATIONS) if every is None else every
    for name, value in (("within", within), ("every", every)):
        if not 0 < value < np.inf:
            raise RockfallError(f"{name} = {value}: must be > 0 m")
    if (number := at[-1] / every) > MAX_STATIONS:
        raise RockfallError(
            f"every = {every}: makes {number:,.0f} stations, at most {MAX_STATIONS:,}"
        )
    distance = np.append(np.arange(0.0, at[-1] * (1 - 1e-9), every), at[-1])
    side = np.clip(np.searchsorted(at, distance, side="right") - 1, 0, vertices.size - 2)
    directions = np.diff(vertices)
    return distance, np.interp(distance, at, vertices), (directions / abs(directions))[side]


def _flights(result: xr.Dataset) -> _Flights:
    """Flights of the recorded boulders that have rows."""
    names = ("boulder", "x", "y", "z", "time", "velocity_x", "velocity_y", "velocity_z", "out_w")
    recorded = [one for one in vertices_of(result, *names) if one.shape[1] > 1]
    known = result["boulder"].values
    recorded = [one for one in recorded if one[0, 0] in known]
    if not recorded:
        raise RockfallError(
            "section: the result has no trajectories of boulders that moved: &output trajectories"
        )
    parts = []
    for boulder, x, y, z, time, velocity_x, velocity_y, velocity_z, spin in recorded:
        place, duration = x + 1j * y, np.diff(time)
        below = np.diff(z) - velocity_z[:-1] * duration  # -g t^2/2 at the end of a flight
        with np.errstate(divide="ignore", invalid="ignore"):
            fall = np.where(duration > 0, 2 * below / duration**2, 0.0)
        row = np.searchsorted(known, boulder[:-1])
        plan_speed = np.hypot(velocity_x, velocity_y)[:-1]
        parts.append((place[:-1], place[1:], z[:-1], velocity_z[:-1], plan_speed, duration, fall,
                      spin[:-1], row))  # fmt: skip
    return _Flights(*map(np.concatenate, zip(*parts, strict=True)))


def _masses(result: xr.Dataset) -> np.ndarray:
    """Mass of each boulder [kg], NaN if unknown: from its energy at any line that it crossed, else
    from the density of the case, unless sources may have others."""
    case = case_of(result)
    known = "rock_density" not in case.boulder and "source_feature" not in result
    masses = result["volume"].values * (case.boulder["density"] if known else np.nan)
    if "line_energy_translational" in result:
        energies, speeds = (
            result[f"line_{name}"].values for name in ("energy_translational", "speed")
        )
        for energy, speed in zip(energies, speeds, strict=True):
            crossed = speed > 0  # False for NaN
            masses[crossed] = 2 * energy[crossed] / speed[crossed] ** 2
    return masses


def _first_crossings(
    flights: _Flights, place: complex, direction: complex, within: float
) -> tuple[np.ndarray, np.ndarray]:
    """Flights with which boulders first cross a station, and the parts flown by then (0 to 1)."""
    before = ((flights.start - place) * np.conj(direction)).real
    after = ((flights.end - place) * np.conj(direction)).real
    k = np.flatnonzero((before * after <= 0) & (before != after))
    part = before[k] / (before[k] - after[k])
    here = flights.start[k] + part * (flights.end[k] - flights.start[k])
    near = np.abs(((here - place) * np.conj(direction)).imag) <= within
    k, part = k[near], part[near]
    _, first = np.unique(flights.row[k], return_index=True)
    return k[first], part[first]


def _values(
    flights: _Flights, k: np.ndarray, part: np.ndarray, masses: np.ndarray, radii: np.ndarray,
    terrain: Terrain | None,
) -> dict[str, np.ndarray]:  # fmt: skip
    """QUANTITIES of boulders within these flights, and the elevation of their point."""
    of = _Flights(*(values[k] for values in flights))
    time, here = part * of.duration, of.start + part * (of.end - of.start)
    z = of.z + of.velocity_z * time + of.fall * time**2 / 2
    squared = of.plan_speed**2 + (of.velocity_z + of.fall * time) ** 2
    jump = np.maximum(0.0, z - _ground(terrain, here, height))
    energy = 0.5 * masses[of.row] * (squared + INERTIA_FACTOR * of.spin**2)
    passing = jump + radii[of.row] * _ground(terrain, here, steepness)
    found = (np.sqrt(squared), energy, jump, passing)
    return {"elevation": z, **dict(zip(QUANTITIES, found, strict=True))}


def _ground(
    terrain: Terrain | None, places: np.ndarray, what: Callable[..., np.ndarray]
) -> np.ndarray:
    """Number of the ground (`height` or `steepness`) at places; NaN where it is unknown."""
    found = np.full(places.shape, np.nan)
    if terrain is not None:
        z, grid = terrain
        known = inside(grid, places.real, places.imag)
        found[known] = what(z, grid, places.real[known], places.imag[known])
    return found


def _envelopes(values: dict[str, np.ndarray], source: Sources) -> dict[str, float]:
    """Quantiles with their intervals and the maximum of each quantity, where any is known."""
    row: dict[str, float] = {}
    for quantity in QUANTITIES:
        known = np.isfinite(values[quantity])
        if not known.any():
            continue
        numbers = sample_numbers(values[quantity][known], source[known])
        names = [one for name in LEVELS for one in with_limits(name)]
        row |= {f"{quantity}_{name}": numbers[name] for name in [*names, "max"]}
    return row
