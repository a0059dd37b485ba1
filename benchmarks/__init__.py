# SPDX-License-Identifier: BSD-3-Clause
"""Measurements, not tests: run, for example, `python -m benchmarks.speed.throughput` in the parent
folder."""

import sys
from pathlib import Path

# benchmarks use helpers of the tests, and the reference
sys.path += [str(Path(__file__).parents[1] / folder) for folder in ("tests", "tests/reference")]
