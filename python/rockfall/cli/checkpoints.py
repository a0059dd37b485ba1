# SPDX-License-Identifier: BSD-3-Clause
"""Checkpoints of a study of several runs, next to its folder."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterable
from pathlib import Path

from rockfall.cli.messages import say, warn
from rockfall.errors import RockfallError
from rockfall.interrupts import exit_status
from rockfall.simulation.parts.checkpoint import Checkpoint


def study_checkpoints(
    arguments: argparse.Namespace, folder: Path, runs: Iterable[str], study: str
) -> list[Checkpoint]:
    """Checkpoints FOLDER.RUN.checkpoint of runs; existing ones are overwritten only on request."""
    if not arguments.checkpoint >= 0:
        raise RockfallError(f"--checkpoint {arguments.checkpoint}: must be >= 0 seconds")
    paths = []
    for run in runs:
        output = folder.with_name(f"{folder.name}.{run}")
        checkpoint = Checkpoint(output, arguments.checkpoint or math.inf, warn, keep=True)
        if (done := checkpoint.found()) and not arguments.resume:
            raise RockfallError(
                f"{checkpoint.path}: holds {done:,} boulders of {study} that was stopped; go on "
                "with --resume, or remove it"
            )
        paths.append(checkpoint)
    return paths


def study_interrupted(checkpoints: Iterable[Checkpoint]) -> int:
    """Report what the checkpoints hold after Ctrl-C, and return the exit status."""
    kept = [str(checkpoint.path) for checkpoint in checkpoints if checkpoint.saved]
    if not kept:
        raise KeyboardInterrupt
    return say(
        f"interrupted: {', '.join(kept)}: hold what is done; --resume goes on", exit_status()
    )
