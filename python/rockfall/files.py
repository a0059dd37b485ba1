# SPDX-License-Identifier: BSD-3-Clause
"""Files appear under their name only when they are whole."""

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from rockfall.errors import RockfallError

LARGEST_TEXT = 64 * 1024**2  # bytes, as in rockfall_textfile.f90


def check_free(path: str | Path, inputs: Iterable[str | Path] = ()) -> None:
    """Refuse a place for a file that is a folder, in none, or one of the inputs."""
    path = Path(path)
    if os.path.realpath(path) in map(os.path.realpath, inputs):
        raise RockfallError(f"{path}: is an input; it is not overwritten")
    if path.is_dir():
        raise RockfallError(f"{path}: is a folder; a file name is needed")
    if not path.absolute().parent.is_dir():
        raise RockfallError(f"{path}: there is no folder {path.parent}")


def check_regular(path: str | Path) -> None:
    """Refuse a pipe or a device as a file to read: it may have no end, or not even a beginning."""
    if os.path.exists(path) and not (os.path.isfile(path) or os.path.isdir(path)):
        raise RockfallError(f"{path}: not a regular file")


def check_text_file(path: str | Path) -> None:
    """Refuse what is no regular file, or larger than any text of ours."""
    check_regular(path)
    if os.path.isfile(path) and os.path.getsize(path) > LARGEST_TEXT:
        raise RockfallError(f"{path}: larger than 64 MB; not a text file of ours")


@contextmanager
def whole_file(path: str | Path) -> Iterator[Path]:
    """A temporary path beside `path`, renamed to it when the block ends well, removed when not.

    It keeps the ending of the name, from which drivers tell the format.
    """
    path = Path(path)
    part = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    try:
        yield part
        os.replace(part, path)
    except OSError as error:
        raise RockfallError(f"{path}: cannot be written: {error.strerror or error}") from error
    finally:
        part.unlink(missing_ok=True)
