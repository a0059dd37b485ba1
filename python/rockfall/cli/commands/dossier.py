# SPDX-License-Identifier: BSD-3-Clause
"""Dossier of a case: the scenarios of each variant, and the pages for signature."""

import argparse
from pathlib import Path

from rockfall.case import read_case
from rockfall.case.files import input_files
from rockfall.case.variants import variants
from rockfall.cli.checkpoints import check_study_folder, study_checkpoints, study_interrupted
from rockfall.cli.given import at_risk, memory_of, with_overrides
from rockfall.cli.messages import DONE, print_files, warn, warn_each, warnings_told
from rockfall.dossiers import check_needs, designs_of, dossier_files, put_dossier, terrain_of_inputs
from rockfall.errors import need
from rockfall.html_report.dossier_page import answers
from rockfall.html_report.inputs import Parties
from rockfall.interrupts import interrupts
from rockfall.io.atomic import atomic_folder
from rockfall.protection.yearly import check_period
from rockfall.simulation.parts.lock import locked
from rockfall.simulation.simulate import Interrupted
from rockfall.studies.dossier import read_dossier, run_dossier
from rockfall.tables.dossier import model_texts


def dossier_command(arguments: argparse.Namespace) -> int:
    need("a dossier needs", "vector")
    check_needs(arguments.language)
    check_period(arguments.return_period)
    case = with_overrides(read_case(arguments.case), arguments)
    folder = arguments.output or Path(f"{arguments.case.stem}_dossier")
    given = at_risk(arguments)
    inputs = [*input_files(case), *given.files]
    inputs += [arguments.costs] if arguments.costs else []
    check_study_folder(folder, dossier_files([*variants(case)] or [""]), inputs)
    with locked(folder.resolve(), warn):
        memory = memory_of(arguments)
        read = read_dossier(case, given, memory, one_model=arguments.one_model)
        runs = [f"run{k}" for k, _ in enumerate(read.runs, start=1)]
        checkpoints = study_checkpoints(arguments, folder.resolve(), runs, "a dossier")
        for remark in read.remarks:
            warn(remark)
        with interrupts():  # keeps completed work
            try:
                made = run_dossier(
                    read, period=arguments.return_period, progress=not arguments.quiet,
                    checkpoints=dict(zip(read.runs, checkpoints, strict=True)),
                )  # fmt: skip
            except Interrupted:
                return study_interrupted(checkpoints)
            parties = Parties(arguments.project, arguments.client, arguments.author)
            how = terrain_of_inputs(read), parties, arguments.language
            designs = designs_of(made, arguments.costs)
            with atomic_folder(folder, inputs) as part, warnings_told():
                paths = list(put_dossier(made, designs, part, *how))
        for checkpoint in checkpoints:
            checkpoint.remove()
    warn_each(model_texts(made))
    if not arguments.quiet:
        print(*answers(made, designs), sep="\n")
        print_files([folder / path.name for path in paths])
    return DONE
