# SPDX-License-Identifier: BSD-3-Clause
"""Entry point of `python -m rockfall_lab`, the same as `rockfall lab`."""

import sys

from rockfall.cli import main

sys.exit(main(["lab", *sys.argv[1:]]))
