# SPDX-License-Identifier: BSD-3-Clause
"""First crossings of evaluation lines: a row for each line and boulder, sorted by line, then by
boulder. Results store the kernel's measurements; speeds, energies and other heights are derived
from them by the kernel's rules.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.case import case_in
from rockfall.errors import RockfallError
from rockfall.kernel_rules import line_quantities, points_along
from rockfall.result.contents import Contents
from rockfall.result.samples import check_rows
from rockfall.result.variables import FRAGMENT, HIT, LINE, fields

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from rockfall.result.contents import Held

    Known = Held | Mapping[str, Any]  # a result, or arrays by name

HEIGHTS = ("upper_edge", "normal_height", "normal_upper_edge")
QUANTITIES = fields("line_quantity")  # kernel order
DERIVED = {name: k for k, name in enumerate(QUANTITIES[:-1])}
MOTION = ("velocity_x", "velocity_y", "velocity_z", "omega", "jump_height", "passing_height")
POSITION = "position"  # distance along the line
MOST_LINES = 20  # maximum lines with rows on a terminal, tables in a report, names on a map
MAX_DENSE = 2e9  # maximum size of a dense view [bytes]
MAX_SHARED = 5e8  # maximum size of quantities cached within `sharing` [bytes]


def line_names(result: Known) -> list[str]:
    """Names of the evaluation lines in a result; may be empty."""
    return [str(name) for name in np.asarray(result["line_name"])] if "line_name" in result else []


def line_index(result: Held, line: str | int) -> int:
    """Index of a line from its name or index; a RockfallError lists the known names."""
    names = line_names(result)
    if isinstance(line, str) and line in names:
        return names.index(line)
    if isinstance(line, int | np.integer) and 0 <= line < len(names):
        return int(line)
    raise RockfallError(f"line {line}: no such line (lines: {', '.join(names) or 'none'})")


def chosen_lines(result: Held, lines: Sequence[str | int] | None = None) -> list[tuple[int, str]]:
    """Index and name of each line, or of lines given by name or index."""
    names = line_names(result)
    chosen = range(len(names)) if lines is None else [line_index(result, line) for line in lines]
    return [(k, names[k]) for k in chosen]


def most_crossed(result: Known, most: int | None = None) -> list[int]:
    """Indices of the lines that the most boulders pass, in line order; by default all lines."""
    passed = np.asarray(result["row_size"]) if "row_size" in result else np.zeros(0)
    return sorted(np.argsort(-passed, kind="stable")[:most].tolist())


def rows_at(result: Known, line: int) -> slice:
    """Rows of crossings at the line with this index."""
    sizes = np.asarray(result["row_size"])
    first = int(sizes[:line].sum(dtype="i8"))
    return slice(first, first + int(sizes[line]))


class AtLine:
    """Crossings of all or selected boulders at a line; values are cached."""

    def __init__(self, result: Known, line: int) -> None:
        """`result` may be arrays by name; without a case, these have no energies. `line` is an
        index."""
        self._result: Any = result
        self._held: Any = getattr(result, "variables", result)  # faster than creating DataArrays
        self._line = line
        self.kept: dict[Any, Any] = {}  # results of analyses, cached for other analyses
        self._rows, self.boulders = self._rows_and_boulders()

    def _rows_and_boulders(self) -> tuple[slice | np.ndarray, np.ndarray]:
        """Rows of crossings, and the `boulder` index of each, in boulder order."""
        rows, kept = rows_at(self._held, self._line), np.asarray(self._held["boulder"])
        numbers = np.asarray(self._held["crossing_boulder"][rows])  # only these rows of a file
        if not kept.size or not numbers.size:
            return slice(0), np.zeros(0, "i8")
        if kept[-1] - kept[0] + 1 == kept.size and (kept[1:] > kept[:-1]).all():
            index = numbers - kept[0]
            has_all = numbers[0] >= kept[0] and numbers[-1] <= kept[-1]
            is_kept = np.ones(0, bool) if has_all else (index >= 0) & (index < kept.size)
        else:
            order = np.argsort(kept, kind="stable")
            index = order[np.minimum(np.searchsorted(kept, numbers, sorter=order), kept.size - 1)]
            is_kept = kept[index] == numbers
            has_all = bool(is_kept.all())
        if has_all:
            return rows, index
        return rows.start + np.flatnonzero(is_kept), index[is_kept]

    def stored(self, name: str) -> np.ndarray:
        """Values of the stored variable crossing_NAME."""
        return np.asarray(self._held[f"crossing_{name}"][self._rows])

    @cached_property
    def volumes(self) -> np.ndarray:
        """Volume [m3] of each boulder or, if boulders may break, of the crossing fragment."""
        if "crossing_volume" in self._result:
            return self.stored("volume").astype("f8")
        return np.asarray(self._held["volume"])[self.boulders]

    @cached_property
    def derived(self) -> np.ndarray:
        """Quantities derived from stored values, (quantities, n), in the order of `DERIVED`."""
        if not self.boulders.size:
            return np.empty((len(DERIVED), 0))
        mass = masses_of(self._result, self.boulders)
        if "crossing_volume" in self._result:
            mass = mass * (self.volumes / np.asarray(self._held["volume"])[self.boulders])
        motion = np.array([self.stored(name) for name in MOTION], "f8")
        return line_quantities(motion.T, self.volumes, mass).T

    def values(self, quantity: str) -> np.ndarray:
        """Values of a quantity, in the order of `boulders`; requires a result with rows."""
        if quantity in ("x", "y"):
            return self.places()["xy".index(quantity)]
        if quantity in DERIVED and quantity not in MOTION:
            return self.derived[DERIVED[quantity]]
        values = self.stored("distance" if quantity == POSITION else quantity)
        return values.astype("f8") if values.dtype.kind in "fi" else values

    def places(self) -> np.ndarray:
        """Map coordinates (2, n) [m]."""
        on_line = self._result["line_vertex_line"].values == self._line
        vertices = (self._result[f"line_vertex_{axis}"].values[on_line] for axis in "xy")
        return points_along(*vertices, self.stored("distance").astype("f8"))


def masses_of(result: Held, boulders: np.ndarray | slice = slice(None)) -> np.ndarray:
    """Mass [kg] of all boulders, or of the boulders with these indices."""
    if "mass" in result:
        return np.asarray(result["mass"])[boulders]
    density = _density(str(result.attrs["case"]), str(result.attrs["case_file"]))
    return np.asarray(result["volume"])[boulders] * density


@lru_cache(maxsize=8)
def _density(text: str, file: str) -> float:
    """Density of a case's boulders [kg/m3]; cached, because parsing a case with many lines takes
    longer than the statistics at a line."""
    return float(case_in({"case": text, "case_file": file}).boulder["density"])


class _Shared:
    """Cache, limited in size, of the crossings at lines; the line used last is at the end."""

    def __init__(self, result: Known) -> None:
        self.result = result
        self._lines: dict[int, AtLine] = {}
        self._kept: dict[int, dict[Any, Any]] = {}  # caches of all lines
        self._size = 0  # crossings in `_lines`
        self.kept: dict[Any, Any] = {}

    def at(self, line: int) -> AtLine:
        if line in self._lines:
            self._lines[line] = self._lines.pop(line)
            return self._lines[line]
        self._lines[line] = at = AtLine(self.result, line)
        at.kept = self._kept.setdefault(line, at.kept)
        self._size += at.boulders.size
        while len(self._lines) > 1 and 8 * len(DERIVED) * self._size > MAX_SHARED:
            self._size -= self._lines.pop(next(iter(self._lines))).boulders.size
        return at


_shared: ContextVar[_Shared | None] = ContextVar("shared", default=None)


@contextmanager
def sharing(result: Known) -> Iterator[None]:
    """Within the block, analyses share the values at lines; the result must not change."""
    token = _shared.set(_Shared(result))
    try:
        yield
    finally:
        _shared.reset(token)


def at_line(result: Known, line: int) -> AtLine:
    """Crossings of a line, shared within `sharing`."""
    shared = _shared.get()
    if shared is None or shared.result is not result:
        return AtLine(result, line)
    return shared.at(line)


def kept_of(result: Known) -> dict[Any, Any]:
    """Cache for results of analyses, shared within `sharing`."""
    shared = _shared.get()
    return shared.kept if shared is not None and shared.result is result else {}


def boulders_at(result: Known, line: int) -> np.ndarray:
    """The `boulder` index of each boulder that crosses a line, by increasing number."""
    return at_line(result, line).boulders


def has_crossed(result: Known, line: int) -> np.ndarray:
    """Mask (boulder,) of boulders that cross a line."""
    crossed = np.zeros(np.asarray(result["boulder"]).size, bool)
    crossed[boulders_at(result, line)] = True
    return crossed


def stored_at(result: Known, name: str, line: int) -> np.ndarray:
    """Values of the stored variable crossing_NAME at a line."""
    return at_line(result, line).stored(name)


def values_at(result: Held, quantity: str, line: int) -> np.ndarray:
    """Values of a quantity for boulders that cross a line, in the order of `boulders_at`."""
    check_rows(result, "a quantity of each boulder at a line")
    return at_line(result, line).values(quantity)


def places_at(result: Held, line: int) -> np.ndarray:
    """Map coordinates (2, n) [m] of the crossings of a line."""
    return at_line(result, line).places()


def line_values(result: Held, quantity: str, line: int) -> np.ndarray:
    """Values (boulder,) of a quantity at a line; NaN where a boulder does not cross."""
    check_rows(result, "a quantity of each boulder at a line")
    values, at = np.full(result.sizes["boulder"], np.nan), at_line(result, line)
    values[at.boulders] = at.values(quantity)
    return values


def outcomes_at(result: Held, line: int) -> np.ndarray:
    """Outcome code (boulder,) at the barrier on a line; 0 for boulders that do not reach it."""
    outcome, at = np.zeros(result.sizes["boulder"], "i1"), at_line(result, line)
    outcome[at.boulders] = at.stored("outcome")
    return outcome


def without_absent(result: Held) -> Held:
    """Result without the crossings of boulders that it no longer contains, for instance after a
    selection."""
    if isinstance(result, Contents) or "row_size" not in result:
        return result
    line, number = (result[f"crossing_{name}"].values for name in ("line", "boulder"))
    is_kept = np.isin(number, result["boulder"].values)
    if is_kept.all():
        return result
    sizes = np.bincount(line[is_kept], minlength=result.sizes["line"]).astype("i4")
    chosen = result.isel(crossing=np.flatnonzero(is_kept))
    return chosen.assign(row_size=("line", sizes, result["row_size"].attrs))


def crossings(result: xr.Dataset, line: str | int | None = None) -> pd.DataFrame:
    """Table with a row for each first crossing of a line (by name or index; default: all lines),
    sorted by line, then by boulder.

    Columns: line (name), boulder (number), x, y [m], time [s], distance along the line [m], speed
    and its components [m/s], omega [rad/s], heights [m], energies [J]; volume [m3] and fragments
    if boulders may break, outcome if there are barriers. Times and motion are stored in single
    precision: relative errors are below 1e-7, and positions along a 1 km line are accurate to 0.1
    mm.

    >>> import rockfall
    >>> result = rockfall.run(rockfall.read_case("case.nml"))
    >>> rockfall.crossings(result, "L")["line"].iloc[0]
    'L'
    """
    import pandas as pd

    names = line_names(result)
    parts = []
    for k in range(len(names)) if line is None else [line_index(result, line)]:
        columns = {"line": names[k], **columns_at(result, k)}
        parts.append(pd.DataFrame(columns))
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=["line"])


def columns_at(result: Held, line: int) -> dict[str, np.ndarray]:
    """Columns of `crossings` at the line with this index, without its name."""
    at = at_line(result, line)
    x, y = at.places()
    columns = {"boulder": at.stored("boulder"), "x": x, "y": y}
    columns |= {name: at.values(name) for name in ("time", "distance", *[*LINE][3:], *HEIGHTS)}
    extra = {**FRAGMENT, **HIT}
    return columns | {name: at.stored(name) for name in extra if f"crossing_{name}" in result}


def at_lines(result: xr.Dataset) -> xr.Dataset:
    """Crossings of a few lines as a dense Dataset: line_x, line_y, line_time and so on, with
    dimensions (line, boulder); NaN, or 0 for fragments and outcomes, if a boulder does not cross.

    Raises a RockfallError for more than 2 GB.

    >>> import rockfall
    >>> result = rockfall.run(rockfall.read_case("case.nml"))
    >>> rockfall.at_lines(result)["line_speed"].dims
    ('line', 'boulder')
    """
    import xarray as xr

    lines, boulders = len(line_names(result)), result.sizes["boulder"]
    if (size := 8 * lines * boulders * len(LINE)) > MAX_DENSE:
        raise RockfallError(
            f"at_lines: {lines:,} lines x {boulders:,} boulders need {size / 1e9:,.1f} GB: read "
            "one line with rockfall.crossings(result, line)"
        )
    data: dict[str, Any] = {}

    def put(name: str, attrs: dict[str, str], values: list[np.ndarray]) -> None:
        shape = lines, boulders
        data[name] = (("line", "boulder"), np.array(values).reshape(shape), attrs)

    for name, attrs in LINE.items():
        put(f"line_{name}", attrs, [line_values(result, name, k) for k in range(lines)])
    if "crossing_volume" in result:
        volumes = [line_values(result, "volume", k) for k in range(lines)]
        put("line_volume", FRAGMENT["volume"], volumes)
        counts = [np.nan_to_num(line_values(result, "fragments", k)) for k in range(lines)]
        put("line_fragments", FRAGMENT["fragments"], [count.astype("i4") for count in counts])
    if "crossing_outcome" in result:
        attrs = dict(result["crossing_outcome"].attrs)
        put("barrier_outcome", attrs, [outcomes_at(result, k) for k in range(lines)])
    coords = {"line": line_names(result), "boulder": result["boulder"].values}
    return xr.Dataset(data, coords)
