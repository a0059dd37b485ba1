# SPDX-License-Identifier: BSD-3-Clause
"""A folder that one run at a time works in: two would destroy each other's files."""

import fcntl
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from rockfall.errors import RockfallError

LOCK = "rockfall.lock"  # as in io/lock.f90


@contextmanager
def locked(folder: Path, say: Callable[[str], None]) -> Iterator[None]:
    """Keep other processes, rockfall-batch too, out of a folder. It is made where it is missing,
    and removed at the end if it is empty. However the process ends, the kernel opens the lock."""
    try:
        descriptor = _open(folder)
        while not _hold(descriptor, folder, say):
            os.close(descriptor)
            descriptor = _open(folder)
    except OSError as error:
        raise RockfallError(f"{folder}: cannot be written: {error.strerror}") from error
    try:
        yield
    finally:
        with suppress(OSError):  # somebody has removed it, or keeps files of his own there
            (folder / LOCK).unlink()
        os.close(descriptor)
        with suppress(OSError):
            folder.rmdir()


def _open(folder: Path) -> int:
    folder.mkdir(exist_ok=True)
    return os.open(folder / LOCK, os.O_RDWR | os.O_CREAT, 0o666)


def _hold(descriptor: int, folder: Path, say: Callable[[str], None]) -> bool:
    """Whether the lock was taken, and is still the file of that name: who held it may have removed
    it just before."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise RockfallError(
            f"{folder}: another run is at work on it; wait for its end, or choose another output"
        ) from None
    except OSError as error:
        say(f"{folder}: cannot be locked ({error.strerror}); two runs on it would destroy it")
        return True
    try:
        return os.path.samestat(os.fstat(descriptor), os.stat(folder / LOCK))
    except FileNotFoundError:
        return False
