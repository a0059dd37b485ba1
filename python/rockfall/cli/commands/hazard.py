# SPDX-License-Identifier: BSD-3-Clause
"""Hazard of a case, from scenarios to zones, and the origins of the boulders at a place."""

import argparse
import math
from pathlib import Path

from rockfall.analysis.hazard.combined import HazardInputs
from rockfall.analysis.hazard.finished import is_finished
from rockfall.analysis.hazard.scenarios import base_case
from rockfall.analysis.hazard.variables import map_names
from rockfall.case import Case
from rockfall.case.files import files_behind, input_files
from rockfall.cli.checkpoints import (
    check_study_folder,
    is_done,
    study_checkpoints,
    study_interrupted,
)
from rockfall.cli.given import at_risk, memory_of, overridden, stem_of
from rockfall.cli.messages import DONE, print_files, say, warn, warnings_told
from rockfall.cli.result_warnings import warn_of_results
from rockfall.errors import RockfallError, need
from rockfall.files.hazard_files import in_folder, put_hazard, read_hazard
from rockfall.files.origin_files import FIGURE, FILES, origin_tables, put_origins
from rockfall.interrupts import interrupts
from rockfall.io.atomic import atomic_folder, atomic_write
from rockfall.io.output_files import check_output, overwriting
from rockfall.language import catalogue, speaking
from rockfall.plots.cartography.sheet import PAGE
from rockfall.plots.hazard.hazard_figures import hazard_figures
from rockfall.plots.hazard.hazard_sheet import Imprint, hazard_sheet, warning_pages
from rockfall.plots.hazard.origin_map import origin_map
from rockfall.plots.style import save, save_pages
from rockfall.plots.terrain import terrain_of
from rockfall.result.maps.flat_maps import shown
from rockfall.simulation.parts.checkpoint import Checkpoint
from rockfall.simulation.parts.finished import FINISHED
from rockfall.simulation.parts.lock import locked
from rockfall.simulation.progress import add_steps, working
from rockfall.simulation.simulate import Interrupted
from rockfall.studies.hazard import coordinates_of, read_study, run_study, traced
from rockfall.tables.hazard import Place
from rockfall.text.hazard import hazard_summary, hazard_warnings, origins_text, warning_groups

DOTS = 200  # figure resolution [dots per inch]
SHEET = "hazard_sheet.pdf"


def hazard_command(arguments: argparse.Namespace) -> int:
    need("a hazard needs", "vector")
    need("a hazard needs", "report")
    catalogue(arguments.language)  # refuses unknown languages before files are read
    case = overridden(arguments)
    base_case(case)  # refuses invalid cases before files are read
    folder = arguments.output or Path(f"{stem_of(arguments)}_hazard")
    inputs = [*input_files(case), *at_risk(arguments).files]
    if arguments.write_cases:
        return _write_cases(arguments, case, inputs)
    inputs += arguments.results
    made = folder / "hazard.nc"
    is_there = arguments.resume and made.exists()
    with overwriting(arguments.overwrite or is_there):
        check_study_folder(folder, _files(case), inputs)
    with locked(folder.resolve(), warn):
        runs = [f"scenario{k}" for k in range(1, len(case.scenario) + 1)]
        checkpoints = study_checkpoints(arguments, folder.resolve(), runs, "a hazard")
        study = read_study(case, at_risk(arguments), memory_of(arguments))
        inputs_of = study.case, study.scene, study.objects, study.segments
        if is_done(arguments, [made], checkpoints, lambda: is_finished(made, *inputs_of)):
            return say(f"{folder}: {FINISHED}", DONE)
        for line in study.remarks:
            warn(line)
        return _run_to(arguments, folder, study, checkpoints, inputs)


def _write_cases(arguments: argparse.Namespace, case: Case, inputs: list[Path]) -> int:
    """Write each scenario as a separate case file next to the case, to be run elsewhere."""
    study = read_study(case, at_risk(arguments))
    stem = arguments.case.with_suffix("")
    cases = {Path(f"{stem}_scenario{k}.nml"): own for k, own in enumerate(study.scenarios, start=1)}
    for path in cases:
        check_output(path, inputs)
    for path, scenario in cases.items():
        with atomic_write(path) as part:
            text = f"! Written by `rockfall hazard`.\n{scenario.case.text()}"
            part.write_text(text, encoding="utf-8")
    print(*cases, sep="\n")
    return DONE


def _run_to(
    arguments: argparse.Namespace,
    folder: Path,
    study: HazardInputs,
    checkpoints: list[Checkpoint],
    inputs: list[Path],
) -> int:
    shown = not arguments.quiet
    with interrupts():  # keeps completed work
        try:
            hazard = run_study(
                study, results=arguments.results, progress=shown, checkpoints=checkpoints
            )
        except Interrupted:
            return study_interrupted(checkpoints)
        rasters = study.scene.rasters
        terrain = (rasters.z, rasters.grid) if rasters.z.size else None
        with atomic_folder(folder, inputs) as part, working(shown):
            figures = hazard_figures(hazard, terrain)
            add_steps(len(figures) + 1)
            paths = list(put_hazard(hazard, part))
            for hazard_figure in figures:
                paths.append(part / f"{hazard_figure.name}.png")
                save(hazard_figure.draw(), paths[-1], DOTS)
            paths.append(part / SHEET)
            with speaking(arguments.language):
                imprint = Imprint(arguments.project, arguments.client, arguments.author)
                sheet = hazard_sheet(hazard, terrain, imprint, [*hazard_warnings(hazard)])
                pages = [sheet, *warning_pages(hazard, warning_groups(hazard))]
                save_pages(pages, paths[-1], DOTS)
    for checkpoint in checkpoints:
        checkpoint.remove()
    if shown:
        print(hazard_summary(hazard))
        print_files([folder / path.name for path in paths])
    return DONE


def _files(case: Case) -> list[str]:
    """Names of the files that a hazard may write."""
    names = ["hazard.nc", "hazard.gpkg"]
    tables = "objects", "risk", "segments", "return_periods"
    names += [f"{name}.csv" for name in tables]
    names += ["hazard_class.png", "risk.png", "segments.png", SHEET]
    names += [f"{name}.{ending}" for name, _ in map_names(case) for ending in ("tif", "qml")]
    periods = (
        shown("return_period", return_period) for return_period in case.hazard["return_periods"]
    )
    return [*names, *(f"intensity_{period}.png" for period in periods)]


def origins_command(arguments: argparse.Namespace) -> int:
    need("origins need", "vector")
    need("origins need", "report")
    given = getattr(arguments, "hazard.nc")
    path = in_folder(given)
    stem = path.stem if path == given else path.resolve().parent.name
    folder = arguments.output or Path(f"{stem}_origins")
    if not 0 < arguments.side < math.inf:
        raise RockfallError(f"--side {arguments.side:g}: must be above 0")
    hazard = read_hazard(path)
    inputs = [path, *files_behind(hazard)]
    check_study_folder(folder, FILES, inputs)
    kind, place = next(
        (kind, text)
        for kind in ("line", "object", "at")
        if (text := getattr(arguments, kind)) is not None
    )
    at = coordinates_of(place) if kind == "at" else place
    with working():
        traced_hazard, kind, k = traced(hazard, at, [kind], progress=True)
        tables = origin_tables(traced_hazard, kind, k, arguments.side)
        if tables["cells"].empty:
            raise RockfallError(f"{place}: no simulated boulder arrives")
        with warnings_told():
            terrain = terrain_of(traced_hazard, beside=path.parent)
        with atomic_folder(folder, inputs) as part:
            paths = [*put_origins(traced_hazard, tables, part), part / FIGURE]
            figure = origin_map(traced_hazard, terrain, Place(kind, k, place), PAGE)
            save(figure, paths[-1], DOTS)
    warn_of_results(path)
    print(origins_text(tables["areas"], place, arguments.side))
    print_files([folder / path.name for path in paths])
    return DONE
