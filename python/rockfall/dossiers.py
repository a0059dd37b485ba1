# SPDX-License-Identifier: BSD-3-Clause
"""Dossier of a case: report pages, tables as a workbook and a document, and hazard files."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from rockfall.analysis.objects.at_risk import AtRisk
from rockfall.analysis.validity.warnings import warn_each
from rockfall.case import Case
from rockfall.case.files import files_behind, input_files
from rockfall.files.hazard_files import read_hazard
from rockfall.html_report.dossier_page import Given, parts_of, title_of, write_dossier_page
from rockfall.html_report.inputs import Parties
from rockfall.html_report.page import check_page, check_page_needs
from rockfall.io.atomic import atomic_folder
from rockfall.io.output_files import check_folder, check_outputs
from rockfall.io.tables import write_csv
from rockfall.language import catalogue, speaking
from rockfall.office.tables import (
    FORMATS,
    check_tables,
    write_dossier_document,
    write_dossier_workbook,
)
from rockfall.plots.terrain import terrain_of
from rockfall.protection.yearly import YEARS, check_period, yearly_design
from rockfall.result.dataset import put_netcdf
from rockfall.result.trajectories import Terrain
from rockfall.scene.layers import file_checksum
from rockfall.studies.dossier import Designs, Dossier, DossierInputs, read_dossier, run_dossier
from rockfall.studies.yearly_variants import FREQUENCIES, frequency_file, yearly_table
from rockfall.tables.dossier import model_texts

PAGES = "dossier.pdf"
SECOND = "hazard_by_second_model.nc"


def dossier(
    case: Case,
    folder: str | Path,
    *,
    objects: Any = None,
    objects_layer: str | Sequence[str] | None = None,
    vulnerability: str | Path | None = None,
    segments: Any = None,
    segments_layer: str | None = None,
    segment_length: float | None = None,
    return_period: float = YEARS,
    costs: str | Path | None = None,
    language: str = "en",
    project: str = "",
    client: str = "",
    author: str = "",
    one_model: bool = False,
    progress: bool = False,
    threads: int | None = None,
    **arrays: Any,
) -> list[Path]:
    """Run all scenarios for each variant of a case and write the dossier to `folder`: dossier.pdf
    (page 1 answers the main questions and can be signed), its tables as dossier.xlsx and
    dossier.docx, frequencies.csv, and a hazard file for each variant and the second model. Return
    the files.

    The first variant is also run with a second rebound model if its ground allows one, unless
    `one_model` is True. `return_period` [year], one of 10, 30, 100, 300 and 1,000, is used for the
    answers; at most one boulder passes the advised barrier in this period. `costs` is a table of
    barrier prices, as in `rockfall.design`. The other arguments are as in `rockfall.hazard` and
    `rockfall.report`. Invalid inputs raise a RockfallError.

    >>> import rockfall
    >>> case = rockfall.read_case("case.nml")
    >>> case = case.replace(scenario=[{"name": "small", "return_period": 10.0}])
    >>> files = rockfall.dossier(case, "dossier")
    """
    check_needs(language)
    check_period(return_period)
    folder, roads = Path(folder), (segments, segments_layer, segment_length)
    given = AtRisk(objects, objects_layer, vulnerability, *roads)
    inputs = read_dossier(case, given, one_model=one_model, **arrays)
    files = list(input_files(case))
    check_folder(folder)
    check_outputs([folder / name for name in dossier_files(list(inputs.studies))], files)
    for line in inputs.remarks:
        warnings.warn(line, stacklevel=2)
    made = run_dossier(inputs, period=return_period, progress=progress, threads=threads)
    how = terrain_of_inputs(inputs), Parties(project, client, author), language
    with atomic_folder(folder, files) as part:
        paths = list(put_dossier(made, designs_of(made, costs), part, *how))
    warn_each(model_texts(made))
    return [folder / path.name for path in paths]


def report_hazard(
    path: str | Path,
    page: str | Path,
    *,
    dem: str | Path | None = None,
    return_period: float = YEARS,
    **imprint: Any,
) -> Path:
    """Write a hazard file (hazard.nc) as the pages of a dossier (.pdf or .html). `dem` is the
    terrain under the maps (default: the case's terrain). `imprint` are `project`, `client`,
    `author`, `dem_date` and `language`, as in `report`. Return the path of the pages. Invalid
    inputs raise a RockfallError."""
    page, hazard = Path(page), read_hazard(path)
    language = imprint.pop("language", "en")
    catalogue(language)
    check_page(page, [path, *files_behind(hazard)])
    terrain = terrain_of(hazard, dem, Path(path).parent)
    made = Dossier({"": hazard}, yearly_table({}, {}), return_period)
    given = Given(Parties(**imprint, result=file_checksum(Path(path))), terrain)
    write_dossier_page(made, designs_of(made), given, page, language)
    return page


def check_needs(language: str) -> None:
    """Raise a RockfallError if a package for the dossier is missing, or `language` is unknown."""
    check_page_needs(PAGES)
    check_tables(FORMATS, language)


def hazard_name(variant: str) -> str:
    """File name for the hazard of a variant."""
    return f"hazard_{variant}.nc" if variant else "hazard.nc"


def dossier_files(variants: Sequence[str]) -> list[str]:
    """Names of all files that a dossier with these variants can contain."""
    office = [f"dossier.{ending}" for ending in FORMATS]
    return [*map(hazard_name, variants), SECOND, FREQUENCIES, PAGES, *office]


def terrain_of_inputs(inputs: DossierInputs) -> Terrain | None:
    """Elevations and grid under the maps, from the first variant; None if it is read in windows."""
    rasters = next(iter(inputs.studies.values())).scene.rasters
    return (rasters.z, rasters.grid) if rasters.z.size else None


def designs_of(made: Dossier, costs: str | Path | None = None) -> Designs:
    """Barrier designs for the hazards that have evaluation lines."""
    by_variant = {
        name: yearly_design(hazard, made.period, costs)
        for name, hazard in made.hazards.items()
        if "line_class_behind" in hazard
    }
    if made.second is None or "line_class_behind" not in made.second.hazard:
        return Designs(by_variant)
    return Designs(by_variant, yearly_design(made.second.hazard, made.period, costs))


def put_dossier(
    made: Dossier,
    designs: Designs,
    folder: Path,
    terrain: Terrain | None,
    parties: Parties,
    language: str,
) -> Iterator[Path]:
    """Write the files of a dossier to an existing folder; yield their paths."""
    hazards = [folder / hazard_name(name) for name in made.hazards]
    results = [*made.hazards.values()]
    if made.second:
        hazards.append(folder / SECOND)
        results.append(made.second.hazard)
    for path, hazard in zip(hazards, results, strict=True):
        put_netcdf(hazard, path, path)
        yield path
    write_csv(frequency_file(made.frequencies), folder / FREQUENCIES)
    yield folder / FREQUENCIES
    given = Given(parties._replace(result=file_checksum(hazards[0])), terrain)
    write_dossier_page(made, designs, given, folder / PAGES, language)
    yield folder / PAGES
    with speaking(language):
        parts, title = list(parts_of(made, designs)), title_of(made)
        yield write_dossier_workbook(title, parts, folder / "dossier.xlsx")
        yield write_dossier_document(title, parts, folder / "dossier.docx")
