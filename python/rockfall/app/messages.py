# SPDX-License-Identifier: BSD-3-Clause
"""Messages between server and page: JSON, or a JSON header followed by arrays.

A binary message is the length of its header (uint32, little-endian), the header, padded with spaces
to a multiple of 8 bytes, and the arrays in C order, little-endian, each at a multiple of 8 bytes.
The header lists their names, types, shapes and offsets.
"""

from __future__ import annotations

import json
import math
import os
import struct
import traceback
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, TypeAlias

if TYPE_CHECKING:
    import numpy as np

MAX_BYTES = 4_000_000  # of a message from the page
_TYPES = {"f4": "<f4", "f8": "<f8", "u1": "<u1", "u4": "<u4", "i4": "<i4"}
_WORD = 8  # bytes to which arrays are aligned

Message: TypeAlias = "str | bytes"


class Refused(Exception):
    """A refused request from the page, with the location of the problem in its document."""

    def __init__(
        self, text: str, *, layer: str = "", id: str = "", group: str = "", key: str = ""
    ) -> None:
        super().__init__(text)
        self.text = text
        self.place = {"layer": layer, "id": id, "group": group, "key": key}

    def entry(self) -> dict[str, str]:
        """Entry in the errors of a document."""
        return {"text": self.text} | {name: value for name, value in self.place.items() if value}


def text_message(type: str, /, **content: Any) -> str:
    """Text message of a type. Numbers that are not finite become null."""
    return _json({"type": type, **content})


def fault_message(error: Exception) -> str:
    """Message `fault` of an internal error."""
    if os.environ.get("ROCKFALL_TRACEBACK"):
        traceback.print_exception(error)
    text = f"internal error: {type(error).__name__}: {error}"
    return text_message("fault", text=" ".join(text.splitlines()))


def binary_message(type: str, /, arrays: Mapping[str, np.ndarray], **content: Any) -> bytes:
    """Binary message of a type, with arrays by name."""
    import numpy as np  # not needed until the file is opened

    entries, parts, offset = [], [], 0
    for name, array in arrays.items():
        kind = f"{array.dtype.kind}{array.dtype.itemsize}"
        data = np.ascontiguousarray(array, _TYPES[kind]).tobytes()
        entries.append({"name": name, "dtype": kind, "shape": [*array.shape], "offset": offset})
        parts.append(data + bytes(-len(data) % _WORD))
        offset += len(parts[-1])
    header = _json({"type": type, **content, "arrays": entries}).encode()
    header += b" " * (-(len(header) + 4) % _WORD)
    return b"".join([struct.pack("<I", len(header)), header, *parts])


def read_message(text: str) -> dict[str, Any]:
    """Parsed message from a page; only objects with a type and plain numbers are accepted."""
    try:
        message = json.loads(text, parse_constant=_no_number, parse_float=_finite)
    except (ValueError, RecursionError):
        raise Refused("not JSON") from None
    if not isinstance(message, dict) or not isinstance(message.get("type"), str):
        raise Refused("message without a type")
    return message


def _no_number(token: str) -> float:
    raise ValueError(f"{token} is not a JSON number")


def _finite(token: str) -> float:
    """Number of a JSON token; a ValueError if it is too large."""
    value = float(token)
    if not math.isfinite(value):
        raise ValueError(f"{token} is too large")
    return value


def _json(content: Any) -> str:
    # In ASCII: names of files, and texts from a page, may have code points that UTF-8 lacks.
    try:
        return json.dumps(content, allow_nan=False, separators=(",", ":"), default=_plain)
    except (TypeError, ValueError):  # for NaN and NumPy keys; takes twenty times as long
        return json.dumps(_plain(content), allow_nan=False, separators=(",", ":"))


def _plain(value: Any) -> Any:
    """Content as JSON types; None for numbers that are not finite."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if hasattr(value, "tolist"):  # NumPy scalar or array
        return _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
