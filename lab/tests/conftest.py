# SPDX-License-Identifier: BSD-3-Clause
"""Use one thread, and treat warnings as errors, as in the other tests."""

import os

from warning_filters import pytest_configure  # noqa: F401

# Read when rockfall is loaded.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OMP_WAIT_POLICY", "passive")
