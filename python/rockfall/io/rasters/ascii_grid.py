# SPDX-License-Identifier: BSD-3-Clause
"""Strict reader of ESRI ASCII grids.

GDAL replaces missing and invalid tokens by zeros, in the header as well as in the data. Therefore
everything except the CRS is read here.
"""

import math
import os
import re
import warnings
from codecs import BOM_UTF8
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from rockfall.errors import RockfallError
from rockfall.io.files import start_of
from rockfall.io.rasters.grid import Box, Transform
from rockfall.io.tables import plain_decimal
from rockfall.limits import MAX_REAL

_KEYS = (
    "ncols", "nrows", "xllcorner", "yllcorner", "xllcenter", "yllcenter", "cellsize", "dx", "dy",
    "nodata_value",
)  # fmt: skip
_CHUNK = 4_000_000  # bytes of text in memory
_HUGE = 1e30  # beyond any elevation; nodata such as -3.4e38 is written with 6 to 17 digits
_OVERFLOW = re.compile(r"[-+]?1\.79769\d*e\+?308", re.IGNORECASE)
_MAX_TOKEN = 4096  # [bytes] longer than any number


@dataclass(frozen=True)
class AsciiCells:
    """Cells of a file, read after its header."""

    path: str
    shape: tuple[int, int]
    transform: Transform
    nodata: float | None  #: value in the header
    start: tuple[int, int]  #: byte offset and line of the first number
    dtype = np.dtype(np.float64)
    packing = 1.0, 0.0

    def rows(self, box: Box) -> Iterator[tuple[slice, np.ndarray, np.ndarray]]:
        """Yield blocks of the rows of a box: (rows in the file, values, valid mask)."""
        # The default of the format is -9999.
        nodata = -9999.0 if self.nodata is None else self.nodata
        for rows, block in self._whole_rows():
            if rows.start >= box.stop_row and box.stop_row < self.shape[0]:
                return  # if the box ends at the last row, read on: invalid text may follow
            first, stop = max(rows.start, box.row), min(rows.stop, box.stop_row)
            if first < stop:
                block = block[first - rows.start : stop - rows.start, box.columns]
                yield slice(first, stop), block, ~_is_nodata(block, nodata)

    def _whole_rows(self) -> Iterator[tuple[slice, np.ndarray]]:
        """Yield blocks of complete rows from the north: (rows, float64 of shape (n, nx)).

        Lines may be wrapped. Invalid, missing and surplus tokens are errors.
        """
        (ny, nx), path = self.shape, self.path
        due = f"ncols x nrows = {nx} x {ny} expected"
        held, done = np.empty(0), 0
        with open(path, "rb") as file:
            file.seek(self.start[0])
            for numbers in _numbers(file, path, self.start[1]):
                held = np.concatenate((held, numbers))
                if done * nx + held.size > nx * ny:
                    raise RockfallError(f"{path}: more than {nx * ny} values, {due}")
                n = held.size // nx
                if n:
                    yield slice(done, done + n), held[: n * nx].reshape(n, nx)
                held = held[n * nx :]
                done += n
        if done < ny:
            raise RockfallError(
                f"{path}: ends after {done * nx + held.size} values, {due}: truncated or damaged"
            )


def _is_nodata(block: np.ndarray, nodata: float) -> np.ndarray:
    """Mask of nodata values, even if header and data differ by single-precision rounding."""
    if abs(nodata) > _HUGE:
        return block > _HUGE if nodata > 0 else block < -_HUGE
    with np.errstate(over="ignore"):
        return block.astype(np.float32) == np.float32(nodata)


def is_ascii(start: bytes) -> bool:
    """Return True if the first bytes are those of an ESRI ASCII grid."""
    tokens = start.removeprefix(BOM_UTF8).split(maxsplit=1)
    return bool(tokens) and tokens[0].lower().decode("latin-1") in _KEYS


def is_ascii_grid(path: str | Path) -> bool:
    """Return True for an existing ESRI ASCII grid, regardless of its name."""
    return os.path.isfile(path) and is_ascii(start_of(path))


def open_ascii(path: str) -> AsciiCells:
    """Read the header of an ESRI ASCII grid; refuses truncated files and malformed headers."""
    values: dict[str, float] = {}
    start, line = 0, 1
    with open(path, "rb") as file:
        if file.read(len(BOM_UTF8)) != BOM_UTF8:
            file.seek(0)
        while tokens := _header_line(file.readline(_MAX_TOKEN)):
            where, key = f"{path}: line {line}", tokens[0].lower()
            if len(tokens) != 2:
                raise RockfallError(f"{where}: {tokens[0]}: must be followed by one value")
            if key in values:
                raise RockfallError(f"{where}: {tokens[0]}: occurs twice in the header")
            values[key] = _value(f"{where}: {tokens[0]} = {tokens[1][:40]}", key, tokens[1])
            start, line = file.tell(), line + 1
    _check_keys(path, values)
    nx, ny = int(values["ncols"]), int(values["nrows"])
    if os.path.getsize(path) < 2 * nx * ny:
        raise RockfallError(
            f"{path}: too short for ncols x nrows = {nx} x {ny} values: truncated or damaged"
        )
    return AsciiCells(path, (ny, nx), _place(values), values.get("nodata_value"), (start, line))


def _header_line(line: bytes) -> list[str]:
    """Tokens of a header line, which starts with a key; empty for other lines."""
    tokens = line.decode("latin-1").split()
    return tokens if tokens and tokens[0].lower() in _KEYS else []


def _value(where: str, key: str, text: str) -> float:
    """Valid value of a key; errors start with `where`."""
    value = plain_decimal(text)
    if key in ("ncols", "nrows"):
        if not (text.isascii() and text.isdigit() and 0 < value < 2**31):
            raise RockfallError(f"{where}: must be an integer > 0")
    elif key == "nodata_value":
        if _OVERFLOW.fullmatch(text):  # the text of the largest double is rounded up
            return math.copysign(math.inf, -1 if text.startswith("-") else 1)
        if math.isnan(value) and text.lower() != "nan":
            raise RockfallError(f"{where}: must be a number or nan")
    elif not abs(value) <= MAX_REAL:
        raise RockfallError(f"{where}: must be a number, at most 1e12")
    elif key in ("cellsize", "dx", "dy") and not value > 0:
        raise RockfallError(f"{where}: must be > 0 [m]")
    return value


def _check_keys(path: str, values: dict[str, float]) -> None:
    """Check that the header gives size, corner (or centre) and cell size exactly once each."""
    given = values.keys()
    if not {"ncols", "nrows"} <= given:
        raise RockfallError(f"{path}: the header lacks ncols or nrows")
    corner, centre = {"xllcorner", "yllcorner"} & given, {"xllcenter", "yllcenter"} & given
    if sorted((len(corner), len(centre))) != [0, 2]:
        raise RockfallError(
            f"{path}: the header must have xllcorner and yllcorner, or else xllcenter and yllcenter"
        )
    if ("cellsize" in given, *(key in given for key in ("dx", "dy"))) not in (
        (True, False, False),
        (False, True, True),
    ):
        raise RockfallError(f"{path}: the header must have cellsize, or else dx and dy")


def _place(values: dict[str, float]) -> Transform:
    """Transform from columns and rows to coordinates, bit for bit as in GDAL."""
    width, height = (values.get("cellsize", values.get(key, 0.0)) for key in ("dx", "dy"))
    if "xllcorner" in values:
        west, south = values["xllcorner"], values["yllcorner"]
    else:
        west, south = values["xllcenter"] - 0.5 * width, values["yllcenter"] - 0.5 * height
    return Transform(width, 0.0, west, 0.0, -height, south + values["nrows"] * height)


def _numbers(file: BinaryIO, path: str, line: int) -> Iterator[np.ndarray]:
    """Yield numbers from the rest of the file in chunks; `line` is the number of the first line.
    Refuses binary data."""
    tail = b""
    while block := file.read(_CHUNK):
        text = tail + block
        cut = max(text.rfind(space) for space in (b" ", b"\n", b"\t", b"\r")) + 1
        text, tail = text[:cut], text[cut:]
        if len(tail) > _MAX_TOKEN:
            raise RockfallError(f"{path}: is not text with numbers, so it is damaged")
        yield _parse(text, path, line)
        line += text.count(b"\n")
    yield _parse(tail, path, line)


def _parse(text: bytes, path: str, line: int) -> np.ndarray:
    if not text.strip():
        return np.empty(0)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", DeprecationWarning)  # older NumPy versions only warn
            return np.fromstring(text, sep=" ")
    except (ValueError, DeprecationWarning):
        number, token = _first_bad_token(text)
        raise RockfallError(f"{path}: line {line + number}: {token!r} is not a number") from None


def _first_bad_token(text: bytes) -> tuple[int, str]:
    """Number of lines before the first token that is not a number, and this token."""
    for number, row in enumerate(text.split(b"\n")):
        for token in row.split():
            try:
                float(token.replace(b"_", b"?"))  # Python accepts 1_000, the format does not
            except ValueError:
                return number, token[:40].decode("ascii", "replace")
    return 0, "?"
