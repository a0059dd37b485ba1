# SPDX-License-Identifier: BSD-3-Clause
"""Where a command may write: over nothing that it reads, and over nothing but what rockfall wrote.

Names are anyone's, so files of ours are recognised by their contents.
"""

from __future__ import annotations

import os
import re
import shutil
import sqlite3
import tempfile
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import closing, contextmanager
from contextvars import ContextVar
from pathlib import Path

from rockfall.errors import RockfallError
from rockfall.interrupts import interrupts
from rockfall.io.files import NETCDF, SQLITE, TEMPORARY, TIFF, check_netcdf

RESULT, ENSEMBLE, IMPACTS = "a result of a run", "an ensemble", "impacts of the laboratory"
TABLE = "a table of impacts"
HAZARD, STYLE, OBJECT_TABLE = "a hazard", "a style for QGIS", "a table of objects at risk"
SCENE, SCENARIO = "a scene file", "a case of a scenario"
FIGURE, MAP, LAYERS, PAGE = "a figure", "a map", "layers of a result", "a report"
ENSEMBLE_TABLE, STUDY = "the table of an ensemble", "a study of convergence"
LINE_TABLE, LEVEL_TABLE = "a table of line statistics", "a table of return levels"
GROUP_TABLE, PROFILE = "line statistics of groups", "a profile along a line"
MODELS = "a table of rebound models"
VALIDATION = "a validation"
COMPARISON, SETS, JOB = "a comparison", "impact sets of the laboratory", "a Slurm job"
DESIGN, FACTORS = "a table of a design", "a table of partial factors"
POSTERIOR = "a back-analysis"
BOULDER_TABLE, CROSSINGS = "a table of boulders", "a table of crossings"

SIGNATURE = "rockfall"  # the software that a figure, a map and a layer of ours name
BY_SLURM = "# Written by `rockfall slurm`."
BY_HAZARD = "! Written by `rockfall hazard`."
SIGNS = (  # how a file of ours begins, what else its head holds, and what it is
    (b"line,result,units,", b"", ENSEMBLE_TABLE),
    (b"line,quantity,statistic,", b"", STUDY),
    (b"line,quantity,n,fraction,", b"", LINE_TABLE),
    (b"line,source,boulders,", b"", GROUP_TABLE),
    (b"line,volume,boulders,", b"", GROUP_TABLE),
    (b"line,start,end,n,", b"", PROFILE),
    (b"line,quantity,n,max,", b"", LEVEL_TABLE),
    (b"table,line,quantity,", b"", COMPARISON),
    (b"model,line,quantity,", b"", MODELS),
    (b"law,line,quantity,", b"", VALIDATION),
    (b"table,distance,observed,", b"", COMPARISON),
    (b"table,source,statistic,", b"", COMPARISON),
    (b"measure,result,distance,", b"", COMPARISON),
    (b"table,x,y,reach_probability", b"", COMPARISON),
    (b"result,line,", b"", DESIGN),
    (b"standard,factor,", b"", FACTORS),
    (b"parameter,units,case,", b"", POSTERIOR),
    (b"draw,", b"", POSTERIOR),
    (b"! Made by `rockfall back`", b"", POSTERIOR),
    (b"boulder,volume,", b"", BOULDER_TABLE),
    (b"boulder,x,y,time,", b"", CROSSINGS),
    (b"object,geometry,frequency,", b"", OBJECT_TABLE),
    (b"<!DOCTYPE qgis", f"<!-- {SIGNATURE} -->".encode(), STYLE),
    (b"#!/bin/sh\n", BY_SLURM.encode(), JOB),
    (BY_HAZARD.encode(), b"", SCENARIO),
    (b"! ", b"; `rockfall lab remake FILE` makes it again.", SETS),
    (b"<!DOCTYPE html>", f'<meta name="generator" content="{SIGNATURE}">'.encode(), PAGE),
    (b"<?xml", f"<dc:title>{SIGNATURE}</dc:title>".encode(), FIGURE),  # SVG
    (b"\x89PNG", f"tEXtSoftware\0{SIGNATURE}".encode(), FIGURE),
)
RESULT_NAME = re.compile(r"(\.nc|(^|\.)part\d+of\d+)$")
HEAD = 4096  # bytes
EXISTS = "already exists; not overwritten (--overwrite replaces it)"
#: Whether what an earlier command wrote may be replaced: yes in scripts, which say so by the call.
_replacing: ContextVar[bool] = ContextVar("replacing", default=True)


@contextmanager
def overwriting(allowed: bool) -> Iterator[None]:
    """Allow or refuse, within the block, to replace files that rockfall wrote earlier."""
    before = _replacing.set(allowed)
    try:
        yield
    finally:
        _replacing.reset(before)


def check_output(path: str | Path, kind: str, inputs: Iterable[str | Path] = ()) -> None:
    """Refuse a place for a file of this kind, before the work and not after it: one that is a
    folder, in none, not writable, an input, or taken by what is not of the same kind."""
    path = Path(path)
    check_outputs({path: kind}, inputs)
    if kind == RESULT and not RESULT_NAME.search(path.name):
        raise RockfallError(f"{path}: results are netCDF files, their names must end in .nc")
    if not path.parent.is_dir():
        raise RockfallError(f"{path}: there is no folder {path.parent}")
    try:
        tempfile.TemporaryFile(dir=path.parent).close()
    except OSError as error:
        raise RockfallError(
            f"{path}: folder {path.parent} is not writable: {error.strerror}"
        ) from error


def check_outputs(
    kinds: Mapping[Path, str | None],
    inputs: Iterable[str | Path] = (),
    former: Collection[Path] = (),
    same: Collection[Path] = (),
) -> None:
    """Refuse to write over an input, by whatever name it goes there, over what is not of the kind
    that is to be written, except for `former` files, which are known to be of ours, and, unless
    `overwriting` allows it, over any file. Those that stay the `same` are no loss."""
    taken = [path for path in kinds if os.path.lexists(path)]
    read = {_identity(path) for path in inputs if os.path.exists(path)} if taken else set()
    for path in taken:
        if path.is_dir():
            raise RockfallError(f"{path}: is a folder; a file name is needed")
        if path.exists() and _identity(path) in read:
            raise RockfallError(f"{path}: is an input; it is not overwritten")
        if path not in former and path not in same and kind_of(path) != (kinds[path] or ""):
            kind = kinds[path] or "a file"
            raise RockfallError(
                f"{path}: is there, and not {kind} that rockfall wrote; it is not overwritten"
            )
        if not _replacing.get() and path not in same:
            raise RockfallError(f"{path}: {EXISTS}")


def _same_bytes(path: Path, new: Path) -> bool:
    """Whether a file has the contents of the one that is to replace it: nothing is lost."""
    both = path.is_file() and new.is_file() and path.stat().st_size == new.stat().st_size
    return both and path.read_bytes() == new.read_bytes()


def _identity(path: str | Path) -> tuple[int, int]:
    """The same for all names of a file."""
    found = os.stat(path)
    return found.st_dev, found.st_ino


def kind_of(path: str | Path) -> str | None:
    """What a file is that rockfall wrote; None for any other."""
    if not os.path.isfile(path):
        return None
    with open(path, "rb") as file:
        head = file.read(HEAD)
    if head.startswith(NETCDF):
        return _netcdf_kind(path)
    if head.startswith(TIFF):
        return _tiff_kind(path)
    if head.startswith(SQLITE):
        return _geopackage_kind(path)
    if head.startswith(b"%PDF"):  # which names its creator near its end
        return FIGURE if f"/Creator ({SIGNATURE})".encode() in Path(path).read_bytes() else None
    kinds = (kind for start, inside, kind in SIGNS if head.startswith(start) and inside in head)
    return next(kinds, None)


def _netcdf_kind(path: str | Path) -> str | None:
    import netCDF4

    try:
        check_netcdf(path)
        with netCDF4.Dataset(path) as file:
            attrs = {name: file.getncattr(name) for name in file.ncattrs()}
    except (OSError, RuntimeError, ValueError, AttributeError):  # damaged: whose it was is unknown
        return None
    if "contacts_sha256" in attrs:
        return TABLE
    if "lab_case" in attrs:
        return IMPACTS
    if "scene_layout" in attrs:
        return SCENE
    if "hazard_layout" in attrs:
        return HAZARD
    if "case" not in attrs or not str(attrs.get("source", "")).startswith(f"{SIGNATURE} "):
        return None
    signs = {"models_layout": MODELS, "back_layout": POSTERIOR, "ensemble_runs": ENSEMBLE}
    signs |= {"boulders_requested": RESULT}  # which the others have too
    return next((kind for sign, kind in signs.items() if sign in attrs), None)


def _tiff_kind(path: str | Path) -> str | None:
    import rasterio

    try:
        with rasterio.open(path) as file:
            return MAP if file.tags().get("TIFFTAG_SOFTWARE") == SIGNATURE else None
    except rasterio.errors.RasterioError:
        return None


def _geopackage_kind(path: str | Path) -> str | None:
    """All layers must be of ours: who added one would lose it."""
    try:
        read_only = f"{Path(path).absolute().as_uri()}?mode=ro"
        with closing(sqlite3.connect(read_only, uri=True)) as file:
            about = file.execute("SELECT description FROM gpkg_contents").fetchall()
    except sqlite3.Error:
        return None
    return LAYERS if about and all(one == (SIGNATURE,) for one in about) else None


def check_folder(folder: Path) -> None:
    """Refuse a file in place of a folder, which need not be there."""
    if folder.exists() and not folder.is_dir():
        raise RockfallError(f"{folder}: is a file, a folder is needed")


@contextmanager
def atomic_folder(
    folder: str | Path,
    inputs: Iterable[str | Path] = (),
    former: Collection[Path] = (),
    last: str = "",
) -> Iterator[Path]:
    """A temporary folder, whose files go to `folder` when the block ends well, `last` at the end,
    in place of `former` files. When not, nothing has changed."""
    folder = Path(folder)
    check_folder(folder)
    place = folder.resolve()
    base = next(path for path in (place, *place.parents) if path.exists())
    part = None
    try:
        part = Path(tempfile.mkdtemp(dir=base, prefix=TEMPORARY))  # nobody else may enter it
        new, old = part / "new", part / "old"
        for path in new, old:
            path.mkdir()
        yield new
        paths = sorted(new.iterdir(), key=lambda path: path.name == last)
        kinds = dict.fromkeys(former) | {folder / path.name: kind_of(path) for path in paths}
        same = [path for path in kinds if _same_bytes(path, new / path.name)]
        check_outputs(kinds, inputs, former, same)
        there = sorted(filter(os.path.lexists, kinds), key=lambda path: path.name != last)
        moves = [(path, old / path.name) for path in there]
        moves += [(path, folder / path.name) for path in paths]
        with _made(folder), interrupts():  # all of them, or none
            _move_all(moves)
    except OSError as error:
        raise RockfallError(f"{folder}: cannot be written: {error.strerror or error}") from error
    except RockfallError as error:
        raise RockfallError(str(error).replace(str(new), str(folder)), error.code) from error
    finally:
        if part:
            shutil.rmtree(part, ignore_errors=True)


@contextmanager
def _made(folder: Path) -> Iterator[None]:
    """A folder, with those above it; those that were not there are gone again after an error."""
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
    """Move files one by one; when one cannot be moved, or on Ctrl-C, all are where they were."""
    begun = []
    try:
        for source, target in moves:
            begun.append((source, target))
            os.replace(source, target)
    except BaseException:
        for source, target in reversed(begun):
            if os.path.lexists(target) and not os.path.lexists(source):
                os.replace(target, source)
        raise
