# SPDX-License-Identifier: BSD-3-Clause
"""Studies with many runs of a case: uncertain inputs, and convergence of results."""

import argparse
from collections.abc import Iterable
from pathlib import Path

from rockfall.analysis.observed.compare import observed_files
from rockfall.analysis.observed.observations import read_observed
from rockfall.case import Case
from rockfall.case.files import input_files
from rockfall.cli.checkpoints import check_study_folder
from rockfall.cli.given import given_case, given_options, overridden, stem_of, warn_of_inputs
from rockfall.cli.messages import DONE, say, warn_each
from rockfall.errors import RockfallError, need
from rockfall.interrupts import exit_status
from rockfall.io.atomic import atomic_folder
from rockfall.io.output_files import check_outputs
from rockfall.io.rasters.dem import dem_header
from rockfall.io.rasters.grid import Grid
from rockfall.io.tables import write_csv
from rockfall.io.vectors.point_rows import is_point_layer
from rockfall.plots.studies.convergence_figure import figure
from rockfall.plots.studies.models import models_figure
from rockfall.plots.studies.posterior_figure import posterior_figure
from rockfall.plots.style import save
from rockfall.simulation.simulate import StudyInterrupted
from rockfall.studies.back.files import check_back, write_back
from rockfall.studies.back.study import Back, back_analysis
from rockfall.studies.convergence import converge
from rockfall.studies.ensemble.study import check_place, run_ensemble, write_ensemble
from rockfall.studies.models import run_models, write_models
from rockfall.studies.validation import validate
from rockfall.tables.back import back_text
from rockfall.tables.convergence import convergence_text
from rockfall.tables.ensemble import ensemble_summary
from rockfall.tables.models import models_text, validation_text

TABLES = ("study", "error", "cost", "numerical")
DRAWINGS = "convergence.png", "convergence.pdf"
FILES = (*(f"{table}.csv" for table in TABLES), *DRAWINGS)  # files of a convergence study
MODEL_FILES = "models.csv", "models.png", "models.nc"


def ensemble_command(arguments: argparse.Namespace) -> int:
    case = overridden(arguments)
    if arguments.runs is not None:
        case = case.replace(ensemble={"runs": arguments.runs})
    path = arguments.output or Path(f"{stem_of(arguments)}-ensemble.nc")
    check_place(path, len(case.lines), input_files(case))
    warn_of_inputs(case)
    try:
        ensemble = run_ensemble(case, progress=not arguments.quiet)
    except StudyInterrupted as stop:
        write_ensemble(stop.result, path)
        runs = case.ensemble["runs"]
        holds = (
            f"{path} contains the first {stop.runs} of {runs} draws, like a run with --runs "
            f"{stop.runs}"
        )
        return say(f"interrupted: {holds}", exit_status())
    write_ensemble(ensemble, path)
    if not arguments.quiet:
        print(ensemble_summary(ensemble))
        print(path)
    return DONE


def back_command(arguments: argparse.Namespace) -> int:
    case = overridden(arguments)
    folder = arguments.output or Path(f"{stem_of(arguments)}_back")
    need("back needs", "report")
    files = arguments.observed or observed_files(case)
    if not files:
        raise RockfallError("back requires OBSERVED files, or &observed files in the case")
    seen = read_observed(*files, grid=_grid(case, files))
    check_back(folder, [*input_files(case), *files])
    warn_of_inputs(case)
    how = {"members": arguments.members, "enough": arguments.effective}
    given = {name: value for name, value in how.items() if value is not None}
    try:
        analysis = back_analysis(case, seen, progress=not arguments.quiet, **given)
    except StudyInterrupted as stop:
        write_back(stop.result, folder, files, _draw_posterior)
        holds = f"{folder} contains the posterior of the first {stop.runs} members"
        return say(f"interrupted: {holds}", exit_status())
    paths = write_back(analysis, folder, files, _draw_posterior)
    warn_each(analysis.model_warnings)
    if not arguments.quiet:
        print(back_text(analysis))
        print(*paths, sep="\n")
    return DONE


def _grid(case: Case, observed: Iterable[Path]) -> Grid | None:
    """Terrain grid if an observation is a layer, which is read on the grid; else None."""
    if "dem" not in case.terrain or not any(map(is_point_layer, observed)):
        return None
    return dem_header(case.path(case.terrain["dem"]))[0]


def _draw_posterior(analysis: Back, path: Path) -> None:
    save(posterior_figure(analysis), path, dpi=200)


def convergence_command(arguments: argparse.Namespace) -> int:
    folder = arguments.output or Path(f"{stem_of(arguments)}_convergence")
    case = given_case(arguments)
    inputs = list(input_files(case))
    _check_folder(folder, FILES, "convergence", inputs)
    given = given_options(arguments, ("boulders", "reference"))
    warn_of_inputs(case)
    study = converge(case, **given, progress=True)
    with atomic_folder(folder, inputs) as part:
        for name in TABLES:
            write_csv(getattr(study, name), part / f"{name}.csv")
        figure(study, [part / name for name in DRAWINGS])
    warn_each(study.model_warnings)
    print(convergence_text(study))
    print("", *(folder / name for name in FILES), sep="\n")
    return DONE


def models_command(arguments: argparse.Namespace) -> int:
    case = overridden(arguments)
    folder = arguments.output or Path(f"{stem_of(arguments)}_models")
    inputs = list(input_files(case))
    _check_folder(folder, MODEL_FILES, "models", inputs)
    tables = arguments.table
    models = run_models(case, arguments.ground, progress=not arguments.quiet, tables=tables)
    warn_of_inputs(case)
    with atomic_folder(folder, inputs) as part:
        write_csv(models.table, part / "models.csv")
        save(models_figure(models), part / "models.png", dpi=200)
        write_models(models, part / "models.nc")
    warn_each(models.warnings)
    if not arguments.quiet:
        print(models_text(models))
    print(*(folder / name for name in MODEL_FILES), sep="\n")
    return DONE


def validate_command(arguments: argparse.Namespace) -> int:
    case = overridden(arguments)
    inputs = [*input_files(case), *arguments.observed]
    if arguments.output is not None:
        check_outputs([arguments.output], inputs)
    seen = read_observed(*arguments.observed, grid=_grid(case, arguments.observed))
    tables = arguments.table or None
    validation = validate(case, seen, tables, arguments.seeds, progress=not arguments.quiet)
    warn_of_inputs(case)
    if arguments.output is not None:
        write_csv(validation.table, arguments.output)
    warn_each(validation.warnings)
    print(validation_text(validation))
    return DONE


def _check_folder(
    folder: Path, files: Iterable[str], study: str, inputs: Iterable[str | Path]
) -> None:
    need(f"{study} needs", "report")
    check_study_folder(folder, files, inputs)
