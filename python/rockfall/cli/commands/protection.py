# SPDX-License-Identifier: BSD-3-Clause
"""Commands on protection: design sheet, design block, siting of a barrier."""

import argparse
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from rockfall.analysis.design_block import DesignBlock, design_block
from rockfall.case.files import files_behind, input_files
from rockfall.case.text import namelist_text
from rockfall.cli.given import given_options, overridden, stem_of, warn_of_inputs
from rockfall.cli.messages import DONE
from rockfall.cli.result_warnings import warn_of_results
from rockfall.errors import RockfallError, need
from rockfall.files.export import crs_wkt, write_geopackage
from rockfall.files.hazard_files import in_folder, is_hazard, read_hazard
from rockfall.io.atomic import atomic_folder
from rockfall.io.output_files import check_folder, check_outputs
from rockfall.io.tables import write_csv
from rockfall.language import speaking
from rockfall.office.tables import check_tables, put_design
from rockfall.plots.along_figures import along_figure
from rockfall.plots.studies.siting_figure import siting_figure
from rockfall.plots.style import save
from rockfall.protection.design import Design, design
from rockfall.protection.factors import COLUMNS, Conditions
from rockfall.protection.yearly import YEARS, YearlyDesign, yearly_design
from rockfall.result.crossings import line_names
from rockfall.result.dataset import read_result, write_result
from rockfall.result.same_case import check_same_site
from rockfall.scene.layers import file_checksum
from rockfall.simulation.memory import read_memory
from rockfall.simulation.progress import add_steps, working
from rockfall.studies.barrier_advice import group_of
from rockfall.studies.siting import CONDITIONS, Siting, site
from rockfall.tables.design import design_text
from rockfall.tables.design_block import design_block_text, scenario_text
from rockfall.tables.siting import siting_text
from rockfall.tables.yearly_design import yearly_design_text

YEARLY_TABLES = ("loads", "choices", "checks")  # tables of a design from hazards
TABLES = ("loads", "demand", "checks", "choices", "along")
OPTIONS = ("along", "width", "min_boulders", "residual", "volume", "factors", "costs")
BLOCK_OPTIONS = ("years", "events", "threshold", "volume_max")  # for a return period only
SITING = ("every", "to", "direction", "candidates", "candidates_layer", "max_height", "max_class",
          "max_bypass", "space", "acceptable", "volume", "factors", "costs",
          *sorted(CONDITIONS))  # fmt: skip
SITING_FILES = "siting.csv", "siting.png", "siting.gpkg"
ADVISED = "barrier.nml"


def design_command(arguments: argparse.Namespace) -> int:
    keys = [*OPTIONS, *(field.name for field in fields(Conditions))]
    arguments.results = [*map(in_folder, arguments.results)]
    if hazards := [path for path in arguments.results if is_hazard(path)]:
        if others := [path for path in arguments.results if path not in hazards]:
            reason = "has no frequencies, unlike the hazard"
            raise RockfallError(
                f"{others[0]}: {reason} {hazards[0]}: run design for each separately"
            )
        return _design_hazards(arguments, [*keys, *BLOCK_OPTIONS])
    _check_mode(arguments, keys)
    if arguments.return_period is not None:
        return _design_block(arguments)
    folder, paths = arguments.output, [str(path) for path in arguments.results]
    if arguments.tables:
        check_tables(arguments.tables, arguments.language)
        if not folder:
            raise RockfallError("--tables requires -o DIR")
    if folder:
        check_folder(folder)
        if arguments.along:
            need("figures need", "report")
    given = given_options(arguments, keys)
    results, sheets = {}, {}
    for path in paths:
        if path in results:
            raise RockfallError(f"{path}: is given twice")
        results[path] = read_result(path)
    check_same_site(results)
    with working():
        add_steps(sum(len(line_names(result)) for result in results.values()))
        for path in paths:
            try:
                sheets[path] = design(results[path], **given)
            except RockfallError as error:
                raise RockfallError(f"{path}: {error}", error.code) from error
    for path, sheet in sheets.items():
        print(*([f"{path}\n"] if len(sheets) > 1 else []), design_text(sheet), "", sep="\n")
    told = {text for sheet in sheets.values() for text in sheet.warnings}
    warn_of_results(*map(Path, paths), told=told)
    if folder:
        formats, language = arguments.tables, arguments.language
        print(*write_design(sheets, folder, results, formats, language), sep="\n")
    return DONE


def _design_hazards(arguments: argparse.Namespace, keys: list[str]) -> int:
    """Design barriers for a return period of passing boulders, over the scenarios of hazards.
    Refuses options that are only valid for results."""
    for key in keys:
        if key != "costs" and getattr(arguments, key) is not None:
            reason = "is only valid for results OUT.nc: a hazard takes --return-period and --costs"
            raise RockfallError(f"--{key.replace('_', '-')} {reason}")
    if arguments.tables:
        raise RockfallError(
            "--tables is only valid for results OUT.nc: see rockfall dossier for a hazard"
        )
    folder, paths = arguments.output, arguments.results
    years = YEARS if arguments.return_period is None else arguments.return_period
    sheets = {str(path): yearly_design(read_hazard(path), years, arguments.costs) for path in paths}
    with speaking(arguments.language):
        for path, sheet in sheets.items():
            print(*([f"{path}\n"] if len(sheets) > 1 else []), yearly_design_text(sheet), sep="\n")
    warn_of_results(*map(Path, paths))
    if folder:
        with atomic_folder(folder, paths) as part:
            for name in YEARLY_TABLES:
                write_csv(_joined(sheets, name), part / f"design_{name}.csv")
        print(*(folder / f"design_{name}.csv" for name in YEARLY_TABLES), sep="\n")
    return DONE


def _check_mode(arguments: argparse.Namespace, keys: list[str]) -> None:
    """Refuse options that need `--return-period` if it is absent, and options that cannot be
    combined with it if it is given. Without it, require results."""
    is_block = arguments.return_period is not None
    others = [key for key in keys if key != "blocks"] if is_block else BLOCK_OPTIONS
    rule = "cannot be combined with" if is_block else "requires"
    for key in others:
        if getattr(arguments, key) is not None:
            raise RockfallError(f"--{key.replace('_', '-')} {rule} --return-period")
    if not is_block and not arguments.results:
        raise RockfallError("OUT.nc is required, or --return-period: see rockfall design --help")


def _design_block(arguments: argparse.Namespace) -> int:
    """Print and write the block of a return period. Refuses results, and a missing survey."""
    if arguments.results:
        raise RockfallError(
            "--return-period: requires hazards HAZARD.nc or the survey --blocks, not results"
        )
    if arguments.blocks is None:
        raise RockfallError("--return-period requires --blocks, the table of surveyed blocks")
    folder, inputs = arguments.output, [Path(arguments.blocks)]
    inputs += [arguments.events] if arguments.events else []
    if folder:
        check_folder(folder)
        check_outputs([folder / name for name in ("design_block.csv", "design_block.nml")], inputs)
    given = {key: getattr(arguments, key) for key in BLOCK_OPTIONS}
    block = design_block(arguments.blocks, arguments.return_period, **given)
    print(design_block_text(block))
    if folder:
        print("", *_write_block(block, folder, inputs), sep="\n")
    return DONE


def _write_block(block: DesignBlock, folder: Path, inputs: list[Path]) -> list[Path]:
    """Write the table of return periods and any scenario: both or none."""
    with atomic_folder(folder, inputs) as part:
        write_csv(block.levels, part / "design_block.csv")
        if block.scenario:
            text = f"! Written by `rockfall design --return-period`.\n{scenario_text(block)}"
            (part / "design_block.nml").write_text(text, encoding="utf-8")
        names = sorted(path.name for path in part.iterdir())
    return [folder / name for name in names]


def site_command(arguments: argparse.Namespace) -> int:
    case = overridden(arguments)
    folder = arguments.output or Path(f"{stem_of(arguments)}_siting")
    given = given_options(arguments, SITING)
    if arguments.memory is not None:
        given["memory"] = read_memory(arguments.memory)
    files = [given[key] for key in ("candidates", "factors", "costs") if key in given]
    inputs = [*input_files(case), *files]
    need("site needs", "report")
    need("site needs", "vector")
    check_folder(folder)
    names = results_of([scenario["name"] for scenario in case.scenario])
    check_outputs([folder / name for name in (*SITING_FILES, *names, ADVISED)], inputs)
    warn_of_inputs(case)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # printed above as lines
        siting = site(case, arguments.line, progress=not arguments.quiet, **given)
    with atomic_folder(folder, inputs) as part:
        write_csv(siting.table, part / "siting.csv")
        save(siting_figure(siting), part / "siting.png", dpi=200)
        write_geopackage(
            part / "siting.gpkg", {"alignments": ("LineString", [_features(siting)])},
            crs_wkt(siting.result),
        )  # fmt: skip
        for name, result in zip(names, siting.results.values(), strict=True):
            write_result(result, part / name)
        if siting.advice:
            group = {"barrier": [group_of(siting.advice.barrier)]}
            (part / ADVISED).write_text(namelist_text(group), encoding="utf-8")
    if not arguments.quiet:
        print(siting_text(siting))
    files = (*SITING_FILES, *names, *([ADVISED] if siting.advice else []))
    print(*(folder / name for name in files), sep="\n")
    return DONE


def results_of(scenarios: Sequence[str]) -> list[str]:
    """File names for the runs of a siting: one for each scenario, or one for a case without
    scenarios."""
    return [f"siting_scenario{k}.nc" for k in range(1, len(scenarios) + 1)] or ["siting.nc"]


def _features(siting: Siting) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Alignments as line features with their values."""
    import shapely

    shapes = [
        shapely.LineString(np.column_stack([alignment.x, alignment.y]))
        for alignment in siting.alignments
    ]
    columns = {str(name): column.to_numpy() for name, column in siting.table.items()}
    return np.array(shapes, object), {
        name: column if column.dtype.kind == "O" else column.astype(float)
        for name, column in columns.items()
    }


def design_files(sheets: Mapping[str, Design], formats: Sequence[str] = ()) -> list[str]:
    """Names of the files that `write_design` writes."""
    along = any(sheet.along is not None for sheet in sheets.values())
    files = [f"design_{name}.csv" for name in TABLES if along or name != "along"]
    figures = [f"design_along{k}.png" for k in numbered(sheets)]
    office = [f"design.{form}" for form in formats]
    return [*files, "design_factors.csv", *(figures if along else []), *office]


def numbered(sheets: Mapping[str, Design]) -> list[str]:
    """Suffix for the files of each result; none for a single result."""
    return [""] if len(sheets) == 1 else [f"_{k}" for k in range(1, len(sheets) + 1)]


def write_design(
    sheets: Mapping[str, Design],
    folder: Path,
    results: Mapping[str, xr.Dataset],
    formats: Sequence[str] = (),
    language: str = "en",
) -> list[Path]:
    """Write the tables of designs, by the names of their results, and figures along lines: all or
    none. `formats` are workbook and document formats, in `language`."""
    inputs = [Path(name) for name in sheets]
    inputs += [path for result in results.values() for path in files_behind(result)]
    files = design_files(sheets, formats)
    check_outputs([folder / name for name in files], inputs)
    tables = {f"design_{name}": _joined(sheets, name) for name in TABLES
              if f"design_{name}.csv" in files}  # fmt: skip
    tables["design_factors"] = _factor_table(next(iter(sheets.values())))
    with atomic_folder(folder, inputs) as part:
        for name, table in tables.items():
            write_csv(table, part / f"{name}.csv")
        if "design_along.csv" in files:
            for word, sheet in zip(numbered(sheets), sheets.values(), strict=True):
                save(along_figure(sheet), part / f"design_along{word}.png")
        checksums = {name: file_checksum(Path(name)) for name in (sheets if formats else ())}
        list(put_design(sheets, results, tables, part, formats, language, checksums))
    return [folder / name for name in files]


def _joined(sheets: Mapping[str, Design | YearlyDesign], name: str) -> pd.DataFrame:
    """Table of all results, with the result name in the first column."""
    tables = []
    for result, sheet in sheets.items():
        table = getattr(sheet, name).copy()
        table.insert(0, "result", result)
        tables.append(table)
    return pd.concat(tables, ignore_index=True)


def _factor_table(sheet: Design) -> pd.DataFrame:
    """Table of the factors with their sources, which `--factors` can read; without factors, a table
    to fill in."""
    factors = sheet.factors
    rows = [
        (factors.conditions.standard, name, factors.condition(name), value, factors.sources[name])
        for name, value in factors.values.items()
    ]
    return pd.DataFrame(rows, columns=COLUMNS)
