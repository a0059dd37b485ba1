# SPDX-License-Identifier: BSD-3-Clause
"""Job array in a real Slurm with one node. Only run on request: `./run slurm-test`."""

import getpass
import os
import shutil
import signal
import socket
import subprocess
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

import pytest

import rockfall
from programs import find_program, same_results, wait_until_busy
from rockfall.cli import main

ROOT = Path(__file__).parents[2]
SHARDS = 4
BOULDERS = 400_000  # a job takes seconds, so it can be stopped meanwhile
CONFIGURATION = """\
ClusterName=test
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
SlurmUser={user}
SlurmdUser={user}
AuthInfo=socket={folder}/munge.socket,cred_expire=5
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
MpiDefault=none
SchedulerParameters=sched_interval=2
KillWait=30
MailProg=/bin/true
NodeName={host} NodeAddr=127.0.0.1 CPUs={cores}
PartitionName=all Nodes=ALL Default=YES State=UP
"""

if not os.environ.get("ROCKFALL_SLURM"):
    pytest.skip("ROCKFALL_SLURM is not set: see ./run slurm-test", allow_module_level=True)


@pytest.fixture(scope="module")
def slurm():
    """Run Slurm on this machine for this user, until the tests end."""
    folder = Path(tempfile.mkdtemp(prefix="slurm"))  # short path, because it contains a socket
    folder.chmod(0o755)
    for name in "state", "spool":
        (folder / name).mkdir()
    (folder / "munge.key").write_bytes(os.urandom(1024))
    (folder / "munge.key").chmod(0o600)
    (folder / "slurm.conf").write_text(
        CONFIGURATION.format(
            host=socket.gethostname().partition(".")[0], user=getpass.getuser(), folder=folder,
            cores=os.cpu_count(), ports=_free_ports(),
        )
    )  # fmt: skip
    places = {
        "key-file": "munge.key", "socket": "munge.socket", "pid-file": "munge.pid",
        "log-file": "munge.log", "seed-file": "munge.seed",
    }  # fmt: skip
    munge = ["munged", "--force", "--foreground"]
    daemons = [
        [*munge, *(f"--{option}={folder / name}" for option, name in places.items())],
        ["slurmctld", "-D"],
        ["slurmd", "-D"],
    ]
    with pytest.MonkeyPatch.context() as patch, ExitStack() as stack:
        patch.setenv("SLURM_CONF", str(folder / "slurm.conf"))
        patch.setenv("PATH", "/usr/sbin", prepend=":")
        log = stack.enter_context((folder / "log").open("w"))
        signs = [
            (folder / "munge.socket").exists,
            lambda: "UP" in _answer("scontrol", "ping"),
            lambda: "idle" in _answer("sinfo", "--noheader"),
        ]
        for daemon, is_up in zip(daemons, signs, strict=True):
            process = subprocess.Popen(daemon, stdout=log, stderr=log)
            stack.callback(process.wait)
            stack.callback(process.terminate)
            _wait(is_up, f"{daemon[0]} does not start")
        yield
        subprocess.run(["scancel", "--user", getpass.getuser()])
        _wait(lambda: not _said("squeue", "--noheader"), "jobs do not end")
    shutil.rmtree(folder)


@pytest.fixture(scope="module")
def case():
    """Case file in a folder of its own, and the result of its run as a single job."""
    folder, site = Path(tempfile.mkdtemp(prefix="jobs")), ROOT / "cases/vaujany"
    case = rockfall.read_case(site / "case.nml").replace(
        case={"boulders": BOULDERS},
        terrain={"dem": site / "dem.tif"},
        surface={key: site / f"zones.{end}" for key, end in (("zones", "tif"), ("table", "csv"))},
        output={"kept": "none", "trajectories": 0},
    )
    (folder / "case.nml").write_text(case.text())
    yield folder / "case.nml", rockfall.run(case)
    shutil.rmtree(folder)


@pytest.fixture(params=["python", "batch"])
def jobs(request, slurm, case, tmp_path, monkeypatch):
    """Folder of a submitted job array, the number of the array, and that of the merge job."""
    path = case[0]
    if request.param == "batch":
        if not find_program():
            pytest.skip("rockfall-batch is not built")
        monkeypatch.setenv("PATH", str(Path(find_program()).parent), prepend=":")
        path = tmp_path / "ready/case.nml"
        assert main(["prepare", str(case[0]), str(path.parent)]) == 0
    folder = tmp_path / "jobs"
    words = ["--shards", str(SHARDS), "--threads", "1", "--time", "20", "--program", request.param]
    assert main(["slurm", str(path), str(folder), *words]) == 0
    merge = _said(folder / "submit.sh").split()[-1]
    return folder, str(int(merge) - 1), merge


def test_a_job_that_is_requeued_goes_on_and_the_merge_waits_for_it(jobs, case):
    folder, array, merge = jobs
    wait_until_busy(_process(folder / "parts/part1of4"))
    _said("scontrol", "requeue", f"{array}_1")  # sends SIGTERM, and later again
    _wait(lambda: "Restarts=1" in _said("scontrol", "show", "job", f"{array}_1"), "not requeued")
    while True:  # the array last, because it may end between two queries
        waits, is_merged = _states(merge) == ["PENDING"], (folder / "case.nc").exists()
        if not {"RUNNING", "PENDING"} & {*_states(array)}:
            break
        assert waits and not is_merged
        time.sleep(0.5)
    log = (folder / "1.log").read_text()
    assert "continue with --resume" in log
    _wait(lambda: _states(merge) == ["COMPLETED"], "no merge")
    same_results(rockfall.read_result(folder / "case.nc"), case[1])


def test_a_job_that_is_killed_holds_the_merge_until_it_is_done_and_merged_by_hand(jobs, case):
    folder, array, merge = jobs
    process = _process(folder / "parts/part2of4")
    wait_until_busy(process)
    os.kill(process, signal.SIGKILL)
    _wait(lambda: {*_states(array)} == {"COMPLETED", "FAILED"}, "the array does not end")
    _wait(lambda: "NeverSatisfied" in _said("squeue", "--noheader"), "the merge does not wait")
    assert not (folder / "case.nc").exists()
    _said("scontrol", "requeue", f"{array}_2")
    _wait(lambda: {*_states(array)} == {"COMPLETED"}, "the job does not end")
    _said("scancel", merge)
    merge = _said("sbatch", "--parsable", folder / "merge.sh").strip()
    _wait(lambda: _states(merge) == ["COMPLETED"], "no merge")
    same_results(rockfall.read_result(folder / "case.nc"), case[1])


def _free_ports():
    with socket.socket() as one, socket.socket() as other:
        for each in one, other:
            each.bind(("127.0.0.1", 0))
        return one.getsockname()[1], other.getsockname()[1]


def _said(*words):
    done = subprocess.run([*map(str, words)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def _answer(*words):
    """Output of a command; empty until a daemon answers."""
    return subprocess.run(words, capture_output=True, text=True).stdout


def _states(job):
    words = _said("scontrol", "show", "job", job).split()
    return [one.removeprefix("JobState=") for one in words if one.startswith("JobState=")]


def _process(output):
    """Number of the process that writes an output; waits until there is one."""

    def find():
        for place in Path("/proc").glob("[0-9]*/cmdline"):
            try:
                words = place.read_bytes().split(b"\0")
            except OSError:
                continue
            if str(output).encode() in words:
                return int(place.parent.name)
        return None

    return _wait(find, f"nothing writes {output}")


def _wait(ready, message, seconds=3000):
    for _ in range(seconds * 5):
        if found := ready():
            return found
        time.sleep(0.2)
    raise TimeoutError(message)
