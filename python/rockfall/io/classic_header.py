# SPDX-License-Identifier: BSD-3-Clause
"""Check of the header of a classic netCDF file against the size of the file.

The header gives the numbers of dimensions, attributes and variables. The netCDF library allocates
memory for them before reading, and aborts the process if memory is insufficient.

The format: NetCDF Classic Format Specification, Unidata, docs.unidata.ucar.edu/netcdf-c.
"""

import os
from pathlib import Path
from typing import BinaryIO

_VERSIONS = {b"CDF\x01": (4, 4), b"CDF\x02": (4, 8), b"CDF\x05": (8, 8)}  # bytes: count, offset
_BYTES_OF = (1, 1, 2, 4, 4, 8, 1, 2, 4, 8, 8)  # of a value, by its type, from 1


class _Overstated(Exception):
    pass


def overstates(path: str | Path) -> bool:
    """Return True if a file is classic netCDF (CDF-1, CDF-2, CDF-5) and its header claims more than
    the file holds; False for unreadable files and other formats."""
    try:
        with open(path, "rb") as file:
            if widths := _VERSIONS.get(file.read(4)):
                _Header(file, *widths).walk()
    except _Overstated:
        return True
    except OSError:
        return False
    return False


class _Header:
    """Parser of the bytes of a header after its magic number."""

    def __init__(self, file: BinaryIO, count: int, offset: int) -> None:
        self.file, self.count, self.offset = file, count, offset
        self.left = os.fstat(file.fileno()).st_size - 4  # bytes

    def walk(self) -> None:
        self.skip(self.count)  # the number of records
        for _ in range(self.list_length()):  # dimensions
            self.skip_padded(self.number(self.count))
            self.skip(self.count)
        self.skip_attributes()
        for _ in range(self.list_length()):
            self.skip_variable()

    def skip_variable(self) -> None:
        """Skip name, dimensions, attributes, type, size and offset of a variable."""
        self.skip_padded(self.number(self.count))
        self.skip(self.number(self.count) * self.count)
        self.skip_attributes()
        self.skip(4 + self.count + self.offset)

    def skip_attributes(self) -> None:
        for _ in range(self.list_length()):
            self.skip_padded(self.number(self.count))
            kind, values = self.number(4), self.number(self.count)
            if not 1 <= kind <= len(_BYTES_OF):
                raise _Overstated
            self.skip_padded(values * _BYTES_OF[kind - 1])

    def list_length(self) -> int:
        self.skip(4)  # its tag
        return self.number(self.count)

    def number(self, width: int) -> int:
        """Number of following items, which take at least a byte each: never more than the bytes
        left."""
        value = int.from_bytes(self.file.read(width), "big")
        self.left -= width
        if not value <= self.left:
            raise _Overstated
        return value

    def skip_padded(self, n: int) -> None:
        """Skip bytes, padded to a multiple of four."""
        self.skip((n + 3) // 4 * 4)

    def skip(self, n: int) -> None:
        self.left -= n
        if self.left < 0:
            raise _Overstated
        self.file.seek(n, os.SEEK_CUR)
