# SPDX-License-Identifier: BSD-3-Clause
"""The study on docs/start/python.md prints the output shown on the page, and draws its figures."""

import re
import shutil
import subprocess
import sys

import pytest

from programs import ROOT

PAGE = (ROOT / "docs/start/python.md").read_text(encoding="utf-8")
STUDY = PAGE.partition("## A study of uncertain inputs")[2].partition("\n## ")[0]


def code(kind):
    return re.findall(rf"^```{kind}\n(.*?)^```$", STUDY, re.MULTILINE | re.DOTALL)


@pytest.mark.all
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_the_study_prints_what_the_page_says(tmp_path, monkeypatch, capsys):
    pytest.importorskip("matplotlib", reason="the report extra is not installed")
    monkeypatch.setenv("MPLBACKEND", "agg")
    slope = shutil.copytree(ROOT / "cases/protected-road", tmp_path / "cases/protected-road")
    subprocess.run([sys.executable, "make_terrain.py"], cwd=slope, check=True)
    monkeypatch.chdir(tmp_path)
    names = {}
    for block in code("python"):
        exec(compile(block, "docs/start/python.md", "exec"), names)
    (shown,) = code("text")
    said = capsys.readouterr().out
    assert said.split() == shown.split() and len(names["study"]) == 9
    assert (tmp_path / "study.png").stat().st_size > 10_000
    assert (tmp_path / "passing.png").stat().st_size > 10_000
    assert len(names["far"]) == 5 and names["far"].is_monotonic_decreasing
