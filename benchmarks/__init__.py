# SPDX-License-Identifier: BSD-3-Clause
"""Measured, not tested: `python -m benchmarks.speed.throughput` in the folder above."""

import sys
from pathlib import Path

# what tests share, and the reference: for benchmarks too
sys.path += [str(Path(__file__).parents[1] / folder) for folder in ("tests", "tests/reference")]
