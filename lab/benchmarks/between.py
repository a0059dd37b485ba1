# SPDX-License-Identifier: BSD-3-Clause
"""Accuracy of planes of tables between their parts, where about half of the boulders pass:

    python -m lab.benchmarks.between FOLDER [--tables 3]

FOLDER stores contacts and results; missing ones are computed, in about 25 minutes on one core.
Prints the fraction of boulders that pass 200 m of an even slope: by tables simulated at places
between the parts, and by the ground shipped by name, with the strength and relief of the place
(docs/archive/field_protocol.md, "Planes between their parts, judged" and "for the last time").
"""

import argparse
import json
import re
import tempfile
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from math import log, nan
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import rockfall
from benchmarks.evidence import record, with_origin
from benchmarks.machine import machine
from lab.benchmarks.plane import plane
from rockfall.evidence import Evidence
from rockfall.grounds.impact_tables import ImpactTable, reliefs_thrown, save_table
from rockfall.kernel_rules import USUAL_DENSITY, USUAL_WEIGHT
from rockfall.result.crossings import at_lines
from rockfall.scene.surface import SAFER
from rockfall_lab.blocks.case import restitution_of
from rockfall_lab.tables import table_of
from tools.ship_tables import RADIUS, contacts_of, part_case

LINE, SPEED, BOULDERS = 200.0, 5.0, 1000  # distance down the plane [m], initial speed [m/s], number
# Cell size [m], columns, rows above the release, length below the line [m]:
CELL, COLUMNS, ABOVE, BEYOND = 2.5, 120, 8, 160.0
ABOVE_RELIEF, STEP = 6.0, 1.5  # first slope minus relief, and step [degree]
NO_REST = 60.0  # rest angle [degree]: boulders rest only where blocks did
REST = {"ploughed": 27.0, "hard": 29.0}  # rest angles [degree]
LIKE = {"ploughed": "meadow", "hard": "compact"}  # shipped grounds of these models
THROWS, PATCHES, NEXT = 400, 32, 100  # throws and patches of a table; step of its seed
FIRST = 95101, 96101  # seeds of the first table, by trial
ALL = 10**9  # number of records
AWAY = 1.0  # from the slope on which half of the boulders pass [degree]
FOUND, JUDGED = 7, (8, 9)  # seeds of boulders: for that slope; for passing fractions, by trial
WRONG = 0.1  # bound of errors of passing fractions
IN_FIRST = 20  # places of the first trial
PLACES = (  # plane, strength / (rho_b g R_b), relief [degree]
    ("ploughed-compact", 17.0, 12.75),
    ("ploughed-compact", 17.0, 15.25),
    ("ploughed-compact", 34.0, 10.25),
    ("ploughed-compact", 68.0, 15.25),
    ("ploughed-compact", 136.0, 8.0),
    ("ploughed-compact", 136.0, 12.75),
    ("ploughed-compact", 272.0, 10.25),
    ("ploughed-compact", 540.0, 15.25),
    ("hard-compact", 48.0, 14.5),
    ("hard-compact", 120.0, 11.5),
    ("hard-compact", 300.0, 14.5),
    ("hard-compact", 750.0, 14.5),
    ("ploughed-compact", 48.0, 12.75),
    ("ploughed-compact", 96.0, 15.25),
    ("ploughed-compact", 192.0, 12.75),
    ("hard-compact", 190.0, 11.5),
    ("ploughed-elongated", 34.0, 11.5),
    ("ploughed-platy", 136.0, 11.5),
    ("hard-elongated", 120.0, 13.5),
    ("hard-platy", 300.0, 13.5),
    ("ploughed-compact", 17.0, 8.0),
    ("hard-compact", 300.0, 11.5),
    ("ploughed-compact", 34.0, 12.75),
    ("hard-compact", 1900.0, 14.5),
    ("ploughed-compact", 68.0, 10.25),
    ("hard-compact", 120.0, 17.5),
    ("ploughed-compact", 136.0, 15.25),
    ("hard-compact", 1900.0, 11.5),
    ("ploughed-compact", 272.0, 12.75),
    ("hard-compact", 48.0, 17.5),
    ("ploughed-compact", 540.0, 10.25),
    ("hard-compact", 750.0, 17.5),
    ("ploughed-compact", 34.0, 17.75),
    ("ploughed-compact", 272.0, 17.75),
)
SHIPPED = {"shipped": 0.0, "smaller relief": SAFER}  # relief reductions [degree]
GROUPS = {  # patterns of plane names
    "compact blocks": "[a-z]+-compact",
    "compact blocks, ploughed": "ploughed-compact",
    "compact blocks, hard": "hard-compact",
    "other shapes": ".*(elongated|platy)",
}

Keys = dict[str, dict[str, Any]]  # case keys by group


def passing(keys: Keys, slope: float, folder: Path, seed: int) -> float:
    """Fraction of boulders with R_b = RADIUS that pass LINE on an even slope [degree]. The case
    `keys` select the rebound; their files are in `folder`."""
    angle = np.radians(slope)
    rows = int((LINE * np.cos(angle) + BEYOND) / CELL)
    top, width = (rows - ABOVE) * CELL, COLUMNS * CELL
    fixed = {"volume": "fixed", "volume_mean": 4 / 3 * np.pi * RADIUS**3, "density": USUAL_DENSITY}
    case = rockfall.Case(
        folder=folder,
        case={"boulders": BOULDERS, "seed": seed},
        impact={"form": "table"} | keys["impact"],
        surface={"uniform_mean_radius": 0.1} | keys.get("surface", {}),
        boulder=fixed | {"ground_strength_sigma": 0.0} | keys.get("boulder", {}),
        release={
            "x": [width / 2], "y": [top], "drop_height": 0.5,
            "velocity": [0.0, -SPEED * np.cos(angle), -SPEED * np.sin(angle)],
        },
        line=[{"name": "line", "x": [0.0, width], "y": [top - LINE * np.cos(angle)] * 2}],
        output={"maps": None, "rebounds": False, "trajectories": 0},
    )  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about few boulders, steep planes, an unknown table
        result = rockfall.run(case, **plane(slope, rows, COLUMNS, CELL))
    return float(at_lines(result)["line_speed"].isel(line=0).notnull().mean())


def half_slope(table: ImpactTable, guess: float) -> float:
    """Slope [degree] on which half of the boulders pass by a table, interpolated in the logarithm
    of the odds between slopes STEP/2 apart."""
    keys = {"impact": {"table": "own.nc", "rest_angle": NO_REST}}
    odds: dict[float, float] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        save_table(table, folder / "own.nc")

        def passes(slope: float) -> bool:
            if slope not in odds:
                part = passing(keys, slope, folder, FOUND)
                part = float(np.clip(part, 0.5 / BOULDERS, 1 - 0.5 / BOULDERS))
                odds[slope] = log(part / (1 - part))
            return odds[slope] >= 0

        before, after = guess, guess
        up = not passes(guess)
        while passes(after) != up:
            before, after = after, after + (STEP if up else -STEP)
        low, high = sorted([before, after])
        middle = (low + high) / 2
        low, high = (low, middle) if passes(middle) else (middle, high)
    return low - odds[low] * (high - low) / (odds[high] - odds[low])


class Place:
    """A place between the parts of a plane; a folder stores its contacts and results."""

    def __init__(self, number: int, folder: Path):
        self.folder = folder
        self.trial, self.number = divmod(number, IN_FIRST)
        self.name, self.strength, self.relief = PLACES[number]
        self.model, self.shape = self.name.split("-")
        self.pressure = float(f"{self.strength * USUAL_WEIGHT * RADIUS:.6g}")

    def thrown(self, table: int) -> ImpactTable:
        """Table simulated at the place with seed number `table`; all contacts are records."""
        restitution = restitution_of(self.pressure, USUAL_DENSITY)
        ground = {"yield_pressure": self.pressure, "restitution": restitution}
        seed = FIRST[self.trial] + self.number + NEXT * table
        case = part_case(self.name, 0, 0).replace(
            lab={"throws": THROWS, "seed": seed},
            ground=ground | {"relief": self.relief, "patches": PATCHES},
        )
        return table_of([contacts_of(case, self.folder / f"{self.name}-place-{seed}.nc")], ALL)

    def slopes(self) -> tuple[float, float]:
        """Slopes of the trial [degree]."""

        def half(table: int) -> float:
            return half_slope(self.thrown(table), self.relief + ABOVE_RELIEF)

        middle = np.mean([self._stored(f"half-{m}", partial(half, m)) for m in range(2)])
        return round(middle - AWAY, 1), round(middle + AWAY, 1)

    def passing(self, column: str) -> list[float]:
        """Passing fractions on both slopes, for a column of the table of results."""

        def passes() -> list[float]:
            with tempfile.TemporaryDirectory() as name:
                folder = Path(name)
                keys = self.shipped(column) if column in SHIPPED else self._keys_of(column, folder)
                seed = JUDGED[self.trial]
                return [passing(keys, slope, folder, seed) for slope in self.slopes()]

        return self._stored(column.replace(" ", "-"), passes)

    def _stored(self, what: str, make: Callable[[], Any]) -> Any:
        path = self.folder / f"{self.name}-{self.strength:g}-{self.relief:g}.{what}.json"
        if not path.exists():
            path.write_text(json.dumps(make()))
        return json.loads(path.read_text())

    def shipped(self, column: str) -> Keys:
        """Keys of the ground shipped by name, with strength and relief of the place."""
        low, _ = reliefs_thrown(self.model, [self.shape])
        relief = max(low, self.relief - SHIPPED[column])
        own = {"ground_strength": self.pressure, "ground_relief": relief}
        return {
            "impact": {"table": LIKE[self.model]}, "surface": own,
            "boulder": {"block_shape": self.shape},
        }  # fmt: skip

    def _keys_of(self, column: str, folder: Path) -> Keys:
        table = self.thrown(int(column.split()[1]) - 1)
        ground = table.ground._replace(rest_angle=REST[self.model])  # the laboratory has none
        save_table(replace(table, ground=ground), folder / "own.nc")
        return {"impact": {"table": "own.nc", "rest_angle": REST[self.model]}}


def half_way(passes: Sequence[float], slopes: Sequence[float]) -> float:
    """Slope [degree] on which half of the boulders pass, from the logarithm of the odds on two
    slopes."""
    part = np.clip(passes, 0.5 / BOULDERS, 1 - 0.5 / BOULDERS)
    low, high = np.log(part / (1 - part))
    return slopes[0] - low * (slopes[1] - slopes[0]) / (high - low)


class Trial(NamedTuple):
    """Result at a place, on both slopes."""

    place: Place
    thrown: np.ndarray  # passing fractions by tables simulated there (table, slope)
    shipped: dict[str, np.ndarray]  # passing fractions on shipped ground, by column (slope)
    steeper: float  # slope on which half pass, shipped minus simulated [degree]


def trial(place: Place, n_tables: int) -> Trial:
    slopes = place.slopes()
    thrown = np.array([place.passing(f"thrown {m + 1}") for m in range(n_tables)])
    shipped = {column: np.array(place.passing(column)) for column in SHIPPED}
    half = np.mean([half_way(fractions, slopes) for fractions in thrown])
    return Trial(place, thrown, shipped, float(half_way(shipped["shipped"], slopes) - half))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--tables", type=int, default=3, help="simulated at each place")
    parser.add_argument("--write", action="store_true", help="record errors as evidence")
    given = parser.parse_args()
    print(machine())
    heads = *(f"simulated {m + 1}" for m in range(given.tables)), "mean", *SHIPPED
    print(f"| plane, N, relief, slope | {' | '.join(heads)} |\n|---{'|--:' * len(heads)}|")
    trials = []
    for k in range(len(PLACES)):
        place = Place(k, given.folder)
        found = trial(place, given.tables)
        for m, slope in enumerate(place.slopes()):
            thrown = found.thrown[:, m]
            values = *thrown, thrown.mean(), *(one[m] for one in found.shipped.values())
            cells = " | ".join(f"{value:.2f}" for value in values)
            where = f"{place.name} {place.strength:g}, {place.relief:g}, {slope:g}"
            print(f"| {where} | {cells} |", flush=True)
        trials.append(found)
    rows = [row for group, name in GROUPS.items() for row in errors(group, name, trials)]
    if given.write:
        record(rows)


def errors(group: str, name: str, trials: list[Trial]) -> list[Evidence]:
    """Print and return errors of the shipped ground in a group of places."""
    own = [one for one in trials if re.fullmatch(name, one.place.name)]
    variance = np.mean([one.thrown.var(axis=0, ddof=1) for one in own])
    standard_error = float(np.sqrt(variance / len(own[0].thrown)))
    rows = []
    for column in SHIPPED:
        off = np.array([one.shipped[column] - one.thrown.mean(axis=0) for one in own])
        numbers = {
            "passing_error": _mean(np.abs(off).mean(axis=1)),
            "passing_bias": _mean(off.mean(axis=1)),
            "passing_too_low": (float(-off.min()), standard_error),
        }
        if column == "shipped":
            steeper = np.array([one.steeper for one in own])
            numbers["half_slope_error"] = _mean(steeper)
            numbers["half_slope_too_steep"] = float(steeper.max()), nan
        rows += [
            with_origin(
                ("between-parts", group, quantity, column),
                "degree" if "slope" in quantity else "", nan, *values,
            )
            for quantity, values in numbers.items()
        ]  # fmt: skip
        too_low = int((off < -(WRONG + 2 * standard_error)).sum())
        print(f"{group}, {column}: {len(own)} places, too low by over {WRONG} + 2 SE: {too_low}")
    for row in rows:
        print(f"  {row.model}: {row.quantity} {row.error:+.3f} ± {row.standard_error:.3f}")
    return rows


def _mean(values: np.ndarray) -> tuple[float, float]:
    """Mean and its standard error."""
    return float(values.mean()), float(values.std(ddof=1) / len(values) ** 0.5)


if __name__ == "__main__":
    main()
