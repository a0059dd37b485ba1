# SPDX-License-Identifier: BSD-3-Clause
"""Warnings of stored results and hazards."""

from collections.abc import Collection
from contextlib import ExitStack
from pathlib import Path

from rockfall.analysis.hazard.model_warnings import messages_of
from rockfall.analysis.validity.warnings import joined_warnings, joint_warnings
from rockfall.case import case_in
from rockfall.cli.messages import warn
from rockfall.io.input_warnings import doubts_in
from rockfall.result.dataset import open_result


def warn_of_results(*paths: Path, told: Collection[str] = ()) -> None:
    """Print each input and model warning of results and hazards once, except those in `told`."""
    stems = [path.stem for path in paths]
    with ExitStack() as opened:
        by_name = {
            path.stem if stems.count(path.stem) == 1 else str(path): opened.enter_context(
                open_result(path)
            )
            for path in paths
        }
        hazards = [data for data in by_name.values() if "hazard_class" in data]
        results = {name: data for name, data in by_name.items() if "hazard_class" not in data}
        inputs = [
            f"{case_in(data.attrs).name}: {where}: {text}"
            for data in by_name.values()
            for where, text in doubts_in(data.attrs.get("input_warnings", "[]"))
        ]
        of_hazards = [text for each in hazards for text in joined_warnings(messages_of(each))]
        for text in dict.fromkeys((*inputs, *joint_warnings(results), *of_hazards)):
            if text not in told:
                warn(text)
