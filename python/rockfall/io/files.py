# SPDX-License-Identifier: BSD-3-Clause
"""Atomic writing of files: they appear under their name only when complete."""

import itertools
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rockfall.errors import RockfallError
from rockfall.limits import MAX_TEXT
from rockfall.system import replace

IN_USE = "cannot be replaced; is it open in another program?"
TEMPORARY = ".rockfall-"  # prefix of temporary folders
START = 1024  # bytes by which GDAL identifies a format too
#: First bytes of netCDF files, of the classic ones among them, and of GeoTIFFs.
CLASSIC = (b"CDF\1", b"CDF\2", b"CDF\5")
NETCDF = (*CLASSIC, b"\x89HDF\r\n\x1a\n")
TIFF = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")


def check_regular(path: str | Path) -> None:
    """Refuse a pipe or a device as input: it may be endless or block."""
    if os.path.exists(path) and not (os.path.isfile(path) or os.path.isdir(path)):
        raise RockfallError(f"{path}: not a regular file")


def start_of(path: str | Path) -> bytes:
    """First bytes of a file."""
    try:
        with open(path, "rb") as file:
            return file.read(START)
    except OSError as error:
        raise RockfallError(f"{path}: cannot be read: {reason(error, path)}") from error


def reason(error: OSError, path: str | Path) -> str:
    """Reason why a file cannot be read; Windows reports a denied permission for a folder."""
    return "Is a directory" if os.path.isdir(path) else error.strerror or str(error)


def relative_name(path: str | Path, folder: str | Path) -> str:
    """Name of a file as a case in `folder` holds it: relative, with `/` on every system; absolute
    if Windows has the file on another drive."""
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:
        return Path(path).absolute().as_posix()


def check_text_file(path: str | Path) -> None:
    """Refuse files that are not regular, or too large for a text."""
    check_regular(path)
    if os.path.isfile(path) and os.path.getsize(path) > MAX_TEXT:
        raise RockfallError(f"{path}: larger than 64 MB; not a text file of ours")


def read_text(path: str | Path) -> str:
    """Text of a regular file, without a byte order mark."""
    check_text_file(path)
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except OSError as error:
        raise RockfallError(f"{path}: cannot be read: {reason(error, path)}") from error
    except UnicodeDecodeError as error:
        raise RockfallError(f"{path}: is not text (UTF-8)") from error


def not_replaced(error: OSError) -> str:
    """Why a finished file did not take its name."""
    return IN_USE if isinstance(error, PermissionError) else f"no renaming: {error.strerror}."


def keep_next_to(path: Path, new: Path) -> Path:
    """Move a file or folder next to the one that it cannot replace, as NAME-2, NAME-3, ...; it
    stays in place on a file system that cannot rename."""
    names = (path.with_name(f"{path.stem}-{k}{path.suffix}") for k in itertools.count(2))
    kept = next(name for name in names if not os.path.lexists(name))
    try:
        os.rename(new, kept)
    except OSError:
        return new
    return kept


def check_renaming(folder: Path) -> None:
    """Try what `atomic_write` does last; an OSError if the folder permits no new folders and files,
    or its file system cannot rename a file over another."""
    descriptor, target = tempfile.mkstemp(dir=folder, prefix=TEMPORARY)
    os.close(descriptor)
    try:
        with tempfile.TemporaryDirectory(dir=folder, prefix=TEMPORARY) as place:
            part = Path(place) / "part"
            part.touch()
            replace(part, Path(target))
    finally:
        os.unlink(target)


@contextmanager
def atomic_write(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path of the same name, renamed to `path` if the block succeeds and removed
    if it fails. It is in a new folder next to `path` with access for its owner only, so that in a
    shared folder nobody can place a link where format drivers will write. If the file cannot be
    renamed, as on Windows over an open one, it is left next to `path`."""
    path = Path(path)
    try:
        place = Path(tempfile.mkdtemp(dir=path.parent, prefix=TEMPORARY))
    except OSError as error:
        raise RockfallError(f"{path}: cannot be written: {error.strerror}") from error
    part, kept = place / path.name, None
    try:
        yield part
        try:
            replace(part, path)
        except OSError as error:
            if not part.exists():  # it was not written
                raise
            kept = keep_next_to(path, part)
            raise RockfallError(f"{path}: {not_replaced(error)} The new file is {kept}") from error
    except OSError as error:
        raise RockfallError(f"{path}: cannot be written: {error.strerror or error}") from error
    finally:
        if kept != part:
            shutil.rmtree(place, ignore_errors=True)
