# SPDX-License-Identifier: BSD-3-Clause
"""Import of other programs' projects: the report on each input, and the case file."""

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn

import numpy as np

from rockfall.case import read_case
from rockfall.case.text import Entry, Group, case_text
from rockfall.case.variants import variants
from rockfall.draft.dem import read_source
from rockfall.errors import RockfallError
from rockfall.io.files import read_text, relative_name
from rockfall.io.rasters.dem import dem_header
from rockfall.io.rasters.geotiff import write_geotiff
from rockfall.io.rasters.grid import Grid
from rockfall.io.tables import plain_decimal
from rockfall.scene.read import read_scene
from rockfall.simulation.memory import machine_memory

CASE, DEM = "case.nml", "dem.tif"
#: Headings of the three lists that an import reports.
TAKEN, CHANGED, LEFT = "taken over", "imported with changes", "not imported"


@dataclass
class Import:
    """An import in progress. Its lists have a line for each input."""

    folder: Path
    dem: Path
    out: Path
    part: Path  # temporary folder for the files of `out`
    crs: str | None = None
    taken: list[str] = field(default_factory=list)
    changed: list[str] = field(default_factory=list)
    left: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        if self.crs is None:
            self.grid: Grid = dem_header(self.dem)[0]
        else:
            z, self.grid = read_source(self.dem, self.crs)[:2]
            self.write_raster(DEM, z)
        self.taken.append(f"{self.name(self.dem)}: the terrain")

    def name(self, path: Path) -> str:
        """Name of an input in the lists."""
        return relative_name(path.resolve(), self.folder.resolve())

    def refuse(self, path: Path, flaw: str) -> NoReturn:
        raise RockfallError(f"{path}: {flaw}")

    def terrain(self, place: Path) -> Group:
        """Group &terrain of a case in the folder `place`."""
        name = DEM if self.crs else relative_name(self.dem.resolve(), place.resolve())
        return Group("terrain", [Entry("dem", name, f"in {self.crs}" if self.crs else "")])

    def write_raster(self, name: str, values: np.ndarray) -> None:
        """Write a raster on the DEM cells to the case folder."""
        nodata = np.nan if values.dtype.kind == "f" else None
        path = self.part / name
        write_geotiff(path, values, self.grid, nodata=nodata, TIFFTAG_SOFTWARE="rockfall")

    def lists(self) -> dict[str, list[str]]:
        """All lines under their headings; empty lists are omitted."""
        lists = {TAKEN: self.taken, CHANGED: self.changed, LEFT: self.left}
        return {head: lines for head, lines in lists.items() if lines}

    def write(self, program: str, groups: Callable[[Path], Iterable[Group]]) -> None:
        """Write the case with `groups(place)`, whose file names are relative to the folder `place`;
        then check it by reading all its inputs."""
        head = [f"Made by `rockfall import-{program}` from {self.folder.resolve().name}."]
        head += ["Keys: docs/case.md."]
        foot = [
            line
            for title, lines in self.lists().items()
            for line in (f"{title}:", *(f"- {text}" for text in lines))
        ]
        path = self.part / CASE
        for place in self.part, self.out:
            path.write_text(case_text(head, groups(place), foot), encoding="utf-8")
            if place == self.part:
                case = read_case(path)
                for variant in variants(case).values() or [case]:
                    read_scene(variant, memory=machine_memory())
        read_case(path)


def only(paths: Iterable[Path], folder: Path, what: str) -> Path:
    """Return the only path; raises a RockfallError for none or several."""
    several = sorted(paths)
    if len(several) != 1:
        names = ", ".join(path.name for path in several) or "none"
        raise RockfallError(f"{folder}: must have exactly one {what} (found: {names})")
    return several[0]


def tree_rows(path: Path) -> tuple[list[str], bool]:
    """Lines of a CSV table made from a tree list (x, y, DBH separated by spaces, commas or
    semicolons), and True if the list has further columns. Refuses lists with invalid or no rows."""
    rows = ["x,y,dbh"]
    more = False
    for line, cells in _lines(read_text(path)):
        numbers = [plain_decimal(cell) for cell in cells[:3]]
        head = len(rows) == 1 and np.isnan(numbers).all()
        if head and not cells[0][0].isdigit():
            continue
        if len(numbers) < 3 or np.isnan(numbers).any():
            raise RockfallError(
                f"{path}: line {line}: must be x, y and DBH [cm], with decimal points"
            )
        more |= len(cells) > 3
        rows.append(",".join(map(repr, numbers)))
    if len(rows) == 1:
        raise RockfallError(f"{path}: contains no trees")
    return rows, more


def _lines(text: str) -> Iterator[tuple[int, list[str]]]:
    """Number and cells of each non-empty line. It is split at commas only if spaces and semicolons
    give at most two cells, because commas may be decimal signs."""
    for line, words in enumerate(text.splitlines(), start=1):
        cells = [cell for word in re.split(r"[\s;]+", words) if (cell := word.strip(","))]
        if len(cells) <= 2:
            cells = [cell for cell in re.split(r"[\s,;]+", words) if cell]
        if cells:
            yield line, cells
