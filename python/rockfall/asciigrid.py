# SPDX-License-Identifier: BSD-3-Clause
"""The numbers of ESRI ASCII grids, read strictly and written so that they come back the same.

GDAL reads the headers, but takes a file that ends early, or a word, for zeros; so the numbers
are read here.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np

from rockfall.errors import RockfallError
from rockfall.files import whole_file
from rockfall.grid import NO_ID, Grid

_KEYS = {
    b"ncols", b"nrows", b"xllcorner", b"yllcorner", b"xllcenter", b"yllcenter",
    b"cellsize", b"dx", b"dy", b"nodata_value",
}  # fmt: skip
_CHUNK = 4_000_000  # bytes of text in memory at a time
_LONGEST = 4096  # bytes; no number is as long


def check_size(path: str, ny: int, nx: int) -> None:
    """Refuse a header that promises more numbers than the file has room for."""
    if Path(path).stat().st_size < 2 * nx * ny:
        raise RockfallError(
            f"{path}: too short for ncols x nrows = {nx} x {ny} numbers: truncated or damaged"
        )


def read_rows(path: str, ny: int, nx: int) -> Iterator[tuple[slice, np.ndarray]]:
    """Blocks of whole rows from the north: (which rows, float64 of shape (n, nx)).

    Lines may be wrapped. A word, or too few or too many numbers, is an error.
    """
    due = f"ncols x nrows = {nx} x {ny} are due"
    held, done = np.empty(0), 0
    with open(path, "rb") as file:
        for numbers in _numbers(file, path, _skip_header(file)):
            held = np.concatenate((held, numbers))
            if done * nx + held.size > nx * ny:
                raise RockfallError(f"{path}: more than {nx * ny} numbers, {due}")
            n = held.size // nx
            if n:
                yield slice(done, done + n), held[: n * nx].reshape(n, nx)
            held = held[n * nx :]
            done += n
    if done < ny:
        raise RockfallError(
            f"{path}: ends after {done * nx + held.size} numbers, {due}: truncated or damaged"
        )


def write_ascii(path: str | Path, array: np.ndarray, grid: Grid, nodata: float = -9999) -> None:
    """Write an ESRI ASCII grid whose numbers and edges read back to the same doubles.

    NaN, and `NO_ID` among integers, become `nodata`. The CRS goes to a .prj file beside it.
    """
    if array.shape != grid.shape:
        raise RockfallError(f"{path}: array {array.shape} is not of the grid {grid.shape}", code=1)
    corner = _corner(path, grid)
    header = f"ncols {grid.nx}\nnrows {grid.ny}\n{corner}\nNODATA_value {nodata}\n"
    with whole_file(path) as part, open(part, "w", encoding="ascii", newline="\n") as file:
        file.write(header)
        for row in array:
            file.write(_row_text(path, row, nodata) + "\n")
    if grid.crs is not None:
        from rasterio.enums import WktVersion

        with whole_file(Path(path).with_suffix(".prj")) as part:
            part.write_text(grid.crs.to_wkt(version=WktVersion.WKT1_ESRI), encoding="utf-8")


def _row_text(path: str | Path, row: np.ndarray, nodata: float) -> str:
    if (row == nodata).any():
        raise RockfallError(f"{path}: {nodata} is a value of the raster, it cannot mark nodata")
    if row.dtype.kind == "f":
        missing = np.isnan(row)
        words = list(map(repr, row.tolist()))  # a float32 is written as the double it equals
    else:
        missing = row == NO_ID
        words = list(map(str, row.astype(np.int64).tolist()))
    for k in np.flatnonzero(missing):
        words[k] = str(nodata)
    return " ".join(words)


def _corner(path: str | Path, grid: Grid) -> str:
    """The part of the header from which readers, who add, get the very doubles of the edges.

    north = yllcorner + nrows*cellsize. Now and then no yllcorner does it; then a dy does that
    differs from dx in its last bits.
    """
    north, cell = float(grid.north), float(grid.cell)
    for dy in _neighbours(cell):
        height = grid.ny * dy
        for south in _neighbours(north - height):
            if south + height == north:
                size = f"cellsize {cell!r}" if dy == cell else f"dx {cell!r}\ndy {dy!r}"
                return f"xllcorner {float(grid.west)!r}\nyllcorner {south!r}\n{size}"
    raise RockfallError(f"{path}: no ESRI ASCII header gives the northern edge {north!r}; round it")


def _neighbours(value: float) -> Iterator[float]:
    """A double and those next to it, outwards."""
    yield value
    below = above = value
    for _ in range(8):
        below, above = math.nextafter(below, -math.inf), math.nextafter(above, math.inf)
        yield from (below, above)


def _skip_header(file: BinaryIO) -> int:
    """Move to the first number; returns its line, counted from 1."""
    line = 1
    while True:
        start = file.tell()
        words = file.readline(_LONGEST).split(maxsplit=1)
        if not words or words[0].lower() not in _KEYS:
            file.seek(start)
            return line
        line += 1


def _numbers(file: BinaryIO, path: str, line: int) -> Iterator[np.ndarray]:
    """The numbers of the rest of the file, some at a time; `line` is where it starts."""
    tail = b""
    while block := file.read(_CHUNK):
        text = tail + block
        cut = max(text.rfind(space) for space in (b" ", b"\n", b"\t", b"\r")) + 1
        text, tail = text[:cut], text[cut:]
        if len(tail) > _LONGEST:
            raise RockfallError(f"{path}: not text with numbers; damaged")
        yield _parse(text, path, line)
        line += text.count(b"\n")
    yield _parse(tail, path, line)


def _parse(text: bytes, path: str, line: int) -> np.ndarray:
    if not text.strip():
        return np.empty(0)
    try:
        return np.fromstring(text, sep=" ")
    except ValueError:
        number, word = _first_bad_word(text)
        raise RockfallError(f"{path}: line {line + number}: {word!r} is not a number") from None


def _first_bad_word(text: bytes) -> tuple[int, str]:
    """The first word that is no number, and how many lines precede it."""
    for number, row in enumerate(text.split(b"\n")):
        for word in row.split():
            try:
                float(word.replace(b"_", b"?"))  # Python's 1_000 is not a number here
            except ValueError:
                return number, word[:40].decode("ascii", "replace")
    return 0, "?"
