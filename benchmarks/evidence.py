# SPDX-License-Identifier: BSD-3-Clause
"""Rows of the table of evidence, python/rockfall/data/field_evidence.csv, recorded by scripts."""

import datetime
import shlex
import subprocess
import sys
from collections.abc import Iterable
from dataclasses import asdict
from math import nan
from pathlib import Path

import numpy as np
import pandas as pd

import rockfall
from benchmarks.machine import ROOT
from rockfall.evidence import TABLE, Evidence, table
from rockfall.io.tables import write_csv

DIGITS = 4  # significant digits of errors


def row(
    key: tuple[str, str, str, str], unit: str, observed: float, values: Iterable[float]
) -> Evidence:
    """Row for a site, place, quantity and model, from values of independent runs of this script, or
    from one published value without standard error."""
    values = np.asarray([*values], float)
    errors = values if np.isnan(observed) else 100 * (values / observed - 1)
    spread = errors.std(ddof=1) / np.sqrt(errors.size) if errors.size > 1 else nan
    return with_origin(key, unit, observed, errors.mean(), spread)


def with_origin(
    key: tuple[str, str, str, str], unit: str, observed: float, error: float, spread: float
) -> Evidence:
    """Row with an error, its standard error, today's date and the current command."""
    head = ["git", "rev-parse", "--short=8", "HEAD"]
    commit = subprocess.run(head, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    script = Path(sys.argv[0]).resolve().relative_to(ROOT)
    if script.parts[0] in ("benchmarks", "lab"):
        script = f"-m {'.'.join(script.with_suffix('').parts)}"
    words = shlex.join(word for word in sys.argv[1:] if word != "--write")
    today = datetime.datetime.now(datetime.UTC).date().isoformat()
    return Evidence(
        *key, unit, observed, _rounded(error), _rounded(spread), f"python {script} {words}".strip(),
        f"{rockfall.__version__}+{commit.strip()}", today,
    )  # fmt: skip


def record(rows: Iterable[Evidence]) -> None:
    """Write rows to the table, replacing rows of the same site, place, quantity and model."""
    known = {old.key: old for old in table()} | {new.key: new for new in rows}
    write_csv(pd.DataFrame([asdict(old) for old in known.values()]), TABLE)
    table.cache_clear()


def _rounded(number: float) -> float:
    return float(f"{number:.{DIGITS}g}")
