# SPDX-License-Identifier: BSD-3-Clause
"""Use one thread, as in the other tests; read when rockfall is loaded."""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OMP_WAIT_POLICY", "passive")
