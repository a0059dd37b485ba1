# SPDX-License-Identifier: BSD-3-Clause
"""Where falling rocks go, how fast, how high and how often."""

from importlib.metadata import PackageNotFoundError, version

from rockfall.case import Case, read_case
from rockfall.ensemble import ensemble_table, run_ensemble
from rockfall.errors import RockfallError
from rockfall.parts import merge
from rockfall.result import read_result, write_result
from rockfall.simulate import Interrupted, run
from rockfall.statistics import line_statistics
from rockfall.tails import return_levels
from rockfall.until import run_until

try:
    __version__ = version("rockfall")
except PackageNotFoundError:  # a source tree that is not installed
    __version__ = "unknown"

__all__ = [
    "Case",
    "Interrupted",
    "RockfallError",
    "ensemble_table",
    "line_statistics",
    "merge",
    "read_case",
    "read_result",
    "return_levels",
    "run",
    "run_ensemble",
    "run_until",
    "write_result",
]
