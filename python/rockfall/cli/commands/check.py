# SPDX-License-Identifier: BSD-3-Clause
"""Preview of a case."""

from __future__ import annotations

import argparse

from rockfall.analysis.observed.compare import site_observations
from rockfall.case import Case, read_case
from rockfall.case.variants import variants
from rockfall.cli.given import given_case, scene_of
from rockfall.cli.messages import DONE
from rockfall.text.preview import preview


def check_command(arguments: argparse.Namespace) -> int:
    cases = {} if arguments.variant else variants(read_case(arguments.case))
    if not cases:
        print(_preview(given_case(arguments), arguments))
    blocks = (f"variant {key}\n{_preview(case, arguments)}" for key, case in cases.items())
    for k, block in enumerate(blocks):
        print(f"\n{block}" if k else block, flush=True)
    return DONE


def _preview(case: Case, arguments: argparse.Namespace) -> str:
    scene = scene_of(case, arguments)
    site_observations(scene)  # refuses what a run could not be compared with
    return preview(scene)
