# SPDX-License-Identifier: BSD-3-Clause
"""Variants of a case, from its groups to the comparison; comparison of results."""

import argparse
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import pandas as pd
import xarray as xr

from rockfall.analysis.observed.compare import compare, observed_files
from rockfall.analysis.observed.deposits import grid_for
from rockfall.analysis.observed.observations import read_observed
from rockfall.analysis.observed.ranks import rank_results
from rockfall.case import Case, case_of, read_case
from rockfall.case.files import files_behind, input_files
from rockfall.case.variants import variants
from rockfall.cli.checkpoints import (
    check_study_folder,
    is_done,
    study_checkpoints,
    study_interrupted,
)
from rockfall.cli.commands.results import IMPRINT
from rockfall.cli.given import memory_of, with_overrides
from rockfall.cli.messages import DONE, print_files, say, warn, warn_each, warnings_told
from rockfall.cli.result_warnings import warn_of_results
from rockfall.errors import RockfallError
from rockfall.html_report.page import check_page_needs
from rockfall.interrupts import interrupts
from rockfall.io.atomic import atomic_folder
from rockfall.io.output_files import check_output, overwriting
from rockfall.io.tables import plain_decimal, write_csv
from rockfall.language import catalogue
from rockfall.products import report_variants
from rockfall.result.dataset import read_result, write_result
from rockfall.scene.read import read_scene
from rockfall.scene.stages import KeptStages
from rockfall.simulation.parts.finished import FINISHED, contains_run
from rockfall.simulation.parts.lock import locked
from rockfall.simulation.progress import working
from rockfall.simulation.simulate import Interrupted
from rockfall.studies.difference_maps import (
    difference_maps,
    have_passages,
    on_same_cells,
    write_variants,
)
from rockfall.studies.variants import check_variant_scenes, compare_variants, run_each
from rockfall.studies.yearly_variants import FREQUENCIES, frequency_file, run_name, yearly_variants
from rockfall.tables.comparison import comparison_text, ranks_text
from rockfall.tables.variants import comparison_notes, variants_text


def variants_command(arguments: argparse.Namespace) -> int:
    case = with_overrides(read_case(arguments.case), arguments)
    names, pages = list(variants(case)), _pages(arguments)
    folder = arguments.output or Path(f"{arguments.case.stem}_variants")
    inputs = list(input_files(case))
    yearly = [run_name(name, scenario["name"]) for name in names for scenario in case.scenario]
    files = [
        *(f"{name}.nc" for name in names),
        "differences.csv",
        *[FREQUENCIES] * bool(yearly),
        *pages,
    ]
    made = [folder / name for name in files]
    is_there = arguments.resume and any(path.exists() for path in made)
    with overwriting(arguments.overwrite or is_there):
        check_study_folder(folder, files, inputs)
    if pages:
        catalogue(arguments.language)  # refuses unknown languages before files are read
        check_page_needs(pages[0])
    with locked(folder.resolve(), warn):
        runs = [*names, *(f"{name}.scenario{k}" for name in names
                          for k, _ in enumerate(case.scenario, start=1))]  # fmt: skip
        checkpoints = study_checkpoints(arguments, folder.resolve(), runs, "a variant")
        memory = memory_of(arguments)
        given = {"memory": memory, "stages": KeptStages()}
        remarks = check_variant_scenes(case, **given)
        if is_done(arguments, made, checkpoints, lambda: _are_finished(folder, case, memory)):
            return say(f"{folder}: {FINISHED}", DONE)
        for remark in remarks:
            warn(remark)
        with interrupts():  # keeps completed work
            by_name = dict(zip([*names, *yearly], checkpoints, strict=True))
            how: dict[str, Any] = {
                "progress": not arguments.quiet,
                "checkpoints": by_name,
                **given,
            }
            try:
                results, limits = run_each(case, **how)
                yearly_numbers = yearly_variants(case, **how) if yearly else None
            except Interrupted:
                return study_interrupted(checkpoints)
            frequencies = yearly_numbers.table if yearly_numbers else None
            paths = _write(case, results, frequencies, folder, arguments, inputs)
        for checkpoint in checkpoints:
            checkpoint.remove()
    warn_each(yearly_numbers.warnings if yearly_numbers else limits)
    if not arguments.quiet:
        notes = "\n".join(comparison_notes(results, bool(yearly)))
        print(variants_text(compare_variants(results), notes, frequencies))
        print_files(paths)
    return DONE


def _write(
    case: Case,
    results: Mapping[str, xr.Dataset],
    frequencies: pd.DataFrame | None,
    folder: Path,
    arguments: argparse.Namespace,
    inputs: Iterable[Path],
) -> list[Path]:
    """Write results, differences, maps and page to the folder: all or none."""
    maps = {}
    if have_passages(results):
        alike = on_same_cells(results)
        maps = difference_maps(alike)
        if others := [name for name in results if name not in alike]:
            warn(
                f"no difference maps for {', '.join(others)}: their cells differ from the first "
                "variant"
            )
    costs = {variant["name"]: variant["cost"] for variant in case.variant if "cost" in variant}
    title = case.case["title"] or arguments.case.stem
    imprint = {key: getattr(arguments, key) for key in IMPRINT}
    with atomic_folder(folder, inputs) as part, working(not arguments.quiet):
        made = []
        for name, result in results.items():
            made.append(part / f"{name}.nc")
            write_result(result, made[-1])
        made += write_variants(compare_variants(results), maps, part)
        if frequencies is not None:
            made.append(part / FREQUENCIES)
            write_csv(frequency_file(frequencies), made[-1])
        for name in _pages(arguments):
            made.append(part / name)
            with warnings_told():
                report_variants(
                    results, made[-1], frequencies=frequencies,
                    costs=costs, title=title, **imprint,
                )  # fmt: skip
    return [folder / path.name for path in made]


def _pages(arguments: argparse.Namespace) -> list[str]:
    """Names of the requested pages in the folder, as HTML and PDF."""
    given = {"variants.html": arguments.report, "variants.pdf": arguments.pdf}
    return [name for name, wanted in given.items() if wanted]


def _are_finished(folder: Path, case: Case, memory: float) -> bool:
    """Return True if the folder has the results of all variants of a case."""
    return all(
        contains_run(folder / f"{name}.nc", read_scene(variant, memory=memory))
        for name, variant in variants(case).items()
    )


def compare_command(arguments: argparse.Namespace) -> int:
    paths = [path for path in arguments.files if path.suffix == ".nc"]
    sources = [path for path in arguments.files if path.suffix != ".nc"]
    results = {str(path): read_result(path) for path in paths}
    if len(arguments.files) == 1 and paths:
        sources = observed_files(case_of(results[str(paths[0])]))
    if not paths or len(paths) + len(sources) < 2:
        raise RockfallError("compare needs results (.nc) and observations (CSV), or variants (.nc)")
    if len(results) < len(paths):
        raise RockfallError("compare: a result is given twice")
    if not sources:
        return _compare_variants(results, arguments)
    for option in ("maps", "report"):
        if getattr(arguments, option):
            raise RockfallError(f"--{option} requires variants: results without observations")
    seen = read_observed(*sources, grid=grid_for(next(iter(results.values())), sources))
    if len(results) == 1:
        (result,) = results.values()
        comparison = compare(result, seen)
        table, report = comparison.table(), comparison_text(comparison)
    else:
        table = rank_results(results, seen)
        report = "\n".join([ranks_text(table), *seen.notes])
    if arguments.output:
        behind = (path for result in results.values() for path in files_behind(result))
        check_output(arguments.output, (*arguments.files, *sources, *behind))
        write_csv(table, arguments.output)
    warn_of_results(*paths)
    print(report)
    return DONE


def _compare_variants(results: dict[str, xr.Dataset], arguments: argparse.Namespace) -> int:
    names = [Path(path).stem for path in results]
    if len({*names}) < len(names):
        raise RockfallError("compare: variants need different file names")
    variants = dict(zip(names, results.values(), strict=True))
    if arguments.costs and not arguments.report:
        raise RockfallError("--costs requires --report")
    table = compare_variants(variants)
    inputs = [
        *arguments.files,
        *(path for result in results.values() for path in files_behind(result)),
    ]
    if arguments.output:
        check_output(arguments.output, inputs)
        write_csv(table, arguments.output)
    if arguments.maps:
        write_variants(table, difference_maps(variants), arguments.maps, inputs)
    if arguments.report:
        costs = dict(map(_cost, arguments.costs))
        named = {name: getattr(arguments, name) for name in IMPRINT}
        check_output(arguments.report, inputs)
        with warnings_told():
            report_variants(variants, arguments.report, costs=costs, **named)
    warn_of_results(*map(Path, results))
    print(variants_text(table, "\n".join(comparison_notes(variants))))
    return DONE


def _cost(given: str) -> tuple[str, float]:
    """Variant and cost from NAME=AMOUNT; refuses texts not of this form."""
    name, _, amount = given.rpartition("=")
    if not name or math.isnan(cost := plain_decimal(amount)):
        raise RockfallError(f"--costs {given}: must be NAME=AMOUNT")
    return name, cost
