# SPDX-License-Identifier: BSD-3-Clause
"""Foreign files are refused, or read with correct values: a part of the benchmark."""

import subprocess
import sys

import pytest

from benchmarks.machine import ROOT


@pytest.mark.all
def test_foreign_files_are_refused_or_read_to_the_numbers_they_hold():
    """The benchmark is a process of its own, which can be ended if it waits for a pipe."""
    pytest.importorskip("pyogrio", reason="the vector extra is not installed")
    command = [sys.executable, "-m", "benchmarks.stability.foreign", "--files=100", "--seed=7"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    rows = [line.split("|")[1:-1] for line in done.stdout.splitlines() if line.startswith("| ")][2:]
    assert len(rows) == 4
    for _, accepted, refused, wrong in rows:  # the benchmark must produce both
        assert int(accepted) > 25 and int(refused) > 25 and int(wrong) == 0
