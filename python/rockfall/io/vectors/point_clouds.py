# SPDX-License-Identifier: BSD-3-Clause
"""Point clouds: LAS and LAZ (laspy, lazrs), and XYZ text, read in chunks.

Memory: 48 bytes for each point while points are joined, 24 afterwards. If points are averaged in
squares: about 150 bytes for each square with points, and 0.3 GB for the chunks.
"""

from __future__ import annotations

import os
import shlex
import struct
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.errors import RockfallError, need
from rockfall.io.coordinates.crs import crs_name, same_crs
from rockfall.io.coordinates.geo_keys import DIRECTORY, TEXTS, check_plan, keys_of, stated_heights
from rockfall.io.coordinates.length_units import Stated, refuse_units, unit_in_words
from rockfall.io.coordinates.projection_file import vertical_units
from rockfall.io.files import start_of
from rockfall.io.gdal_files import plain_file
from rockfall.io.vectors.point_text import TEXT, is_point_text, text_chunks
from rockfall.limits import MAX_ELEVATION, MAX_REAL

if TYPE_CHECKING:
    from rasterio.crs import CRS

#: Yields chunks (n, 3) [m] of a file.
Chunks = Iterator[np.ndarray]

LASER = (".las", ".laz")
GROUND = (2,)  # ASPRS classes in LAS files
CHUNK = 1_000_000  # points
MAX_POINTS = 20_000_000  # maximum points in memory
MAX_INDEX = 2**31  # maximum index of a square along an axis
_HEADER = struct.Struct("<4s20xBB68xHIIBHI")  # signature, version, sizes, records, format, points
_V14 = struct.Struct("<QIQ")  # at byte 235: extended records and their number, points
_PLACE, _TABLE = struct.Struct("<q"), struct.Struct("<II")  # LAZ: chunk table: offset, header
_RECORD, _EXTENDED = 54, 60  # header sizes of records [bytes]
_WITHHELD = "withheld"
_WKT, _DESCRIPTION = 2112, 3  # LAS records: coordinate system, text area


def is_cloud(path: str | Path) -> bool:
    """Return True for the name of a point cloud, and for text files with a point in each row."""
    return Path(path).suffix.lower() in (*LASER, TEXT) or is_point_text(path)


def read_clouds(
    paths: Sequence[str | Path],
    classes: Sequence[int] | None = None,
    thin: float | None = None,
    given: CRS | None = None,
) -> tuple[np.ndarray, CRS | None]:
    """Read points (n, 3) [m] from all files, and their common CRS, from LAS files or `given`.
    Raises a RockfallError for invalid options, files or CRSs.

    LAS files contribute the points of the `classes` (default: 2, ground) that are not withheld.
    With `thin`, the points in each square of this side [m] are replaced by their mean.
    """
    if thin is not None and not 0 < thin < np.inf:
        raise RockfallError(f"--thin {thin:g}: must be > 0 [m]")
    for path in paths:
        if classes is not None and not _is_laser(path):
            raise RockfallError(f"--classes: {path} has no classes (only .las and .laz have)")
    chosen = GROUND if classes is None else tuple(classes)
    for number in chosen:
        if not 0 <= number <= 255:
            raise RockfallError(f"--classes {number}: must be 0 to 255")
    crs = _common_crs(paths, given)
    chunks = (chunk for path in paths for chunk in _checked(path, _chunks(path, chosen)))
    return (_joined(chunks) if thin is None else _averaged(chunks, thin)), crs


def _chunks(path: str | Path, classes: Sequence[int]) -> Chunks:
    return _laser_chunks(path, classes) if _is_laser(path) else text_chunks(path)


def _is_laser(path: str | Path) -> bool:
    return Path(path).suffix.lower() in LASER


def _checked(path: str | Path, chunks: Chunks) -> Chunks:
    """Yield chunks after checking their coordinates; refuse a file without points."""
    total = 0
    for chunk in chunks:
        limits = np.array([MAX_REAL, MAX_REAL, MAX_ELEVATION])
        for row in np.flatnonzero(~(np.abs(chunk) <= limits).all(axis=1))[:1]:
            x, y, z = chunk[row].tolist()
            raise RockfallError(f"{path}: x = {x:g}, y = {y:g}, z = {z:g}: not a position [m]")
        total += len(chunk)
        yield chunk
    if not total:
        raise RockfallError(f"{path}: has no points")


def _joined(chunks: Iterable[np.ndarray]) -> np.ndarray:
    """All points in one array; refuse too many."""
    kept, total = [], 0
    for chunk in chunks:
        total += len(chunk)
        if total > MAX_POINTS:
            raise RockfallError(
                f"more than {MAX_POINTS:,} points: average them in squares of M metres with --thin "
                "M"
            )
        kept.append(chunk)
    return np.concatenate(kept)


def _averaged(chunks: Iterable[np.ndarray], side: float) -> np.ndarray:
    """Mean (n, 3) of the points in each square of a `side` [m]; independent of chunk sizes except
    for rounding. Points on a plane stay on the plane. Refuses a side for which too many points
    remain."""
    squares, sums = _sums(np.empty(0, np.int64), np.empty((0, 4)))
    waiting: list[tuple[np.ndarray, np.ndarray]] = []
    for chunk in chunks:
        index = np.floor(chunk[:, :2] / side)
        if not (np.abs(index) < MAX_INDEX).all():
            raise RockfallError(f"--thin {side:g}: too small for these coordinates")
        off = np.column_stack([chunk[:, :2] - index * side, chunk[:, 2], np.ones(len(chunk))])
        east, north = index.astype(np.int64).T
        waiting.append(_sums(east * 2 * MAX_INDEX + (north + MAX_INDEX), off))
        if sum(len(points) for points, _ in waiting) > max(CHUNK, len(squares)):
            squares, sums = _together([(squares, sums), *waiting])
            waiting = []
    squares, sums = _together([(squares, sums), *waiting])
    if len(squares) > MAX_POINTS:
        raise RockfallError(
            f"--thin {side:g}: leaves more than {MAX_POINTS:,} points: use a larger value"
        )
    east, north = np.divmod(squares, 2 * MAX_INDEX)
    corner = np.column_stack([east, north - MAX_INDEX, np.zeros(len(squares))]) * side
    return corner + sums[:, :3] / sums[:, 3:]


def _together(parts: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    return _sums(*map(np.concatenate, zip(*parts, strict=True)))


def _sums(squares: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distinct squares (n,), and the sum of each square's values (n, columns) in their order."""
    if not len(squares):
        return squares, values
    order = np.argsort(squares, kind="stable")
    squares = squares[order]
    first = np.flatnonzero(np.append(True, squares[1:] != squares[:-1]))
    return squares[first], np.add.reduceat(values[order], first, axis=0)


def _common_crs(paths: Sequence[str | Path], given: CRS | None) -> CRS | None:
    """CRS shared by all files, else `given`. Raises a RockfallError for different CRSs, and for a
    file with a CRS in spite of `given`."""
    named = [(path, _laser_crs(path)) for path in paths if _is_laser(path)]
    for path, crs in named:
        if crs is not None and given is not None:
            raise RockfallError(f"--crs: {path} has its own CRS, {crs_name(crs)}")
    named += [(path, None) for path in paths if not _is_laser(path)]
    (first, common), *others = named
    for path, crs in others:
        if (crs is None) != (common is None) or not same_crs(crs, common):
            own, other = (crs_name(c) if c else "no CRS" for c in (common, crs))
            raise RockfallError(
                f"{path}: has {other}, but {first} has {own}: all must have the same CRS"
            )
    return given if common is None else common


def _laser_crs(path: str | Path) -> CRS | None:
    """CRS of a LAS file, or None. Contradictory records are refused: laspy uses the last record,
    other readers use the first or combine them."""
    from rasterio.crs import CRS

    with _Laser(path) as reader:
        crs = reader.header.parse_crs()
        by_keys = reader.header.parse_crs(prefer_wkt=False)
        records = [*reader.header.vlrs, *(reader.header.evlrs or ())]
        own = [record for record in records if record.user_id == "LASF_Projection"]
        for number, name in ((_WKT, "WKT"), (DIRECTORY, "GeoKey")):
            contents = {record.record_data_bytes().rstrip(b"\0") for record in own
                        if record.record_id == number}  # fmt: skip
            if len(contents) > 1:
                raise RockfallError(
                    f"{path}: has {len(contents)} different {name} records: keep the record that "
                    "applies to coordinates and elevations"
                )
        _check_heights(path, own, records)
    if crs is not None:
        by_text, by_key = (CRS.from_wkt(system.to_wkt()) for system in (crs, by_keys))
        if not same_crs(by_text, by_key):
            raise RockfallError(
                f"{path}: its WKT names {crs_name(by_text)}, its GeoKeys {crs_name(by_key)}: "
                "correct one of them"
            )
        return by_text
    if own:
        raise RockfallError(f"{path}: has a CRS that cannot be read")
    return None


def _check_heights(path: str | Path, own: Sequence[Any], records: Sequence[Any]) -> None:
    """Refuse heights not in metres, from GeoKeys (which laspy ignores) or a description."""
    data = {record.record_id: record.record_data_bytes() for record in own}
    directory = data.get(DIRECTORY, b"")
    keys = keys_of(struct.unpack(f"<{len(directory) // 2}H", directory[: len(directory) // 2 * 2]))
    check_plan(str(path), keys)
    stated = stated_heights(keys, data.get(TEXTS, b"").decode("latin-1"))
    for record in records:
        if (record.user_id, record.record_id) == ("LASF_Spec", _DESCRIPTION):
            unit = unit_in_words(record.record_data_bytes().decode("latin-1"))
            stated += [Stated(unit, "its text area")] if unit else []
        elif record.user_id == "liblas":  # WKT, written before LAS had a record for it
            text = record.record_data_bytes().decode("latin-1")
            stated += [Stated(unit, "its libLAS record") for unit in vertical_units(text)]
    refuse_units(path, stated, lambda factor: _in_metres(Path(path), factor))


def _in_metres(path: Path, factor: str) -> str:
    """Command that writes a cloud with heights multiplied by a factor. It drops the CRS, because
    readers would convert again; --crs gives the plan CRS."""
    made = str(path.with_name(f"{path.stem}_m{path.suffix}"))
    code = f"import laspy; p = laspy.read({str(path)!r}); p.z = p.z * {factor}; p.vlrs = []; "
    code += f"p.evlrs = []; p.write({made!r})"
    return shlex.join(["python", "-c", code])


class _Laser:
    """An open LAS file; all errors become RockfallErrors."""

    def __init__(self, path: str | Path) -> None:
        self.path = path

    def __enter__(self) -> Any:
        need("LAS and LAZ need", "points", "laspy", "lazrs")
        import laspy

        name = plain_file(self.path)
        _check_header(self.path)
        try:
            self.reader = laspy.open(name)
        except Exception as error:
            raise self._refusal(error) from error
        return self.reader

    def __exit__(self, kind: Any, error: BaseException | None, *_: Any) -> None:
        self.reader.close()
        if isinstance(error, Exception) and not isinstance(error, RockfallError):
            raise self._refusal(error) from error

    def _refusal(self, error: Exception) -> RockfallError:
        """RockfallError for a damaged file, on which laspy and lazrs raise arbitrary errors."""
        return RockfallError(f"{self.path}: cannot be read as a LAS file ({error})")


def _check_header(path: str | Path) -> None:
    """Refuse a file whose header claims more data than it contains, because laspy trusts it."""
    size, start = os.path.getsize(path), start_of(path)
    if len(start) < _HEADER.size or not start.startswith(b"LASF"):
        raise RockfallError(f"{path}: is not a LAS file")
    _, major, minor, header, offset, records, kind, length, points = _HEADER.unpack_from(start)
    extended, many = 0, 0
    if (major, minor) >= (1, 4) and len(start) >= 235 + _V14.size:
        extended, many, points = _V14.unpack_from(start, 235)
    claims = (
        header + _RECORD * records > offset or offset > size
        or (many and extended + _EXTENDED * many > size)
    )  # fmt: skip
    if not points:
        raise RockfallError(f"{path}: has no points")
    if not claims:
        compressed = bool(kind & 0xC0)
        needed = _chunk_points(path, offset, size) if compressed else points
        claims = needed < 0 or offset + needed * length > size
    if claims:
        raise RockfallError(f"{path}: is truncated: shorter than its header states")


def _chunk_points(path: str | Path, offset: int, size: int) -> int:
    """Number of chunks in a LAZ file, each with an uncompressed first point; -1 if invalid."""
    with open(path, "rb") as file:
        file.seek(offset)
        (table,) = _PLACE.unpack(file.read(_PLACE.size).ljust(_PLACE.size, b"\0"))
        if table == -1:  # written as a stream: the offset is at the file end
            file.seek(max(0, size - _PLACE.size))
            (table,) = _PLACE.unpack(file.read(_PLACE.size))
        if not offset < table <= size - _TABLE.size:
            return -1
        file.seek(table)
        version, chunks = _TABLE.unpack(file.read(_TABLE.size))
    return -1 if version else chunks


def _laser_chunks(path: str | Path, classes: Sequence[int]) -> Chunks:
    """Yield points of the given classes, without withheld points. Refuses truncated files and
    missing classes."""
    seen: Counter[int] = Counter()
    read = kept = 0
    with _Laser(path) as reader:
        total = reader.header.point_count
        for points in reader.chunk_iterator(CHUNK):
            if not len(points):
                break
            read += len(points)
            own = np.asarray(points.classification)
            numbers, counts = np.unique(own, return_counts=True)
            seen.update(dict(zip(numbers.tolist(), counts.tolist(), strict=True)))
            taken = np.isin(own, classes) & ~np.asarray(points[_WITHHELD], bool)
            kept += int(taken.sum())
            yield np.column_stack([np.asarray(points[axis])[taken] for axis in "xyz"])
    if read != total:
        raise RockfallError(f"{path}: is truncated: {read:,} of its {total:,} points can be read")
    if not kept:
        has = ", ".join(f"{number} ({count:,} points)" for number, count in sorted(seen.items()))
        wanted = ", ".join(map(str, classes))
        raise RockfallError(
            f"{path}: has no points of class {wanted} (classes: {has}): choose with --classes"
        )
