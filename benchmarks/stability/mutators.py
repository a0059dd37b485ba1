# SPDX-License-Identifier: BSD-3-Clause
"""Alterations of a file: its bytes, words, numbers, structure, or the target of its name.

A mutator of content takes (random, content, other content of the same kind) and returns content;
a mutator of places puts something other than a file under a name.
"""

from __future__ import annotations

import contextlib
import os
import re
import struct
import tempfile
from collections.abc import Callable
from pathlib import Path

import netCDF4
import numpy as np

Content = Callable[[np.random.Generator, bytes, bytes], bytes]
Place = Callable[[np.random.Generator, Path], None]

MOST = 4_000_000  # maximum bytes of an altered file: more costs time and shows nothing
_NUMBER = re.compile(rb"[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?")
_WORD = re.compile(rb"[A-Za-z_][A-Za-z_0-9]*")
_QUOTED = re.compile(rb"'[^'\n]*'|\"[^\"\n]*\"")
NUMBERS = (
    b"inf", b"-Infinity", b"nan", b"1e999", b"-1e999", b"1e-999", b"-0", b"-0.0", b"0", b"", b"-1",
    b"1e308", b"5e-324", b"2147483647", b"2147483648", b"-2147483649", b"1000000000", b"1e9",
    b"99999999999999999999999999", b"0x10", b"1_000", b"1,5", b"1d400", b"1e", b"+-1", b"--1", b".",
    "٣".encode(), "１２".encode(), "½".encode(), b"1 2", b"3*", b"2*1.0", b"1000000000*1.0",
    b"(1,2)", b"1.0.0", b"1e+", b"\xff", b"\x00", b"#", b"9" * 400, b"0." + b"0" * 5000 + b"1",
)  # fmt: skip
TEXTS = (
    b"", b" ", b".", b"..", b"/", b"../../escape", b"/dev/zero", b"/dev/full", b"/dev/null",
    b"/dev/stdin", b"/proc/self/mem", b"/proc/self/environ", b"~", b"dem.tif", b"case.nml",
    b"a/" * 3000 + b"b", b"a" * 5000, b"../" * 500, b"x.nc:", b"x.nc:y:z", b":", b"%s%n%d",
    b"/vsimem/x", b"/vsicurl/http://127.0.0.1:9/x", b"/vsizip/dem.asc", b"/vsistdin/",
    b"NETCDF:dem.nc:z", b"GTIFF_DIR:1:dem.tif", b"<VRTDataset></VRTDataset>", b"$(id)", b"a\nb",
    b"''", b"\"", "é".encode() * 200, "\u202etxt".encode(), b"\x1b[31m", b"\x00", b"-o", b"--help",
)  # fmt: skip


SIZES = tuple(b"1000000000 2147483647 4294967297 65536 46341 0 -3 1 1e9".split())
TAGS = (256, 257, 258, 259, 273, 277, 278, 322, 324, 339, 42113)  # TIFF tags


def _place(random: np.random.Generator, content: bytes) -> int:
    return int(random.integers(len(content) + 1))


def _one(random: np.random.Generator, several: tuple | list):
    return several[int(random.integers(len(several)))]


def _replace(random: np.random.Generator, content: bytes, pattern: re.Pattern, by: bytes) -> bytes:
    """Replace one occurrence of a pattern."""
    found = list(pattern.finditer(content))
    if not found:
        return bits(random, content, b"")
    here = _one(random, found)
    return content[: here.start()] + by + content[here.end() :]


# ---- bytes ---------------------------------------------------------------------------------------


def bits(random: np.random.Generator, content: bytes, _: bytes) -> bytes:
    """Flip one to eight bits, mostly near each other."""
    spoiled = bytearray(content or b"\0")
    near = _place(random, content)
    for _k in range(int(random.integers(1, 9))):
        beside = random.random() < 0.7
        place = near + int(random.integers(64)) if beside else _place(random, content)
        spoiled[place % len(spoiled)] ^= 1 << int(random.integers(8))
    return bytes(spoiled)


def head_bits(random: np.random.Generator, content: bytes, _: bytes) -> bytes:
    """Flip bits in the first 512 bytes, where formats store sizes and positions."""
    return bits(random, content[:512], b"") + content[512:]


def random_bytes(random: np.random.Generator, content: bytes, _: bytes) -> bytes:
    """Replace a part by noise."""
    start, noise = _place(random, content), random.bytes(int(random.integers(1, 200)))
    return content[:start] + noise + content[start + len(noise) :]


def extremes(random: np.random.Generator, content: bytes, _: bytes) -> bytes:
    """Set a binary number of 1 to 8 bytes to one of its extremes."""
    start = _place(random, content)
    ones, numbers = b"\xff" * 7, [struct.pack("<d", float(name)) for name in ("nan", "inf")]
    value = _one(random, (ones + b"\xff", b"\0" * 8, b"\x7f" + ones, ones + b"\x7f", *numbers))
    value = value[: _one(random, (1, 2, 4, 8))]
    return content[:start] + value + content[start + len(value) :]


def truncation(random: np.random.Generator, content: bytes, _: bytes) -> bytes:
    """Remove the end of a file, sometimes everything."""
    ends = (0, 1, len(content) // 2, len(content) - 1, _place(random, content))
    return content[: _one(random, ends)]


def duplication(random: np.random.Generator, content: bytes, _: bytes) -> bytes:
    """Repeat a part of the file, or all of it."""
    first, last = sorted((_place(random, content), _place(random, content)))
    times = min(_one(random, (2, 2, 50, 5000)), MOST // max(1, last - first) + 1)
    return content[:first] + content[first:last] * times + content[last:]


def removal(random: np.random.Generator, content: bytes, _: bytes) -> bytes:
    """Remove a part of the file."""
    first, last = sorted((_place(random, content), _place(random, content)))
    return content[:first] + content[min(last, first + 2000) :]


def splice(random: np.random.Generator, content: bytes, other: bytes) -> bytes:
    """Join the beginning of one file and the end of another."""
    return content[: _place(random, content)] + other[_place(random, other) :]


def noise(random: np.random.Generator, content: bytes, _: bytes) -> bytes:
    """Replace everything after the first few bytes by random bytes."""
    return content[: _one(random, (0, 4, 8, 100))] + random.bytes(int(random.integers(5000)))


BYTES = (bits, head_bits, random_bytes, extremes, truncation, duplication, removal, splice, noise)

# ---- text ----------------------------------------------------------------------------------------


def number(random: np.random.Generator, content: bytes, _: bytes) -> bytes:
    """Replace a number by an invalid or excessive one."""
    return _replace(random, content, _NUMBER, _one(random, NUMBERS))


def numbers(random: np.random.Generator, content: bytes, _: bytes) -> bytes:
    """Replace two to four numbers."""
    for _k in range(int(random.integers(2, 5))):
        content = number(random, content, b"")
    return content


def quoted(random: np.random.Generator, content: bytes, _: bytes) -> bytes:
    """Replace a quoted text by a path, or by an invalid path."""
    return _replace(random, content, _QUOTED, b"'" + _one(random, TEXTS) + b"'")


def word(random: np.random.Generator, content: bytes, _: bytes) -> bytes:
    """Repeat, rename, capitalise, remove or replace a word."""
    words = [found.group() for found in _WORD.finditer(content)] or [b"x"]
    mine = _one(random, words)
    others = (mine * 2, mine + b"_", mine.upper(), mine[:-1], b"", _one(random, words), b"q" * 5000)
    return _replace(random, content, re.compile(re.escape(mine)), _one(random, others))


def line_twice(random: np.random.Generator, content: bytes, _: bytes) -> bytes:
    """Repeat, move or remove a line."""
    lines = content.splitlines(keepends=True) or [b""]
    mine = lines.pop(int(random.integers(len(lines))))
    for _k in range(_one(random, (0, 1, 2, 300))):
        lines.insert(int(random.integers(len(lines) + 1)), mine)
    return b"".join(lines)


def line_ends(random: np.random.Generator, content: bytes, _: bytes) -> bytes:
    """Change line ends, or add a byte-order mark, tabs for blanks, or UTF-16."""
    how = (
        lambda: content.replace(b"\n", b"\r\n"), lambda: content.replace(b"\n", b"\r"),
        lambda: b"\xef\xbb\xbf" + content, lambda: content.decode("latin1").encode("utf-16"),
        lambda: content.replace(b" ", b"\t"), lambda: content.replace(b"\n", b""),
        lambda: content.replace(b"\n", b"\x0b"), lambda: content.replace(b" ", "\u00a0".encode()),
    )  # fmt: skip
    return _one(random, how)()


def insertion(random: np.random.Generator, content: bytes, _: bytes) -> bytes:
    """Insert characters with or without a special meaning."""
    signs = (
        b"\0", b"'", b"\"", b"''", b"/", b"&", b"&end", b"!", b",", b",,", b";", b"\n", b"\r",
        b"\t", b"=", b"(", b")", b"%", b"\\", b"{", b"[", b"\xc3", b"\xff", b"\x1a", b"\x7f", b"#",
        b"* ",
    )  # fmt: skip
    start, many = _place(random, content), _one(random, signs)
    many *= _one(random, (1, 1, 1, 3, 2000))
    return content[:start] + many + content[start:]


def long_line(random: np.random.Generator, content: bytes, _: bytes) -> bytes:
    """Insert a line of a million characters."""
    start = _place(random, content)
    piece = _one(random, (b" ", b"1", b"1 ", b"x,", b"a", b"'", b"!", b"1.5,"))
    return content[:start] + piece * (1_000_000 // len(piece)) + content[start:]


def sizes(random: np.random.Generator, content: bytes, _: bytes) -> bytes:
    """Falsify the first numbers of a grid, i.e. its sizes."""
    lie = _one(random, SIZES)
    for place in (0, 1) if random.random() < 0.5 else (int(random.integers(0, 2)),):
        found = list(_NUMBER.finditer(content))
        if len(found) > place:
            content = content[: found[place].start()] + lie + content[found[place].end() :]
    return content


TEXT = (number, number, numbers, quoted, word, word, line_twice, line_ends, insertion, long_line)


def columns(random: np.random.Generator, content: bytes, _: bytes) -> bytes:
    """Make very many columns or rows in a table, or an open quote."""
    head, _, rest = content.partition(b"\n")
    many = int(_one(random, (100, 100_000, 1_000_000)))
    how = (
        lambda: head + b",a" * many + b"\n" + rest,
        lambda: head + b"".join(b",c%d" % k for k in range(many // 5)) + b"\n" + rest,
        lambda: head + b"," * many + b"\n" + rest.split(b"\n")[0] + b"," * many,
        lambda: content + rest * min(many, MOST // max(1, len(rest))),
        lambda: head + b"\n\"" + rest * min(many, 1000),
    )  # fmt: skip
    return _one(random, how)()


def nesting(random: np.random.Generator, content: bytes, _: bytes) -> bytes:
    """Nest brackets, up to a hundred thousand deep."""
    depth = int(_one(random, (10, 500, 5000, 100_000)))
    shapes = b'{"type":"GeometryCollection","geometries":['
    open_, close = _one(random, ((b"[", b"]"), (b'{"a":', b"}"), (shapes, b"]}")))
    inner = _one(random, (b"", b"0", b"[0,0]"))
    found = list(re.finditer(rb"\[", content)) or [re.match(b"", content)]
    start = _one(random, found).start()
    return content[:start] + open_ * depth + inner + close * depth + content[start:]


# ---- formats -------------------------------------------------------------------------------------


def tiff_tag(random: np.random.Generator, content: bytes, _: bytes) -> bytes:
    """Falsify an entry of the first directory: sizes, strips and their positions, compression,
    types."""
    if len(content) < 8 or content[:2] not in (b"II", b"MM"):
        return bits(random, content, b"")
    end = "<" if content[:2] == b"II" else ">"
    (start,) = struct.unpack_from(end + "I", content, 4)
    if start + 2 > len(content):
        return bits(random, content, b"")
    (entries,) = struct.unpack_from(end + "H", content, start)
    spoiled, place = bytearray(content), start + 2 + 12 * int(random.integers(max(1, entries)))
    if place + 12 > len(content):
        return bits(random, content, b"")
    how = int(random.integers(4))
    numbers = (0, 1, 2, 7, 65535, 100_000, 2**31 - 1, 2**32 - 1, len(content), start)
    value = _one(random, numbers)
    if how == 0:
        struct.pack_into(end + "H", spoiled, place, _one(random, TAGS))
    elif how == 1:
        struct.pack_into(end + "H", spoiled, place + 2, value % 20)
    else:
        struct.pack_into(end + "I", spoiled, place + (4 if how == 2 else 8), value)
    return bytes(spoiled)


def tiff_bomb(random: np.random.Generator, content: bytes, _: bytes) -> bytes:
    """Make a few hundred bytes that decompress to gigabytes: false width and height of a deflated
    file."""
    if content[:2] != b"II" or len(content) < 8:
        return bits(random, content, b"")
    spoiled, (start,) = bytearray(content), struct.unpack_from("<I", content, 4)
    for k in range(struct.unpack_from("<H", content, start)[0] if start + 2 <= len(content) else 0):
        place = start + 2 + 12 * k
        if place + 12 <= len(content) and struct.unpack_from("<H", content, place)[0] in (256, 257):
            size = int(_one(random, (20_000, 40_000, 100_000, 2**31 - 1)))
            struct.pack_into("<HI", spoiled, place + 2, 4, 1)
            struct.pack_into("<I", spoiled, place + 8, size)
    return bytes(spoiled)


def names(random: np.random.Generator, content: bytes, _: bytes) -> bytes:
    """Replace a name in a binary file (dimension, variable, attribute), keeping its length."""
    found = sorted({w.group() for w in re.finditer(rb"[A-Za-z_][A-Za-z_0-9]{2,30}", content)})
    if not found:
        return bits(random, content, b"")
    mine = _one(random, found)
    others = (b"q" * len(mine), mine[::-1], mine.upper(), mine[:-1] + b"\0", mine[:-1] + b"/")
    return content.replace(mine, _one(random, others), -1 if random.random() < 0.5 else 1)


def structure(random: np.random.Generator, content: bytes, _: bytes) -> bytes:
    """Change the contents of a valid netCDF file: rename a variable or dimension, remove or change
    an attribute, or set an invalid number. Only for valid files."""
    with tempfile.NamedTemporaryFile(suffix=".nc") as place:
        Path(place.name).write_bytes(content)
        with (
            netCDF4.Dataset(place.name, "a") as file,
            contextlib.suppress(RuntimeError, AttributeError),
        ):
            _change(random, file)  # changes refused by netCDF are skipped
        return Path(place.name).read_bytes()


def _change(random: np.random.Generator, file: netCDF4.Dataset) -> None:
    variable = _one(random, list(file.variables.values()))
    owner = _one(random, (file, variable))
    attribute = _one(random, owner.ncattrs() or [""])
    values = ("", "x", "{}", "[1]", "2", -1, 2**40, float("nan"), "9" * 400, [1.0, 2.0], "\u0663")
    what = int(random.integers(5))
    if what == 0:
        file.renameVariable(variable.name, "other")
    elif what == 1:
        file.renameDimension(_one(random, list(file.dimensions)), "other")
    elif what == 2 and attribute:
        owner.delncattr(attribute)
    elif what == 3 and attribute not in ("", "_FillValue"):
        owner.setncattr(attribute, _one(random, values))
    elif variable.size and variable.dtype is not str and variable.dtype.kind in "if":
        whole = variable.dtype.kind == "i"
        most = 2**31 - 1 if whole else float(_one(random, ("nan", "inf", "1e300")))
        index = tuple(int(random.integers(n)) for n in variable.shape)
        value = np.array(_one(random, (most, -most, -1, 0)))
        with np.errstate(over="ignore"):
            variable[index or ...] = value.astype(variable.dtype)


# ---- places --------------------------------------------------------------------------------------


def _link(to: str) -> Place:
    def link(_: np.random.Generator, path: Path) -> None:
        path.unlink()
        path.symlink_to(to)

    link.__name__ = f"link to {to}"
    return link


def fifo(_: np.random.Generator, path: Path) -> None:
    """Make a pipe that nobody writes to."""
    path.unlink()
    os.mkfifo(path)


def folder(_: np.random.Generator, path: Path) -> None:
    """Make a folder with the name of the file."""
    path.unlink()
    path.mkdir()


def missing(_: np.random.Generator, path: Path) -> None:
    """Remove the file."""
    path.unlink()


def sparse(_: np.random.Generator, path: Path) -> None:
    """Append a gigabyte of zeros that take no disk space."""
    os.truncate(path, 1_000_000_000)


def itself(_: np.random.Generator, path: Path) -> None:
    """Make a link to itself."""
    path.unlink()
    path.symlink_to(path.name)


def deep(_: np.random.Generator, path: Path) -> None:
    """Put the file at the end of a path of a hundred folders, and link to it."""
    bottom = path.parent.joinpath(*["d" * 30] * 100)
    os.makedirs(bottom)
    path.rename(bottom / path.name)
    path.symlink_to(bottom / path.name)


PLACES = (
    *map(_link, ("/dev/zero", "/dev/full", "/dev/null", "/dev/urandom", "/proc/self/mem")),
    fifo, folder, missing, sparse, itself, deep,
)  # fmt: skip

GRID = (*TEXT, *BYTES, sizes, sizes)
TABLE = (*TEXT, *BYTES, columns, columns)
JSON = (*TEXT, *BYTES, nesting, nesting)
TIFF = (*BYTES, tiff_tag, tiff_tag, tiff_tag, tiff_bomb)
HDF5 = (*BYTES, names, names)
RESULT = (*HDF5, *[structure] * len(HDF5))
