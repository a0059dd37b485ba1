# SPDX-License-Identifier: BSD-3-Clause
"""A share of benchmarks/foreign.py: foreign files are refused, or read to the numbers they hold."""

import subprocess
import sys
from pathlib import Path

import pytest

BENCHMARK = Path(__file__).parents[2] / "benchmarks" / "foreign.py"


def test_foreign_files_are_refused_or_read_to_the_numbers_they_hold():
    """In a process of its own: one that waits for a pipe is ended."""
    pytest.importorskip("pyogrio", reason="the vector extra is not installed")
    command = [sys.executable, str(BENCHMARK), "--files", "100", "--seed", "7"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    rows = [line.split("|")[1:-1] for line in done.stdout.splitlines() if line.startswith("| ")][2:]
    assert len(rows) == 4
    for _, accepted, refused, wrong in rows:  # the benchmark must make both
        assert int(accepted) > 25 and int(refused) > 25 and int(wrong) == 0
