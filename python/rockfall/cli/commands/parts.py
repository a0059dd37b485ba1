# SPDX-License-Identifier: BSD-3-Clause
"""Runs in parts, and cases for other machines: merge, prepare, slurm."""

import argparse

from rockfall.cli.given import given_case
from rockfall.cli.messages import DONE, say, warn
from rockfall.errors import RockfallError
from rockfall.io.output_files import EXISTS, check_result_path, overwriting
from rockfall.result.dataset import write_result
from rockfall.scene.prepare import prepare
from rockfall.simulation.parts.finished import FINISHED, is_finished
from rockfall.simulation.parts.merge import Joined
from rockfall.simulation.slurm import USUAL_SHARDS, write_jobs
from rockfall.text.summary import summary


def merge_command(arguments: argparse.Namespace) -> int:
    path, there = arguments.output, arguments.output.exists() and not arguments.overwrite
    with overwriting(arguments.overwrite or there):
        check_result_path(path, arguments.parts)
    joined = Joined()
    for part in arguments.parts:
        joined.add(part)
    result = joined.result()
    if there:
        assert joined.first is not None
        origin = joined.first.origin
        if not is_finished(path, origin, range(1, origin.boulders + 1)):
            raise RockfallError(f"{path}: {EXISTS}")
        return say(f"{path}: {FINISHED}", DONE)
    write_result(result, path)
    print(summary(result))
    print(arguments.output)
    return DONE


def prepare_command(arguments: argparse.Namespace) -> int:
    print(*prepare(given_case(arguments), arguments.folder), sep="\n")
    return DONE


def slurm_command(arguments: argparse.Namespace) -> int:
    how = {key: getattr(arguments, key) for key in ("program", "threads", "time", "variant")}
    print(*write_jobs(arguments.case, arguments.folder, arguments.shards, **how), sep="\n")
    if arguments.shards > USUAL_SHARDS:
        warn(
            f"--shards {arguments.shards}: Slurm usually allows arrays of {USUAL_SHARDS:,} jobs: "
            "`scontrol show config` lists MaxArraySize, which must be larger than --shards"
        )
    return DONE
