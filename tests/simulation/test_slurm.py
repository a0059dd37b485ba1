# SPDX-License-Identifier: BSD-3-Clause
"""Job array run by hand: a loop over SLURM_ARRAY_TASK_ID, then the merge."""

import os
import stat
import subprocess
from pathlib import Path

import pytest

import rockfall
from programs import find_program
from rockfall.cli import main


@pytest.fixture
def commands(tmp_path):
    """Environment of a job: `sbatch` is on the PATH, the programs of rockfall are not."""
    folder = tmp_path / "bin"
    folder.mkdir()
    (folder / "sbatch").write_text('#!/bin/sh\necho "$@" >>jobs.txt\necho 4711\n')
    (folder / "sbatch").chmod(0o755)
    return {**os.environ, "PATH": f"{folder}:/usr/bin:/bin"}


@pytest.mark.all
@pytest.mark.parametrize("program", ["python", "batch"])
def test_the_array_run_by_hand_gives_the_run(
    program, few_boulders, commands, tmp_path, monkeypatch, capsys
):
    case = few_boulders.rename(few_boulders.with_name("part1of3.nml"))  # named like a part
    whole = rockfall.run(rockfall.read_case(case))
    if program == "batch":
        if not find_program():
            pytest.skip("rockfall-batch is not built")
        assert main(["prepare", str(case), str(tmp_path / "prepared")]) == 0
        case = tmp_path / "prepared" / "case.nml"
        monkeypatch.setenv("PATH", str(Path(find_program()).parent), prepend=":")
    jobs = tmp_path / "jobs"
    words = ["slurm", str(case), str(jobs), "--shards", "3", "--program", program]
    assert main([*words, "--threads", "2", "--time", "10:00"]) == 0
    script = (jobs / "run.sh").read_text()
    for line in ("--array=1-3", "--cpus-per-task=2", "--time=10:00"):
        assert f"#SBATCH {line}\n" in script
    assert " --resume " in script
    for path in jobs.iterdir():
        assert path.suffix == ".sh" and path.stat().st_mode & stat.S_IXUSR
        assert subprocess.run(["sh", "-n", path]).returncode == 0
    for k in range(1, 4):
        job = {**commands, "SLURM_ARRAY_TASK_ID": str(k), "SLURM_CPUS_PER_TASK": "1"}
        assert subprocess.run([jobs / "run.sh"], env=job, cwd="/").returncode == 0
    assert subprocess.run([jobs / "merge.sh"], env=commands, cwd="/").returncode == 0
    assert sorted(path.name for path in (jobs / "parts").iterdir()) == [
        f"part{k}of3" for k in (1, 2, 3)
    ]
    joined = rockfall.read_result(jobs / f"{case.stem}.nc")
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
        (["--shards", "1"], "--shards 1: must be 2 to 10000"),
        (["--shards", "51"], "--shards 51: must be at most 50, one boulder each"),
        (["--shards", "2", "--threads", "0"], "--threads 0: must be at least 1"),
        (["--shards", "2", "--program", "c"], "--program c: must be python or batch"),
        (
            ["--shards", "2", "--threads", "1025"],
            "{case}: &case threads = 1025: must be 0 to 1024",
        ),
        *(
            (["--shards", "2", f"--time={time}"], f"--time {time}: must be a Slurm time")
            for time in ("", "1;rm", "1:2:3:4", "1-", "١")
        ),
    ],
)
def test_what_cannot_be_a_job_is_refused(words, message, few_boulders, tmp_path, capsys):
    assert main(["slurm", str(few_boulders), str(tmp_path / "jobs"), *words]) == 2
    err = capsys.readouterr().err
    assert err.startswith(f"rockfall: {message.format(case=few_boulders)}") and err.count("\n") == 1
    assert not (tmp_path / "jobs").exists()


@pytest.mark.parametrize("time", ["90", "12:00:00", "2-12:30:15"])
def test_times_are_those_of_sbatch(time, few_boulders, tmp_path, capsys):
    assert (
        main(["slurm", str(few_boulders), str(tmp_path / "jobs"), "--shards=2", "--time", time])
        == 0
    )
    for name in ("run.sh", "merge.sh"):
        assert f"#SBATCH --time={time}\n" in (tmp_path / "jobs" / name).read_text()


@pytest.mark.parametrize(("shards", "warns"), [(1_000, False), (1_001, True), (10_000, True)])
def test_arrays_beyond_what_slurm_usually_takes_are_reported(
    shards, warns, few_boulders, tmp_path, capsys
):
    words = ["slurm", str(few_boulders), str(tmp_path / "jobs"), "--shards", str(shards)]
    few_boulders.write_text(few_boulders.read_text().replace("boulders = 50", "boulders = 10000"))
    assert main(words) == 0
    told = f"rockfall: warning: --shards {shards}: Slurm usually allows arrays of 1,000 jobs: "
    told += "`scontrol show config` lists MaxArraySize, which must be larger than --shards\n"
    assert capsys.readouterr().err == (told if warns else "")
    assert f"#SBATCH --array=1-{shards}\n" in (tmp_path / "jobs/run.sh").read_text()


def test_batch_runs_prepared_cases_only(few_boulders, tmp_path, batch, capsys):
    words = ["slurm", str(few_boulders), str(tmp_path / "jobs"), "--shards=2", "--program=batch"]
    assert main(words) == 2
    said = "scene.nc is missing next to it: create both with `rockfall prepare`"
    assert capsys.readouterr().err == f"rockfall: {few_boulders}: {said}\n"
    assert not (tmp_path / "jobs").exists()


def test_batch_that_is_not_there_is_said(few_boulders, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("PATH", str(tmp_path))
    words = ["slurm", str(few_boulders), str(tmp_path / "jobs"), "--shards=2", "--program=batch"]
    assert main(words) == 2
    assert capsys.readouterr().err == (
        "rockfall: --program batch: rockfall-batch is not on the PATH\n"
    )
    assert not (tmp_path / "jobs").exists()
