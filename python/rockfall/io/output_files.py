# SPDX-License-Identifier: BSD-3-Clause
"""Permission to write outputs: never over an input, and over an existing file only on request."""

from __future__ import annotations

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
from rockfall.interrupts import interrupts
from rockfall.io.files import (
    TEMPORARY,
    check_regular,
    check_renaming,
    keep_next_to,
    not_replaced,
)
from rockfall.io.netcdf import check_letters
from rockfall.system import replace, reserve

RESULT_NAME = re.compile(r"(\.nc|(^|\.)part\d+of\d+)$")
EXISTS = "already exists; not overwritten (--overwrite replaces it)"
#: A disk with less left [bytes] is full to a library: some take back what they wrote last.
LEFT_FREE = 2**24
#: Permission to replace files: given in scripts, where the call implies it.
_replacing: ContextVar[bool] = ContextVar("replacing", default=True)


@contextmanager
def overwriting(allowed: bool) -> Iterator[None]:
    """Allow or refuse, within the block, to replace existing files."""
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
        raise RockfallError(f"{path}: results are netCDF files, their names must end in .nc")


def check_output(
    path: str | Path, inputs: Iterable[str | Path] = (), *, tries: bool = True
) -> None:
    """Refuse an output path before the work starts: an input, an existing file unless
    `overwriting` allows it, a folder, a missing folder, or a path that is not writable, which is
    only tried if requested: after the work what is finished shall be written anywhere."""
    path = Path(path)
    check_outputs([path], inputs)
    if not path.parent.is_dir():
        raise RockfallError(f"{path}: there is no folder {path.parent}")
    if tries:
        _check_place(path, path.parent)


def _check_place(path: Path, folder: Path) -> None:
    """Refuse an output in a folder without permission to write, or that cannot rename files."""
    try:
        check_renaming(folder)
    except OSError as error:
        cannot = "cannot rename files" if error.filename2 else "is not writable"
        raise RockfallError(f"{path}: folder {folder} {cannot}: {error.strerror}") from error


def check_space(path: Path, size: int) -> None:
    """Refuse an output of at least this size [bytes] that the disk of its folder cannot hold."""
    try:
        reserve(path.parent, size)
    except OSError as error:
        raise RockfallError(
            f"{path}: needs at least {size / 1e6:,.2g} MB of disk: {error.strerror}"
        ) from error


def check_outputs(paths: Iterable[Path], inputs: Iterable[str | Path] = ()) -> None:
    """Refuse to overwrite an input under any name, a folder or a device, and, unless `overwriting`
    allows it, any file."""
    taken = [path for path in paths if os.path.lexists(path)]
    read = {_identity(path) for path in inputs if os.path.exists(path)} if taken else set()
    for path in taken:
        if path.is_dir():
            raise RockfallError(f"{path}: is a folder; a file name is needed")
        if path.exists() and _identity(path) in read:
            raise RockfallError(f"{path}: is an input; it is not overwritten")
        check_regular(path)
        if not _replacing.get():
            raise RockfallError(f"{path}: {EXISTS}")


def _identity(path: str | Path) -> tuple[int, int]:
    """Identity of a file, equal for all its names."""
    status = os.stat(path)
    return status.st_dev, status.st_ino


def why_unwritten(error: Exception, folder: Path) -> str:
    """Reason why a library could not write a file in a folder: most do not report that the disk is
    full."""
    full = shutil.disk_usage(folder).free < LEFT_FREE
    return os.strerror(errno.ENOSPC) if full else str(error)


def check_folder(folder: Path, *, tries: bool = True) -> None:
    """Refuse a file in place of a folder, and, if this shall be tried, one that is not writable;
    the folder need not exist."""
    if folder.exists() and not folder.is_dir():
        raise RockfallError(f"{folder}: is a file, a folder is needed")
    if tries:
        _check_place(folder, _existing(folder))


def _existing(folder: Path) -> Path:
    """The folder, or the nearest of its parents that exists."""
    place = folder.resolve()
    return next(path for path in (place, *place.parents) if path.exists())


@contextmanager
def atomic_folder(
    folder: str | Path, inputs: Iterable[str | Path] = (), last: str = ""
) -> Iterator[Path]:
    """Yield a temporary folder, whose files are moved to `folder` if the block succeeds, `last` at
    the end. If it fails, nothing has changed; if a file of it cannot be replaced, as on Windows one
    that is open, the new ones are left in a folder next to it."""
    folder = Path(folder)
    check_folder(folder, tries=False)
    part = kept = None
    try:
        # accessible to its owner only
        part = Path(tempfile.mkdtemp(dir=_existing(folder), prefix=TEMPORARY))
        new, old = part / "new", part / "old"
        for path in new, old:
            path.mkdir()
        yield new
        paths = sorted(new.iterdir(), key=lambda path: path.name == last)
        targets = [folder / path.name for path in paths]
        check_outputs(targets, inputs)
        moves = [(path, old / path.name) for path in reversed(targets) if os.path.lexists(path)]
        moves += zip(paths, targets, strict=True)
        try:
            with _made(folder), interrupts():  # all of them, or none
                _move_all(moves)
        except OSError as error:
            kept = keep_next_to(folder.resolve(), new)
            raise RockfallError(
                f"{error.filename or folder}: {not_replaced(error)} The new files are in {kept}"
            ) from error
    except OSError as error:
        raise RockfallError(f"{folder}: cannot be written: {error.strerror or error}") from error
    except RockfallError as error:
        if kept is not None:
            raise
        raise RockfallError(str(error).replace(str(new), str(folder)), error.code) from error
    finally:
        if part and kept != new:
            shutil.rmtree(part, ignore_errors=True)


@contextmanager
def _made(folder: Path) -> Iterator[None]:
    """Create a folder and its parents; new ones are removed again after an error."""
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        yield
    except BaseException:
        for path in missing:
            if path.exists():
                path.rmdir()
        raise


def _move_all(moves: Iterable[tuple[Path, Path]]) -> None:
    """Move files one by one; on a failure or Ctrl-C, all are moved back."""
    begun = []
    try:
        for source, target in moves:
            begun.append((source, target))
            replace(source, target)
    except BaseException:
        for source, target in reversed(begun):
            if os.path.lexists(target) and not os.path.lexists(source):
                replace(target, source)
        raise
