# SPDX-License-Identifier: BSD-3-Clause
"""Files of field experiments and events: from a local folder, or downloaded once and checked."""

import hashlib
import os
from pathlib import Path

from rockfall.errors import RockfallError, need
from rockfall.field.archives import ARCHIVES, Archive, RemoteFile

FOLDER = "ROCKFALL_FIELD_DATA"  # environment variable: a folder used in place of downloads
CACHE = "rockfall"  # name of the download folder in the user's cache


def fetch(name: str, folder: str | Path | None = None) -> dict[str, Path]:
    """Return the files of an archive by their local names.

    They are taken from `folder`, or that of the environment variable ROCKFALL_FIELD_DATA, directly
    or in its subfolder of the archive's name; without either they are downloaded into the user's
    cache, once. Every file is checked against its checksum. A RockfallError names missing or
    different files.
    """
    if name not in ARCHIVES:
        raise RockfallError(f"no archive {name!r}, known: {', '.join(ARCHIVES)}")
    archive = ARCHIVES[name]
    given = folder or os.environ.get(FOLDER)
    if given:
        return {file.name: _local(file, Path(given), name) for file in archive.files}
    need("downloading field data needs", "field", "pooch")
    return {file.name: _downloaded(file, archive, name) for file in archive.files}


def _local(file: RemoteFile, folder: Path, name: str) -> Path:
    """File in a folder, unchanged from its publication."""
    if not folder.is_dir():
        raise RockfallError(f"{folder}: no such folder of field data")
    for path in (folder / name / file.name, folder / file.name):
        if path.is_file():
            break
    else:
        raise RockfallError(f"{folder}: has no {file.name}, nor {name}/{file.name}")
    algorithm, _, expected = file.checksum.partition(":")
    try:
        with path.open("rb") as stream:
            digest = hashlib.file_digest(stream, algorithm).hexdigest()
    except OSError as error:
        raise RockfallError(f"{path}: cannot be read: {error.strerror or error}") from None
    if digest != expected:
        raise RockfallError(f"{path}: {algorithm} {digest} is not that of {file.url}: {expected}")
    return path


def _downloaded(file: RemoteFile, archive: Archive, name: str) -> Path:
    """File in the user's cache, downloaded if missing."""
    import pooch

    text = f"{archive.title} (doi:{archive.doi}): {file.url}"
    try:
        path = pooch.retrieve(
            file.url, file.checksum, fname=file.name, path=pooch.os_cache(CACHE) / name
        )
    except ValueError as error:  # from pooch: another checksum
        raise RockfallError(f"{text}: {error}") from None
    except OSError as error:  # no network, no such file, no space
        advice = f"or give a folder that holds {', '.join(archive.names)} ({FOLDER}, --data)"
        raise RockfallError(f"{text}: cannot be downloaded: {error}; {advice}") from None
    return Path(path)
