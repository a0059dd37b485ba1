# SPDX-License-Identifier: BSD-3-Clause
"""Atomic writing: a file, or all files of a folder, appear only when complete."""

import itertools
import os
import shutil
import socket
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from rockfall.errors import RockfallError
from rockfall.interrupts import interrupts
from rockfall.io.output_files import TEMPORARY, check_folder, check_outputs, existing
from rockfall.system import lock, replace

LOCK, UNLOCKED = "lock", "unlocked"  # files in a temporary folder
OLD = "old"  # subfolder for previous versions of replaced files
IN_USE = "cannot be replaced (is it open in another program?)."


@contextmanager
def atomic_write(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path with the same name. After the block, rename it to `path`; after an
    error, remove it. It is in a new folder next to `path` that only its owner can access, so that
    no other user can place a link there. Raises a RockfallError if it cannot be written, or renamed
    (on Windows, over an open file); the file is then kept next to `path`."""
    path = Path(path)
    try:
        with _temporary(path.parent) as (place, stays):
            part = place / path.name
            yield part
            try:
                replace(part, path)
            except OSError as error:
                if not part.exists():  # the block wrote nothing
                    raise
                kept = keep_next_to(path, part)
                stays.append(kept)
                text = f"{path}: {not_replaced(error)} The new file is {kept}"
                raise RockfallError(text) from error
    except OSError as error:
        raise RockfallError(f"{path}: cannot be written: {error.strerror or error}") from error


@contextmanager
def atomic_folder(
    folder: str | Path, inputs: Iterable[str | Path] = (), last: str = ""
) -> Iterator[Path]:
    """Yield a temporary folder. If the block succeeds, move its files to `folder`, `last` after all
    others; if it fails, change nothing. `inputs` are never overwritten. Raises a RockfallError if
    files cannot be written, or old files not replaced (on Windows, open files); the new files are
    then kept in a folder next to `folder`."""
    folder = Path(folder)
    check_folder(folder, tries=False)
    new = kept = None
    try:
        with _temporary(existing(folder)) as (place, stays):
            new, old = place / "new", place / OLD
            for path in new, old:
                path.mkdir()
            yield new
            paths = sorted(new.iterdir(), key=lambda path: path.name == last)
            targets = [folder / path.name for path in paths]
            check_outputs(targets, inputs)
            moves = [(path, old / path.name) for path in reversed(targets) if os.path.lexists(path)]
            moves += zip(paths, targets, strict=True)
            try:
                with _made(folder), interrupts():  # moves all files or none
                    _move_all(moves)
            except OSError as error:
                kept = keep_next_to(folder.resolve(), new)
                stays.append(kept)
                raise RockfallError(
                    f"{error.filename or folder}: {not_replaced(error)} The new files are in {kept}"
                ) from error
    except OSError as error:
        raise RockfallError(f"{folder}: cannot be written: {error.strerror or error}") from error
    except RockfallError as error:
        if kept is not None:
            raise
        raise RockfallError(str(error).replace(str(new), str(folder)), error.code) from error


@contextmanager
def _temporary(parent: Path) -> Iterator[tuple[Path, list[Path]]]:
    """Yield a new folder that only its owner can access, and a list for files that must stay in it;
    if the list is empty at the end, remove the folder. First remove folders of killed processes on
    this machine, unless they contain the only copy of a replaced file."""
    machine = socket.gethostname().encode()  # other machines of a cluster may ignore locks
    for left in parent.glob(f"{TEMPORARY}*/{LOCK}"):
        with suppress(OSError), open(left, "r+b") as file:
            lock(file.fileno())
            if file.read() == machine and not any(left.parent.glob(f"{OLD}/*")):
                shutil.rmtree(left.parent, ignore_errors=True)
    place, kept = Path(tempfile.mkdtemp(dir=parent, prefix=TEMPORARY)), list[Path]()
    try:
        with open(place / UNLOCKED, "xb") as file:
            file.write(machine)
            file.flush()
            with suppress(OSError):  # without locks, the folder of a killed process stays
                lock(file.fileno())
                os.rename(place / UNLOCKED, place / LOCK)
            yield place, kept
    finally:
        if any(place in path.parents for path in kept):
            (place / LOCK).unlink(missing_ok=True)
        else:
            shutil.rmtree(place, ignore_errors=True)


@contextmanager
def _made(folder: Path) -> Iterator[None]:
    """Create a folder and its parents; after an error, remove the folders that were created."""
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
    """Move files in turn; on a failure or Ctrl-C, move all back."""
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


def not_replaced(error: OSError) -> str:
    """Reason why a finished file could not be renamed."""
    return IN_USE if isinstance(error, PermissionError) else f"no renaming: {error.strerror}."


def keep_next_to(path: Path, new: Path) -> Path:
    """Move a file or folder that could not replace `path` next to `path`, as NAME-2, NAME-3, ...,
    and return its new path. On a file system that cannot rename, leave it in place and return
    `new`."""
    names = (path.with_name(f"{path.stem}-{k}{path.suffix}") for k in itertools.count(2))
    kept = next(name for name in names if not os.path.lexists(name))
    try:
        os.rename(new, kept)
    except OSError:
        return new
    return kept
