# SPDX-License-Identifier: BSD-3-Clause
"""Preview of a case."""

from __future__ import annotations

import argparse

from rockfall.case import read_case
from rockfall.cli.given import scene_of
from rockfall.cli.messages import DONE
from rockfall.text.preview import preview


def check_command(arguments: argparse.Namespace) -> int:
    print(preview(scene_of(read_case(arguments.case), arguments)))
    return DONE
