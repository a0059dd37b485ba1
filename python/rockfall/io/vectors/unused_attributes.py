# SPDX-License-Identifier: BSD-3-Clause
"""Layer attributes and table columns that are probably mistakes: unused or misspelt names, and
numbers that stand for missing values."""

from collections.abc import Callable, Iterable, Mapping

import numpy as np

from rockfall.io.vectors.layers import SHORT
from rockfall.language import remark

#: Attributes that GIS software adds automatically.
_BOOKKEEPING = frozenset({
    "fid", "ogc_fid", "objectid", "id", "gid", "uuid", "globalid", "layer", "path", "geometry",
    "shape_length", "shape_leng", "shape_area", "remark", "comment", "note", "source",
})  # fmt: skip
#: Numbers that programs write for missing values; negative ones are out of range anyway.
_MARKS = (99.9, 99.99, 127.0, 255.0, 999.0, 999.9, 9999.0, 32767.0, 65535.0, 99999.0)
_APART = 0.5  # ratio of the largest other number to the mark; above it, the mark counts as data
_NO_NUMBERS = frozenset({"name", "zone", "x", "y"})  # columns without a check for marks
_CLOSE = 0.7  # minimum similarity of misspelt names, such as valeur for value
_MAX_NAMED = 5


def note_unused(
    remarks: list[str],
    where: object,
    columns: Iterable[str],
    used: Iterable[str],
    plain: Callable[[str], str] = str.lower,
) -> None:
    """Add a remark on columns whose names are not `used` (shapefiles truncate names). If a column
    resembles a used name that the file lacks, the remark mentions it."""
    names = [plain(name) for name in used]
    expected = {*names, *(name[:SHORT] for name in names)}
    own = {plain(name): name for name in columns}
    unused = {key: name for key, name in own.items() if key not in expected | _BOOKKEEPING}
    if not unused:
        return
    from difflib import get_close_matches

    absent = [name for name in names if own.keys().isdisjoint({name, name[:SHORT]})]
    shown = []
    for key, name in unused.items():
        meant = get_close_matches(key, absent, 1, _CLOSE)
        shown.append(f"{name} ({meant[0]}?)" if meant else name)
    shown[_MAX_NAMED:] = ["..."] * (len(shown) > _MAX_NAMED)
    text = remark(where, "input.unused_attributes", names=", ".join(shown))
    remarks += [text] * (text not in remarks)


def note_marks(
    remarks: list[str],
    where: object,
    columns: Mapping[str, np.ndarray],
    used: Iterable[str],
    plain: Callable[[str], str] = str.lower,
) -> None:
    """Add a remark on columns whose largest number is isolated and looks like missing data."""
    names = {plain(name) for name in used} - _NO_NUMBERS
    names |= {name[:SHORT] for name in names}
    for name, column in columns.items():
        if plain(name) not in names:
            continue
        try:
            numbers = np.asarray(column, float)
        except (TypeError, ValueError):
            continue
        numbers = numbers[np.isfinite(numbers)]
        top = numbers.max(initial=0.0)
        if not np.isclose(_MARKS, top, rtol=1e-6, atol=0).any():
            continue
        others = numbers[numbers < top]
        if others.size and others.max() <= _APART * top:
            n = numbers.size - others.size
            text = remark(where, "input.mark", name=name, value=float(top), n=n)
            remarks += [text] * (text not in remarks)
