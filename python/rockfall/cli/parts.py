# SPDX-License-Identifier: BSD-3-Clause
"""Runs in parts, and cases for other machines: merge, prepare, slurm."""

from __future__ import annotations

import argparse

from rockfall.cli.given import given_case
from rockfall.cli.messages import DONE
from rockfall.io.output_files import check_result_path
from rockfall.result.dataset import write_result
from rockfall.scene.prepare import prepare
from rockfall.simulation.merge import join
from rockfall.simulation.slurm import write_jobs
from rockfall.text.summary import summary


def merge_command(arguments: argparse.Namespace) -> int:
    check_result_path(arguments.output, arguments.parts)
    result = join(arguments.parts)
    write_result(result, arguments.output)
    print(summary(result))
    print(arguments.output)
    return DONE


def prepare_command(arguments: argparse.Namespace) -> int:
    print(*prepare(given_case(arguments), arguments.folder), sep="\n")
    return DONE


def slurm_command(arguments: argparse.Namespace) -> int:
    how = {key: getattr(arguments, key) for key in ("program", "threads", "time", "variant")}
    print(*write_jobs(arguments.case, arguments.folder, arguments.shards, **how), sep="\n")
    return DONE
