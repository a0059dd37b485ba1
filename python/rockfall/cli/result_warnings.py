# SPDX-License-Identifier: BSD-3-Clause
"""Warnings of stored results and hazards."""

from collections.abc import Collection
from contextlib import ExitStack
from pathlib import Path

from rockfall.analysis.hazard.messages import messages_of
from rockfall.analysis.validity.warnings import joined_warnings, joint_warnings
from rockfall.case import case_in
from rockfall.cli.messages import warn
from rockfall.files.hazard_files import is_hazard, read_hazard
from rockfall.io.input_warnings import doubts_in
from rockfall.result.dataset import open_result


def warn_of_results(*paths: Path, told: Collection[str] = ()) -> None:
    """Print each input and model warning of results and hazards once, except those in `told`."""
    of_hazard = {path for path in paths if is_hazard(path)}
    hazards = [read_hazard(path) for path in paths if path in of_hazard]
    with ExitStack() as opened:
        stems = [path.stem for path in paths]
        results = {
            path.stem if stems.count(path.stem) == 1 else str(path): opened.enter_context(
                open_result(path)
            )
            for path in paths
            if path not in of_hazard
        }
        inputs = [
            f"{case_in(attrs).name}: {where}: {text}"
            for attrs in (data.attrs for data in (*results.values(), *hazards))
            for where, text in doubts_in(attrs.get("input_warnings", "[]"))
        ]
        of_hazards = [text for each in hazards for text in joined_warnings(messages_of(each))]
        for text in dict.fromkeys((*inputs, *joint_warnings(results), *of_hazards)):
            if text not in told:
                warn(text)
