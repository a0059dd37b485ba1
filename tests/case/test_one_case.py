# SPDX-License-Identifier: BSD-3-Clause
"""The text of a case is parsed once by the kernel, and written once."""

import shutil
import sys
from pathlib import Path

import pytest
from rockfall._core import rockfall_f2py as _core

import rockfall
from rockfall.case.text import namelist_text
from rockfall.cli import main

SITE = Path(__file__).parents[2] / "cases/vaujany"


@pytest.fixture
def seen(monkeypatch):
    """Two lists of namelist texts: those passed to the kernel, and those written for cases."""
    taken, written = [], []

    class Watched:
        """Kernel whose procedures record the texts passed to them."""

        def __getattr__(self, name):
            return lambda *arguments, **named: self._call(getattr(_core, name), arguments, named)

        def _call(self, procedure, arguments, named):
            taken.extend(
                one.decode() for one in arguments if isinstance(one, bytes) and b"&" in one
            )
            return procedure(*arguments, **named)

    def writer(*groups, **how):
        written.append(namelist_text(*groups, **how))
        return written[-1]

    for name, module in [*sys.modules.items()]:
        if name.startswith("rockfall.") and getattr(module, "_core", None) is _core:
            monkeypatch.setattr(module, "_core", Watched())
    monkeypatch.setattr("rockfall.case.case.namelist_text", writer)
    return taken, written


def site(folder):
    """Path of a case that no other test has read, with a barrier and blocks that break."""
    path = shutil.copytree(SITE, folder / "site") / "case.nml"
    text = path.read_text().replace("boulders = 10000", "boulders = 2")
    path.write_text(
        f"{text}! {folder}\n&barrier name = 'net', height = 3, capacity = 1e3, "
        "x = 1.25, 198.75, y = 420, 420 /\n&breakage at = 'impact' /\n"
    )
    return path


def test_one_run_reads_its_case_once_and_writes_it_once(seen, tmp_path):
    path, (taken, written) = site(tmp_path), seen
    assert main(["run", str(path), "--threads", "1", "-o", str(tmp_path / "out.nc")]) == 0
    texts, cases = [text for text in taken if "&set" not in text], [*written]
    change = "&case\n    threads = 1\n/\n"  # from the option, which is read separately
    assert texts == [path.read_text(), change]
    assert cases == [change, rockfall.read_case(path).replace(case={"threads": 1}).text()]


def test_a_part_is_written_and_joined_with_its_case_read_once(seen, tmp_path):
    path, (taken, _) = site(tmp_path), seen
    case = rockfall.read_case(path).replace(case={"boulders": 20})
    parts = [rockfall.run(case, shard=(k, 2)) for k in (1, 2)]
    result = rockfall.merge(parts)
    assert rockfall.case.case_of(result) == case
    assert [text for text in taken if "&terrain" in text] == [path.read_text()]
