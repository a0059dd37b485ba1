# SPDX-License-Identifier: BSD-3-Clause
"""A case as a job array of Slurm: one job a shard, and a last one that joins them."""

from __future__ import annotations

import shlex
from pathlib import Path
from string import Template

from rockfall.case import read_case
from rockfall.errors import RockfallError
from rockfall.files import whole_file

RUN = Template(
    """#!/bin/sh
#SBATCH --job-name=$name
#SBATCH --array=1-$shards
#SBATCH --cpus-per-task=$threads
#SBATCH --time=$time
#SBATCH --output=$folder/%a.log
# One part of the run for each job of the array; a job that is started again goes on.
set -eu
part=$$SLURM_ARRAY_TASK_ID
export OMP_NUM_THREADS="$${SLURM_CPUS_PER_TASK:-$threads}"
exec $command
"""
)
COMMANDS = {
    "python": Template(
        'rockfall run $case --quiet --resume --threads "$$OMP_NUM_THREADS" '
        '--shard "$$part/$shards" --output $folder/"part$$part.nc"'
    ),
    "batch": Template(
        'rockfall-batch $case quiet=true resume=true threads="$$OMP_NUM_THREADS" '
        'shard="$$part/$shards" output=$folder/"part$$part.nc"'
    ),
}
MERGE = Template(
    """#!/bin/sh
#SBATCH --job-name=$name-merge
#SBATCH --time=$time
#SBATCH --output=$folder/merge.log
set -eu
exec rockfall merge $folder/part*.nc --output $folder/$stem.nc
"""
)
SUBMIT = Template(
    """#!/bin/sh
# The array, and the merge once all of its jobs are done.
set -eu
job=$$(sbatch --parsable $folder/run.sh)
sbatch --dependency="afterok:$$job" $folder/merge.sh
"""
)


def write_jobs(
    path: str | Path, folder: str | Path, shards: int, *, program: str, threads: int, time: str
) -> list[Path]:
    """Write run.sh, merge.sh and submit.sh for a case to `folder`, made where it is missing.

    `program` is python or batch; a case for the latter is as `rockfall prepare` makes it. `threads`
    and `time` (as Slurm has it) are what each job asks for.
    """
    case = read_case(path)
    if program not in COMMANDS:
        raise RockfallError(f"--program {program}: must be {' or '.join(COMMANDS)}")
    if threads < 1:
        raise RockfallError(f"--threads {threads}: must be at least 1")
    if shards < 2:
        raise RockfallError(f"--shards {shards}: must be at least 2")
    if "x" in case.release and shards > (
        boulders := case.case["boulders"] * len(case.release["x"])
    ):
        raise RockfallError(f"--shards {shards}: must be at most {boulders}, one boulder each")
    if not time or not set(time) <= set("0123456789-:"):
        raise RockfallError(f"--time {time}: must be as Slurm has it: MINUTES, H:M:S or D-H")
    folder = Path(folder).absolute()
    about = {
        "case": shlex.quote(str(Path(path).absolute())), "folder": shlex.quote(str(folder)),
        "name": "rockfall", "stem": shlex.quote(Path(path).stem), "shards": shards,
        "threads": threads, "time": time,
    }  # fmt: skip
    if any(character.isspace() for character in str(folder)):
        raise RockfallError(f"{folder}: #SBATCH lines take no folder with blanks in its name")
    about["command"] = COMMANDS[program].substitute(about)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RockfallError(f"{folder}: cannot be made: {error.strerror}") from error
    return [
        _write(folder / name, text.substitute(about))
        for name, text in (("run.sh", RUN), ("merge.sh", MERGE), ("submit.sh", SUBMIT))
    ]


def _write(path: Path, text: str) -> Path:
    with whole_file(path) as part:
        part.write_text(text)
        part.chmod(0o755)
    return path
