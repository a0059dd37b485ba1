# SPDX-License-Identifier: BSD-3-Clause
"""Output folder of a study with several runs, and the checkpoints next to it."""

import argparse
import math
from collections.abc import Callable, Iterable
from pathlib import Path

from rockfall.cli.messages import say, warn
from rockfall.errors import RockfallError
from rockfall.interrupts import exit_status
from rockfall.io.output_files import EXISTS, check_folder, check_outputs
from rockfall.simulation.parts.checkpoint import Checkpoint


def check_study_folder(folder: Path, files: Iterable[str], inputs: Iterable[str | Path]) -> None:
    """Refuse a folder where these files cannot be written, before the runs start."""
    check_folder(folder)
    if not folder.resolve().parent.is_dir():
        raise RockfallError(f"{folder}: folder {folder.parent} does not exist")
    check_outputs([folder / name for name in files], inputs)


def is_done(
    arguments: argparse.Namespace,
    made: list[Path],
    checkpoints: Iterable[Checkpoint],
    are_finished: Callable[[], bool],
) -> bool:
    """Return True if `--resume` finds a finished study. With `--resume`, refuse existing files of
    an unfinished or different study, unless `--overwrite` is given."""
    there = [path.exists() for path in made]
    if not (arguments.resume and any(there)):
        return False
    stopped = any(checkpoint.path.exists() for checkpoint in checkpoints)
    if all(there) and not stopped and are_finished():
        return True
    if not arguments.overwrite:
        raise RockfallError(f"{next(filter(Path.exists, made))}: {EXISTS}")
    return False


def study_checkpoints(
    arguments: argparse.Namespace, folder: Path, runs: Iterable[str], study: str
) -> list[Checkpoint]:
    """Checkpoints FOLDER.RUN.checkpoint, one for each run; `study` is used in messages."""
    check_interval(arguments)
    outputs = (folder.with_name(f"{folder.name}.{run}") for run in runs)
    return [new_checkpoint(arguments, output, study, keep=True) for output in outputs]


def check_interval(arguments: argparse.Namespace) -> None:
    """Refuse a negative time between checkpoints."""
    if not arguments.checkpoint >= 0:
        raise RockfallError(f"--checkpoint {arguments.checkpoint}: must be >= 0 seconds")


def new_checkpoint(
    arguments: argparse.Namespace, output: Path, run: str, keep: bool = False
) -> Checkpoint:
    """Checkpoint of an output; an existing one is refused without `--resume`."""
    checkpoint = Checkpoint(output, arguments.checkpoint or math.inf, warn, keep)
    if (done := checkpoint.found()) and not arguments.resume:
        raise RockfallError(
            f"{checkpoint.path}: contains {done:,} boulders of {run}: continue with --resume, or "
            "remove it"
        )
    return checkpoint


def study_interrupted(checkpoints: Iterable[Checkpoint]) -> int:
    """Report checkpoints after Ctrl-C and return the status; raise KeyboardInterrupt without
    checkpoints."""
    kept = [str(checkpoint.path) for checkpoint in checkpoints if checkpoint.saved]
    if not kept:
        raise KeyboardInterrupt
    return say(
        f"interrupted: completed boulders are in {', '.join(kept)}: continue with --resume",
        exit_status(),
    )
