# SPDX-License-Identifier: BSD-3-Clause
"""Saving a document as a case with a GeoPackage next to the opened file."""

import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from rockfall.app.edited.document import Document, Runnable, Site, runnable
from rockfall.app.edited.places import without_files
from rockfall.app.messages import Refused
from rockfall.case import Case, Key, file_keys, given_groups, given_in_lists
from rockfall.case.files import input_files
from rockfall.case.rules import CHOSEN
from rockfall.case.text import literal, namelist_text
from rockfall.case.variants import BASE, variants
from rockfall.errors import RockfallError
from rockfall.files.export import Layers, write_geopackage
from rockfall.io.atomic import atomic_folder
from rockfall.io.coordinates.crs import plan_wkt
from rockfall.io.output_files import overwriting
from rockfall.language import say
from rockfall.scene.frames import GROUPS

MAX_NAME = 80  # maximum characters
_NAME = re.compile(r"[\w-](?:[\w .-]*[\w-])?")  # neither hidden, nor ending with a blank or dot


class Exists(Refused):
    """Refused because a file already exists."""


def check_name(name: object) -> str:
    """Check a file name without folder and extension; refuse anything that could be a path."""
    if not isinstance(name, str) or len(name) > MAX_NAME or not _NAME.fullmatch(name):
        raise Refused(say("app.server_name", length=MAX_NAME))
    return name


def check_free(folder: Path, names: list[str], overwrite: bool) -> None:
    """Raise Exists if files or folders with these names exist, unless `overwrite`. Raise Refused
    for links to folders, because files elsewhere would be replaced."""
    taken = [name for name in names if os.path.lexists(folder / name)]
    for name in taken:
        if (folder / name).is_symlink() and (folder / name).is_dir():
            raise Refused(say("app.server_link", name=name))
    if taken and not overwrite:
        raise Exists(say("app.server_exists", files=", ".join(taken)))


class Saved(NamedTuple):
    """The files written, and a remark if the case is incomplete."""

    files: list[Path]
    remark: str = ""


def save(site: Site, document: Document, name: str, overwrite: bool) -> Saved:
    """Write NAME.nml and, if anything is drawn, its layers to NAME.gpkg: all files or none, never
    over a file that the case reads, and over other files only with `overwrite`."""
    made = runnable(site, document)
    case, inline, remark = _with_variants(site, document, made, f"{name}.gpkg")
    drawn = {name: layer for name, layer in made.layers.items() if name not in inline}
    files = [f"{name}.nml", *([f"{name}.gpkg"] if drawn else [])]
    check_free(site.folder, files, overwrite)
    crs = plan_wkt(site.grid.crs) if site.grid.crs else None
    own, *inputs = input_files(made.case)
    inputs += [site.folder / path for _, _, path in _files_of_variants(site)]
    with overwriting(overwrite), atomic_folder(site.folder, inputs, last=files[0]) as place:
        if drawn:
            layers: Layers = {
                name: (layer.geometry, [(layer.shapes(), layer.columns())])
                for name, layer in drawn.items()
            }
            write_geopackage(place / files[1], layers, crs)
        (place / files[0]).write_text(case_text(case), encoding="utf-8")
    return Saved([site.folder / file for file in files], remark)


def _with_variants(
    site: Site, document: Document, made: Runnable, file: str
) -> tuple[Case, set[str], str]:
    """Case with the site's &variant groups, layers to write inline (variants select their features
    by name), and a remark. Variants are omitted if one would fail or change its meaning. Refuses to
    omit the edited variant."""
    groups = site.variants.groups
    if not groups:
        return made.named(file), set(), ""
    try:
        if document.variant:
            raise RockfallError(say("app.server_of_variant", name=document.variant))
        named = {CHOSEN[key] for group in groups for key in CHOSEN.keys() & group.keys()}
        inline = {layer for layer in made.layers if GROUPS.get(layer) in named}
        case = made.named(file, inline).replace(variant=groups)
        _check_layers(site, variants(case))
        return case, inline, say("app.server_base", name=BASE)
    except RockfallError as error:
        reason = without_files(str(error), site)
        return made.named(file), set(), say("app.server_without_variants", reason=reason)


def _check_layers(site: Site, saved: dict[str, Case]) -> None:
    """Raise a RockfallError if a variant with its own file would get the layer name of the saved
    file."""
    for name, key, _ in _files_of_variants(site):
        layer = f"{key.name}_layer"
        before, after = (getattr(cases[name], key.group) for cases in (site.variants.cases, saved))
        if before.get(layer) != after.get(layer):
            raise RockfallError(f"&variant name = {literal(name)}: {key.group}_{layer} is missing")


def _files_of_variants(site: Site) -> Iterator[tuple[str, Key, str]]:
    """Files that variants use: name of the variant, key and file."""
    for given in site.variants.groups:
        for key in file_keys():
            named = given.get(f"{key.group}_{key.name}", [])
            for file in named if isinstance(named, list) else [named]:
                yield given["name"], key, file


def case_text(case: Case) -> str:
    """Text of a case, with the values that differ from the defaults."""
    return namelist_text({**given_groups(case), **given_in_lists(case)})
