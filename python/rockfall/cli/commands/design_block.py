# SPDX-License-Identifier: BSD-3-Clause
"""Mode of `rockfall design` for the block of a return period."""

import argparse
from pathlib import Path

from rockfall.analysis.design_block import DesignBlock, design_block
from rockfall.cli.messages import DONE
from rockfall.errors import RockfallError
from rockfall.io.atomic import atomic_folder
from rockfall.io.output_files import check_folder, check_outputs
from rockfall.io.tables import write_csv
from rockfall.tables.design_block import design_block_text, scenario_text

OPTIONS = ("years", "events", "threshold", "volume_max")  # options of this mode only


def design_block_command(arguments: argparse.Namespace) -> int:
    if arguments.results:
        raise RockfallError(
            "--return-period: requires hazards HAZARD.nc or the survey --blocks, not results"
        )
    if arguments.blocks is None:
        raise RockfallError("--return-period requires --blocks, the table of surveyed blocks")
    folder, inputs = arguments.output, [Path(arguments.blocks)]
    inputs += [arguments.events] if arguments.events else []
    if folder:
        check_folder(folder)
        check_outputs([folder / name for name in ("design_block.csv", "design_block.nml")], inputs)
    given = {key: getattr(arguments, key) for key in OPTIONS}
    block = design_block(arguments.blocks, arguments.return_period, **given)
    print(design_block_text(block))
    if folder:
        print("", *_write(block, folder, inputs), sep="\n")
    return DONE


def _write(block: DesignBlock, folder: Path, inputs: list[Path]) -> list[Path]:
    """Write the table of return periods and any scenario: both or none."""
    with atomic_folder(folder, inputs) as part:
        write_csv(block.levels, part / "design_block.csv")
        if block.scenario:
            text = f"! Written by `rockfall design --return-period`.\n{scenario_text(block)}"
            (part / "design_block.nml").write_text(text, encoding="utf-8")
        names = sorted(path.name for path in part.iterdir())
    return [folder / name for name in names]
