# SPDX-License-Identifier: BSD-3-Clause
"""Files that pages mention exist."""

import re
import shutil
import subprocess

import pytest

from programs import ROOT

GIT = shutil.which("git")
LIST = [GIT or "", "ls-files"]
LISTED = subprocess.run(LIST, cwd=ROOT, capture_output=True, text=True).stdout if GIT else ""
FILES = {f"/{name}" for name in LISTED.split("\n")}
PAGES = [
    path
    for folder in ("docs", "lab/docs")
    for path in sorted((ROOT / folder).rglob("*.md"))
    if "archive" not in path.parts
]
WRITTEN = {"run.sh", "merge.sh", "submit.sh"}  # written by `rockfall slurm`


@pytest.mark.skipif(len(FILES) < 100, reason="no checkout of git")
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_files_on_a_page_are_there(page):
    """Pages give complete paths, or the last parts of a path."""
    named = set(re.findall(r"`([\w./-]+\.(?:py|f90|ts|sh))`", page.read_text(encoding="utf-8")))
    gone = [
        name for name in named - WRITTEN if not any(file.endswith(f"/{name}") for file in FILES)
    ]
    assert not gone
