# SPDX-License-Identifier: BSD-3-Clause
"""Checks before outputs are written: inputs are never overwritten, other files only on request."""

import errno
import os
import re
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

from rockfall.errors import RockfallError
from rockfall.io.files import check_regular
from rockfall.io.netcdf import check_letters
from rockfall.system import replace, reserve

TEMPORARY = ".rockfall-"  # prefix of temporary folders
RESULT_NAME = re.compile(r"(\.nc|(^|\.)part\d+of\d+)$")
EXISTS = "already exists; not overwritten (--overwrite replaces it)"
#: Free space [bytes] below which a failed write is blamed on a full disk.
LEFT_FREE = 2**24
#: Whether existing files may be replaced; scripts may by default.
_replacing: ContextVar[bool] = ContextVar("replacing", default=True)


@contextmanager
def overwriting(allowed: bool) -> Iterator[None]:
    """Allow or forbid the replacement of existing files within the block."""
    before = _replacing.set(allowed)
    try:
        yield
    finally:
        _replacing.reset(before)


def check_result_path(
    path: str | Path, inputs: Iterable[str | Path] = (), *, tries: bool = True
) -> None:
    """Refuse an output path for a result before the work starts; see `check_output`."""
    check_output(path, inputs, tries=tries)
    check_letters(path)
    if not RESULT_NAME.search(Path(path).name):
        raise RockfallError(f"{path}: results are netCDF files: the output name must end in .nc")


def check_output(
    path: str | Path, inputs: Iterable[str | Path] = (), *, tries: bool = True
) -> None:
    """Refuse an output path before the work starts: an input, an existing file (unless
    `overwriting` allows it), a folder, or a file in a missing folder; with `tries`, also a folder
    in which files cannot be written or renamed. After the work, finished files are kept wherever
    possible."""
    path = Path(path)
    check_outputs([path], inputs)
    if not path.parent.is_dir():
        raise RockfallError(f"{path}: folder {path.parent} does not exist")
    if tries:
        _check_place(path, path.parent)


def _check_place(path: Path, folder: Path) -> None:
    """Refuse an output in a folder without write permission, or where files cannot be renamed."""
    try:
        _try_renaming(folder)
    except OSError as error:
        cannot = "cannot rename files" if error.filename2 else "is not writable"
        raise RockfallError(f"{path}: folder {folder} {cannot}: {error.strerror}") from error


def _try_renaming(folder: Path) -> None:
    """Try to create a folder and a file, and to replace a file by renaming; raises OSError."""
    descriptor, target = tempfile.mkstemp(dir=folder, prefix=TEMPORARY)
    os.close(descriptor)
    try:
        with tempfile.TemporaryDirectory(dir=folder, prefix=TEMPORARY) as place:
            part = Path(place) / "part"
            part.touch()
            replace(part, Path(target))
    finally:
        os.unlink(target)


def check_space(path: Path, size: int) -> None:
    """Refuse an output of at least this size [bytes] if the disk lacks the space."""
    try:
        reserve(path.parent, size)
    except OSError as error:
        raise RockfallError(
            f"{path}: needs at least {size / 1e6:,.2g} MB of disk: {error.strerror}"
        ) from error


def check_outputs(paths: Iterable[Path], inputs: Iterable[str | Path] = ()) -> None:
    """Refuse to overwrite an input (under any name), a folder, a device or, unless `overwriting`
    allows it, any existing file."""
    taken = [path for path in paths if os.path.lexists(path)]
    read = {_identity(path) for path in inputs if os.path.exists(path)} if taken else set()
    for path in taken:
        if path.is_dir():
            raise RockfallError(f"{path}: is a folder: give a file name")
        if path.exists() and _identity(path) in read:
            raise RockfallError(f"{path}: is an input; not overwritten")
        check_regular(path)
        if not _replacing.get():
            raise RockfallError(f"{path}: {EXISTS}")


def _identity(path: str | Path) -> tuple[int, int]:
    """Device and inode of a file, which are the same under all its names."""
    status = os.stat(path)
    return status.st_dev, status.st_ino


def why_unwritten(error: Exception, folder: Path) -> str:
    """Reason why a library could not write a file; most libraries do not report a full disk."""
    full = shutil.disk_usage(folder).free < LEFT_FREE
    return os.strerror(errno.ENOSPC) if full else str(error)


def check_folder(folder: Path, *, tries: bool = True) -> None:
    """Refuse an output folder that is a file or, with `tries`, not writable; it may be missing."""
    if folder.exists() and not folder.is_dir():
        raise RockfallError(f"{folder}: is a file: give a folder")
    if tries:
        _check_place(folder, existing(folder))


def existing(folder: Path) -> Path:
    """The folder, or its nearest existing parent."""
    place = folder.resolve()
    return next(path for path in (place, *place.parents) if path.exists())
