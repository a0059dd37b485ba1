# SPDX-License-Identifier: BSD-3-Clause
"""The job array, run by hand: a loop over SLURM_ARRAY_TASK_ID, then the merge."""

import os
import stat
import subprocess
import sys

import pytest

import rockfall
from rockfall.cli import main
from test_batch import find_program


@pytest.fixture
def commands(tmp_path):
    """A folder with `rockfall` and `rockfall-batch`, wherever they are in this tree."""
    folder = tmp_path / "bin"
    folder.mkdir()
    for name, what in (
        ("rockfall", f'{sys.executable} -m rockfall.cli "$@"'),
        ("rockfall-batch", f'{find_program()} "$@"'),
        ("sbatch", 'echo "$@" >>jobs.txt; echo 4711'),
    ):
        (folder / name).write_text(f"#!/bin/sh\nexec {what}\n".replace("exec echo", "echo"))
        (folder / name).chmod(0o755)
    return {**os.environ, "PATH": f"{folder}:{os.environ['PATH']}"}


@pytest.mark.parametrize("program", ["python", "batch"])
def test_the_array_run_by_hand_gives_the_run(program, few_boulders, commands, tmp_path, capsys):
    case = few_boulders
    if program == "batch":
        about = subprocess.run(["rockfall-batch", "--version"], env=commands, capture_output=True)
        if b"without netCDF" in about.stdout:
            pytest.skip("rockfall-batch was built without netCDF")
        assert main(["prepare", str(case), str(tmp_path / "prepared")]) == 0
        case = tmp_path / "prepared" / "case.nml"
    jobs = tmp_path / "jobs"
    words = ["slurm", str(case), str(jobs), "--shards", "3", "--program", program]
    assert main([*words, "--threads", "2", "--time", "10:00"]) == 0
    script = (jobs / "run.sh").read_text()
    for line in ("--array=1-3", "--cpus-per-task=2", "--time=10:00"):
        assert f"#SBATCH {line}\n" in script
    assert {"python": " --resume ", "batch": " resume=true "}[program] in script
    for path in jobs.iterdir():
        assert path.stat().st_mode & stat.S_IXUSR
        assert subprocess.run(["sh", "-n", path]).returncode == 0
    for k in range(1, 4):
        job = {**commands, "SLURM_ARRAY_TASK_ID": str(k), "SLURM_CPUS_PER_TASK": "1"}
        assert subprocess.run([jobs / "run.sh"], env=job, cwd="/").returncode == 0
    assert subprocess.run([jobs / "merge.sh"], env=commands, cwd="/").returncode == 0
    joined = rockfall.read_result(jobs / "case.nc")
    whole = rockfall.run(rockfall.read_case(case))
    assert joined.equals(whole)
    assert joined.attrs["threads"] == 1


def test_submit_makes_the_merge_wait_for_the_array(few_boulders, commands, tmp_path):
    jobs = tmp_path / "jobs"
    assert main(["slurm", str(few_boulders), str(jobs), "--shards", "3"]) == 0
    assert subprocess.run([jobs / "submit.sh"], env=commands, cwd=tmp_path).returncode == 0
    first, second = (tmp_path / "jobs.txt").read_text().splitlines()
    assert first == f"--parsable {jobs}/run.sh"
    assert second == f"--dependency=afterok:4711 {jobs}/merge.sh"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--shards", "0"], "--shards 0: must be at least 2"),
        (["--shards", "1"], "--shards 1: must be at least 2"),
        (["--shards", "51"], "--shards 51: must be at most 50, one boulder each"),
        (["--shards", "2", "--threads", "0"], "--threads 0: must be at least 1"),
        (["--shards", "2", "--program", "c"], "--program c: must be python or batch"),
        (["--shards", "2", "--time", "1;rm"], "--time 1;rm: must be as Slurm has it"),
    ],
)
def test_what_cannot_be_a_job_is_refused(words, message, few_boulders, tmp_path, capsys):
    assert main(["slurm", str(few_boulders), str(tmp_path / "jobs"), *words]) == 2
    err = capsys.readouterr().err
    assert err.startswith(f"rockfall: {message}") and err.count("\n") == 1
    assert not (tmp_path / "jobs").exists()
