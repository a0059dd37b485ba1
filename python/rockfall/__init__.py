# SPDX-License-Identifier: BSD-3-Clause
"""Where falling rocks go, how fast, how high and how often."""

from rockfall.analysis.ensemble import ensemble_table, run_ensemble
from rockfall.analysis.line_statistics import line_statistics
from rockfall.analysis.return_levels import return_levels
from rockfall.analysis.run_until import run_until
from rockfall.case import Case, read_case
from rockfall.errors import RockfallError
from rockfall.result.dataset import read_result, write_result
from rockfall.simulation.merge import merge
from rockfall.simulation.simulate import Interrupted, run
from rockfall.version import __version__

__all__ = [
    "__version__",
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
