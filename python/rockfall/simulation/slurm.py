# SPDX-License-Identifier: BSD-3-Clause
"""Slurm job array for a case: a job for each shard, and a final job that merges the shards."""

import re
import shlex
import shutil
import sys
from pathlib import Path
from string import Template

from rockfall.case import read_case
from rockfall.case.files import input_files
from rockfall.case.variants import chosen_variant
from rockfall.errors import RockfallError
from rockfall.io.atomic import atomic_folder
from rockfall.io.output_files import check_outputs

MAX_SHARDS = 10_000
#: Default maximum number of jobs in a Slurm array: MaxArraySize - 1.
USUAL_SHARDS = 1_000
ROCKFALL = shlex.join([sys.executable, "-m", "rockfall"])
#: Formats of `sbatch --time`: minutes, M:S, H:M:S, D-H, D-H:M, D-H:M:S.
TIME = r"[0-9]{1,9}(:[0-9]{1,9}){0,2}|[0-9]{1,9}-[0-9]{1,9}(:[0-9]{1,9}){0,2}"
RUN = Template(
    """#!/bin/sh
# Written by `rockfall slurm`.
#SBATCH --job-name=$name
#SBATCH --array=1-$shards
#SBATCH --cpus-per-task=$threads
#SBATCH --time=$time
#SBATCH --output=$folder/%a.log
#SBATCH --open-mode=append
#SBATCH --requeue
# One part of the run for each job of the array; a job that is started again continues.
set -eu
mkdir -p $folder/parts
part=$$SLURM_ARRAY_TASK_ID
export OMP_NUM_THREADS="$${SLURM_CPUS_PER_TASK:-$threads}"
exec $program $case$variant --quiet --resume --overwrite --threads "$$OMP_NUM_THREADS" \\
  --shard "$$part/$shards" --output $folder/parts/"part$${part}of$shards"
"""
)
PROGRAMS = "python", "batch"
MERGE = Template(
    """#!/bin/sh
# Written by `rockfall slurm`.
#SBATCH --job-name=$name-merge
#SBATCH --time=$time
#SBATCH --output=$folder/merge.log
set -eu
cd $folder/parts
part=0
while [ "$$part" -lt $shards ]; do
  part=$$((part + 1))
  set -- "$$@" "part$${part}of$shards"
done
exec $rockfall merge "$$@" --output $folder/$stem.nc
"""
)
SUBMIT = Template(
    """#!/bin/sh
# Written by `rockfall slurm`.
# The array, and the merge once all of its jobs are done.
set -eu
job=$$(sbatch --parsable $folder/run.sh)
sbatch --dependency="afterok:$$job" $folder/merge.sh
"""
)


def write_jobs(
    path: str | Path,
    folder: str | Path,
    shards: int,
    *,
    program: str,
    threads: int,
    time: str,
    variant: str | None = None,
) -> list[Path]:
    """Write run.sh, merge.sh and submit.sh for a case to `folder` (created if missing): all files
    or none.

    `program` is python or batch; batch needs a case made by `rockfall prepare`. Each job requests
    `threads` and `time` (in Slurm's format). `variant` selects a variant of the case. Raises a
    RockfallError for invalid values.
    """
    case = chosen_variant(read_case(path), variant)
    if program not in PROGRAMS:
        raise RockfallError(f"--program {program}: must be {' or '.join(PROGRAMS)}")
    if threads < 1:
        raise RockfallError(f"--threads {threads}: must be at least 1")
    case.replace(case={"threads": threads})  # raises an error for too many threads
    if not 2 <= shards <= MAX_SHARDS:
        raise RockfallError(f"--shards {shards}: must be 2 to {MAX_SHARDS}")
    if "x" in case.release and shards > (
        boulders := case.case.get("boulders_total")
        or case.case["boulders"] * len(case.release["x"])
    ):
        raise RockfallError(f"--shards {shards}: must be at most {boulders}, one boulder each")
    if not re.fullmatch(TIME, time):
        raise RockfallError(
            f"--time {time}: must be a Slurm time: MINUTES, M:S, H:M:S, D-H, D-H:M or D-H:M:S"
        )
    folder = Path(folder).absolute()
    if any(character.isspace() for character in str(folder)):
        raise RockfallError(f"{folder}: folder names in #SBATCH lines cannot contain spaces")
    inputs = list(input_files(case))
    check_outputs([folder / f"{Path(path).stem}.nc"], inputs)  # the output of merge.sh
    attrs = {
        "case": shlex.quote(str(Path(path).absolute())), "folder": shlex.quote(str(folder)),
        "name": "rockfall", "stem": shlex.quote(Path(path).stem), "shards": shards,
        "threads": threads, "time": time,
        "variant": "" if variant is None else f" --variant {shlex.quote(variant)}",
        "rockfall": ROCKFALL, "program": f"{ROCKFALL} run" if program == "python" else _batch(path),
    }  # fmt: skip
    scripts = {"run.sh": RUN, "merge.sh": MERGE, "submit.sh": SUBMIT}
    with atomic_folder(folder, inputs) as part:
        for name, text in scripts.items():
            (part / name).write_text(text.substitute(attrs), "utf-8", newline="\n")
            (part / name).chmod(0o755)
    return [folder / name for name in scripts]


def _batch(path: str | Path) -> str:
    """Path of rockfall-batch for the jobs, quoted for the shell. Raises a RockfallError if it is
    not on the PATH, or if the case is not prepared."""
    program = shutil.which("rockfall-batch")
    if not program:
        raise RockfallError("--program batch: rockfall-batch is not on the PATH")
    if not Path(path).with_name("scene.nc").is_file():
        raise RockfallError(
            f"{path}: scene.nc is missing next to it: create both with `rockfall prepare`"
        )
    return shlex.quote(str(Path(program).absolute()))
