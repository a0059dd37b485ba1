# SPDX-License-Identifier: BSD-3-Clause
"""The two commands that start the laboratory."""

import subprocess
import sys

import pytest


@pytest.mark.parametrize("module", [["rockfall", "lab"], ["rockfall_lab"]])
def test_both_commands_are_the_laboratory(module, tmp_path):
    words = [sys.executable, "-m", *module, "relief", "missing.tif"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 2 and not done.stdout
    assert done.stderr.startswith("rockfall: missing.tif: ") and done.stderr.count("\n") == 1
