# SPDX-License-Identifier: BSD-3-Clause
"""Permission to write outputs: never over inputs, and only over files written by rockfall.

Names may be anything, so our files are recognised by their contents.
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

SIGNATURE = "rockfall"  # software name in our figures, maps and layers
BY_SLURM = "# Written by `rockfall slurm`."
BY_HAZARD = "! Written by `rockfall hazard`."
SIGNS = (  # first bytes of our files, other content of the header, and kind
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
#: Permission to replace earlier output: given in scripts, where the call implies it.
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
    """Refuse an output path for a file of this kind before the work starts: a folder, a missing
    folder, a path that is not writable, an input, or a file of another kind."""
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
    """Refuse to overwrite an input under any name, files of other kinds than the new ones except
    for `former` files, which are known to be ours, and, unless `overwriting` allows it, any file.
    Unchanged files (`same`) are permitted."""
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
    """Return True if a file has the contents of its replacement, so that nothing is lost."""
    both = path.is_file() and new.is_file() and path.stat().st_size == new.stat().st_size
    return both and path.read_bytes() == new.read_bytes()


def _identity(path: str | Path) -> tuple[int, int]:
    """Identity of a file, equal for all its names."""
    found = os.stat(path)
    return found.st_dev, found.st_ino


def kind_of(path: str | Path) -> str | None:
    """Kind of a file written by rockfall; None for any other."""
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
    if head.startswith(b"%PDF"):  # PDF names its creator near its end
        return FIGURE if f"/Creator ({SIGNATURE})".encode() in Path(path).read_bytes() else None
    kinds = (kind for start, inside, kind in SIGNS if head.startswith(start) and inside in head)
    return next(kinds, None)


def _netcdf_kind(path: str | Path) -> str | None:
    import netCDF4

    try:
        check_netcdf(path)
        with netCDF4.Dataset(path) as file:
            attrs = {name: file.getncattr(name) for name in file.ncattrs()}
    except (OSError, RuntimeError, ValueError, AttributeError):  # damaged: the owner is unknown
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
    signs |= {"boulders_requested": RESULT}  # shared by the other kinds
    return next((kind for sign, kind in signs.items() if sign in attrs), None)


def _tiff_kind(path: str | Path) -> str | None:
    import rasterio

    try:
        with rasterio.open(path) as file:
            return MAP if file.tags().get("TIFFTAG_SOFTWARE") == SIGNATURE else None
    except rasterio.errors.RasterioError:
        return None


def _geopackage_kind(path: str | Path) -> str | None:
    """Kind of a GeoPackage if all its layers are ours; a layer added by a user would be lost."""
    try:
        read_only = f"{Path(path).absolute().as_uri()}?mode=ro"
        with closing(sqlite3.connect(read_only, uri=True)) as file:
            about = file.execute("SELECT description FROM gpkg_contents").fetchall()
    except sqlite3.Error:
        return None
    return LAYERS if about and all(one == (SIGNATURE,) for one in about) else None


def check_folder(folder: Path) -> None:
    """Refuse a file in place of a folder; the folder need not exist."""
    if folder.exists() and not folder.is_dir():
        raise RockfallError(f"{folder}: is a file, a folder is needed")


@contextmanager
def atomic_folder(
    folder: str | Path,
    inputs: Iterable[str | Path] = (),
    former: Collection[Path] = (),
    last: str = "",
) -> Iterator[Path]:
    """Yield a temporary folder, whose files are moved to `folder` if the block succeeds, `last` at
    the end, replacing `former` files. If it fails, nothing has changed."""
    folder = Path(folder)
    check_folder(folder)
    place = folder.resolve()
    base = next(path for path in (place, *place.parents) if path.exists())
    part = None
    try:
        part = Path(tempfile.mkdtemp(dir=base, prefix=TEMPORARY))  # accessible to its owner only
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
            os.replace(source, target)
    except BaseException:
        for source, target in reversed(begun):
            if os.path.lexists(target) and not os.path.lexists(source):
                os.replace(target, source)
        raise
