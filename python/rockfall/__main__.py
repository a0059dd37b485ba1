# SPDX-License-Identifier: BSD-3-Clause
"""Entry point of `python -m rockfall`, the same as the command `rockfall`."""

import sys

from rockfall.cli import main

sys.exit(main())
