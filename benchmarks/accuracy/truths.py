# SPDX-License-Identifier: BSD-3-Clause
"""Options and file of a calibration with synthetic truths that can resume after interruption."""

import argparse
from collections.abc import Callable, Iterable
from pathlib import Path
from tempfile import TemporaryDirectory

import pandas as pd

from benchmarks.machine import machine


def parser_of(about: str, **numbers: int) -> argparse.ArgumentParser:
    """Parser of a calibration: the file of truths, and numeric options with their defaults."""
    parser = argparse.ArgumentParser(description=about.splitlines()[0])
    parser.add_argument("file", type=Path)
    for name, value in numbers.items():
        parser.add_argument(f"--{name}", type=int, default=value)
    return parser


def all_truths(
    file: Path, key: list[str], truths: Iterable[tuple], rows_of: Callable[..., pd.DataFrame]
) -> pd.DataFrame:
    """Rows of all truths; missing truths are computed and appended to the file. `key` has the
    columns that identify a truth."""
    print(machine())
    done = {*pd.read_csv(file)[key].itertuples(index=False, name=None)} if file.exists() else set()
    with TemporaryDirectory() as folder:
        for truth in truths:
            if truth not in done:
                rows = rows_of(Path(folder), *truth)
                rows.to_csv(file, mode="a", header=not file.exists(), index=False)
    return pd.read_csv(file)
