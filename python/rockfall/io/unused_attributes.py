# SPDX-License-Identifier: BSD-3-Clause
"""Attributes of layers, and columns of tables, that nothing uses: misspelt ones among them."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from rockfall.io.layers import SHORT
from rockfall.language import remark

#: Attributes that geographic information systems add by themselves.
_BOOKKEEPING = frozenset({
    "fid", "ogc_fid", "objectid", "id", "gid", "uuid", "globalid", "layer", "path", "geometry",
    "shape_length", "shape_leng", "shape_area", "remark", "comment", "note", "source",
})  # fmt: skip
_CLOSE = 0.7  # similarity of a misspelt name, as of valeur and value
_MAX_NAMED = 5


def note_unused(
    remarks: list[str],
    where: object,
    columns: Iterable[str],
    used: Iterable[str],
    plain: Callable[[str], str] = str.lower,
) -> None:
    """Add a remark on the columns that are none of the `used` names, which shapefiles truncate;
    with the used name that a column resembles, if the file does not have that."""
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
