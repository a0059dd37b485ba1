# SPDX-License-Identifier: BSD-3-Clause
"""Saving of a document as a case with a GeoPackage, next to the opened file."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import TYPE_CHECKING

from rockfall.app.document import Document, Site, runnable
from rockfall.app.messages import Refused
from rockfall.case import REPEATABLE, Case, given_groups, namelist_text
from rockfall.case_files import input_files
from rockfall.io.output_files import atomic_folder, overwriting
from rockfall.language import say
from rockfall.result.export import write_geopackage

if TYPE_CHECKING:
    from rockfall.result.export import Layers

MAX_NAME = 80  # characters
_NAME = re.compile(r"[\w-](?:[\w .-]*[\w-])?")  # not hidden, no blanks or dots at the end


class Exists(Refused):
    """Refused because a file exists."""


def check_name(name: object) -> str:
    """Bare name of files without an extension; Refused for anything that could be a path."""
    if not isinstance(name, str) or len(name) > MAX_NAME or not _NAME.fullmatch(name):
        raise Refused(say("app.server_name", length=MAX_NAME))
    return name


def check_free(folder: Path, names: list[str], overwrite: bool) -> None:
    """Refuse names of existing files or folders, unless they are to be replaced; and links to
    folders, through which files elsewhere would be replaced."""
    taken = [name for name in names if os.path.lexists(folder / name)]
    for name in taken:
        if (folder / name).is_symlink() and (folder / name).is_dir():
            raise Refused(say("app.server_link", name=name))
    if taken and not overwrite:
        raise Exists(say("app.server_exists", files=", ".join(taken)))


def save(site: Site, document: Document, name: str, overwrite: bool) -> list[Path]:
    """Write NAME.nml, and NAME.gpkg with the layers if anything is drawn: all or nothing, and never
    over a file that the case reads. Returns the files."""
    made = runnable(site, document)
    files = [f"{name}.nml", *([f"{name}.gpkg"] if made.layers else [])]
    check_free(site.folder, files, overwrite)
    crs = site.grid.crs.to_wkt() if site.grid.crs else None
    own, *inputs = input_files(made.case)
    with overwriting(overwrite), atomic_folder(site.folder, inputs, last=files[0]) as place:
        if made.layers:
            layers: Layers = {
                name: (layer.geometry, [(layer.shapes(), layer.columns())])
                for name, layer in made.layers.items()
            }
            write_geopackage(place / files[1], layers, crs)
        (place / files[0]).write_text(case_text(made.named(files[-1])), encoding="utf-8")
    return [site.folder / one for one in files]


def case_text(case: Case) -> str:
    """Text of a case, with what differs from the defaults."""
    return namelist_text(given_groups(case), {name: getattr(case, name) for name in REPEATABLE})
