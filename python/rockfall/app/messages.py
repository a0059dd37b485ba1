# SPDX-License-Identifier: BSD-3-Clause
"""Messages between server and page: JSON, or a JSON header followed by arrays.

A binary message consists of the header length (uint32, little-endian), the header, padded with
spaces to a multiple of 8 bytes, and the arrays (C order, little-endian), each aligned to 8 bytes.
The header lists the names, types, shapes and offsets of the arrays.
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

MAX_BYTES = 4_000_000  # maximum size of a message from the page
_TYPES = {"f4": "<f4", "f8": "<f8", "u1": "<u1", "u4": "<u4", "i4": "<i4"}
_WORD = 8  # alignment of arrays [bytes]

Message: TypeAlias = "str | bytes"


class Refused(Exception):
    """A refused request from the page, with the place of the problem in its document."""

    def __init__(
        self, text: str, *, layer: str = "", id: str = "", group: str = "", key: str = ""
    ) -> None:
        super().__init__(text)
        self.text = text
        self.place = {"layer": layer, "id": id, "group": group, "key": key}

    def entry(self) -> dict[str, str]:
        """Entry in the error list of a document."""
        return {"text": self.text} | {name: value for name, value in self.place.items() if value}


def text_message(type: str, /, **content: Any) -> str:
    """Text message of a given type. Non-finite numbers become null."""
    return _json({"type": type, **content})


def fault_message(error: Exception) -> str:
    """Message `fault` of an internal error."""
    if os.environ.get("ROCKFALL_TRACEBACK"):
        traceback.print_exception(error)
    text = f"internal error: {type(error).__name__}: {error}"
    return text_message("fault", text=" ".join(text.splitlines()))


def binary_message(type: str, /, arrays: Mapping[str, np.ndarray], **content: Any) -> bytes:
    """Binary message of a given type, with named arrays."""
    import numpy as np  # imported only once a file is open

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
    """Parsed message from a page; it must be an object with a type and finite numbers."""
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
    """Parse a JSON number; raises ValueError if it is too large."""
    value = float(token)
    if not math.isfinite(value):
        raise ValueError(f"{token} is too large")
    return value


def _json(content: Any) -> str:
    # ASCII only: file names, and texts from a page, may have code points that UTF-8 cannot encode.
    try:
        return json.dumps(content, allow_nan=False, separators=(",", ":"), default=_plain)
    except (TypeError, ValueError):  # NaN, or NumPy keys; conversion takes 20 times as long
        return json.dumps(_plain(content), allow_nan=False, separators=(",", ":"))


def _plain(value: Any) -> Any:
    """Content converted to JSON types; non-finite numbers become None."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if hasattr(value, "tolist"):  # NumPy scalar or array
        return _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
