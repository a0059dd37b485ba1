# SPDX-License-Identifier: BSD-3-Clause
"""Locks that allow one run at a time to write an output, as in io/system.c."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from rockfall.errors import RockfallError
from rockfall.io.files import check_regular
from rockfall.system import NO_FOLLOW, lock, remove_locked


@contextmanager
def locked(output: Path, say: Callable[[str], None]) -> Iterator[None]:
    """Lock an output against other processes, including rockfall-batch, with an empty file next to
    it. The operating system releases the lock when the process ends, however it ends. Raises a
    RockfallError if the file cannot be written, or if another run holds the lock."""
    path = output.with_name(f"{output.name}.lock")
    try:
        descriptor = _open(path)
        while not _hold(descriptor, path, say):
            os.close(descriptor)
            descriptor = _open(path)
    except OSError as error:
        raise RockfallError(f"{path}: cannot be written: {error.strerror}") from error
    try:
        yield
    finally:
        remove_locked(path, descriptor)


def _open(path: Path) -> int:
    check_regular(path)
    if path.exists() and (path.is_dir() or path.stat().st_size):
        raise RockfallError(f"{path}: exists but is not a lock: choose another output")
    return os.open(path, os.O_RDWR | os.O_CREAT | NO_FOLLOW, 0o666)


def _hold(descriptor: int, path: Path, say: Callable[[str], None]) -> bool:
    """Lock a file; False if it was replaced meanwhile. Refuse an output that is locked. Warn, and
    return True, if the file system has no locks."""
    try:
        lock(descriptor)
    except BlockingIOError:
        os.close(descriptor)
        raise RockfallError(
            f"{path}: another run is writing this output: wait, or choose another output"
        ) from None
    except OSError as error:
        say(
            f"{path}: cannot be locked ({error.strerror}), "
            "so do not start a second run with this output"
        )
        return True
    try:
        return os.path.samestat(os.fstat(descriptor), os.stat(path))
    except FileNotFoundError:
        return False
