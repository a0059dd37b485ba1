# SPDX-License-Identifier: BSD-3-Clause
"""Throws kept in a plane of tables, and passing fractions between its parts:

    python -m lab.benchmarks.kept FOLDER [--tables 2]

FOLDER stores contacts (of parts, as `tools/ship_tables.py --contacts FOLDER`), slopes of parts, and
choices; missing files are computed, in about two hours on one core. Prints the fraction of boulders
that passes 200 m of a plane, by tables simulated there, by the shipped parts, and by parts with
chosen throws: the first balanced set of throws that gives a part its slope on a smooth surface over
strength and relief (docs/archive/field_protocol.md, "Throws that are kept").
"""

import argparse
import json
import tempfile
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import product
from math import log
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import rockfall
from benchmarks.machine import machine
from lab.benchmarks.plane import plane
from rockfall.grounds.impact_tables import FIELDS, KINDS, ImpactTable, save_table
from rockfall.kernel_rules import USUAL_DENSITY, USUAL_WEIGHT
from rockfall.result.crossings import at_lines
from rockfall_lab import tables
from rockfall_lab.blocks.case import BlockCase, restitution_of
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
THROWS, PATCHES, FIRST, NEXT = 400, 32, 94101, 100  # a table at a place; its seeds
LOW, HIGH, WRONG = 0.2, 0.9, 0.1  # passing fractions
PLACES = (  # plane, strength / (rho_b g R_b), relief [degree], slopes [degree]
    ("ploughed-compact", 17.0, 10.25, (17.2, 19.2)),
    ("ploughed-compact", 34.0, 8.0, (14.1, 16.1)),
    ("ploughed-compact", 34.0, 15.25, (20.9, 22.9)),
    ("ploughed-compact", 68.0, 12.75, (17.9, 19.9)),
    ("ploughed-compact", 68.0, 17.75, (22.9, 24.9)),
    ("ploughed-compact", 136.0, 10.25, (15.7, 17.7)),
    ("ploughed-compact", 272.0, 15.25, (19.6, 21.6)),
    ("ploughed-compact", 540.0, 12.75, (17.9, 19.9)),
    ("hard-compact", 48.0, 11.5, (16.2, 18.2)),
    ("hard-compact", 120.0, 14.5, (18.7, 20.7)),
    ("hard-compact", 300.0, 17.5, (21.3, 23.3)),
    ("hard-compact", 750.0, 11.5, (16.2, 18.2)),
)

Part = tuple[float, float]  # strength / (rho_b g R_b), relief [degree]


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


def passing(keys: dict[str, dict[str, Any]], slope: float, folder: Path) -> float:
    """Fraction of boulders with R_b = RADIUS that passes LINE on a plane [degree], by case keys in
    a folder."""
    angle = np.radians(slope)
    rows = int((LINE * np.cos(angle) + BEYOND) / CELL)
    top, width = (rows - ABOVE) * CELL, COLUMNS * CELL
    fixed = {"volume": "fixed", "volume_mean": 4 / 3 * np.pi * RADIUS**3, "density": USUAL_DENSITY}
    case = rockfall.Case(
        folder=folder,
        case={"boulders": BOULDERS, "seed": 7},
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
    """Stored results for parts of planes."""

    def __init__(self, path: Path):
        self.path = path

    def contacts(self, name: str, part: Part) -> xr.Dataset:
        column, row = PLANES[name].strengths.index(part[0]), PLANES[name].reliefs.index(part[1])
        case = part_case(name, column, row)
        return contacts_of(case, self.path / f"{name}-{part[0]:g}-{part[1]:g}.nc")

    def _kept(self, name: str, part: Part, what: str, make: Callable[[], Any]) -> Any:
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
        return smoothed({p: self._kept(name, p, "slope", partial(slope, p)) for p in parts})

    def chosen(self, name: str, part: Part, target: float) -> xr.Dataset:
        """Contacts of a part, numbered so that a table keeps the chosen throws."""
        data = self.contacts(name, part)
        throws, _ = self._kept(name, part, "throws", partial(chosen_throws, data, target))
        return numbered(data, KEPT, throws)


def place_case(name: str, strength: float, relief: float, seed: int) -> BlockCase:
    """Laboratory case for a place between the parts of a plane."""
    pressure = float(f"{strength * USUAL_WEIGHT * RADIUS:.6g}")
    restitution = restitution_of(pressure, USUAL_DENSITY)
    ground = {"yield_pressure": pressure, "restitution": restitution, "relief": relief}
    return part_case(name, 0, 0).replace(
        lab={"throws": THROWS, "seed": seed}, ground=ground | {"patches": PATCHES}
    )


def around(name: str, strength: float, relief: float) -> list[Part]:
    """The four parts of a plane around a place."""
    strengths, reliefs, *_ = PLANES[name]
    column, row = np.searchsorted(strengths, strength), np.searchsorted(reliefs, relief)
    return [*product(strengths[column - 1 : column + 1], reliefs[row - 1 : row + 1])]


def at_place(k: int, kept: Folder, n_tables: int, targets: dict[Part, float]) -> np.ndarray:
    """Passing fractions at place k, (slope, table): tables simulated there, shipped, chosen."""
    name, strength, relief, slopes = PLACES[k]
    model, shape = name.split("-")
    thrown = [
        tables.table_of([contacts_of(case, kept.path / f"{name}-place-{seed}.nc")], ALL)
        for seed in (FIRST + k + NEXT * m for m in range(n_tables))
        for case in [place_case(name, strength, relief, seed)]
    ]
    parts = [kept.chosen(name, part, targets[part]) for part in around(name, strength, relief)]
    chosen = tables.table_of(parts, KEPT * len(parts))
    pressure = strength * USUAL_WEIGHT * RADIUS
    ground = chosen.ground._replace(
        strength=pressure, relief=relief, relief_radius=1.0, hurst=1.0
    )  # the same relief for all sizes
    own = {"ground_strength": pressure, "ground_relief": relief}
    shipped = {
        "impact": {"table": LIKE[model]}, "surface": own, "boulder": {"block_shape": shape}
    }  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        keys = []
        for m, table in enumerate((*thrown, replace(chosen, ground=ground))):
            ground = table.ground._replace(rest_angle=REST[model])  # the laboratory has none
            save_table(replace(table, ground=ground), Path(folder) / f"{m}.nc")
            keys.append({"impact": {"table": f"{m}.nc", "rest_angle": REST[model]}})
        keys.insert(n_tables, shipped)
        return np.array([[passing(one, slope, Path(folder)) for one in keys] for slope in slopes])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("contacts", type=Path)
    parser.add_argument("--tables", type=int, default=2, help="thrown at each place")
    given = parser.parse_args()
    print(machine())
    kept = Folder(given.contacts)
    targets = {name: kept.targets(name) for name in dict.fromkeys(place[0] for place in PLACES)}
    heads = *(f"thrown {m + 1}" for m in range(given.tables)), "mean", "shipped", "chosen"
    print(f"| plane, N, relief, slope | {' | '.join(heads)} |\n|---{'|--:' * len(heads)}|")
    found = []
    for k, (name, strength, relief, slopes) in enumerate(PLACES):
        found.append(at_place(k, kept, given.tables, targets[name]))
        for slope, one in zip(slopes, found[-1], strict=True):
            values = *one[:-2], one[:-2].mean(), *one[-2:]
            cells = " | ".join(f"{value:.2f}" for value in values)
            print(f"| {name} {strength:g}, {relief:g}, {slope:g} | {cells} |", flush=True)
    judge(np.array(found))


def judge(found: np.ndarray) -> None:
    """Print errors of the passing fractions, (place, slope, table), as shipped and as chosen."""
    thrown, reference = found[..., :-2], found[..., :-2].mean(axis=-1)
    error = np.sqrt(thrown.var(axis=-1, ddof=1).mean() / thrown.shape[-1])
    counts = (reference >= LOW) & (reference <= HIGH)
    off = np.where(counts[..., None], found[..., -2:] - reference[..., None], np.nan)
    by_place = np.nanmean(np.abs(off), axis=1)
    by_place = by_place[counts.any(axis=1)]
    gain = by_place[:, 0] - by_place[:, 1]
    low = off < -(WRONG + 2 * error)
    print(f"standard error of a reference {error:.3f}; {counts.sum()} slopes count")
    print("mean error {:.3f} as shipped, {:.3f} as chosen".format(*by_place.mean(axis=0)))
    print(f"nearer by {gain.mean():.3f} ± {gain.std(ddof=1) / len(gain) ** 0.5:.3f}")
    print("mean, with sign {:+.3f}, {:+.3f}".format(*np.nanmean(off, axis=(0, 1))))
    print("too low: {} as shipped, {} as chosen".format(*low.sum(axis=(0, 1))))
    print(f"too low as chosen, not as shipped: {int((low[..., 1] & ~low[..., 0]).sum())}")


if __name__ == "__main__":
    main()
