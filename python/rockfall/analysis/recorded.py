# SPDX-License-Identifier: BSD-3-Clause
"""Observations from recorded trajectories of another program: numbers at the evaluation lines and
stopping places, as if they had been surveyed."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rockfall.errors import RockfallError
from rockfall.io.ramms import Recorded, read_trajectories

#: Name and vertices x, y of an evaluation line, as `rockfall.result.trajectories.lines` has them.
Line = tuple[str, np.ndarray, np.ndarray]
ENERGY_UNITS = {"J": 1.0, "kJ": 1000.0}
GRAVITY = 9.81  # [m/s2]
MOVING = 1.0  # [m/s] of the last record: the boulder has not come to rest


class Crossing(NamedTuple):
    """Numbers at the first crossing of a line."""

    speed: float  # [m/s]
    passing_height: float  # of the centre above the terrain, vertical [m]
    energy_total: float  # in the unit of the file


def recorded_numbers(
    paths: Sequence[str | Path], lines: Sequence[Line], energy_unit: str | None = None
) -> tuple[list[dict], list[dict], list[str]]:
    """Samples (line, quantity, value) and stops (x, y, start_x, start_y) of the trajectories of
    files, and notes for readers. Energies are taken if their unit, J or kJ, is given."""
    if energy_unit is not None and energy_unit not in ENERGY_UNITS:
        raise RockfallError(f"energy unit {energy_unit}: must be {' or '.join(ENERGY_UNITS)}")
    recorded = [read_trajectory for path in paths for read_trajectory in read_trajectories(path)]
    if not recorded:
        return [], [], []
    samples: list[dict] = []
    cross = []
    for name, x, y in lines:
        crossings = [(flight.where, crossing(flight, x, y)) for flight in recorded]
        met = [(where, met_at) for where, met_at in crossings if met_at is not None]
        cross.append(f"; {len(met):,} cross {name}")
        for where, passage in met:
            values = {"speed": passage.speed, "passing_height": max(0.0, passage.passing_height)}
            if energy_unit is not None:
                values["energy_total"] = ENERGY_UNITS[energy_unit] * passage.energy_total
            crossing_row = {"where": where, "line": name}
            samples += [crossing_row | {"quantity": key, "value": v} for key, v in values.items()]
    layout = f"{len(recorded):,} trajectories are read by a layout that is not confirmed"
    notes = ["".join([layout, *cross, "."])]
    if energy_unit is None:
        notes.append(_unit_note(recorded))
    moving = sum(float(np.linalg.norm(flight.velocity[-1])) > MOVING for flight in recorded)
    if moving:
        notes.append(
            f"{moving:,} trajectories end faster than {MOVING:g} m/s; they count with the distance "
            "they reached."
        )
    return samples, [_stop(flight) for flight in recorded], notes


def crossing(recorded: Recorded, x: np.ndarray, y: np.ndarray) -> Crossing | None:
    """First crossing of a polyline in plan; None if there is none.

    Between two records velocity and energy are linear in time, and height follows a parabola: exact
    in flight, and no lower than the boulder where it touches the ground in between.
    """
    place = _first_crossing(recorded.position[:, :2], np.column_stack([x, y]))
    if place is None:
        return None
    k, part = place

    def between(values: np.ndarray) -> np.ndarray:
        return values[k] + part * (values[k + 1] - values[k])

    duration = recorded.time[k + 1] - recorded.time[k]
    rise = GRAVITY / 2 * part * (1 - part) * duration**2
    height = between(recorded.position[:, 2]) - between(recorded.terrain) + rise
    speed = np.linalg.norm(between(recorded.velocity))
    return Crossing(float(speed), float(height), float(between(recorded.energy)))


def _first_crossing(path: np.ndarray, line: np.ndarray) -> tuple[int, float] | None:
    """Segment of a path (n, 2), and the fraction of it, where it first meets a line (m, 2)."""
    steps = np.diff(path, axis=0)
    best: tuple[int, float] | None = None
    for start, end in zip(line, line[1:], strict=False):
        side = end - start
        across = steps[:, 0] * side[1] - steps[:, 1] * side[0]
        away = start - path[:-1]
        with np.errstate(divide="ignore", invalid="ignore"):
            part = (away[:, 0] * side[1] - away[:, 1] * side[0]) / across
            along = (away[:, 0] * steps[:, 1] - away[:, 1] * steps[:, 0]) / across
        hits = (across != 0) & (part >= 0) & (part <= 1) & (along >= 0) & (along <= 1)
        for k in np.flatnonzero(hits)[:1].tolist():
            place = k, float(part[k])
            best = place if best is None else min(best, place)
    return best


def _stop(recorded: Recorded) -> dict:
    """Ends of a trajectory, as a row of stopping places."""
    (start_x, start_y), (x, y) = (recorded.position[k, :2].tolist() for k in (0, -1))
    return {"where": recorded.where, "x": x, "y": y, "start_x": start_x, "start_y": start_y}


def _unit_note(recorded: Iterable[Recorded]) -> str:
    """Note that energies are left out, with the mass that each unit would mean."""
    speeds = np.concatenate([np.linalg.norm(flight.velocity, axis=1) for flight in recorded])
    energies = np.concatenate([flight.energy for flight in recorded])
    fastest = int(np.argmax(speeds))
    text = "Energies of the trajectories are left out, their unit is not known"
    if not speeds[fastest] > 0:
        return f"{text}."
    mass = 2 * energies[fastest] / speeds[fastest] ** 2
    masses = (
        f"{unit} would be a block of at most {factor * mass:,.3g} kg"
        for unit, factor in ENERGY_UNITS.items()
    )
    return f"{text}: --energy-unit gives it ({', '.join(masses)})."
