# SPDX-License-Identifier: BSD-3-Clause
"""The programs that tests run, and how their runs are ended."""

import os
import shutil
import sys
import time
from pathlib import Path

from rockfall.simulation import simulate

ROOT = Path(__file__).parents[1]


def find_program():
    """The program of this build, or of this installation."""
    places = [ROOT / "build" / "fortran", Path(sys.executable).parent]
    beside = [place / "rockfall-batch" for place in places if (place / "rockfall-batch").is_file()]
    return shutil.which("rockfall-batch") or (str(beside[0]) if beside else None)


def wait_until_busy(pid):
    """Return when a process has spent a second of CPU: it has read its case and runs."""
    ticks = os.sysconf("SC_CLK_TCK")
    for _ in range(600):
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        if (int(fields[11]) + int(fields[12])) / ticks > 1.5:
            return
        time.sleep(0.05)
    raise TimeoutError("the program does not run")


class Killed(BaseException):
    pass


def killed_after(monkeypatch, chunks):
    """A run ends like one that is killed, after so many chunks."""
    calls = iter(range(chunks))
    fly = simulate._fly

    def until(*arguments):
        if next(calls, None) is None:
            raise Killed
        return fly(*arguments)

    monkeypatch.setattr(simulate, "_fly", until)
