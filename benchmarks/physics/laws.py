# SPDX-License-Identifier: BSD-3-Clause
"""Rebound models by their names in site benchmarks: the matrix, impact tables, and rows of a ground
table.

`--law NAME=TABLE` is a shipped impact table or a file, where {shape} in the name is replaced by the
block shape; `TABLE@27` adds a `rest_angle` of 27 degrees. `--ground ROW` is a classical rebound
from a row of the shipped ground table; `ROW@16` adds a `roughness_angle` of 16 degrees; `TABLE:ROW`
is a row of another shipped ground table or of a file.
"""

import argparse
import csv
import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from rockfall.grounds import (
    GroundTable,
    other_tables,
    shipped_grounds,
    shipped_rows,
    table_names,
    yielding_ground,
)

ROCKS = 0.2  # R_m for the matrix [m]
OBSTACLES = 0.1  # obstacle height on classical grounds, used by rockyfor3d [m]


@dataclass(frozen=True)
class Law:
    """Rebound model: keys of the case by group, with {shape} for the block shape, and the mean rock
    radius [m] for sites without rock sizes."""

    name: str
    keys: dict[str, dict[str, Any]]
    radius: float | None = None

    def of(self, shape: str) -> dict[str, dict[str, Any]]:
        """Keys for a block shape, at a site with rock sizes."""
        return {
            group: {
                key: value.format(shape=shape) if isinstance(value, str) else value
                for key, value in keys.items()
            }
            for group, keys in self.keys.items()
        }

    def everywhere(self, shape: str) -> dict[str, dict[str, Any]]:
        """Keys for a block shape, at a site without rock sizes."""
        found = self.of(shape)
        if self.radius is not None:
            found["surface"] = found.get("surface", {}) | {"uniform_mean_radius": self.radius}
        return found

    def added(self, groups: dict[str, dict[str, Any]], shape: str) -> dict[str, dict[str, Any]]:
        """Groups of a case with these keys added."""
        keys = self.everywhere(shape)
        return {name: groups.get(name, {}) | keys.get(name, {}) for name in groups | keys}


def matrix() -> Law:
    """Model by the matrix, with the default impact set and rocks of R_m = ROCKS."""
    return Law(f"matrix, R_m {ROCKS} m", {"impact": {"form": "matrix"}}, ROCKS)


def table(text: str) -> Law:
    """Model for NAME=TABLE or NAME=TABLE@REST_ANGLE."""
    name, _, file = text.partition("=")
    file, _, angle = (file or name).partition("@")
    rest = {"rest_angle": float(angle)} if angle else {}
    impact = {"form": "table", "table": file, "ratio": None} | rest
    return Law(name, {"impact": impact, "boulder": {"block_shape": "{shape}"}}, ROCKS)


def ground(text: str) -> Law:
    """Model for ROW, ROW@ROUGHNESS or TABLE:ROW."""
    where, _, row = text.rpartition(":")
    row, _, roughness = row.partition("@")
    path = other_tables().get(where, Path(where)) if where else shipped_grounds()
    if roughness:
        path = _roughened(path, float(roughness))
    surface = {"ground": row, "ground_table": str(path)}
    keys = {"impact": {"form": "matrix", "ratio": None}, "surface": surface}
    if row in GroundTable(path).yielding:
        return Law(text, keys | {"boulder": {"block_shape": "{shape}"}})
    return Law(text, keys, OBSTACLES / 2)


def changed_ground(name: str, ground: str, **values: float) -> Law:
    """Rebound model of a shipped ground with impact tables and changed values: strength [Pa],
    relief [degree] and others."""
    model, own = yielding_ground(shipped_rows().rows[ground])
    row = own._asdict() | values
    path = Path(_folder().name) / f"{name}.csv"
    head, cells = ",".join(row), ",".join(map(repr, row.values()))
    path.write_text(f"name,model,source,{head}\nown,{model},tried,{cells}\n")
    unused = {"ratio": None, "sets": None, "turning": None}
    surface = {"ground": "own", "ground_table": str(path)}
    keys = {"impact": {"form": "matrix"} | unused, "surface": surface}
    return Law(name, keys | {"boulder": {"block_shape": "{shape}"}})


@cache
def _roughened(path: Path, roughness: float) -> Path:
    """Ground table with another `roughness_angle` [degree]."""
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    made = Path(_folder().name) / f"{path.stem}-{roughness:g}.csv"
    with made.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        for row in rows:
            if row["roughness_angle"]:
                row["roughness_angle"] = f"{roughness:g}"
            writer.writerow(row)
    return made


@cache
def _folder() -> tempfile.TemporaryDirectory:
    """Folder that exists as long as the process."""
    return tempfile.TemporaryDirectory(prefix="grounds-")


def shipped_table_laws() -> list[Law]:
    """Model for each shipped impact table."""
    return [table(name) for name in table_names()]


def add_laws(parser: argparse.ArgumentParser) -> None:
    """Add the repeatable options `--law` and `--ground` to a command, as one list `law`."""
    parser.add_argument("--law", type=table, action="append", default=[], metavar="NAME=TABLE")
    parser.add_argument(
        "--ground", type=ground, action="append", dest="law", metavar="[TABLE:]ROW[@ROUGHNESS]"
    )
