# SPDX-License-Identifier: BSD-3-Clause
"""Planes of tables between their parts, on slopes where about half of the boulders pass:

    python -m lab.benchmarks.kept FOLDER [--tables 3]

FOLDER keeps contacts, those of parts as `tools/ship_tables.py --contacts FOLDER` does, slopes of
parts, choices and results; what is missing is made, in some three hours of one core. Prints the
fraction of boulders that passes 200 m of a plane: by tables thrown at the place, by the shipped
parts, and on compact blocks by a table of the four parts around the place, with evenly spaced
throws and with chosen ones (docs/archive/field_protocol.md, "Planes between their parts, judged").
Chosen are, of balanced throws, the first by which a part has the slope of all parts together, a
smooth surface over strength and relief.
"""

import argparse
import json
import tempfile
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import product
from math import log, nan
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import rockfall
from benchmarks.evidence import record, with_origin
from benchmarks.machine import machine
from lab.benchmarks.plane import plane
from rockfall.evidence import Evidence
from rockfall.grounds.impact_tables import FIELDS, KINDS, ImpactTable, save_table
from rockfall.kernel_rules import USUAL_DENSITY, USUAL_WEIGHT
from rockfall.result.crossings import at_lines
from rockfall_lab import tables
from rockfall_lab.blocks.case import restitution_of
from tools.ship_tables import KEPT, PLANES, RADIUS, contacts_of, part_case

LINE, SPEED, BOULDERS = 200.0, 5.0, 1000  # [m] down the plane, [m/s], number
CELL, COLUMNS, ABOVE, BEYOND = 2.5, 120, 8, 160.0  # [m]; cells, rows above the release; [m]
ABOVE_RELIEF, STEP, NEAR = 6.0, 1.5, 0.15  # slopes: first, step; tolerance [degree]
NO_REST = 60.0  # rest angle [degree]: boulders rest only where blocks did
STARTS = 12  # random starts of a choice
SOFT = 24.0  # strength / (rho_b g R_b): boulders sink into softer parts, which keep their slope
CLASSES = 6, 4  # numbers of classes of slope and of speed in which throws are balanced
EXTREME = 5.0  # standard deviations at which sums are clipped
STOPS, ALL = 2, 10**9  # exit code of a record; number of records
REST = {"ploughed": 27.0, "hard": 29.0}  # rest angles [degree]
LIKE = {"ploughed": "meadow", "hard": "compact"}  # shipped grounds of these models
THROWS, PATCHES, FIRST, NEXT = 400, 32, 95101, 100  # of a table thrown at a place; seeds
AWAY = 1.0  # from the slope on which half pass [degree]
JUDGED = 8  # seed of boulders at places
WRONG, ALIKE = 0.1, 0.03  # of what passes: bound, difference of the evenly spaced throws
PLACES = (  # plane, strength over rho_b g R_b, relief [degree]
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
)

Part = tuple[float, float]  # strength over rho_b g R_b, relief [degree]
Keys = dict[str, dict[str, Any]]  # of a case, by group


def balanced_throws(data: xr.Dataset, kept: int, start: int) -> np.ndarray:
    """Numbers of throws of a part that represent all its throws, with about `kept` contacts. From a
    random start, throws are exchanged as long as their sums approach the sums of all throws."""
    contacts = tables._dimensionless(data)
    throws, own = np.unique(contacts.sequence, return_inverse=True)
    sums = np.hstack([one for kind in KINDS for one in _sums(contacts, kind, own)])
    alike = sums @ sums.T
    size = np.diag(alike)
    number = int(kept / (len(own) / len(throws)))
    inside = np.zeros(len(throws), bool)
    inside[np.random.default_rng(start).permutation(len(throws))[:number]] = True
    while True:
        along = alike @ inside
        old, new = np.flatnonzero(inside), np.flatnonzero(~inside)
        change = (size[old] - 2 * along[old])[:, None] + (size[new] + 2 * along[new])
        change -= 2 * alike[np.ix_(old, new)]
        k, m = np.unravel_index(np.argmin(change), change.shape)
        if not change[k, m] < -1e-9 * size.sum():
            return throws[inside]
        inside[[old[k], new[m]]] = False, True


def _sums(contacts: Any, kind: str, own: np.ndarray) -> Iterator[np.ndarray]:
    """Sums over each throw, numbered `own`, of the deviations of its contacts from the means of
    their bins, and of their numbers: in total, by incidence and speed, by slope and speed, and by
    bin. All are standardised, and each way of counting has the same weight."""
    sizes = tables._bins_for(kind, int(tables._of_kind(contacts, kind).sum()))
    groups, _ = tables._sort_into_bins(contacts, kind, sizes)
    rows, bins = np.concatenate(groups), np.repeat(range(len(groups)), [*map(len, groups)])
    beyond = np.concatenate([_beyond_map(contacts.record[group], kind) for group in groups])
    beyond = np.clip(beyond / np.maximum(beyond.std(axis=0), 1e-9), -EXTREME, EXTREME)
    for k in range(len(groups)):
        beyond[bins == k] -= beyond[bins == k].mean(axis=0)
    values = np.column_stack([beyond, np.ones(len(rows))])
    slope, speed = (
        np.searchsorted(np.quantile(key, np.arange(1, n) / n), key)
        for key, n in zip(
            (contacts["pull_along"][rows], contacts["speed_in"][rows]), CLASSES, strict=True
        )
    )
    speeds, incidence = CLASSES[1], bins // (len(groups) // sizes[0])
    for place in (bins * 0, incidence * speeds + speed, slope * speeds + speed, bins):
        sums = np.zeros((own.max() + 1, place.max() + 1, values.shape[1]))
        np.add.at(sums, (own[rows], place), values)
        flat = sums.reshape(len(sums), -1)
        flat = flat - flat.mean(axis=0)
        norm = np.sqrt((flat**2).sum(axis=0))
        yield flat[:, norm > 0] / norm[norm > 0] / np.sqrt((norm > 0).sum())


def _beyond_map(record: np.ndarray, kind: str) -> np.ndarray:
    """Deviations of a bin's contacts from its map, exits, durations, lengths, minus the means."""
    value = {name: record[:, k].astype(float) for k, name in enumerate(FIELDS)}
    scale = value["speed_in"] if kind == "flight" else np.ones(len(record))
    height = value["height_in"] * (kind != "flight")
    inputs = np.stack([*(value[name] / scale for name in ("vt_in", "vn_in", "w_in")), height])
    free = value["along_out"] - value["pull_along"] * value["duration"]
    outputs = np.stack([free, value["vn_out"], value["w_out"]]) / scale
    left = [
        *(outputs - tables._bin(record, kind).map @ inputs),
        value["exit"] == STOPS, value["exit"] == tables.ROLLS_ON,
        value["duration"], value["advance"], value["rise"], np.abs(value["across_out"]) / scale,
    ]  # fmt: skip
    found = np.column_stack(left)
    return found - found.mean(axis=0)


def numbered(data: xr.Dataset, kept: int, chosen: Sequence[int]) -> xr.Dataset:
    """Contacts with throws reordered such that `table_of`, which keeps about `kept` contacts of
    evenly spaced throws, keeps the contacts of the chosen throws."""
    throws, own = np.unique(data["sequence"].values, return_inverse=True)
    number = int(kept / (len(own) / len(throws)))
    kept_places = (np.arange(number) * len(throws)) // number
    inside = np.isin(throws, chosen)
    assert inside.sum() == number, (inside.sum(), number)
    place = np.empty(len(throws), int)
    place[inside] = kept_places
    place[~inside] = np.setdiff1d(np.arange(len(throws)), kept_places)
    return data.assign(sequence=("contact", place[own]))


def passing(keys: Keys, slope: float, folder: Path, seed: int = 7) -> float:
    """The fraction of boulders of R_b = RADIUS that passes LINE on a plane [degree], by keys of a
    case in a folder."""
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
    """Slope [degree] on which half of the boulders pass, by a table: interpolated between
    neighbours within STEP/2, by the logarithm of the odds."""
    keys = {"impact": {"table": "own.nc", "rest_angle": NO_REST}}
    odds: dict[float, float] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        save_table(table, folder / "own.nc")

        def passes(slope: float) -> bool:
            if slope not in odds:
                part = passing(keys, slope, folder)
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


def smoothed(slopes: dict[Part, float]) -> dict[Part, float]:
    """Smoothed slopes of parts: a surface quadratic in ln N and relief is fitted, except for parts
    softer than SOFT."""
    firm = [part for part in slopes if part[0] >= SOFT]
    x, s = np.array([(log(part[0]), part[1]) for part in firm]).T
    terms = np.stack([np.ones_like(x), x, s, x * x, x * s, s * s], axis=1)
    fit = np.linalg.lstsq(terms, np.array([slopes[part] for part in firm]))[0]
    return slopes | dict(zip(firm, (terms @ fit).tolist(), strict=True))


def chosen_throws(data: xr.Dataset, slope: float) -> tuple[list[int], float]:
    """Throws of a part with about KEPT contacts for which half of the boulders pass on a given
    slope, and their own slope [degree], within NEAR; otherwise the nearest of STARTS."""
    tried: list[tuple[list[int], float]] = []
    while len(tried) < STARTS and not (tried and abs(tried[-1][1] - slope) <= NEAR):
        throws = balanced_throws(data, KEPT, 1 + len(tried)).tolist()
        table = tables.table_of([numbered(data, KEPT, throws)], KEPT)
        tried.append((throws, half_slope(table, round(slope, 2))))
    return min(tried, key=lambda one: abs(one[1] - slope))


class Folder:
    """What is kept of parts of planes and of places between them."""

    def __init__(self, path: Path):
        self.path = path

    def contacts(self, name: str, part: Part) -> xr.Dataset:
        column, row = PLANES[name].strengths.index(part[0]), PLANES[name].reliefs.index(part[1])
        case = part_case(name, column, row)
        return contacts_of(case, self.path / f"{name}-{part[0]:g}-{part[1]:g}.nc")

    def kept(self, name: str, part: Part, what: str, make: Callable[[], Any]) -> Any:
        path = self.path / f"{name}-{part[0]:g}-{part[1]:g}.{what}.json"
        if not path.exists():
            path.write_text(json.dumps(make()))
        return json.loads(path.read_text())

    def targets(self, name: str) -> dict[Part, float]:
        """Slopes on which half of the boulders should pass, for all parts of a plane."""

        def slope(part: Part) -> float:
            table = tables.table_of([self.contacts(name, part)], ALL)
            return half_slope(table, part[1] + ABOVE_RELIEF)

        parts = product(PLANES[name].strengths, PLANES[name].reliefs)
        return smoothed({p: self.kept(name, p, "slope", partial(slope, p)) for p in parts})

    def chosen(self, name: str, part: Part, target: float) -> xr.Dataset:
        """Contacts of a part, numbered so that a table keeps the chosen throws."""
        data = self.contacts(name, part)
        throws, _ = self.kept(name, part, "throws", partial(chosen_throws, data, target))
        return numbered(data, KEPT, throws)


class Place:
    """A place between the parts of a plane."""

    def __init__(self, number: int, folder: Folder):
        self.number, self.folder = number, folder
        self.name, *self.part = PLACES[number]
        self.model, self.shape = self.name.split("-")
        self.pressure = float(f"{self.part[0] * USUAL_WEIGHT * RADIUS:.6g}")

    def thrown(self, table: int) -> ImpactTable:
        """Table thrown at the place, of all its contacts."""
        restitution = restitution_of(self.pressure, USUAL_DENSITY)
        ground = {"yield_pressure": self.pressure, "restitution": restitution}
        seed = FIRST + self.number + NEXT * table
        case = part_case(self.name, 0, 0).replace(
            lab={"throws": THROWS, "seed": seed},
            ground=ground | {"relief": self.part[1], "patches": PATCHES},
        )
        path = self.folder.path / f"{self.name}-place-{seed}.nc"
        return tables.table_of([contacts_of(case, path)], ALL)

    def of_parts(self, chosen: bool) -> ImpactTable:
        """Table of the parts around the place, with chosen or evenly spaced throws, for ground of
        the same relief for all sizes."""
        strengths, reliefs, *_ = PLANES[self.name]
        parts = [
            part
            for part in product(strengths, reliefs)
            if _beside(part[0], self.part[0], strengths) and _beside(part[1], self.part[1], reliefs)
        ]
        if chosen:
            targets = self.folder.targets(self.name)
            data = [self.folder.chosen(self.name, part, targets[part]) for part in parts]
        else:
            data = [self.folder.contacts(self.name, part) for part in parts]
        table = tables.table_of(data, KEPT * len(data))
        ground = table.ground._replace(
            strength=self.pressure, relief=self.part[1], relief_radius=1.0, hurst=1.0
        )
        return replace(table, ground=ground)

    def slopes(self) -> tuple[float, float]:
        """Slopes of the trial [degree]."""

        def half(table: int) -> float:
            return half_slope(self.thrown(table), self.part[1] + ABOVE_RELIEF)

        middle = np.mean([self.kept(f"half-{m}", partial(half, m)) for m in range(2)])
        return round(middle - AWAY, 1), round(middle + AWAY, 1)

    def kept(self, what: str, make: Callable[[], Any]) -> Any:
        return self.folder.kept(self.name, (self.part[0], self.part[1]), what, make)

    def passing(self, column: str) -> list[float]:
        """What passes on both slopes, by a column of the table of results."""

        def passes() -> list[float]:
            with tempfile.TemporaryDirectory() as name:
                keys = self.shipped if column == "shipped" else self._own(column, Path(name))
                return [passing(keys, slope, Path(name), JUDGED) for slope in self.slopes()]

        return self.kept(column.replace(" ", "-"), passes)

    @property
    def shipped(self) -> Keys:
        own = {"ground_strength": self.pressure, "ground_relief": self.part[1]}
        return {
            "impact": {"table": LIKE[self.model]}, "surface": own,
            "boulder": {"block_shape": self.shape},
        }  # fmt: skip

    def _own(self, column: str, folder: Path) -> Keys:
        if column.startswith("thrown"):
            table = self.thrown(int(column.split()[1]) - 1)
        else:
            table = self.of_parts(column == "chosen")
        ground = table.ground._replace(rest_angle=REST[self.model])  # the laboratory has none
        save_table(replace(table, ground=ground), folder / "own.nc")
        return {"impact": {"table": "own.nc", "rest_angle": REST[self.model]}}


def _beside(value: float, place: float, values: Sequence[float]) -> bool:
    """Return True if a value is the place or one of the two around it."""
    k = int(np.searchsorted(values, place))
    return value == place or (place not in values and value in values[k - 1 : k + 1])


def half_way(passes: Sequence[float], slopes: Sequence[float]) -> float:
    """The slope [degree] on which half pass, from the logarithm of the odds on two slopes."""
    part = np.clip(passes, 0.5 / BOULDERS, 1 - 0.5 / BOULDERS)
    low, high = np.log(part / (1 - part))
    return slopes[0] - low * (slopes[1] - slopes[0]) / (high - low)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("contacts", type=Path)
    parser.add_argument("--tables", type=int, default=3, help="thrown at each place")
    parser.add_argument("--write", action="store_true", help="record errors as evidence")
    given = parser.parse_args()
    print(machine())
    places = [Place(k, Folder(given.contacts)) for k in range(len(PLACES))]
    compact = [place for place in places if place.shape == "compact"]
    others = [place for place in places if place not in compact]
    thrown = [f"thrown {m + 1}" for m in range(given.tables)]
    rows = judge("compact blocks", compact, thrown, ["shipped", "even", "chosen"])
    rows += judge("elongated and platy blocks", others, thrown, ["shipped"])
    if given.write:
        record(rows)


def judge(title: str, places: list[Place], thrown: list[str], columns: list[str]) -> list[Evidence]:
    """Print what passes at places, and errors of the columns. Returns evidence on the first."""
    heads = *thrown, "mean", *columns
    print(f"\n| {title}: plane, N, relief, slope | {' | '.join(heads)} |")
    print(f"|---{'|--:' * len(heads)}|")
    found, half = [], []
    for place in places:
        own = np.array([place.passing(column) for column in (*thrown, *columns)])  # (column, slope)
        slopes = place.slopes()
        found.append(own.T)
        half.append([half_way(values, slopes) for values in own])
        for slope, values in zip(slopes, own.T, strict=True):
            of_thrown, rest = values[: len(thrown)], values[len(thrown) :]
            cells = " | ".join(f"{value:.2f}" for value in (*of_thrown, of_thrown.mean(), *rest))
            where = f"{place.name} {place.part[0]:g}, {place.part[1]:g}, {slope:g}"
            print(f"| {where} | {cells} |", flush=True)
    of_thrown, rest = np.split(np.array(found), [len(thrown)], axis=-1)  # (place, slope, column)
    off = rest - of_thrown.mean(axis=-1, keepdims=True)
    error = np.sqrt(of_thrown.var(axis=-1, ddof=1).mean() / len(thrown))
    low = off < -(WRONG + 2 * error)
    by_place = np.abs(off).mean(axis=1)
    steeper = np.array(half)[:, len(thrown) :] - np.array(half)[:, : len(thrown)].mean(1)[:, None]
    print(f"standard error of a reference {error:.3f}")
    for k, column in enumerate(columns):
        deviation = steeper[:, k].std(ddof=1)
        print(
            f"{column}: mean error {_mean(by_place[:, k])}, with sign "
            f"{_mean(off[..., k].mean(axis=1))}, from {off[..., k].min():+.2f} to "
            f"{off[..., k].max():+.2f}, too low {low[..., k].sum()}; half pass on slopes steeper "
            f"by {_mean(steeper[:, k])} degrees, deviation {deviation:.2f}"
        )
    if "chosen" in columns:
        apart = np.abs(rest[..., 1] - rest[..., 0]).mean()
        print(f"evenly spaced and shipped differ by {apart:.3f} (bound {ALIKE:g})")
        print(f"chosen nearer by {_mean(by_place[:, 0] - by_place[:, 2])}")
        print(f"too low as chosen, not as shipped: {int((low[..., 2] & ~low[..., 0]).sum())}")
    steep = steeper[:, 0]
    return [
        with_origin(("between-parts", title, quantity, "shipped"), unit, nan, *numbers)
        for quantity, unit, numbers in (
            ("passing_error", "", _mean_of(by_place[:, 0])),
            ("passing_too_low", "", (-off[..., 0].min(), error)),
            ("half_slope_error", "degree", _mean_of(steep)),
            ("half_slope_too_steep", "degree", (steep.max(), nan)),
        )
    ]


def _mean_of(values: np.ndarray) -> tuple[float, float]:
    """Mean and its standard error."""
    return float(values.mean()), float(values.std(ddof=1) / len(values) ** 0.5)


def _mean(values: np.ndarray) -> str:
    return "{:+.3f} ± {:.3f}".format(*_mean_of(values))


if __name__ == "__main__":
    main()
