# SPDX-License-Identifier: BSD-3-Clause
"""Conversion of a Rockyfor3D folder to a case, which uses files of the folder where they mean the
same."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from rockfall.analysis.validity.obstacles import forest_text
from rockfall.case import read_case
from rockfall.case.text import Entry, Group, case_text
from rockfall.errors import RockfallError
from rockfall.importers.imported import CASE, Import, tree_rows
from rockfall.io.atomic import atomic_folder
from rockfall.io.files import relative_name
from rockfall.language import say
from rockfall.rockyfor3d.folder import Folder
from rockfall.rockyfor3d.nets import NETS, TOLERANCE, barriers

MARK = "! Made by `rockfall import-rockyfor3d`"  # first line of an imported case
STEMS, SOURCES = "stems.tif", "sources.tif"
TREES = "trees.csv"
HECTARE = 1e4  # [m2]
BOULDERS = 100  # boulders per source
DROP_HEIGHT = 1.0  # [m]
MAPS = (
    "passages", "deposits", "reach_probability_by_source", "energy_mean", "energy_q95",
    "jump_height_mean", "jump_height_q95", "speed_max_map", "energy_line_angle_min",
    "travel_time_min",
)  # fmt: skip
LEFT = (  # inputs that the folder lacks, or that have no counterpart in rockfall
    "Rockyfor3D requests boulders, drop_height and volume_spread at its start: set them above.",
    "Its heights are normal to the slope; ours are vertical (docs/rockyfor3d.md).",
    "Its choice of the height at which a tree is hit has no counterpart; see &forest stem_height.",
)


@dataclass
class _Import(Import):
    """An import in progress; `left` has notes on inputs that were guessed or not imported."""

    rasters: Folder = field(kw_only=True)
    model: list[str] = field(default_factory=list)  # remarks on the model

    def path(self, name: str) -> str:
        """Path of a raster, as named in the case."""
        return relative_name(self.rasters.rasters[name], self.out.resolve())


def import_rockyfor3d(
    directory: str | Path, out: str | Path, *, crs: str | None = None
) -> list[str]:
    """Write a case for a Rockyfor3D folder to the folder `out`.

    `crs` (such as EPSG:2056) is the CRS of the rasters, whose format cannot store one; the case
    then has a DEM with a CRS. Returns a line for each input that was not imported, or was imported
    with changes. Raises a RockfallError for an input that cannot be used.

    >>> import rockfall
    >>> left_out = rockfall.import_rockyfor3d("folder", "imported", crs="EPSG:2056")
    >>> rockfall.read_case("imported/case.nml").boulder["volume"]
    'source'
    """
    folder, out = Folder(directory), Path(out)
    folder.rasters = {name: path.resolve() for name, path in folder.rasters.items()}
    inputs = [*folder.rasters.values(), *filter(None, [folder.trees])]
    with atomic_folder(out, inputs, last=CASE) as part:
        made = _Import(folder.path, folder.rasters["dem"], out, part, crs, rasters=folder)
        folder.grid = made.grid
        groups = list(_groups(made))
        made.left += [f"{name}: unknown file, left out" for name in folder.unread]
        made.left += made.model
        head = [f"{MARK[2:]} from {folder.path.resolve().name}.", "Keys: docs/case.md."]
        foot = [
            "Not imported, or imported with changes:",
            *(f"- {note}" for note in [*made.left, *LEFT]),
        ]
        (part / CASE).write_text(case_text(head, groups, foot), encoding="utf-8")
        read_case(part / CASE)
    return [*made.left, *LEFT]


def _groups(made: _Import) -> Iterator[Group]:
    """Groups of the case, in order."""
    title = f"{made.folder.resolve().name}, after Rockyfor3D"
    yield Group(
        "case", [Entry("title", title), Entry("boulders", BOULDERS, "from each source cell")]
    )
    yield made.terrain(made.out)
    yield _surface(made)
    yield _boulder(made)
    yield _release(made)
    yield from _forest(made)
    yield from _nets(made)
    yield Group("output", [Entry("maps", list(MAPS)), Entry("rebounds", True)])


def _surface(made: _Import) -> Group:
    entries = [Entry("method", "A", "an obstacle is met at 70, 20 or 10 % of the rebounds")]
    entries += [Entry(name, made.path(name)) for name in ("rg70", "rg20", "rg10")]
    if "soiltype" in made.rasters:
        text = "soil types 0 to 7 are the shipped grounds 0 to 7"
        entries.append(Entry("ground_map", made.path("soiltype"), text))
        unsure = f"{say('model.quoted_coefficients')}: {say('model.understated')}"
        made.model.append(
            "soiltype.asc: rebounds follow the classical model rockyfor3d of the shipped grounds, "
            f"not the impact sets, with {unsure}. `rockfall models` compares other rebounds"
        )
    else:
        made.left.append(
            "soiltype.asc is missing: all rebounds follow the stochastic impact sets, in which "
            "obstacles of 100 m stop no boulder"
        )
    return Group("surface", entries)


def _boulder(made: _Import) -> Group:
    entries = [Entry("volume", "source", "each source cell has its own boulders")]
    entries += [Entry(name, made.path(name)) for name in ("d1", "d2", "d3")]
    if "blshape" in made.rasters:
        entries.append(Entry("shape", made.path("blshape")))
    else:
        made.left.append("blshape.asc is missing: all boulders are spheres")
    entries.append(Entry("rock_density", made.path("rockdensity")))
    entries.append(Entry("volume_spread", 0.1, "for volumes that vary by 10 %", on=False))
    return Group("boulder", entries)


def _release(made: _Import) -> Group:
    density = made.rasters.read("rockdensity")
    if not (density > 0).any():
        raise RockfallError(
            f"{made.rasters.rasters['rockdensity']}: no source cells: at least one cell must be "
            "above zero"
        )
    cells = made.path("rockdensity")
    if (np.rint(density) != density)[~np.isnan(density)].any():  # source rasters contain integers
        cells = SOURCES
        made.write_raster(SOURCES, (density > 0).astype("u1"))
    text = "cells above zero"
    return Group("release", [Entry("cells", cells, text), Entry("drop_height", DROP_HEIGHT, "[m]")])


def _forest(made: _Import) -> Iterator[Group]:
    """Forest group with trees from a list, or generated from cell data."""
    folder = made.rasters
    conifers = Entry("uniform_conifers", 100.0, "[%]; conifers stop less than broadleaved trees")
    if "conif_percent" in folder:
        conifers = Entry("conifers", made.path("conif_percent"))
    if folder.trees is not None:
        _write_trees(made, folder.trees)
        if "nrtrees" in folder:
            made.left.append(f"nrtrees.asc: left out, {folder.trees.name} lists the trees")
        entries = [Entry("trees", TREES, f"{folder.trees.name} with a head"), conifers]
    elif "nrtrees" in folder and "dbhmean" in folder:
        stems = made.rasters.read("nrtrees") * (HECTARE / folder.grid.cell**2)
        if not (stems > 0).any():
            made.left.append("nrtrees.asc: no cell has trees")
            return
        made.write_raster(STEMS, stems.astype("f4"))
        deviation = Entry("uniform_dbh_std", 0.0)
        if "dbhstd" in folder:
            deviation = Entry("dbh_std", made.path("dbhstd"))
        else:
            made.left.append("dbhstd.asc is missing: all stems of a cell have the mean diameter")
        text = "nrtrees.asc per hectare instead of per cell"
        entries = [
            Entry("stems", STEMS, text), Entry("spread", "even", "as many in each cell"),
            Entry("dbh_mean", made.path("dbhmean")), deviation, conifers,
        ]  # fmt: skip
    else:
        given = [
            name for name in ("nrtrees", "dbhmean", "dbhstd", "conif_percent") if name in folder
        ]
        if given:
            missing = " and ".join(folder.missing(["nrtrees", "dbhmean"]))
            made.left.append(f"{missing}: missing, so there is no forest")
        return
    if "conif_percent" not in folder:
        made.left.append("conif_percent.asc is missing: all trees are conifers")
    made.model.append(forest_text())
    yield Group("forest", entries)


def _nets(made: _Import) -> Iterator[Group]:
    """Yield a barrier group for each net; none if a raster of nets is missing."""
    missing = made.rasters.missing(NETS)
    if len(missing) == len(NETS):
        return
    if missing:
        made.left.append(f"{' and '.join(missing)}: missing, so there are no nets")
        return
    for keys, off in barriers(made.rasters):
        if off:
            made.left.append(
                f"net_number.asc: {keys['name']}: {off} cells branch off its line and "
                "stop nothing: give them a separate number"
            )
        within = f"through the cells of net_number, within {TOLERANCE * made.grid.cell:g} m"
        yield Group(
            "barrier",
            [Entry(key, value, within if key == "x" else "") for key, value in keys.items()],
        )


def _write_trees(made: _Import, path: Path) -> None:
    """Write the tree list as a table with a header."""
    rows, more = tree_rows(path)
    if more:
        made.left.append(f"{path.name}: columns after x, y and DBH are left out")
    (made.part / TREES).write_text("\n".join([*rows, ""]), encoding="utf-8")
