# SPDX-License-Identifier: BSD-3-Clause
"""Preview and run of a case."""

from __future__ import annotations

import argparse
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rockfall.analysis.observed.compare import compare, disagreement, site_observations
from rockfall.case import Case, read_case
from rockfall.case.files import input_files
from rockfall.case.variants import variants
from rockfall.cli.checkpoints import check_interval, new_checkpoint
from rockfall.cli.given import given_case, overridden, scene_of, stem_of
from rockfall.cli.messages import DONE, say, warn
from rockfall.errors import RockfallError
from rockfall.interrupts import exit_status, interrupts
from rockfall.io.output_files import EXISTS, check_result_path, overwriting
from rockfall.language import Text
from rockfall.language import say as words
from rockfall.result.dataset import write_result
from rockfall.result.samples import simulated
from rockfall.scene.scene import Scene
from rockfall.simulation.dask import run_on_cluster
from rockfall.simulation.parts.checkpoint import Checkpoint, checkpoint_of
from rockfall.simulation.parts.finished import FINISHED, contains_run
from rockfall.simulation.parts.lock import locked
from rockfall.simulation.simulate import Interrupted, simulate
from rockfall.studies.run_until import simulate_until, verdicts_of
from rockfall.text.preview import preview
from rockfall.text.summary import summary

if TYPE_CHECKING:
    from rockfall.analysis.observed.observations import Observed
    from rockfall.result.contents import Contents


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
    site_observations(scene)  # refuses observations that cannot be compared
    return preview(scene)


def run_command(arguments: argparse.Namespace) -> int:
    _refuse_contradictions(arguments)
    case = overridden(arguments)
    which, parts = shard = (1, 1) if arguments.shard is None else _shard(arguments.shard)
    stem = stem_of(arguments)
    path = arguments.output or Path(f"{stem}.nc" if parts == 1 else f"{stem}.part{which}of{parts}")
    with overwriting(arguments.overwrite or arguments.resume or _was_stopped(path, arguments)):
        check_result_path(path, input_files(case))
        with locked(path, warn):
            return _run_to(path, case, arguments, shard, _checkpoint(arguments, path))


def _was_stopped(path: Path, arguments: argparse.Namespace) -> bool:
    """Return True if a stopped run left a checkpoint next to the output. Then an existing output is
    no error: `--resume` replaces it, and without this option the checkpoint is refused, with a
    clearer message."""
    checkpoints = arguments.until is None and arguments.dask is None
    return checkpoints and checkpoint_of(path).exists()


def _refuse_contradictions(arguments: argparse.Namespace) -> None:
    for word in "boulders", "boulders_total":
        if arguments.until is not None and getattr(arguments, word) is not None:
            option = word.replace("_", "-")
            raise RockfallError(f"--{option}: is chosen by --until: limit it with --cap")
    if arguments.until is None and arguments.cap is not None:
        raise RockfallError("--cap requires --until")
    for word in "shard", "resume", "dask":
        if arguments.until is not None and getattr(arguments, word) not in (None, False):
            raise RockfallError(f"--{word} cannot be combined with --until")
    if arguments.dask is not None and (arguments.resume or arguments.shard is not None):
        raise RockfallError("--dask cannot be combined with --shard or --resume")
    check_interval(arguments)


def _shard(text: str) -> tuple[int, int]:
    which, slash, parts = text.partition("/")
    if not (slash and which.isdecimal() and parts.isdecimal() and 1 <= int(which) <= int(parts)):
        raise RockfallError(f"--shard {text}: must be I/N with I from 1 to N")
    return int(which), int(parts)


def _checkpoint(arguments: argparse.Namespace, path: Path) -> Checkpoint | None:
    if arguments.until is not None or arguments.dask is not None:
        return None
    return new_checkpoint(arguments, path, "a stopped run")


def _run_to(
    path: Path,
    case: Case,
    arguments: argparse.Namespace,
    shard: tuple[int, int],
    checkpoint: Checkpoint | None,
) -> int:
    scene = scene_of(case, arguments)
    seen = site_observations(scene)  # refuses observations that could not be compared later
    if arguments.resume and path.exists() and not checkpoint_of(path).exists():
        if contains_run(path, scene, shard):
            return say(f"{path}: {FINISHED}", DONE)
        if not arguments.overwrite:
            raise RockfallError(f"{path}: {EXISTS}")
    with interrupts():  # completed work is still written
        try:
            result = _simulate(scene, arguments, shard, checkpoint, path.parent)
        except Interrupted as stop:
            return _keep(stop.contents, path, checkpoint)
        _write(result, path, checkpoint)
    if checkpoint:
        checkpoint.remove()
    for verdict in verdicts_of(result):
        if not verdict.met:
            warn(f"--until {verdict}")
    if not arguments.quiet:
        print(summary(result))
        if seen is not None:
            print(f"  {_agreement(result, seen)}")
        print(path)
    return DONE


def _agreement(result: Contents, seen: Observed) -> Text:
    """Text on the agreement of a run with its site, or on why it cannot be compared."""
    try:
        return disagreement(compare(result.dataset(), seen))
    except RockfallError as error:
        return words("page.left_out", parts=words("page.part_observed"), why=error.faults[0])


def _write(result: Contents, path: Path, checkpoint: Checkpoint | None) -> None:
    """Write a result; if this fails, the error mentions the checkpoint."""
    with checkpoint.named() if checkpoint else nullcontext():
        write_result(result, path)


def _simulate(
    scene: Scene,
    arguments: argparse.Namespace,
    shard: tuple[int, int],
    checkpoint: Checkpoint | None,
    folder: Path,
) -> Contents:
    """Simulate all boulders of a case, or as many as the `--until` rules require."""
    shown = not arguments.quiet
    if arguments.dask is not None:
        return run_on_cluster(scene, arguments.dask, progress=shown)
    if arguments.until is None:
        how: dict[str, Any] = {"progress": shown, "keep": False, "spill": folder}
        return simulate(scene, shard=shard, checkpoint=checkpoint, **how)
    return simulate_until(scene, arguments.until, arguments.cap, progress=shown, keep=False)


def _keep(result: Contents, path: Path, checkpoint: Checkpoint | None) -> int:
    """Save the completed boulders after Ctrl-C, and return the exit status. Raises
    KeyboardInterrupt without any."""
    done, requested = simulated(result), result.attrs["boulders_requested"]
    if not done:
        raise KeyboardInterrupt
    _write(result, path, checkpoint)
    if "part_layout" in result.attrs:
        holds = f"{path} contains {done:,} boulders of the part"
    else:
        holds = (
            f"{path} contains the first {done:,} of {requested:,} boulders and is a valid result"
        )
    holds += ": continue with --resume" if checkpoint and checkpoint.saved else ""
    return say(f"interrupted: {holds}", exit_status())
