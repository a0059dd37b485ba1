# SPDX-License-Identifier: BSD-3-Clause
"""Make impact sets again from what their files say of their origin."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Iterator
from itertools import zip_longest
from pathlib import Path

from rockfall.lab.experiment import run_impacts
from rockfall.lab.fit import fit_impacts
from rockfall.lab.setfile import origin, provenance, write_sets


def remake(
    paths: Iterable[str | Path], threads: int = 0, progress: bool = False
) -> Iterator[tuple[Path, str]]:
    """Each set file, and the first line in which the one made again differs; "" if none does."""
    for path, (case, state) in {Path(path): origin(path) for path in paths}.items():
        data = run_impacts(case, progress=progress, threads=threads)
        with tempfile.TemporaryDirectory() as folder:
            again = Path(folder) / path.name
            write_sets(again, fit_impacts(data, state), provenance(data, state))
            yield path, _first_difference(path.read_text("utf-8"), again.read_text("utf-8"))


def _first_difference(old: str, new: str) -> str:
    lines = zip_longest(old.splitlines(), new.splitlines(), fillvalue="(end)")
    for number, (before, after) in enumerate(lines, 1):
        if before != after:
            return f"line {number}: {before!r} is now {after!r}"
    return ""
