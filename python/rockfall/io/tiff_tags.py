# SPDX-License-Identifier: BSD-3-Clause
"""The mark of missing cells in a GeoTIFF, which is text: GDAL takes a word there for zero."""

from __future__ import annotations

import math
import os
import re
import struct
from typing import BinaryIO

from rockfall.errors import RockfallError
from rockfall.io.tables import plain_decimal

_NODATA, _ASCII = 42113, 2  # a tag, and a type
_NOT_FINITE = re.compile(r"[+-]?(nan|inf|infinity|1\.#(qnan|ind|inf)0*)", re.IGNORECASE)
_LONGEST = 64  # bytes of a number


def check_mark(path: str) -> None:
    """Refuse a nodata value that is no number."""
    with open(path, "rb") as file:
        try:
            text = _text(file, os.path.getsize(path))
        except struct.error:  # cut short: GDAL says so
            return
    word = text.strip(" \0")
    if word and math.isnan(plain_decimal(word)) and not _NOT_FINITE.fullmatch(word):
        raise RockfallError(f"{path}: nodata = {word[:40]}: must be a number or nan")


def _text(file: BinaryIO, size: int) -> str:
    """The text of the tag in the first directory; empty where there is none."""
    start = file.read(16)
    end = "<" if start[:2] == b"II" else ">"
    big = struct.unpack_from(f"{end}H", start, 2)[0] == 43
    count, entry = ("Q", "HHQQ") if big else ("H", "HHII")
    file.seek(struct.unpack_from(f"{end}{'Q' if big else 'I'}", start, 8 if big else 4)[0])
    (entries,) = struct.unpack(f"{end}{count}", file.read(struct.calcsize(f"{end}{count}")))
    length = struct.calcsize(f"{end}{entry}")
    for _ in range(min(entries, size // length)):
        tag, kind, many, where = struct.unpack(f"{end}{entry}", one := file.read(length))
        if tag == _NODATA and kind == _ASCII:
            inline = 8 if big else 4
            if many <= inline:
                return one[-inline:][:many].decode("latin-1")
            file.seek(where)
            return file.read(min(many, _LONGEST)).decode("latin-1")
    return ""
